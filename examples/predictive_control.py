"""
Predictive control of a simulated arm with friction, an FR3, at 500 Hz over ROS 2.

Starts `plant_node` and moves its arm between two configurations, with the torques of the
wrist at their limits. `--no-plant` leaves the plant to you: its `joint_states` and
`commands`.
"""

import argparse
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from kane_dynamics import load_urdf, Robot
from kane_dynamics.optimal_control import PredictiveController, TrajectoryOptimizer
import numpy as np
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

ROOT = Path(__file__).resolve().parents[1]
URDF = ROOT / 'urdf' / 'fr3.urdf'
FRICTION = ROOT / 'examples' / 'fr3_friction.yaml'
RATE = 500.0
START = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
TARGETS = (START + [1.0, 0.5, -0.5, 0.5, 0.5, 0.5, -0.8], START)
PAUSE = 1.5  # s between targets


class PredictiveNode(Node):
    """Commands a torque for each joint state, and moves through the targets."""

    def __init__(self, controller: PredictiveController) -> None:
        """Create publisher and subscription; the first state starts the motion."""
        super().__init__('predictive_control')
        self.controller = controller
        self.names = controller.optimizer.robot.joint_names
        self.targets = list(TARGETS)
        self.began = self.last = 0.0  # s, stamps of the first and of the last state
        self.took: list[float] = []  # s, of each cycle
        self.used: list[float] = []  # s of the processor
        self.error = np.inf  # of the last state, rad
        self.finished = False
        self._commands = self.create_publisher(Float64MultiArray, 'commands', 1)
        self.create_subscription(JointState, 'joint_states', self._update, QoSProfile(
            depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))

    def _update(self, message: JointState) -> None:
        """Publish the torque for a joint state."""
        woke = time.perf_counter()
        used = time.thread_time()
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        places = [message.name.index(name) for name in self.names]
        q = np.array(message.position)[places]
        u = np.array(message.velocity)[places]
        if not self.began:
            self.began = self.last = stamp
        reached = int((stamp - self.began) / PAUSE)
        self.finished = reached >= len(self.targets)
        if self.finished:
            return
        self.controller.set_target(self.targets[reached])
        elapsed = max(0.0, stamp - self.last)  # system time may be set back
        tau = self.controller.torque(q, u, elapsed)
        self._commands.publish(Float64MultiArray(data=tau.tolist()))
        self.last, self.error = stamp, float(np.abs(q - self.targets[reached]).max())
        self.took.append(time.perf_counter() - woke)
        self.used.append(time.thread_time() - used)


def plant(rate_factor: float) -> 'subprocess.Popen[bytes]':
    """Start the simulated arm, whose time may pass more slowly than real time."""
    parameters = {'rate_factor': rate_factor, 'publish_clock': rate_factor != 1.0,
                  'urdf': URDF, 'supplement': FRICTION, 'tip': 'fr3_link7', 'rate': RATE,
                  'substeps': 10, 'integrator': 'implicit',
                  'initial.position': START.tolist()}
    arguments = []
    for name, value in parameters.items():
        arguments += ['-p', f'{name}:={value}']
    return subprocess.Popen([sys.executable, '-m', 'kane_dynamics.ros.plant.main',
                             '--ros-args', *arguments], env=os.environ | {
        'PYTHONPATH': os.pathsep.join([str(ROOT), os.environ.get('PYTHONPATH', '')])})


def controller() -> PredictiveController:
    """Return the controller: half a second ahead, speeds up to 95 % of their limits."""
    robot = Robot(load_urdf(URDF, supplement=FRICTION, tip='fr3_link7'))
    optimizer = TrajectoryOptimizer(robot, nodes=50, interval=0.01,
                                    speed_limits=0.95 * robot.limits.velocity)
    built = PredictiveController(optimizer)
    built.set_target(TARGETS[0])
    # The long first cycle, before the arm moves.
    built.torque(START, np.zeros(robot.n), 0.0)
    return built


def main() -> None:
    """Run until the last target's time is over; print errors and times."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--no-plant', action='store_true',
                        help='do not start plant_node')
    parser.add_argument(
        '--rate-factor', type=float, default=1.0, metavar='X',
        help='simulated time in 1 s, at most 1 s: less on a busy machine')
    options = parser.parse_args()
    simulated = None if options.no_plant else plant(options.rate_factor)
    rclpy.init()
    node = PredictiveNode(controller())
    executor = EventsExecutor()
    executor.add_node(node)
    print('ready', flush=True)
    try:
        while not node.finished:
            executor.spin_once(0.1)
    finally:
        rclpy.try_shutdown()
        if simulated is not None:
            simulated.send_signal(signal.SIGINT)
            simulated.wait(10.0)
    p50, p99, largest = 1e3 * np.percentile(node.took, [50, 99, 100])
    print(
        f'{len(node.took)} cycles; error at the end {node.error:.4f} rad; a cycle takes '
        f'{p50:.2f} ms (median), {p99:.2f} ms (99 %), {largest:.2f} ms (longest); '
        f'{1e3 * np.median(node.used):.2f} ms of the processor')


if __name__ == '__main__':
    main()
