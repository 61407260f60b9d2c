"""
A process that publishes joint states at a fixed rate and counts those without torques.

States are not judged near which the machine held up this process, or the threads of the
node that process states: they are lost whatever the node does. Linux counts the time in
which a thread could run and had no processor.
"""

import json
import os
from pathlib import Path
import sys
import time

from node_process import DEEP, NAME
import numpy as np
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

RATE = 500.0
QUEUED = 5  # states that wait for the node before the oldest is lost
# s of one thread in that time: several may wait one after the other
HELD = 0.25 * QUEUED / RATE


def waits_for_a_processor(pid):
    """Return a function of how long each thread of a torque path waited so far, s."""
    files = []
    for task in Path(f'/proc/{pid}/task').iterdir():
        if task.name == str(pid) or (task / 'comm').read_text().startswith('dds.'):
            files.append(os.open(task / 'schedstat', os.O_RDONLY))

    def waited():
        # schedstat: time on a processor, time in its queue, ns, and turns.
        numbers = [os.pread(file, 100, 0).split() for file in files]
        return np.array([1e-9 * int(queued) for _, queued, _ in numbers])
    return waited


def states_to_judge(held):
    """Return which states to judge, (K,), by waits of threads, (K, threads), s."""
    chosen = np.ones(len(held), dtype=bool)
    recent = np.max([np.convolve(thread, np.ones(QUEUED))[:len(held)]
                     for thread in held.T], axis=0)
    for k in np.flatnonzero(recent >= HELD):
        begin = k - QUEUED - int(np.ceil(recent[k] * RATE))  # it is known at its end
        chosen[max(begin, 0):k + 1 + QUEUED] = False
    return chosen


def drive(joints, seconds, pid):
    """Print how many states were sent and judged, and how many lack a torque."""
    rclpy.init()
    node = rclpy.create_node('driver')
    answered = set()
    publisher = node.create_publisher(
        JointState, 'joint_states',
        QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    node.create_subscription(
        JointState, f'{NAME}/joint_torques',
        lambda m: answered.add(m.header.stamp.sec * 10**9 + m.header.stamp.nanosec),
        DEEP)
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
    sent = []
    held = []
    waited = waits_for_a_processor(pid)
    due = time.perf_counter()
    waited_before = waited()
    for _ in range(round(seconds * RATE)):
        sent.append(send())
        now = time.perf_counter()
        waited_after = waited()
        held.append([now - due, *(waited_after - waited_before)])
        waited_before = waited_after
        due = max(due + 1.0 / RATE, now)  # no bursts after a delay
        while (left := due - time.perf_counter()) > 0.0:
            executor.spin_once(left)
    end = time.perf_counter() + 0.5
    while time.perf_counter() < end:
        executor.spin_once(0.1)
    chosen = np.array(sent)[states_to_judge(np.array(held))].tolist()
    print(json.dumps({'sent': len(sent), 'unanswered': len(set(sent) - answered),
                      'judged': len(chosen), 'lost': len(set(chosen) - answered)}),
          flush=True)
    rclpy.shutdown()


if __name__ == '__main__':
    drive(sys.argv[2].split(','), float(sys.argv[1]), int(sys.argv[3]))
