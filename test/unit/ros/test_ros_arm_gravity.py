"""Promises for parameters that state which gravity and payload an arm compensates."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kane_dynamics import load_urdf, Robot  # noqa: E402, I100
from kane_dynamics._util.resources import resource_path  # noqa: E402
from kane_dynamics.model.inertial import Inertial  # noqa: E402
from kane_dynamics.ros.loads.gravity_payload import GravityAndPayload  # noqa: E402
from kane_dynamics.ros.parameters.arm_statement import payload_remark  # noqa: E402
from kane_dynamics.ros.torque_path.path_controller import (path_controller,  # noqa: E402
                                                           path_settings)
from kane_dynamics.ros.torque_path.torque_path import TorquePath  # noqa: E402
from native_rig import EPOCH, python_path, Side  # noqa: E402
from node_values import node_values  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64MultiArray  # noqa: E402

MODEL = load_urdf(resource_path('urdf', 'two_link.urdf'))
Q = np.array([0.4, -0.9])
LOAD = Inertial(1.5, np.array([0.0, 0.02, 0.1]), np.zeros((3, 3)))
TILTED = np.array([3.0, -2.0, -8.0])
STATED = {'arm_compensates': ['gravity'], 'mode': 'gravity_compensation',
          'payload.frame': 'tip', 'arm_payload': [1.5, 0.0, 0.02, 0.1],
          'limits.rate': np.inf, 'state_timeout': 10.0}


def weight(gravity, payload):
    """Return the torque of a model of its own, (2,)."""
    robot = Robot(MODEL, payload_frame='tip')
    robot.parameters.gravity = gravity
    robot.parameters.payload = payload
    return robot.gravity_force(Q)


@pytest.mark.parametrize('make', [python_path, TorquePath])
@pytest.mark.parametrize('arm_gravity', [None, [0.0, 0.0, -9.81]])
def test_an_arm_knows_each_new_gravity_unless_its_own_is_stated(make, arm_gravity):
    stated = STATED if arm_gravity is None else STATED | {'arm_gravity': arm_gravity}
    values = node_values(stated)
    now = [EPOCH]
    side = Side(make, path_controller(MODEL, values), values, lambda: now[0])
    path = side.path
    path.start()
    for gravity, payload in ((MODEL.gravity, None), (TILTED, None), (TILTED, LOAD)):
        # By a parameter, or by an IMU, which changes no parameter.
        for changed in (values, node_values(stated | {'gravity': gravity.tolist()})):
            path.controller.update(**path_settings(changed, path.controller.robot))
            path.set_loads(GravityAndPayload(gravity, payload))
            for _ in range(2):  # the first state is confirmed by the second one
                now[0] += 1_000_000
                message = JointState(name=list(MODEL.joint_names), position=Q.tolist(),
                                     velocity=[0.0, 0.0])
                stamp = message.header.stamp
                stamp.sec, stamp.nanosec = divmod(now[0], 10**9)
                path.on_state(serialize_message(message))
            command = deserialize_message(side.commands.sent[-1], Float64MultiArray).data
            own = weight(gravity if arm_gravity is None else np.array(arm_gravity), LOAD)
            expected = weight(gravity, payload) - own
            np.testing.assert_allclose(command, expected, atol=1e-9)


def test_the_answer_to_a_payload_says_when_the_arm_has_to_be_told_too():
    silent = {'arm_compensates': ['gravity'], 'payload.frame': 'tip'}
    assert 'payload in the arm as well' in payload_remark(node_values(silent))
    assert not payload_remark(node_values(STATED))
    assert not payload_remark(node_values({'arm_compensates': ['friction']}))
