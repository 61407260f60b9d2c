"""
The demo's director: starts the arm and the node, moves the arm, and reports the results.

Three processes over Fast DDS: this one, the arm (`plant`, MuJoCo behind ROS topics) and
the dynamics node. The arm makes the same motion twice, first with its soft servo alone
(the node deactivated), then with the node's feedforward torques on top. Last it is let
go, and its fall is held against what the node's simulate service had predicted.
"""

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence
import math
import os
from pathlib import Path
import random
import sys
import time
from typing import Any

from kane_dynamics._util.progress import progress_bar
from kane_dynamics.demo.children import Child, children, DemoError, stage, Waiting
from kane_dynamics.demo.demo_settings import (DemoRobot, DURATION, FR3, NODE, PLANT,
                                              STATE_TIMEOUT)
from kane_dynamics.demo.tracking_report import repeated_if_late, report, TrackingLog
from kane_dynamics.motion.motion import Motion
from kane_dynamics_interfaces.srv import Simulate
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

LEAD = 0.3  # s between sending a motion and its start
SETTLING = 3.0  # s in which the arm comes to rest under its servo
FALL = 0.25  # s: later it meets joint limits, which a simulation only reports
LOOK = 0.5  # s between two looks at who is waited for


class Director(Node):
    """Clients of the arm and of the dynamics node."""

    def __init__(self) -> None:
        super().__init__('director')
        # That are waited for as long as they make progress
        self.children: list[Child] = []
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._to_plant = self.create_publisher(JointTrajectory, 'desired', latched)
        self._to_node = self.create_publisher(JointTrajectory,
                                              f'{NODE}/joint_trajectory', 1)

    def ask(self, service: type[Any], name: str, **fields: Any) -> Any:
        """Call a service and return its answer."""
        client = self.create_client(service, name)
        waiting = Waiting(f"service '{name}'", self.children)
        try:
            while not client.wait_for_service(LOOK):
                waiting.check()
            future = client.call_async(service.Request(**fields))
            while not future.done():
                rclpy.spin_until_future_complete(self, future, timeout_sec=LOOK)
                waiting.check()
            return future.result()
        finally:
            self.destroy_client(client)

    def node_state(self) -> int:
        """Return the node's lifecycle state."""
        return int(self.ask(GetState, f'{NODE}/get_state').current_state.id)

    def wait_until_active(self) -> None:
        """Wait for the node's kernels and its activation."""
        waiting = Waiting('the node does not become active', self.children)
        while self.node_state() != State.PRIMARY_STATE_ACTIVE:
            waiting.check()
            time.sleep(0.1)

    def change(self, transition: int) -> None:
        """Request a lifecycle transition of the node."""
        answer = self.ask(ChangeState, f'{NODE}/change_state',
                          transition=Transition(id=transition))
        if not answer.success:
            raise DemoError(f'lifecycle transition {transition}: refused by the node; '
                            'expected success')

    def send(self, motion: Motion, feedforward: bool) -> None:
        """Send a motion to the arm, and optionally to the node, to start soon."""
        message = JointTrajectory(joint_names=list(motion.joint_names))
        # The start lies ahead, so that arm and node begin together.
        start = time.time_ns() + int(LEAD * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(start, 10**9)
        for t, positions in zip(motion.times, motion.positions):
            point = JointTrajectoryPoint(positions=positions.tolist())
            moment = point.time_from_start
            moment.sec, moment.nanosec = divmod(round(t * 1e9), 10**9)
            message.points.append(point)
        self._to_plant.publish(message)
        if feedforward:
            self._to_node.publish(message)

    def perform(self, label: str, motion: Motion, record: Path,
                feedforward: bool) -> TrackingLog:
        """Move the arm along a motion from rest; return its record."""
        if self.node_state() == State.PRIMARY_STATE_ACTIVE:
            self.change(Transition.TRANSITION_DEACTIVATE)  # forgets the motion before
        # The arm jumps home: the node must be inactive, since no real arm jumps.
        self.ask(SetBool, f'{PLANT}/reset', data=True)
        if feedforward:
            # States from before the jump that arrive late are stale by then; meanwhile
            # the arm sinks.
            time.sleep(STATE_TIMEOUT)
            self.change(Transition.TRANSITION_ACTIVATE)
        time.sleep(SETTLING)
        self.send(motion, feedforward)
        duration = motion.duration
        end = time.monotonic() + LEAD + duration
        with progress_bar(label, duration) as progress:
            while (left := end - time.monotonic()) > 0.0:
                time.sleep(min(left, 0.1))
                progress(duration - left)
        return self._recorded(record)

    def _recorded(self, record: Path) -> TrackingLog:
        answer = self.ask(Trigger, f'{PLANT}/save')
        if not answer.success:
            raise DemoError(f'the arm cannot save its record: {answer.message}')
        return TrackingLog.load(record)

    def predict_and_let_go(self, robot: DemoRobot,
                           record: Path) -> tuple[Any, TrackingLog]:
        """
        Predict the arm's fall from home, then let it fall.

        Return prediction and record.
        """
        self.change(Transition.TRANSITION_DEACTIVATE)
        # The node predicts the fall before the arm begins it.
        prediction = self.ask(
            Simulate, f'{NODE}/simulate', joint_names=list(robot.positions),
            position=list(robot.positions.values()), duration=FALL, step=5e-4,
            sample_period=2e-3)
        if not prediction.success:
            raise DemoError(f'{NODE}/simulate: {prediction.message}; expected success')
        self.ask(SetBool, f'{PLANT}/reset', data=False)
        time.sleep(FALL + 0.1)
        return prediction, self._recorded(record)


def commands(record: Path) -> dict[str, Sequence[str]]:
    """Return the commands of arm and node by name."""
    parameters = FR3.parameters | {'mode': 'inverse_dynamics', 'activation': 'at_once',
                                   'state_timeout': str(STATE_TIMEOUT)}
    node = [sys.executable, '-u', '-m', 'kane_dynamics.ros.dynamics_node.main',
            '--ros-args']
    for key, value in parameters.items():
        node += ['-p', f'{key}:={value}']
    return {'arm': [sys.executable, '-u', '-m', 'kane_dynamics.demo.mujoco_plant',
                    str(record)],
            'node': node}


def parsed(arguments: Sequence[str] | None) -> Namespace:
    """Return the options of the demo."""
    parser = ArgumentParser(prog='python -m kane_dynamics.demo', description=__doc__)
    parser.add_argument('--duration', type=_seconds, default=DURATION, metavar='S',
                        help='duration of the motion, at least 1 s (default: '
                        '%(default)s)')
    parser.add_argument('--output', type=Path, default=Path('demo_output'),
                        help='folder for the pictures (default: %(default)s)')
    return parser.parse_args(arguments)


def _seconds(text: str) -> float:
    """Return a duration of at least 1 s."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1.0 <= value <= 600.0:
        raise ArgumentTypeError(f'duration: {text}; expected 1 to 600 s')
    return value


def run_demo(arguments: Sequence[str] | None = None) -> int:
    """Run the demo; return the exit code."""
    options = parsed(arguments)
    motion = FR3.motion(options.duration)
    options.output.mkdir(parents=True, exist_ok=True)
    # The demo stays on this machine, in a domain of its own.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('ROS_DOMAIN_ID', str(random.SystemRandom().randint(1, 100)))
    record = (options.output / 'record.npz').resolve()
    print('Starting a simulated arm (MuJoCo), the dynamics node, and this director ...')
    rclpy.init()
    director = Director()
    try:
        with children(commands(record)) as running:
            director.children = running
            # First the arm, then the node, then the motions.
            with stage('Start of the arm'):  # no reset: the node may be active already
                director.ask(SetBool, f'{PLANT}/servo', data=True)
            with stage('Start of the node, which compiles its kernels'):
                director.wait_until_active()
            runs = _runs_of_motion(director, FR3, motion, record)
    finally:
        director.destroy_node()
        rclpy.try_shutdown()
    record.unlink(missing_ok=True)  # a file between the processes
    return report(FR3, motion, *runs, options.output)


def _runs_of_motion(director: Director, robot: DemoRobot, motion: Motion, record: Path
                    ) -> tuple[TrackingLog, TrackingLog, Any, TrackingLog]:
    """Return the records of the servo alone, with feedforward, and of the fall."""
    with stage(f'Motion of {motion.duration:g} s with the servo alone'):
        alone = director.perform('Servo alone         ', motion, record, False)
    with stage(f'Motion of {motion.duration:g} s with servo and feedforward'):
        helped = repeated_if_late(motion, alone, lambda: director.perform(
            'Servo + feedforward ', motion, record, True))
    with stage('Prediction of the fall, and the fall'):
        prediction, fall = director.predict_and_let_go(robot, record)
    return alone, helped, prediction, fall
