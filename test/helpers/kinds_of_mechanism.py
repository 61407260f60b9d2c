"""A small mechanism of every kind, and of every pair of kinds, for features."""

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations

from kane_dynamics import (absolute_rates, box, Closure, disc, Drive, FlexibleLink,
                           knife_edge, ModelBuilder, Prescribed, Robot, rod, Speeds,
                           StiffnessCurve, with_drives)
from kane_dynamics.mechanics.ball_joints import coordinate_rates, on_unit_quaternions
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.definition import nonholonomic
from kane_dynamics.model.model import Limits
import numpy as np

KINDS = ('tree', 'chosen speeds', 'closed loop', 'nonholonomic', 'time-dependent',
         'flexible', 'free and ball joints')
PAIRS = tuple(combinations(KINDS[1:], 2))
ELASTIC = 'elastic joints'  # of a tree
DRIVES = {'upper': Drive(800.0, damping=0.4, rotor_inertia=0.3,
                         friction={'damping': 0.5, 'friction': 0.2}),
          'fore': Drive(500.0, rotor_inertia=0.2)}
T = 0.4  # s, of states
JOINT = {'damping': 0.3, 'friction': 0.2, 'armature': 0.02, 'stiffness': 1.5,
         'rest': 0.1, 'limits': Limits(-6.0, 6.0, 20.0, 200.0)}
ARM = ('upper', 'fore')
LOOP = ('crank', 'coupler', 'rocker')


@dataclass(frozen=True, eq=False)
class Case:
    """A robot with a state that meets its constraints; `t` holds its time."""

    name: str
    robot: Robot
    q: np.ndarray
    u: np.ndarray
    udot: np.ndarray
    t: dict

    @property
    def time(self):
        """Return the time, s; 0 where nothing depends on it."""
        return self.t.get('t', 0.0)

    @cached_property
    def mechanism(self):
        """Return the speeds and constraints, also of a tree."""
        constrained = hasattr(self.robot.equations, 'mechanism')
        return self.robot.mechanism if constrained else Mechanism(self.robot.model)

    @cached_property
    def T(self):
        """Return the joint rates per unit of each speed, by the definition."""
        parts = nonholonomic.reduction(self.mechanism, self.q, self.time)
        free = self.mechanism.free
        return parts.W[:, free] + parts.W[
            :, nonholonomic.dependent_places(self.mechanism)] @ parts.A

    @cached_property
    def joint_motion(self):
        """Return q' and q'', of ball joints angular velocity and acceleration."""
        return nonholonomic.joint_motion(self.mechanism, self.q, self.u, self.udot,
                                         self.time)

    @cached_property
    def q_rate(self):
        """Return q', (n_q,)."""
        return coordinate_rates(self.robot.model, self.q, self.joint_motion[0])


def drive(t):
    """Return the position of a driven joint."""
    return 0.3 * np.sin(2.0 * t)


def rheonomic(model):
    """Return speeds that depend on configuration and time."""
    n = model.n
    return Speeds(lambda q, t: np.diag([2.0 + np.sin(x + t) for x in q[:n]]),
                  lambda q, t: np.array([np.cos(t) * x for x in q[:n]]))


def bar(b, name, on, at, length, beam, **joint):
    """Add a bar about a horizontal axis, rigid or a beam; return its end."""
    joint = {'axis': (0, -1, 0), 'at': at, **JOINT, **joint}
    if beam:
        b.beam(name, on,
               FlexibleLink(length, 2.0, 80.0, (1, 0), up=(0, 0, 1), damping=0.02),
               **joint)
        return f'{name}/tip', (0, 0, 0)
    b.body(name, on, inertial=rod(2.0 * length, (0, 0, 0), (length, 0, 0.1)), **joint)
    return name, (length, 0, 0)


def model_of(kinds):
    """Return the model of these kinds; a cart is nonholonomic, an arm no loop."""
    b = ModelBuilder('-'.join(kinds) or 'tree')
    on = 'world'
    beam = 'flexible' in kinds
    free = 'free and ball joints' in kinds
    if 'nonholonomic' in kinds:
        b.body('cart', kind='planar',
               inertial=box(5.0, (0.6, 0.4, 0.2), at=(0.1, 0, 0.2)))
        on = 'cart'
    elif free:
        b.body('craft', kind='free',
               inertial=box(8.0, (0.6, 0.4, 0.3), at=(0.05, 0.02, 0.01)))
        on = 'craft'
    elif 'closed loop' in kinds and 'time-dependent' in kinds:
        b.body('table', axis=(0, 0, 1), inertial=disc(20.0, 0.5), **JOINT)
        on = 'table'
    b.frame('base', on)
    if 'closed loop' in kinds:
        at = 'base', (0.0, 0.0, 0.0)
        for name, length in zip(LOOP, (0.3, 0.9, 0.7)):
            at = bar(b, name, *at, length, beam and name == 'coupler')
        b.frame('end', at[0], at=at[1])
        b.frame('ground', 'base', at=(1.0, 0, 0))
    else:
        at = bar(b, 'upper', 'base', (0, 0, 0.1), 0.5, beam, axis=(0.2, -1, 0))
        if free:
            b.body('hand', at[0], 'ball', at=at[1], rpy=(0.3, -0.2, 0.1),
                   inertial=box(1.5, (0.3, 0.1, 0.2), at=(0.15, 0.03, 0.02)))
            b.joint('hand/wy', damping=0.3, friction=0.2)
            at = 'hand', (0.3, 0, 0)
        else:
            at = bar(b, 'fore', *at, 0.4, False, axis=(0, -1, 0.4))
    b.frame('tool', at[0], at=(0.1, 0.05, 0.02))
    return b.model()


