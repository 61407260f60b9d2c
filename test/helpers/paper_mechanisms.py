"""Sixty small mechanisms of all kinds, short enough for derivations on paper."""

from dataclasses import replace
from functools import cache
from itertools import product
import warnings

from kane_dynamics import (absolute_rates, body_angular_velocity, box, Closure, Coupling,
                           DependentSpeeds, disc, Drive, FlexibleLink, Inertial,
                           knife_edge, Model, ModelBuilder, momenta, point_mass,
                           PointVelocity, Prescribed, Robot, rod, Rolling, Speeds,
                           with_drives)
from kane_dynamics.closed_forms import derivation
from kane_dynamics.mechanics.ball_joints import on_unit_quaternions
import numpy as np

T = 0.7  # s: where choices that depend on time are evaluated
X, Y, Z = np.eye(3)
PASSIVE = {'damping': 0.3, 'friction': 0.2, 'armature': 0.02, 'stiffness': 1.5,
           'rest': 0.1}
# Derived by variations of vectors, too, and with the forces of all rows.
WITH_ENERGY = ('yy False', 'zyy False', 'zy True', 'Xy rheonomic', 'mimic', 'planar',
               'elastic joints', 'yy prescribed', 'zy speeds', 'slider-crank', 'sleigh',
               'disc')
WITH_ROWS = ('four-bar revolute', 'sleigh', 'point', 'disc')


def chain(axes, passive=False):
    """Return a chain of bars; an axis in upper case slides."""
    b = ModelBuilder(f'chain {axes}')
    on = 'world'
    for k, letter in enumerate(axes):
        kind = 'prismatic' if letter.isupper() else 'revolute'
        b.body(f'bar{k}', on, kind, axis=np.eye(3)['xyz'.index(letter.lower())],
               at=(0.4, 0, 0) if k else (0, 0, 0.1),
               inertial=Inertial(1.0 + k, (0.3, 0.0, 0.1), np.diag([0.1, 0.2, 0.3])),
               **(PASSIVE if passive else {}))
        on = f'bar{k}'
    b.frame('tip', on, at=(0.2, 0, 0.1))
    return b.model()


def rheonomic(model):
    """Return speeds that depend on configuration and time."""
    return Speeds(lambda q, t: np.diag([2.0 + np.sin(x + t) for x in q[:model.n]]),
                  lambda q, t: np.array([np.cos(t) * x for x in q[:model.n]]))


def mimicked():
    """Return two links; the second turns twice as far as the first."""
    first, second = chain('yy').bodies
    joint = replace(second.joint, coordinate=0, multiplier=2.0, offset=0.25)
    return Model('mimic', (first, replace(second, joint=joint)), ('bar0',))


def hinged(*lengths):
    """Return bars in one plane, the last with a frame at its end."""
    b = ModelBuilder('bars')
    on, at = 'world', (0, 0, 0)
    for k, length in enumerate(lengths):
        b.body(f'bar{k}', on, axis=Y, at=at,
               inertial=rod(2 * length, (0, 0, 0), length * X))
        on, at = f'bar{k}', length * X
    b.frame('end', on, at=at)
    b.frame('ground', 'world', at=X)
    return b


def slider_crank():
    """Return crank and rod; a slide follows the end of the rod."""
    b = hinged(0.3, 0.9)
    b.body('slide', 'world', 'prismatic', axis=X, inertial=point_mass(2))
    return b.model()


def single(kind, inertial, **options):
    """Return one body on a joint of several degrees of freedom."""
    b = ModelBuilder(f'body on {kind} joint')
    b.body('body', 'world', kind, inertial=inertial, **options)
    b.frame('point', 'body', at=(-0.4, 0.05, 0))
    return b.model()


def cart_with_pendulum():
    """Return a pendulum on a cart."""
    b = ModelBuilder('cart')
    b.body('cart', 'world', 'prismatic', axis=X, inertial=point_mass(2), damping=0.4)
    b.body('pole', 'cart', axis=Y, inertial=rod(1.5, (0, 0, 0), (0, 0, 0.8)))
    return b.model()


def beam():
    """Return a beam on a hub."""
    b = ModelBuilder('beam')
    link = FlexibleLink(1.0, 2.0, 80.0, (1, 0), up=(0, 0, 1), damping=0.02)
    b.beam('beam', 'world', link, axis=Z)
    return b.model()


