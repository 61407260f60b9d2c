"""Publish the state of the controlled frame, in the services' thread."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from kane_dynamics._util.typing import Flags
from kane_dynamics.control.controller import Controller
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import KaneError
from kane_dynamics.kinematics.poses import pose_error, rotation_quaternion
from kane_dynamics.ros.common.conversion import Array, as_wrench
from kane_dynamics.ros.common.service_errors import reported
from kane_dynamics.ros.modes.live_law import LiveLaw
from kane_dynamics.ros.modes.task_description import TaskSnapshot
from kane_dynamics.ros.torque_path.cycle_observer import ObservedCycle
from kane_dynamics_interfaces.msg import TaskState
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher


class _Moment(NamedTuple):
    """One cycle of a law."""

    sec: int
    nanosec: int
    q: Array
    u: Array
    mode: str
    law: LiveLaw
    snapshot: TaskSnapshot
    clamped: Flags
    rate_limited: Flags


class TaskStateTopic:
    """
    Publishes the state of the controlled frame in the modes that have a law.

    The torque path keeps one state when the timer asks for it; the timer computes all
    figures.

    Parameters
    ----------
    node : Node
    publisher : Publisher
        Publisher of TaskState.
    rate : float
        Rate of messages, 1/s.
    frame : str
        The controlled frame.
    controller : Controller
        The controller of the torque path.
    laws : mapping of Mode to LiveLaw
        Its laws.

    """

    def __init__(self, node: Node, publisher: Publisher, rate: float, frame: str,
                 controller: Controller, laws: Mapping[Mode, LiveLaw]) -> None:
        self._node = node
        self._publisher = publisher
        self._frame = frame
        self._controller = controller
        self._robot = controller.robot
        self._laws = laws
        self._latest: _Moment | None = None
        # A snapshot is taken only when the timer has asked for one.
        self._asked = True
        self._timer = node.create_timer(1.0 / rate,
                                        reported(self._publish, node.get_logger()),
                                        clock=Clock(clock_type=ClockType.STEADY_TIME))

    def start(self) -> None:
        """Drop the stored state."""
        self._latest = None
        self._asked = True

    stop = start

    def on_loads_changed(self) -> None:
        """Do nothing: the laws read gravity and payload at each call."""

    def on_cycle(self, cycle: ObservedCycle) -> None:
        """Keep a state, if one is asked for."""
        law = self._laws.get(self._controller.mode)
        if law is None or not self._asked:
            return
        self._asked = False
        state = cycle.state
        command = cycle.command
        self._latest = _Moment(state.sec, state.nanosec, state.q.copy(), state.u.copy(),
                               self._controller.mode, law, law.snapshot(cycle.stamp),
                               command.clamped, command.rate_limited)

    def close(self) -> None:
        """Stop publishing."""
        self._node.destroy_timer(self._timer)

    def _publish(self) -> None:
        latest = self._latest
        self._latest = None
        self._asked = True
        if latest is not None:
            try:
                self._publisher.publish(self._message(latest))
            except KaneError:  # the loops are singular there; the torque path reports it
                return

    def _message(self, latest: _Moment) -> TaskState:
        """Return the message of a state."""
        robot = self._robot
        # Without a target the frame is at its own.
        pose = robot.frame_pose(self._frame, latest.q)
        desired = pose if latest.snapshot.desired is None else latest.snapshot.desired
        error = pose_error(pose, desired)
        described = latest.law.describe(latest.q, latest.u, latest.snapshot)
        values = np.linalg.svd(robot.jacobian(self._frame, latest.q), compute_uv=False)
        # Six singular values, of which arms of fewer degrees of freedom lack some.
        values = np.pad(values, (0, 6 - len(values)))
        names = robot.joint_names
        saturated = list(described.saturated)
        for what, flags in (('effort', latest.clamped), ('rate', latest.rate_limited)):
            saturated += [f'{what} of {names[k]}' for k in np.flatnonzero(flags)]
        message = TaskState(
            mode=str(latest.mode), pose=_pose(pose), desired_pose=_pose(desired),
            position_error=_vector(error[:3]), orientation_error=_vector(error[3:]),
            wrench=as_wrench(described.wrench), manipulability=float(np.prod(values)),
            smallest_singular_value=float(values.min()),
            target_age=float(latest.snapshot.target_age), saturated=saturated)
        message.header.frame_id = self._frame
        message.header.stamp.sec = latest.sec
        message.header.stamp.nanosec = latest.nanosec
        return message


def _pose(pose: Array) -> Pose:
    """Return a pose (4, 4) as a message."""
    x, y, z = pose[:3, 3].tolist()
    rx, ry, rz, rw = rotation_quaternion(pose[:3, :3]).tolist()
    return Pose(position=Point(x=x, y=y, z=z),
                orientation=Quaternion(x=rx, y=ry, z=rz, w=rw))


def _vector(values: Any) -> Vector3:
    """Return three numbers as a message."""
    x, y, z = map(float, values)
    return Vector3(x=x, y=y, z=z)
