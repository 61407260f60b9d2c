"""Random trees and loops with chosen speeds and a constraint of each kind."""

from functools import cache

from kane_dynamics import ModelBuilder
from kane_dynamics.mechanics.constraints import (
    Closure, Coupling, DependentSpeeds, knife_edge, PointVelocity, Prescribed, Rolling)
from kane_dynamics.mechanics.constraints.independent_speeds import (choose_independent,
                                                                    closed_configuration)
from kane_dynamics.mechanics.constraints.speeds import absolute_rates, momenta, Speeds
from kane_dynamics.model.primitive_inertias import disc, rod
from mechanisms import random_model
import numpy as np

T = 0.7  # s: where rheonomic choices are looked at


def wavy(n, seed):
    """Return smooth speeds of everything, u = Y(q, t) q' + Z(q, t), regular here."""
    rng = np.random.default_rng(seed)
    constant, wave = rng.normal(size=(2, n, n)) * 0.2

    # Y is regular: 2 on its diagonal, all else small.
    regular = constant + 2.0 * np.eye(n)

    def Y(q, t):
        waves = np.array([np.sin(q[s] + 0.3 * t) for s in range(n)])
        return regular + wave * waves

    def Z(q, t):
        return np.array([np.cos(t) * q[r] for r in range(n)])
    return Speeds(Y, Z)


def tree_constraints(frame, base):
    """Return a constraint of each kind that any tree can meet anywhere."""
    return {
        'a point in the world': PointVelocity(frame, (1, 2, 3)),
        'a point in time': PointVelocity(frame, (1, 0, 1),
                                         value=lambda t: np.sin(2.0 * t)),
        'a point seen from a body': PointVelocity(frame, (0, 1, 1), axes=base,
                                                  relative_to=base),
        'an angular velocity': PointVelocity(frame, (0, 0, 1), angular=True, value=0.3),
        'a knife edge': knife_edge(frame, (0, 1, 0)),
        'a coupling': Coupling('joint0', {'joint1': -2.0}, 0.1),
        'a prescribed joint': Prescribed('joint1', lambda t: 0.3 * np.sin(2.0 * t)),
    }


KINDS = [*tree_constraints('', ''), 'speeds of others']


@cache
def tree(seed, kind, speeds):
    """Return a random tree with a constraint, and two of its frames."""
    model = random_model(seed, 5, branching=0.0, prismatic=0.2)
    frame = model.frames[-1].name
    base = model.frames[1].name
    chosen = {'rates': None, 'absolute': absolute_rates, 'momenta': momenta,
              'wavy': wavy(5, seed)}[speeds]
    if kind == 'speeds of others':
        names = choose_independent(model, chosen, ()).speed_names
        constraint = DependentSpeeds(names[3:], lambda q, t: np.array(
            [[np.sin(q[0]), 0.5, t], [0.2, np.cos(q[1]), 1.0]]),
                                     lambda q, t: np.array([t, q[2]]))
    else:
        constraint = tree_constraints(frame, base)[kind]
    return choose_independent(model, chosen, (constraint,))


def linkage_of_four_bars():
    """Return crank, coupler and rocker of a planar four-bar, cut at the last pin."""
    b = ModelBuilder('four_bar')
    b.body('crank', 'world', axis=(0, 1, 0), inertial=rod(1.0, (0, 0, 0), (1, 0, 0)))
    b.body('coupler', 'crank', axis=(0, 1, 0), at=(1, 0, 0),
           inertial=rod(2.0, (0, 0, 0), (3, 0, 0)))
    b.body('rocker', 'world', axis=(0, 1, 0), at=(3, 0, 0),
           inertial=rod(1.5, (0, 0, 0), (2.5, 0, 0)))
    b.frame('pin_coupler', 'coupler', at=(3, 0, 0))
    b.frame('pin_rocker', 'rocker', at=(2.5, 0, 0))
    return b.model()


def rolling_disc():
    """Return a thin disc that is free to move anywhere."""
    b = ModelBuilder('disc')
    b.body('disc', 'world', 'floating', turns='zxy',
           inertial=disc(1.0, 0.3, axis=(0, 1, 0)))
    return b.model()


def states(mechanism, seed):
    """Return q, u, udot of a mechanism that moves as it may."""
    rng = np.random.default_rng(seed)
    q = closed_configuration(mechanism, rng.uniform(-1.0, 1.0, mechanism.model.n), t=T)
    return q, *rng.uniform(-1.0, 1.0, (2, mechanism.n))


def two_bodies_on_a_base():
    """Return a floating base and two bodies on it, with frames turned and shifted."""
    b = ModelBuilder('pair')
    b.body('base', 'world', 'floating', inertial=disc(2.0, 0.3))
    b.body('one', 'base', 'spherical', at=(0.3, 0.1, 0),
           inertial=rod(1.0, (0, 0, 0), (0.4, 0.1, 0)))
    b.body('two', 'base', 'floating', at=(-0.2, 0.1, 0.3),
           inertial=rod(1.5, (0, 0, 0), (0.1, 0.5, 0)))
    b.load('one', disc(0.5, 0.2))
    b.load('two', disc(0.5, 0.2))
    b.frame('end', 'one', at=(0.4, 0.1, 0.2), rpy=(0.3, 0.2, 0.1))
    b.frame('socket', 'two', at=(0.1, -0.2, 0.2), rpy=(-0.3, 0.5, 0.1))
    return b.model()


CLOSURES = ('weld', 'revolute', 'prismatic', 'cylindrical', 'universal', 'spherical',
            'planar', 'inline', 'distance')
AXIS = np.array([0.2, 0.3, 0.9]) / np.sqrt(0.94)


def closure(kind, first='end', second='socket'):
    """Return a closure of a kind, about an axis that is no axis of a frame."""
    return Closure(first, second, kind, AXIS, length=0.5 if kind == 'distance' else None)


ROLLING = {
    f'{body} {side} {surface}'.replace('  ', ' '): (axis, surface, side == 'inside')
    for body, axis in (('ball', None), ('wheel', (0.1, 0.2, 0.97)))
    for surface in ('plane', 'cylinder', 'sphere')
    for side in (('on',) if surface == 'plane' else ('on', 'inside'))}


def rolling(kind):
    """Return rolling of `one`'s end on a surface of `two`'s socket; both move."""
    axis, surface, inside = ROLLING[kind]
    curved = {} if surface == 'plane' else {'surface_radius': 1.2 if inside else 0.8}
    return Rolling('end', 0.4, axis, (0.1, 0.2, 0.9), 0.1 if surface == 'plane' else 0.0,
                   'roll', 'socket', surface,
                   surface_axis=(0.2, 0.1, 1.0), inside=inside,
                   **curved)


# A tilted rim touches the inner side of a cylinder at two points: no residual tells it
# there.
ROLLING_TESTED = [kind for kind in ROLLING if kind != 'wheel inside cylinder']


@cache
def rolling_pair(kind):
    """Return the two bodies, one of which rolls on the other, found where they touch."""
    model = two_bodies_on_a_base()
    start = np.zeros(model.n)
    start[9:12] = (0.5, 0.3, -0.2) if 'inside' in kind else (1.2, 0.9, -0.8)
    free = choose_independent(model, None, (rolling(kind),), rank_tolerance=1e-9)
    return choose_independent(model, None, (rolling(kind),),
                              configuration=closed_configuration(free, start))