def trees():
    """Yield trees in all choices of speeds."""
    axes = ('yy', 'zy', 'Xy', 'yZ', 'xy', 'yyy', 'zyy', 'zx')
    for letters, passive in product(axes, (False, True)):
        if len(letters) == 2 or not passive:
            yield f'{letters} {passive}', chain(letters, passive), {}
    for letters, speeds in product(('yy', 'zy', 'Xy', 'yyy'),
                                   (absolute_rates, rheonomic)):
        yield f'{letters} {speeds.__name__}', chain(letters), {'speeds': speeds}
    for letters in ('yy', 'Xy'):
        yield f'{letters} momenta', chain(letters), {'speeds': momenta}
    for letters in ('yy', 'zy'):
        yield f'{letters} wrench', chain(letters), {'wrench_frames': ('tip',)}
    yield 'mimic', mimicked(), {}
    yield 'elastic joints', with_drives(
        chain('yy'), {'bar0': Drive(800.0, damping=0.4, rotor_inertia=0.3)}), {}
    yield 'cart', cart_with_pendulum(), {}
    yield 'beam', beam(), {}
    top = disc(2, 0.3, Z, at=(0, 0, 0.4))
    yield 'top', single('spherical', top, turns='zxz'), {
        'speeds': body_angular_velocity('body'), 'configuration': [0.3, 1.2, 0.4]}
    yield 'ball joint', single('ball', top), {}
    yield 'free body', single('free', box(2, (0.3, 0.2, 0.1), at=(0.1, 0, 0.2))), {}
    yield 'planar', single('planar', box(3, (1, 0.4, 0.1), at=(0.3, 0.1, 0))), {}
    yield 'universal', single('universal', box(3, (1, 0.4, 0.1), at=(0.3, 0, 0))), {}


def constrained():
    """Yield mechanisms with constraints of all kinds."""
    for letters in ('yy', 'zy', 'Xy'):
        model = chain(letters)
        yield f'{letters} coupling', model, [Coupling('bar0', {'bar1': -2.0}, 0.1)]
        yield f'{letters} prescribed', model, [
            Prescribed('bar1', lambda t: 0.3 * np.sin(2 * t))]
        yield f'{letters} speeds', model, [DependentSpeeds(
            ['bar1'], lambda q, t: np.array([[np.sin(q[0]) + t]]),
            lambda q, t: np.array([t]))]
    model = chain('zyy')
    yield 'point', model, [PointVelocity('tip', Z)]
    yield 'point in time', model, [PointVelocity('tip', Z, value=lambda t: np.sin(t))]
    yield 'angular', model, [PointVelocity('tip', Z, angular=True, value=0.3)]
    yield 'axes', model, [PointVelocity('tip', X, axes='bar0')]
    for kind in ('revolute', 'spherical'):
        yield f'four-bar {kind}', hinged(0.3, 0.9, 0.7).model(), [
            Closure('end', 'ground', kind, axis=Y)]
    yield 'four-bar inline', hinged(0.3, 0.9, 0.7).model(), [
        Closure('end', 'ground', 'inline', axis=X)]
    yield 'distance', hinged(0.3, 0.9, 0.7).model(), [
        Closure('end', 'ground', 'distance', length=0.5)]
    yield 'slider-crank', slider_crank(), [Closure('end', 'slide', 'spherical')]
    sleigh = single('planar', box(3, (1, 0.4, 0.1), at=(0.3, 0.1, 0)))
    yield 'sleigh', sleigh, [knife_edge('point', Y)]
    yield 'sleigh angular', sleigh, [knife_edge('point', Y), PointVelocity(
        'point', Z, angular=True, value=0.2)]
    yield 'disc', single('floating', disc(2, 0.5, Y), turns='zxy'), [
        Rolling('body', 0.5, axis=Y)]
    yield 'ball', single('floating', disc(2, 0.5, Y), turns='zxy'), [
        Rolling('body', 0.5)]


@cache
def mechanisms():
    """Return names and robots; constrained ones also with chosen speeds where short."""
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')
        return _mechanisms()


@cache
def derived(name):
    """Return the derivation of one of `mechanisms`, once for all tests that read it."""
    robot = mechanisms()[name]
    rows = ()
    if name in WITH_ROWS:
        rows = [robot.mechanism.labels[k] for k in robot.mechanism.kept]
    return derivation(robot, auxiliary=rows, energy=name in WITH_ENERGY)


def _mechanisms():
    robots = {}
    for name, model, options in trees():
        robots[name] = Robot(model, **options)
    for name, model, constraints in constrained():
        start = {'configuration': [0.0, 0.0, 0.5, 0.2, 0.3, 0.1]} if name in (
            'disc', 'ball') else {}
        robots[name] = Robot(model, constraints=constraints, **start)
    four_bar = robots['four-bar revolute']
    for name, speeds in (('absolute', absolute_rates), ('rheonomic', rheonomic)):
        robots[f'four-bar {name}'] = Robot(four_bar.model, speeds=speeds,
                                           constraints=four_bar.options['constraints'])
    sleigh = robots['sleigh']
    robots['sleigh rheonomic'] = Robot(sleigh.model, speeds=rheonomic,
                                       constraints=sleigh.options['constraints'])
    return robots


def state(robot, seed=0):
    """Return q and u that meet the constraints, and the time, s."""
    rng = np.random.default_rng(seed)
    q = robot.neutral() if robot.configuration is None else np.array(robot.configuration)
    small = robot.constraint_names or robot.model.flexible
    q = q + (0.05 if small else 0.8) * rng.uniform(-1.0, 1.0, robot.n_q)
    q = on_unit_quaternions(robot.model, q)
    if robot.constraint_names:
        q = robot.closed_configuration(q, t=T)
    return q, rng.uniform(-1.0, 1.0, robot.n), T
