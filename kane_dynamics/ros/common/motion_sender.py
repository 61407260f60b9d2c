"""Send a motion to the dynamics node, and measure how well the arm follows it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import time
from typing import Any

from kane_dynamics._util.text import listing
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.ros.common.command_topic import commanders
from kane_dynamics.ros.common.conversion import nanoseconds
from kane_dynamics.ros.common.qos import EXAMINED_STATES
import numpy as np
from rcl_interfaces.msg import Log
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

WAIT = 120.0  # s, for joint states and torques: kernels of many joints take a while to compile
LEAD = 0.5  # s between sending a motion and its start
LATER_LEAD = 5.0  # s, for a node that compiled kernels while it checked the motion
# How the node's log begins when it rejects a motion, and when it joins one.
REJECTED = 'joint_trajectory rejected'
JOINED = 'joint_trajectory: began'
RATE = 50.0  # points of a trajectory per second
SETTLING = 0.2  # s after the end, in which the arm is still observed


@dataclass(frozen=True, eq=False)
class Tracking:
    """
    Tracking errors of an arm along a motion.

    Attributes
    ----------
    joint_names : tuple of str
    travel : (n,) array
        How far the motion moves each joint, rad or m.
    largest_error : (n,) array
        Largest difference between measured and desired position during the motion, rad
        or m.
    states : int
        Number of joint states that were compared.
    warnings : tuple of str
        What the node warned of meanwhile.
    commanders : tuple of str
        Nodes that command the arm at the end, without torque_guard.

    """

    joint_names: tuple[str, ...]
    travel: Array
    largest_error: Array
    states: int
    warnings: tuple[str, ...]
    commanders: tuple[str, ...] = ()


def send_motion(make: Callable[[Array], Motion], joint_names: tuple[str, ...], *,
                node_name: str = 'kane_dynamics', namespace: str = '',
                joint_states: str = 'joint_states') -> Tracking:
    """
    Send a motion to an active dynamics node, wait for its end and return the tracking errors.

    Parameters
    ----------
    make : callable
        Returns the motion for the measured positions (n,), rad or m.
    joint_names : tuple of str
        The joints of the motion.
    node_name, namespace : str
        Name of the dynamics node, and namespace of the arm.
    joint_states : str
        Topic of the joint states.

    Raises
    ------
    InputError
        No joint states, or no torques, within two minutes; the arm did not move.

    """
    # A context of its own, so that the caller's nodes are not touched.
    context = Context()
    rclpy.init(context=context)
    try:
        sender = _Sender(context, joint_names, node_name, namespace, joint_states)
        tracking = sender.run(make)
        return replace(tracking, commanders=tuple(commanders(sender.node, 'commands')))
    finally:
        rclpy.try_shutdown(context=context)


class _Sender:
    """A node that publishes one trajectory and collects joint states."""

    def __init__(self, context: Context, joint_names: tuple[str, ...], node_name: str,
                 namespace: str, joint_states: str) -> None:
        self._names = joint_names
        self._topic = joint_states
        self._node_name = node_name
        # The states and torques during the motion, and what the node logs meanwhile.
        self.node = Node('kane_dynamics_sender', namespace=namespace, context=context)
        self._states: list[tuple[int, Array]] = []
        self._torques = 0
        self._errors: list[str] = []  # that the dynamics node logged
        self._warnings: list[str] = []
        self.node.create_subscription(JointState, joint_states, self._take_state,
                                      EXAMINED_STATES)
        self.node.create_subscription(JointState, f'{node_name}/joint_torques',
                                      self._count_torques, EXAMINED_STATES)
        self.node.create_subscription(Log, '/rosout', self._take_log, EXAMINED_STATES)
        self._publisher = self.node.create_publisher(
            JointTrajectory, f'{node_name}/joint_trajectory', 1)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)

    def run(self, make: Callable[[Array], Motion]) -> Tracking:
        """Wait for the arm, send the motion, and compare the joint states with it."""
        self._spin(WAIT, lambda: bool(self._states) and self._is_commanding())
        # Where a clock is published, stamps are of that clock.
        if self.node.count_publishers('/clock'):
            self.node.set_parameters([Parameter('use_sim_time', value=True)])
            self._spin(WAIT, lambda: self._now() > 0)
        if not self._states:
            raise InputError(f"joint states: none on '{self._topic}' with {listing(self._names)} "
                             f'within {WAIT:g} s; expected those of a driver or of '
                             'plant_node')
        if not self._is_commanding():
            raise InputError(f"node '{self._node_name}': no torques and no trajectory "
                             f'topic within {WAIT:g} s; expected a dynamics node that '
                             'is active')
        motion, start = self._sent(make, LEAD)
        # The start was ahead of the message: a node that rejects the motion after it, or
        # follows it from a later time on, has checked it too late.
        rejected = any(error.startswith(REJECTED) for error in self._errors)
        joined = any(warning.startswith(JOINED) for warning in self._warnings)
        is_late = (rejected and self._now() > start) or (joined and not self._errors)
        if is_late and self._states:
            motion, start = self._sent(make, LATER_LEAD)
        return self._compared(motion, start)

    def _sent(self, make: Callable[[Array], Motion], lead: float) -> tuple[Motion, int]:
        """Send the motion from where the arm is, and wait; return it and its start, ns."""
        motion = make(self._states[-1][1])
        start = self._now() + round(1e9 * lead)
        self._states.clear()
        self._errors.clear()
        self._warnings.clear()
        self._publisher.publish(_trajectory(motion, start))
        end = start + round(1e9 * (motion.duration + SETTLING))
        self._spin(2.0 * WAIT + motion.duration, lambda: self._now() > end or bool(self._errors))
        return motion, start

    def _compared(self, motion: Motion, start: int) -> Tracking:
        """Return the largest differences of the joint states from the motion."""
        if self._errors:
            raise InputError(f"node '{self._node_name}': {self._errors[0]}")
        stamps = np.array([stamp for stamp, _ in self._states])
        during = (stamps >= start) & (stamps <= start + round(1e9 * motion.duration))
        if not during.any():
            raise InputError(f"joint states: none on '{self._topic}' during the motion; "
                             'expected stamps of the clock of this machine')
        measured = np.array([q for _, q in self._states])[during]
        desired, _, _ = motion.sample(1e-9 * (stamps[during] - start))
        # A joint state driver that shows no motion is no small error.
        travel = np.ptp(desired, axis=0)
        if (np.ptp(measured, axis=0) < 0.1 * travel).all():
            raise InputError('motion: the arm did not move; expected a motion that the '
                             'node accepts: its log has the reason')
        return Tracking(self._names, travel, np.abs(measured - desired).max(axis=0),
                        len(measured), tuple(dict.fromkeys(self._warnings)))

    def _take_state(self, message: Any) -> None:
        """Keep the positions of a joint state that has all joints."""
        places = {name: k for k, name in enumerate(message.name)}
        if set(self._names) <= set(places):
            positions = np.array([message.position[places[name]] for name in self._names])
            self._states.append((nanoseconds(message.header.stamp), positions))

    def _take_log(self, message: Any) -> None:
        """Keep the errors and warnings of the dynamics node."""
        if not message.name.endswith(self._node_name):
            return
        if message.level >= LoggingSeverity.ERROR:
            self._errors.append(message.msg)
        elif message.level >= LoggingSeverity.WARN:
            self._warnings.append(message.msg)

    def _count_torques(self, message: Any) -> None:
        self._torques += 1

    def _is_commanding(self) -> bool:
        """Return whether the node publishes torques and takes trajectories."""
        return self._torques > 0 and self._publisher.get_subscription_count() > 0

    def _now(self) -> int:
        return int(self.node.get_clock().now().nanoseconds)

    def _spin(self, seconds: float, enough: Callable[[], bool]) -> None:
        """Spin until `enough` returns True, or for some time."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not enough():
            self._executor.spin_once(timeout_sec=0.05)


def _trajectory(motion: Motion, start: int) -> JointTrajectory:
    """Return the message of a motion that starts at a time, ns."""
    # Dense points, so that the node's quintics are those of the motion.
    count = max(2, round(motion.duration * RATE) + 1)
    times = np.linspace(0.0, motion.duration, count)
    message = JointTrajectory(joint_names=list(motion.joint_names))
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(start, 10**9)
    for t, q, u, udot in zip(times, *motion.sample(times), strict=True):
        point = JointTrajectoryPoint(positions=q.tolist(), velocities=u.tolist(),
                                     accelerations=udot.tolist())
        since = divmod(round(1e9 * t), 10**9)
        point.time_from_start.sec, point.time_from_start.nanosec = since
        message.points.append(point)
    return message
