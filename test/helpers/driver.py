"""A process that publishes joint states at a fixed rate and counts those without torques."""

import json
import sys
import time

from graph import DEEP, NAME
import numpy as np
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

RATE = 500.0


def drive(joints, seconds):
    """Print the number of states, the number without torques, and the longest delay, s."""
    rclpy.init()
    node = rclpy.create_node('driver')
    answered = set()
    publisher = node.create_publisher(
        JointState, 'joint_states', QoSProfile(depth=1,
                                               reliability=ReliabilityPolicy.BEST_EFFORT))
    node.create_subscription(
        JointState, f'{NAME}/joint_torques',
        lambda m: answered.add(m.header.stamp.sec * 10**9 + m.header.stamp.nanosec), DEEP)
    executor = EventsExecutor()
    executor.add_node(node)
    message = JointState(name=joints, velocity=np.zeros(len(joints)).tolist())

    def send():
        stamp = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.position = (0.5 * np.sin(stamp * 1e-9 + np.arange(len(joints)))).tolist()
        publisher.publish(message)
        return stamp

    deadline = time.monotonic() + 20.0
    while not answered:
        assert time.monotonic() < deadline, 'the node publishes no torques'
        send()
        executor.spin_once(0.1)
    print('ready', flush=True)
    sent, held = [], 0.0
    due = time.perf_counter()
    for _ in range(round(seconds * RATE)):
        sent.append(send())
        now = time.perf_counter()
        held = max(held, now - due)  # delay of one state, or of the machine
        due = max(due + 1.0 / RATE, now)  # no bursts after a delay
        while (left := due - time.perf_counter()) > 0.0:
            executor.spin_once(left)
    end = time.perf_counter() + 0.5
    while time.perf_counter() < end:
        executor.spin_once(0.1)
    print(json.dumps({'sent': len(sent), 'unanswered': len(set(sent) - answered),
                      'held': held}), flush=True)
    rclpy.shutdown()


if __name__ == '__main__':
    drive(sys.argv[2].split(','), float(sys.argv[1]))
