"""Random mechanisms for tests: trees with every kind of joint that a Model can hold."""

from dataclasses import replace

from kane_dynamics import ModelBuilder, Robot, rod
from kane_dynamics.model.model import Body, Frame, Inertial, Joint, Limits, Model, WORLD
import numpy as np


def random_rotation(rng):
    """Return a rotation matrix, uniform; now and then quarter turns only."""
    if rng.random() < 0.3:
        order = rng.permutation(3)
        R = np.eye(3)[:, order] * rng.choice([-1.0, 1.0], 3)
        return R if np.linalg.det(R) > 0.0 else -R
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0.0 else -q


def random_inertial(rng):
    """Return the inertial of a cloud of points: always physical."""
    points = rng.normal(size=(6, 3)) * 0.2 + rng.normal(size=3) * 0.2
    masses = rng.uniform(0.1, 1.0, 6)
    com = masses @ points / masses.sum()
    r = points - com
    inertia = sum(m * (d @ d * np.eye(3) - np.outer(d, d)) for m, d in zip(masses, r))
    return Inertial(masses.sum(), com, inertia)


def random_model(seed, n=6, *, prismatic=0.25, branching=0.3, mimics=0, axes='any',
                 passive=True):
    """
    Return a random tree.

    Parameters
    ----------
    seed : int
        Of the random numbers.
    n : int
        Coordinates.
    prismatic, branching : float
        Share of prismatic joints, and of bodies that do not hang on the one before.
    mimics : int
        Bodies whose joint follows another's coordinate.
    axes : 'any' or 'principal'
        How joint axes lie.
    passive : bool
        Damping, friction, springs and armature at the joints.

    """
    rng = np.random.default_rng(seed)
    bodies = []
    names = []
    for i in range(n + mimics):
        follows = i > 0 and i >= n
        parent = i - 1
        if i and rng.random() < branching:
            parent = int(rng.integers(WORLD, i))
        if axes == 'principal' or rng.random() < 0.4:
            axis = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
        else:
            axis = rng.normal(size=3)
        limits = Limits(-rng.uniform(1, 3), rng.uniform(1, 3), rng.uniform(1, 5),
                        rng.uniform(10, 100))
        extra = {}
        if passive:
            extra = {'damping': rng.uniform(0, 1), 'friction': rng.uniform(0, 1),
                     'armature': rng.uniform(0, 0.1), 'stiffness': rng.uniform(0, 5),
                     'rest': rng.normal(),
                     # Numbers of its own: the others stay what they were without it.
                     'friction_offset': np.random.default_rng((seed, i)).normal()}
        name = f'joint{i}'
        if follows:
            coordinate = int(rng.integers(n))
            multiplier = rng.uniform(-2, 2)
            offset = rng.normal()
        else:
            coordinate = len(names)
            multiplier = 1.0
            offset = 0.0
            names.append(name)
        joint = Joint(
            name, 'prismatic' if rng.random() < prismatic else 'revolute', axis,
            random_rotation(rng), rng.normal(size=3) * 0.5 * rng.integers(0, 2, 3),
            coordinate, multiplier, offset, limits, **extra)
        bodies.append(Body(f'body{i}', parent, joint, random_inertial(rng)))
    frames = [Frame('base', WORLD, np.eye(3), np.zeros(3))]
    frames += [Frame(f'frame{i}', i, random_rotation(rng), rng.normal(size=3) * 0.3)
               for i in range(len(bodies))]
    return Model(f'random{seed}', tuple(bodies), tuple(names), tuple(frames),
                 rng.normal(size=3) * 5.0)


def wheel(**joint):
    """Return a wheel of 1 kg m^2."""
    b = ModelBuilder('wheel')
    b.body('wheel', inertial=rod(3.0, (-1, 0, 0), (1, 0, 0)), **joint)
    return Robot(b.model())


def random_state(model, seed, count=3):
    """Return `count` vectors of length n, and no small ones."""
    return np.random.default_rng(seed).uniform(-2.0, 2.0, (count, model.n))


def with_bodies(model, changed):
    """Return the model with each body replaced by `changed(body)`."""
    return replace(model, bodies=tuple(changed(body) for body in model.bodies))


def with_joints(model, **parameters):
    """Return the model with these parameters in every joint."""
    return with_bodies(
        model, lambda body: replace(body, joint=replace(body.joint, **parameters)))


def with_friction_times(factor, model):
    """Return the model with damping, friction and friction offsets times a factor."""
    def scaled(body):
        joint = body.joint
        return replace(body, joint=replace(
            joint, damping=factor * joint.damping, friction=factor * joint.friction,
            friction_offset=factor * joint.friction_offset))
    return with_bodies(model, scaled)


def with_inertials(model, changed):
    """Return the model with the inertial `changed(inertial)` in every body."""
    return with_bodies(
        model, lambda body: replace(body, inertial=changed(body.inertial)))


def with_inertia_in(model, kept):
    """Return a model whose bodies `kept` alone have inertia, joints no force."""
    free = {'stiffness': 0.0, 'damping': 0.0, 'friction': 0.0, 'friction_offset': 0.0,
            'armature': 0.0, 'drive': None}

    bodies = []
    for k, body in enumerate(with_joints(model, **free).bodies):
        if k not in kept:
            body = replace(body, inertial=Inertial(), beam=without_inertia(body.beam))
        bodies.append(body)
    return replace(model, bodies=tuple(bodies))


def without_inertia(beam):
    """Return the beam without inertia, stiffness and damping; None without a beam."""
    if beam is None:
        return None
    return replace(beam, weights=0.0 * beam.weights, spins=0.0 * beam.spins,
                   stiffness=0.0 * beam.stiffness, damping=0.0 * beam.damping)
