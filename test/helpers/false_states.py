"""Arms in motion, and false joint states of them, each with its reason to drop."""

from functools import cache

from kane_dynamics import load_urdf, Motion, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.loop_tracking.loop_error import CONTRADICTION
from kane_dynamics.mechanics.constraints.loop_closure import closed_configuration
from kane_dynamics.ros.common.stamped_numbers import FUTURE, NOT_FINITE, OUT_OF_ORDER
from kane_dynamics.ros.parameters.parameter_checks import read
from kane_dynamics.ros.plant.plant_parameters import SPECS
from kane_dynamics.ros.plant.plant_state import PlantState
from kane_dynamics.ros.torque_path.drop_reasons import JUMP, OUTSIDE, STALE, TOO_FAST
import numpy as np
from palletizer import DRIVEN, palletizer, positions

NANO = 10**9
PERIOD = NANO // 500  # ns, between states
# States until the first false one, and in all.
FAULT = 80
SHORT = 160
LONG = 450
MOST = 2e-3  # rad
HOME = np.array([0.0, -0.7, 0.0, -2.2, 0.0, 1.6, 0.8])
POSE = (0.2, 0.3, -0.1, 0.5)


@cache
def arm(name):
    """Return a robot, its first configuration, and a motion of its joints."""
    if name == 'palletizer':
        robot = palletizer()
        return robot, positions(robot, *POSE), Motion.from_points(
            [0.0, 0.6, 1.2], [POSE, (0.3, 0.2, 0.0, 0.2), POSE], joint_names=DRIVEN)
    robot = Robot(load_urdf(resource_path('urdf', 'fr3.urdf'),
                            joints=[f'fr3_joint{k}' for k in range(1, 8)]))
    middle = HOME + [0.2, 0.1, -0.2, 0.2, 0.3, -0.2, 0.3]
    return robot, HOME, Motion.from_points([0.0, 0.6, 1.2], [HOME, middle, HOME],
                                           joint_names=robot.joint_names)


@cache
def other_mode():
    """Return the palletizer's passive joints in another assembly mode."""
    robot = palletizer()
    names = robot.joint_names
    start = positions(robot, *POSE)
    for name, angle in (('triangle_pin', -3.0), ('rod_1_pin', 0.5), ('wrist_pin', -3.0),
                        ('rod_2_pin', 3.0)):
        start[names.index(name)] += angle
    return closed_configuration(robot.mechanism, start, fixed=DRIVEN)


def simulated_arm(name):
    """Return the arm of `plant_node`, at its first configuration."""
    robot, start, _ = arm(name)
    values = {spec.name: read(spec, spec.default) for spec in SPECS} | {'substeps': 2}
    simulated = PlantState(robot.copy(), values).arm
    simulated.reset(start)
    return simulated


def changed(joint, by, velocity=0.0, age=0, names=None):
    """Return a function that makes a state false."""
    def change(q, u):
        q = q.copy()
        u = u.copy()
        k = names.index(joint) if isinstance(joint, str) else joint
        q[k] += by
        u[k] += velocity
        return q, u, age
    return change


PASSIVE = palletizer().joint_names
FALSE = {
    'fr3': {'jump': (JUMP, changed(1, 2.0)), 'small jump': (JUMP, changed(3, -0.05)),
            'velocity': (TOO_FAST, changed(2, 0.0, 500.0)),
            'far': (OUTSIDE, changed(0, 40.0)),
            'degrees': (OUTSIDE, lambda q, u: (np.degrees(q), np.degrees(u), 0)),
            'not finite': (NOT_FINITE, changed(1, np.nan)),
            'stale': (STALE, changed(1, 1.0, age=NANO)),
            'future': (FUTURE, changed(1, 1.0, age=-NANO)),
            'disordered': (OUT_OF_ORDER, changed(1, 1.0, age=NANO // 50))},
    'palletizer': {
        'jump': (JUMP, changed('shoulder', 2.0 - 0.9, names=PASSIVE)),
        'far': (OUTSIDE, changed('shoulder', 2.0, names=PASSIVE)),
        'contradiction': (CONTRADICTION, changed('elbow', 0.05, names=PASSIVE)),
        'another assembly mode': (CONTRADICTION, lambda q, u: (
            q + other_mode() - positions(palletizer(), *POSE), u, 0)),
        'not finite': (NOT_FINITE, changed('elbow', np.nan, names=PASSIVE)),
        'stale': (STALE, changed('shoulder', 1.0, age=NANO, names=PASSIVE)),
        'disordered': (OUT_OF_ORDER,
                       changed('shoulder', 1.0, age=NANO // 50, names=PASSIVE))}}