@cache
def case(*kinds):
    """Return the mechanism of one kind or of several."""
    kinds = tuple(kind for kind in kinds if kind != 'tree')
    model = model_of(kinds)
    choice = {}
    if ELASTIC in kinds:
        model = with_drives(model, DRIVES)
    constraints = []
    if 'chosen speeds' in kinds:
        choice['speeds'] = rheonomic if 'time-dependent' in kinds else absolute_rates
    elif 'time-dependent' in kinds:
        driven = {(True, True): 'craft/x', (True, False): 'table',
                  (False, True): 'upper', (False, False): 'fore'}
        joint = driven['closed loop' in kinds, 'free and ball joints' in kinds]
        constraints.append(Prescribed(joint, drive, name='drive'))
    if 'closed loop' in kinds:
        constraints.append(Closure('end', 'ground', 'revolute',
                                   axis=(0, 1, 0), name='pin'))
    if 'nonholonomic' in kinds:
        constraints.append(knife_edge('cart', (0, 1, 0), name='runner'))
    robot = Robot(model, constraints=constraints, wrench_frames=('tool',),
                  payload_frame='tool', **choice)
    q, u, udot = state(robot)
    time = {'t': T} if robot.equations.timed else {}
    return Case(' and '.join(kinds) or 'tree', robot, q, u, udot, time)


def state(robot, seed=0):
    """Return q, u and udot of moderate size, with constraints met; small deflections."""
    rng = np.random.default_rng(seed)
    guess = {'crank': 0.8, 'rocker': -1.5, 'upper': 0.4, 'fore': -0.7, 'cart/rz': 0.5,
             'cart/x': 0.2, 'craft/qw': 1.0, 'hand/qw': 1.0, 'upper_motor': 0.41,
             'fore_motor': -0.69}
    modes = [name for name in robot.coordinate_names if 'mode' in name]
    small = np.array([0.02 if name in modes else 1.0 for name in robot.coordinate_names])
    q = np.array([guess.get(name, 0.0) for name in robot.coordinate_names])
    q = q + 0.1 * small * rng.uniform(-1.0, 1.0, robot.n_q)
    q = on_unit_quaternions(robot.model, q)
    if robot.constraint_names:
        q = robot.closed_configuration(q, fixed=modes or None, t=T)
    scale = np.array([0.05 if 'mode' in name else 1.0 for name in robot.speed_names])
    return q, *(scale * rng.uniform(-1.0, 1.0, (2, robot.n)))


def torque_of(robot):
    """Return a torque of moderate size, other for each speed; modes have none."""
    return np.array([0.0 if 'mode' in name else 1.0 + k
                     for k, name in enumerate(robot.speed_names)])


DRIVE_FRICTION = {'damping': 0.4, 'friction': 0.5, 'friction_offset': 0.1}
ELASTIC_DRIVES = (
    Drive(200.0, damping=0.5, rotor_inertia=0.3, friction=DRIVE_FRICTION),
    Drive(StiffnessCurve([0.01, 0.03], [0.0, 10.0]), rotor_inertia=0.2,
          friction=DRIVE_FRICTION),
    Drive(150.0, ratio=-50.0, damping=0.4, rotor_inertia=1e-3, friction=DRIVE_FRICTION,
          full_coupling=True))
ELASTIC_JOINTS = ('upper', 'crank', 'fore', 'rocker', 'table')


def elastic_case(one):
    """Return a case's robot with drives in its joints, and a configuration."""
    joints = [joint for joint in ELASTIC_JOINTS if joint in one.robot.model.joint_names]
    model = with_drives(one.robot.model, dict(zip(joints, ELASTIC_DRIVES)))
    places = {name: k for k, name in enumerate(one.robot.coordinate_names)}
    rows = []
    for name in model.coordinate_names:
        rows.append(one.q[places[name]] if name in places
                    else one.q[places[name.removesuffix('_motor')]] + 0.015)
    q = np.array(rows)
    return Robot(model, **one.robot.options | {'configuration': q}), q
