"""The modes of a law for an arm with closed loops, held and displaced at rest."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics.control.terms import Mode  # noqa: E402, I100
from kane_dynamics.ros.modes.task_modes import TaskModes  # noqa: E402
from kane_dynamics.ros.parameters.parameter_table import LAW_MODES  # noqa: E402
from kane_dynamics.ros.torque_path.path_controller import path_controller  # noqa: E402
from kane_dynamics.urdf import load_urdf  # noqa: E402
from node_values import node_values  # noqa: E402
from palletizer import DRIVEN, LOOPS, positions, URDF  # noqa: E402

START = (0.1, 0.3, 0.1, 0.2)
NEAR = (0.11, 0.29, 0.12, 0.21)
# The laws of ten joints in three loops take seconds to compile.
pytestmark = pytest.mark.slow


@pytest.fixture(scope='module')
def controller():
    values = node_values({'constraints': str(LOOPS), 'modes': list(map(str, LAW_MODES)),
                          'mode': 'joint_impedance',
                          'cartesian.frame': 'tool', 'joint_impedance.stiffness': 900.0,
                          'cartesian.posture_stiffness': 0.0, 'cartesian.max_force': 1e6,
                          'cartesian.max_moment': 1e6, 'walls.stiffness': 0.0})
    return path_controller(load_urdf(URDF), values,
                           lambda robot: TaskModes(robot, values).laws)


@pytest.mark.parametrize('mode', LAW_MODES)
def test_the_torques_at_rest_are_gravity_and_the_spring(controller, mode):
    robot = controller.robot
    start = positions(robot, *START)
    near = positions(robot, *NEAR)
    at_rest = np.zeros(robot.n)
    controller.update(mode=Mode.INVERSE_DYNAMICS)
    controller.update(mode=mode)
    held = controller.torque(start, at_rest, None, 0.0, t=1.0)
    gravity = robot.joint_torques(robot.gravity_force(start), start)
    np.testing.assert_allclose(held, gravity, rtol=1e-9, atol=1e-8)
    tau = controller.torque(near, at_rest, None, 0.0, t=1.001)
    spring = robot.generalized_force(tau, near) - robot.gravity_force(near)
    if mode is Mode.HAND_GUIDING:
        expected = at_rest
    elif mode is Mode.JOINT_IMPEDANCE:
        names = robot.joint_names
        stretch = {name: 900.0 * (start - near)[names.index(name)] for name in DRIVEN}
        expected = [stretch[name] for name in robot.speed_names]
    else:
        error = robot.frame_pose('tool', start)[:3, 3] - robot.frame_pose(
            'tool', near)[:3, 3]
        wrench = np.concatenate([600.0 * error, [0.0, 0.0, 30.0 * turn_error()]])
        expected = robot.jacobian('tool', near).T @ wrench
    np.testing.assert_allclose(spring, expected, rtol=1e-6, atol=1e-6)


def turn_error():
    """Return the angle about the vertical axis: the tool stays level."""
    swivel, _, _, turn = np.subtract(START, NEAR)
    return swivel + turn
