"""
The demo's director: starts the arm and the node, moves the arm, and reports the results.

Three processes over Fast DDS: this one, the arm (`plant`, MuJoCo behind ROS topics) and
the dynamics node. The arm makes the same motion twice, first with its soft servo alone
(the node deactivated), then with the node's feedforward torques on top. Last it is let
go, and its fall is held against what the node's simulate service had predicted. In
other modes forces act on the arm, or one with elastic joints makes a fast motion.
"""

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Sequence
import json
import math
import os
from pathlib import Path
import random
import sys
import time
from typing import Any

from geometry_msgs.msg import Vector3, WrenchStamped
from kane_dynamics._util.progress import progress_bar
from kane_dynamics._util.whole_files import whole_file
from kane_dynamics.demo.children import Child, children, DemoError, stage, Waiting
from kane_dynamics.demo.deflection_report import DeflectionLog, report_deflections
from kane_dynamics.demo.demo_settings import (AFTER, DemoRobot, DURATION, ELASTIC_RATE,
                                              FAST, FORCES, MOTOR_KD, MOTOR_KP, NODE,
                                              PLANT, ROBOTS, STATE_TIMEOUT, STIFFNESS)
from kane_dynamics.demo.tracking_report import repeated_if_late, report, TrackingLog
from kane_dynamics.demo.vibration_report import report_vibration, VibrationLog
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.smooth_motion import SmoothMotion
from kane_dynamics_interfaces.srv import Simulate
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
import numpy as np
from rcl_interfaces.srv import SetParametersAtomically
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

LEAD = 0.3  # s between sending a motion and its start
SETTLING = 3.0  # s in which the arm comes to rest under its servo
FALL = 0.25  # s: later it meets joint limits, which a simulation only reports
FEEDFORWARD, CARTESIAN, ELASTIC = 'feedforward', 'cartesian', 'elastic'  # demo modes
DENSE = 200.0  # points of the fast motion, 1/s
SUPPLEMENT = 'drives.yaml'  # of the node in mode elastic
REST, PUSHED = 1.5, 1.5  # s without and with a force
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
        self._wrench = self.create_publisher(WrenchStamped, f'{PLANT}/wrench', 1)

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

    def displace(self, record: Path) -> DeflectionLog:
        """
        Apply forces to the arm, which the node alone holds; return the record.

        The servo holds the arm until then.
        """
        self.create_subscription(Clock, '/clock', self._on_clock, 1)
        self.ask(SetBool, f'{PLANT}/servo', data=False)
        duration = REST + len(FORCES) * (PUSHED + REST)
        began = self._simulated_time()
        # Rest, then each force for a while with a rest behind it.
        with progress_bar('Forces              ', duration) as progress:
            def wait(end: float) -> None:
                while (now := self._simulated_time() - began) < end:
                    progress(now)
            end = REST
            wait(end)
            for force in FORCES:
                self._apply(force)
                end += PUSHED
                wait(end)
                self._apply((0.0, 0.0, 0.0))
                end += REST
                wait(end)
        self.ask(Trigger, f'{PLANT}/save')
        return DeflectionLog.load(record)

    def move_fast(self, label: str, mode: str, motion: SmoothMotion,
                  record: Path) -> VibrationLog:
        """Move the arm from rest by the node in a mode; return the record."""
        if self.node_state() == State.PRIMARY_STATE_ACTIVE:
            self.change(Transition.TRANSITION_DEACTIVATE)
        self.ask(SetBool, f'{PLANT}/reset', data=True)  # brakes on
        chosen = Parameter('mode', value=mode).to_parameter_msg()
        answer = self.ask(SetParametersAtomically, f'{NODE}/set_parameters_atomically',
                          parameters=[chosen]).result
        if not answer.successful:
            raise DemoError(f'mode {mode}: {answer.reason}; expected success')
        self.change(Transition.TRANSITION_ACTIVATE)
        clock = self.create_subscription(Clock, '/clock', self._on_clock, 1)
        self._wait_for_steady_torques()
        self.ask(SetBool, f'{PLANT}/servo', data=False)  # brakes off
        began = self._simulated_time()
        end = began + LEAD + motion.duration
        self._to_node.publish(dense_message(motion, began + LEAD))
        duration = LEAD + motion.duration + AFTER
        with progress_bar(label, duration) as progress:
            while (now := self._simulated_time() - began) < duration:
                progress(now)
        self.destroy_subscription(clock)
        self.ask(Trigger, f'{PLANT}/save')
        return VibrationLog.load(record).since(end)

    def _wait_for_steady_torques(self) -> None:
        """Wait until the node holds the arm, whose torques rise at a limited rate."""
        received: list[Sequence[float]] = []

        def on_torques(message: JointState) -> None:
            received.append(message.effort)
        subscription = self.create_subscription(JointState, f'{NODE}/joint_torques',
                                                on_torques, 1)
        waiting = Waiting('steady torques of the node', self.children)
        # Steady: two messages with the same torques, one after the other.
        while len(received) < 2 or not np.allclose(received[-1], received[-2], atol=1e-9):
            del received[:-2]
            rclpy.spin_once(self, timeout_sec=LOOK)
            waiting.check()
        self.destroy_subscription(subscription)

    def _simulated_time(self) -> float:
        """Return a time of /clock, s, that is not older than this call."""
        self._clock = 0.0
        waiting = Waiting('/clock', self.children)
        while not self._clock:
            rclpy.spin_once(self, timeout_sec=LOOK)
            waiting.check()
        return self._clock

    def _on_clock(self, message: Clock) -> None:
        self._clock = message.clock.sec + 1e-9 * message.clock.nanosec

    def _apply(self, force: Sequence[float]) -> None:
        """Apply a force, N in world axes, to the arm until the next one."""
        message = WrenchStamped()
        message.wrench.force = Vector3(x=force[0], y=force[1], z=force[2])
        self._wrench.publish(message)


