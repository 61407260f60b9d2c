"""
Round trip of the node beside empty echo nodes, in one shuffled run.

Three processes live together: the dynamics node with a seven-axis arm, an empty rclpy node that
answers each joint state with an array of the same size on rclpy's default executor, and the same
on the EventsExecutor. One driver visits them in shuffled order, one visit every 2 ms on average,
with a jittered period, so that every contender meets the same noise.

The gate: the median of the dynamics node is no worse than that of the echo on the default
executor.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import os
import random
import signal
import subprocess
import sys
import time

from kane_dynamics import load_urdf
from kane_dynamics.resources import resource_path
import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

URDF = resource_path('urdf', 'fr3.urdf')
JOINTS = [name for name in load_urdf(URDF).joint_names if 'finger' not in name]
OURS, DEFAULT, EVENTS = 'node', 'echo, default executor', 'echo, EventsExecutor'
NAMESPACES = {OURS: '/ours', DEFAULT: '/default', EVENTS: '/events'}
PERIOD = 2e-3  # s between visits, on average
PATIENCE = 20e-3  # s after which an answer counts as lost
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
GENERATOR = np.random.default_rng(0)
RELIABLE = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)


def echo(namespace: str, executor: str) -> None:
    """Be an empty node: one array out for each joint state in."""
    rclpy.init()
    node = Node('echo', namespace=namespace)
    publisher = node.create_publisher(Float64MultiArray, 'commands', RELIABLE)
    node.create_subscription(
        JointState, 'joint_states',
        lambda message: publisher.publish(Float64MultiArray(data=message.position)), BEST_EFFORT)
    spinner = EventsExecutor() if executor == EVENTS else SingleThreadedExecutor()
    spinner.add_node(node)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        spinner.spin_until_future_complete(Future(), 1e6)


@contextmanager
def contenders() -> Iterator[None]:
    """Run the three processes while the block runs."""
    node = [sys.executable, '-m', 'kane_dynamics.ros.main', '--ros-args',
            '-r', f'__ns:={NAMESPACES[OURS]}', '-p', f'urdf:={URDF}', '-p', 'state_timeout:=5.0',
            '-p', 'mode:=computed_torque', '-p', f'joints:=[{",".join(JOINTS)}]']
    commands = [node] + [[sys.executable, __file__, NAMESPACES[name], name]
                         for name in (DEFAULT, EVENTS)]
    running = [subprocess.Popen(command, stderr=subprocess.DEVNULL) for command in commands]
    try:
        yield
    finally:
        for process in running:
            process.send_signal(signal.SIGINT)
        for process in running:
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()


class Driver(Node):
    """Sends a joint state to one contender and waits for its answer."""

    def __init__(self) -> None:
        super().__init__('driver')
        self._answered = ''
        self._at = 0.0
        self._publishers_to = {}
        for name, namespace in NAMESPACES.items():
            self._publishers_to[name] = self.create_publisher(
                JointState, f'{namespace}/joint_states', BEST_EFFORT)
            self.create_subscription(Float64MultiArray, f'{namespace}/commands',
                                     lambda message, name=name: self._on_answer(name), RELIABLE)
        self._message = JointState(name=JOINTS)
        self._executor = EventsExecutor()
        self._executor.add_node(self)

    def _on_answer(self, name: str) -> None:
        self._at = time.perf_counter()
        self._answered = name

    def visit(self, name: str, patience: float = PATIENCE) -> float:
        """Return the seconds of one round trip; nan if there is no answer."""
        message = self._message
        message.position = GENERATOR.uniform(-1.0, 1.0, len(JOINTS)).tolist()
        message.velocity = GENERATOR.uniform(-1.0, 1.0, len(JOINTS)).tolist()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(time.time_ns(), 10**9)
        self._answered = ''
        began = time.perf_counter()
        self._publishers_to[name].publish(message)
        while self._answered != name:
            left = patience - (time.perf_counter() - began)
            if left <= 0.0:
                return float('nan')
            self._executor.spin_once(left)
        return self._at - began

    def pause(self, until: float) -> None:
        """Wait for a time of perf_counter; late answers are taken meanwhile."""
        while (left := until - time.perf_counter()) > 0.0:
            self._executor.spin_once(left)


def measure(samples: int) -> dict[str, np.ndarray]:
    """Return the round trips of each contender, s; rows belong together."""
    driver = Driver()
    deadline = time.monotonic() + 60.0
    for name in NAMESPACES:
        while np.isnan(driver.visit(name, 0.1)):
            if time.monotonic() > deadline:
                raise RuntimeError(f'{name} does not answer')
    trips: dict[str, list[float]] = {name: [] for name in NAMESPACES}
    order = list(NAMESPACES)
    chance = random.Random(0)
    for turn in range(samples + 200):
        chance.shuffle(order)
        for name in order:
            due = time.perf_counter() + PERIOD * chance.uniform(0.5, 1.5)
            trip = driver.visit(name)
            if turn >= 200:  # the first ones warm up
                trips[name].append(trip)
            driver.pause(due)
    driver.destroy_node()
    return {name: np.array(values) for name, values in trips.items()}


def main(samples: int = 2500) -> int:
    """Print the comparison; return 1 if the gate does not hold."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('ROS_DOMAIN_ID', str(random.SystemRandom().randint(1, 100)))
    rclpy.init()
    with contenders():
        trips = measure(samples)
    rclpy.shutdown()
    print(f'Round trip, joint state to torques, {len(JOINTS)} joints, {samples} visits each, one '
          'shuffled run')
    print('| | p50, us | p99, us | lost | over 2 ms |')
    print('|---|---|---|---|---|')
    for name, values in trips.items():
        p50, p99 = np.nanpercentile(values, [50, 99]) * 1e6
        print(f'| {name} | {p50:.0f} | {p99:.0f} | {np.isnan(values).sum()} '
              f'| {(values > PERIOD).sum()} |')
    ratios = {}
    for name in (DEFAULT, EVENTS):
        p50, p99 = (np.nanpercentile(trips[OURS], p) / np.nanpercentile(trips[name], p)
                    for p in (50, 99))
        ratios[name] = p50
        difference = np.nanmedian(trips[OURS] - trips[name]) * 1e6
        print(f'node / {name}: p50 {p50:.2f}, p99 {p99:.2f}; median of the paired differences '
              f'{difference:+.0f} us')
    if ratios[DEFAULT] > 1.0:
        print('FAILED: the node must not be slower than the empty echo on the default executor')
        return 1
    return 0


if __name__ == '__main__':
    if len(sys.argv) == 3:
        echo(*sys.argv[1:])
    else:
        sys.exit(main())
