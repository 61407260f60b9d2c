"""Payload and gravity as a node starts with them, each test with a node of its own."""

import math
import time

from geometry_msgs.msg import Inertia
from kane_dynamics import Robot
from kane_dynamics_interfaces.srv import SetPayload
from node_process import BEST_EFFORT, model, wait_until
import numpy as np
import pytest
from sensor_msgs.msg import Imu

Q = [0.3, -0.4, 0.2]


def close(value, expected):
    return value is not None and np.abs(value - expected).max() <= 1e-9 * np.abs(
        expected).max()


def test_without_a_payload_frame_set_payload_is_refused(client, start):
    start()
    client.connect()
    answer = client.call(SetPayload, 'set_payload', payload=Inertia(m=1.0))
    assert not answer.success
    assert 'payload.frame' in answer.message


def test_an_imu_on_the_base_sets_the_direction_of_gravity(client, start):
    node = start(imu__topic='imu/data', state_timeout=1.0)
    client.connect()
    publisher = client.create_publisher(Imu, 'imu/data', BEST_EFFORT)
    robot = Robot(model())
    robot.parameters.gravity = [9.81 * math.sin(0.4), 0.0, -9.81 * math.cos(0.4)]
    expected = robot.gravity_force(np.array(Q))

    def measured(scale):
        message = Imu()
        message.header.frame_id = 'base'
        message.header.stamp = client.get_clock().now().to_msg()
        message.linear_acceleration.x = -scale * math.sin(0.4)
        message.linear_acceleration.z = scale * math.cos(0.4)
        publisher.publish(message)
        time.sleep(0.02)
        return client.ask(Q, np.zeros(3))

    level = Robot(model()).gravity_force(np.array(Q))

    # Not at rest; the first messages may come before the node is discovered.
    def ignored():
        torque = measured(15.0)
        if torque is None:  # the state was lost
            return False
        assert close(torque, level)
        return 'acceleration of the IMU: 15 m/s^2' in node.log
    assert wait_until(ignored, 60.0), node.log
    assert wait_until(lambda: close(measured(9.7), expected), 60.0), node.log
    answer = client.adjust(gravity=[0.0, 0.0, -9.0])
    assert not answer.successful
    assert 'imu.topic' in answer.reason
    client.destroy_publisher(publisher)


@pytest.mark.parametrize(('words', 'parameters'), [
    ("no frame 'claw'", {'payload__frame': 'claw'}),
    ("'payload.frame': 'base', a frame that does not move", {'payload__frame': 'base'}),
    ('mass: 60 kg', {'payload__frame': 'c', 'payload__mass': 60.0}),
    ('payload.frame is empty; expected a frame', {'payload__mass': 1.0}),
])
def test_invalid_loads_leave_the_node_unconfigured_with_the_reason(
        client, start, words, parameters):
    start(**parameters).wait_for(words)
    assert client.state() == 'unconfigured'