def dense_message(motion: SmoothMotion, start: float) -> JointTrajectory:
    """Return a motion as dense points, which begins at a time, s, as a message."""
    message = JointTrajectory(joint_names=list(motion.joint_names))
    stamp = message.header.stamp
    stamp.sec, stamp.nanosec = divmod(round(start * 1e9), 10**9)
    times = np.linspace(0.0, motion.duration, round(DENSE * motion.duration) + 1)
    sampled = motion.sample(times)
    for t, q, u, udot in zip(times, sampled.q, sampled.u, sampled.udot):
        point = JointTrajectoryPoint(positions=q.tolist(), velocities=u.tolist(),
                                     accelerations=udot.tolist())
        moment = point.time_from_start
        moment.sec, moment.nanosec = divmod(round(t * 1e9), 10**9)
        message.points.append(point)
    return message


def elastic_parameters(robot: DemoRobot, folder: Path) -> dict[str, str]:
    """Return the parameters of the node in mode elastic; the supplement is in the folder."""
    supplement = folder / SUPPLEMENT
    with whole_file(supplement) as stream:
        json.dump({'drives': robot.drives}, stream, indent=2)
    kp, kd = str(list(MOTOR_KP)), str(list(MOTOR_KD))
    return {'use_sim_time': 'true', 'supplement': str(supplement.resolve()),
            'mode': 'joint_impedance', 'modes': '[motor_side]',
            'drives.lead': str(0.5 / ELASTIC_RATE), 'drives.kp': kp, 'drives.kd': kd,
            'joint_impedance.stiffness': kp, 'joint_impedance.damping': kd}


def commands(name: str, record: Path, mode: str) -> dict[str, Sequence[str]]:
    """Return the commands of arm and node by name."""
    robot = ROBOTS[name]
    # The parameters of the node by mode.
    parameters = robot.parameters | {'mode': 'inverse_dynamics',
                                     'state_timeout': str(STATE_TIMEOUT)}
    if mode == CARTESIAN:
        parameters |= {'use_sim_time': 'true', 'mode': 'cartesian_impedance',
                       'cartesian.frame': robot.frame,
                       'cartesian.stiffness': str(list(STIFFNESS))}
    if mode == ELASTIC:
        parameters |= elastic_parameters(robot, record.parent)
    # In the other modes the simulated arm publishes the clock.
    plant = [sys.executable, '-u', '-m', 'kane_dynamics.demo.mujoco_plant', name,
             str(record)]
    if mode != FEEDFORWARD:
        plant.append('clock')
    if mode == ELASTIC:
        plant.append('elastic')
    node = [sys.executable, '-u', '-m', 'kane_dynamics.ros.dynamics_node.main',
            '--ros-args']
    for key, value in parameters.items():
        node += ['-p', f'{key}:={value}']
    return {'arm': plant, 'node': node}


