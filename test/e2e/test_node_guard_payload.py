"""The payload that torque_guard holds: over DDS."""

import signal
import time

from kane_dynamics import Inertial, Robot
from kane_dynamics_interfaces.srv import SetPayload
from node_process import model, wait_until
import numpy as np


def test_the_guard_holds_the_payload_that_the_node_was_told(client, start):
    node = start(guard__enabled='true', payload__frame='c', mode='gravity_compensation')
    guard = start(module='kane_dynamics.ros.guard.main')
    client.connect()
    guard.wait_for('watching kane_dynamics')
    request = SetPayload.Request()
    request.payload.m = 1.5
    request.payload.com.z = 0.1
    assert client.call(SetPayload, 'set_payload', payload=request.payload).success
    q = np.array([0.3, -0.4, 0.2])
    robot = Robot(model(), payload_frame='c')
    robot.parameters.payload = Inertial(1.5, np.array([0.0, 0.0, 0.1]))
    expected = robot.gravity_force(q)

    def holds():
        client.send(q)
        time.sleep(0.005)
        return client.commands and np.abs(client.commands[-1] - expected).max() < 1e-9
    assert wait_until(holds), client.commands[-1:]
    node.end(signal.SIGKILL)
    client.commands.clear()
    assert wait_until(holds), guard.log
    guard.end()
    assert wait_until(lambda: not any(client.commands[-1])), 'zeros at the end'