def parsed(arguments: Sequence[str]) -> Namespace:
    """Return the options of the demo."""
    parser = ArgumentParser(prog='kane-dynamics demo', description=__doc__)
    parser.add_argument('--robot', choices=ROBOTS, default='fr3',
                        help='a seven-axis arm, or a palletizer with three closed loops '
                        '(default: '
                             '%(default)s)')
    parser.add_argument('--mode', choices=(FEEDFORWARD, CARTESIAN, ELASTIC),
                        default=FEEDFORWARD,
                        help='feedforward: a motion with and without the torques of the '
                        'node; cartesian: forces on an arm that the node holds in mode '
                        'cartesian_impedance; elastic: a fast motion of an arm with '
                        'elastic joints, with rigid and with elastic feedforward (default: '
                        '%(default)s)')
    parser.add_argument('--duration', type=_seconds, default=DURATION, metavar='S',
                        help='duration of the motion, at least 1 s (default: '
                        '%(default)s)')
    parser.add_argument('--output', type=Path, default=Path('demo_output'),
                        help='folder for the pictures (default: %(default)s)')
    options = parser.parse_args(list(arguments))
    # Not every robot of the demo has elastic joints.
    if options.mode == ELASTIC and not ROBOTS[options.robot].drives:
        able = [name for name, robot in ROBOTS.items() if robot.drives]
        parser.error(f'argument --robot: {options.robot} has no drives; expected '
                     f'{", ".join(able)} with --mode {ELASTIC}')
    return options


def _seconds(text: str) -> float:
    """Return a duration of at least 1 s."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 1.0 <= value <= 600.0:
        raise ArgumentTypeError(f'duration: {text}; expected 1 to 600 s')
    return value


def run_demo(arguments: Sequence[str] = ()) -> int:
    """Run the demo; return the exit code."""
    options = parsed(arguments)
    robot = ROBOTS[options.robot]
    motion = ROBOTS[options.robot].motion(options.duration)
    options.output.mkdir(parents=True, exist_ok=True)
    # The demo stays on this machine, in a domain of its own.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('ROS_DOMAIN_ID', str(random.SystemRandom().randint(1, 100)))
    record = (options.output / 'record.npz').resolve()
    print('Starting a simulated arm (MuJoCo), the dynamics node, and this director ...')
    rclpy.init()
    director = Director()
    try:
        with children(commands(options.robot, record, options.mode)) as running:
            director.children = running
            # First the arm, then the node, then the motions of the mode.
            with stage('Start of the arm'):  # no reset: the node may be active already
                director.ask(SetBool, f'{PLANT}/servo', data=True)
            with stage('Start of the node, which compiles its kernels'):
                director.wait_until_active()
            if options.mode == ELASTIC:
                vibrations = _fast_runs(director, robot, record)
            elif options.mode == CARTESIAN:
                with stage('Forces against the impedance of the node'):
                    displaced = director.displace(record)
            else:
                runs = _runs_of_motion(director, robot, motion, record)
    finally:
        director.destroy_node()
        rclpy.try_shutdown()
    # Files between the processes, which the user has no use for.
    for file in (record, record.parent / SUPPLEMENT):
        file.unlink(missing_ok=True)
    if options.mode == ELASTIC:
        return report_vibration(robot, vibrations, options.output)
    if options.mode == CARTESIAN:
        return report_deflections(robot, displaced, options.output)
    return report(robot, motion, *runs, options.output)


def _fast_runs(director: Director, robot: DemoRobot,
               record: Path) -> dict[str, VibrationLog]:
    """Return the records of the fast motion with rigid and with elastic feedforward."""
    motion = robot.fast_motion()
    runs = {}
    for label, mode in (('rigid feedforward', 'joint_impedance'),
                        ('elastic feedforward', 'motor_side')):
        with stage(f'Motion of {FAST:g} s, {label} (mode {mode})'):
            runs[label] = director.move_fast(f'{label:20}', mode, motion, record)
    return runs


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
