"""
The messages that move the controlled frame: ~/target_pose, ~/target_twist, ~/target_wrench.

They are read in the thread of the torque path, as wrenches are: a message takes some tens
of microseconds there. In another thread it would take several times as long, and hold the
interpreter for it while a state waits.
"""

from collections.abc import Callable, Mapping
import math
from typing import Any

from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from kane_dynamics.control.terms import Mode
from kane_dynamics.errors import InputError, KaneError
from kane_dynamics.model.model import Frame, WORLD
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.common.stamped_numbers import (MALFORMED, NOT_FINITE,
                                                      read_stamped, StampedNumbers,
                                                      time_fault)
from kane_dynamics.ros.common.transform_tree import TransformTree
from kane_dynamics.ros.loads.wrench_input import approached, wrench_array
from kane_dynamics.ros.modes.cartesian_cycle import LONGEST_PERIOD
from kane_dynamics.ros.modes.cartesian_mode import CartesianMode
from kane_dynamics.ros.modes.cartesian_target import (CartesianTarget, largest_of,
                                                      pose_of_numbers)
from kane_dynamics.ros.modes.pose_functions import bound_call, displaced, displacement
from kane_dynamics.ros.modes.target_reach import REACHED, TargetReach
from kane_dynamics.ros.torque_path.torque_path import TorquePath
import numpy as np

POSE, TWIST, WRENCH = 'target_pose', 'target_twist', 'target_wrench'
INACTIVE, OTHER_MODE, NO_STATE = 'node not active', 'other mode', 'no joint state'
FRAME, STALE = 'unknown frame', 'stale'
TOO_FAR, OUT_OF_REACH, TOO_LARGE = 'too far', 'out of reach', 'too large'
QUATERNION = 0.01  # largest difference of the length of a quaternion from 1
TINY = 1e-300
WORLD_FRAME = 'world'  # name of the axes of the world where no frame has it


class TargetInput:
    """
    Checks target messages and passes them to the target of the controlled frame.

    Parameters
    ----------
    path : TorquePath
    target : CartesianTarget
    frame : str
        The controlled frame.
    values : mapping
        The node's parameters; target.* and limits of cartesian.* are used.
    reject : callable
        Called with the reason and the details of each refused message.
    transforms : TransformTree, optional
        Finds frames that the model lacks.

    """

    def __init__(self, path: TorquePath, target: CartesianTarget, frame: str,
                 values: Mapping[str, Any], reject: Callable[[str, str], None],
                 transforms: TransformTree | None = None) -> None:
        self._path = path
        self._target = target
        target.changed = path.law_changed
        self._frame = frame
        self._reject = reject
        robot = path.controller.robot
        self._fixed = fixed_frames(robot)
        self._transforms = transforms
        self._reach = TargetReach(robot, frame)
        self._workspace = robot.bind()
        self._measured_pose = self._workspace.at_frame('frame_pose', frame)
        # The pose of a message, and its displacement from the measured one.
        self._numbers = np.zeros(7)
        self._axes = np.eye(4)
        self._pose = np.eye(4)
        self._start = np.eye(4)
        self._difference = np.zeros(6)
        self._read_pose = bound_call(robot, pose_of_numbers, self._pose,
                                     numbers=self._numbers, frame=self._axes)
        self._compare = bound_call(robot, displacement, self._difference,
                                   start=self._start, goal=self._pose)
        # Where a target stops that leaves the pose of the message at its speed.
        self._advance = np.zeros(6)
        self._stop_at = np.eye(4)
        self._read_stop = bound_call(robot, displaced, self._stop_at, start=self._pose,
                                     step=self._advance)
        self._last_pose: Array | None = None  # the last one that was accepted
        # With fewer speeds a frame moves along curves: straight on is out of its reach.
        self._moves_freely = robot.n >= 6
        self.update(values)
        self.clear()

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next message on."""
        # Limits as arrays of six, as poses and twists have their entries.
        self._timeout = round(values['target.timeout'] * NANO)
        self._target.timeout = values['target.timeout']
        self._farthest = values['target.max_distance']
        self._widest = values['target.max_angle']
        self._fastest = np.repeat([values['target.max_speed'],
                                   values['target.max_angular_speed']], 3)
        self._accelerations = np.repeat([values['target.max_acceleration'],
                                         values['target.max_angular_acceleration']], 3)
        self._rise = values['wrench.rise_time'] * NANO
        self._strongest = np.repeat([values['cartesian.max_force'],
                                     values['cartesian.max_moment']], 3)

    def clear(self) -> None:
        """Accept stamps of any time, as at the start or after a jump of the clock."""
        self._last_now = 0
        self._pressed = np.zeros(6), False  # the last wrench, and whether it turns
        self._stamps = dict.fromkeys((POSE, TWIST, WRENCH), 0)
        self._last_pose = None
        self._reach.restart()

    def on_pose(self, data: bytes) -> None:
        """Go to the pose of a serialized PoseStamped, or refuse it with the reason."""
        message = self._accepted(POSE, data, PoseStamped, _pose_numbers)
        if message is None:
            return
        # Numbers first, then the frame, then what depends on the state of the arm.
        length = math.sqrt(float(message.numbers[3:] @ message.numbers[3:]))
        if not abs(length - 1.0) <= QUATERNION:
            self._refuse(POSE, NOT_FINITE, f'quaternion of length {length:.4g}; '
                         'expected 1')
            return
        try:
            frame = self._fixed_pose(message.frame)
        except InputError as error:
            self._refuse(POSE, FRAME, str(error))
            return
        q = self._path.measured()
        if q is None:
            self._refuse(POSE, NO_STATE, 'expected valid joint states before')
            return
        law = self._path.controller.laws[Mode.CARTESIAN_IMPEDANCE]
        if isinstance(law, CartesianMode) and law.begins:
            self._refuse(POSE, NO_STATE, 'expected one since the mode began, from where '
                         'the target moves')
            return
        self._numbers[:] = message.numbers
        self._axes[:] = frame
        self._read_pose()
        # The target stays if the pose is refused.
        reason = self._fault(q, message.stamp)
        if reason is not None:
            self._refuse(POSE, *reason)
            return
        self._stamps[POSE] = message.stamp
        self._last_pose = self._pose.copy()
        self._target.go_to(self._pose, self._path.now)

    def _fault(self, q: Array, stamp: int) -> tuple[str, str] | None:
        """Return reason and details for which the pose is refused; None if it is not."""
        # Far from where the arm is: another unit, another frame, or an old target.
        self._workspace.q[:] = q
        self._start[:] = self._measured_pose()
        self._compare()
        distance, angle = largest_of(self._difference)
        if distance > self._farthest or angle > self._widest:
            return TOO_FAR, (f'{distance:.4g} m and {angle:.4g} rad from the measured '
                             f"pose of '{self._frame}'; expected at most "
                             f'{self._farthest:g} m and {self._widest:g} rad')
        beyond = self._beyond_reach(self._pose, q, 'it')
        # A moving target stops beyond the pose, which must be within reach too.
        if beyond is None and self._moves_on(stamp):
            distance, angle = largest_of(self._advance)
            place = (f'the pose, {distance:.3g} m and {angle:.3g} rad further on, at '
                     'which the target stops from its speed')
            beyond = self._beyond_reach(self._stop_at, q, place)
        return None if beyond is None else (OUT_OF_REACH, beyond)

    def _beyond_reach(self, pose: Array, q: Array, place: str) -> str | None:
        """Return why the frame does not reach a pose; None if it does."""
        try:
            distance, angle = self._reach.remaining(pose, q)
        except KaneError as error:  # the loops are singular on the way
            return str(error)
        if max(distance, angle) <= REACHED:
            return None
        return (f"'{self._frame}' comes within {distance:.3g} m and {angle:.3g} rad of "
                f'{place}; expected a pose within the position limits of the joints, on '
                'the branch of the present configuration')

    def _moves_on(self, stamp: int) -> bool:
        """
        Return whether a stream of poses passes the pose; finds where it would stop.

        The target has bounded accelerations: without a further pose it would stop
        speed^2 / (2 acceleration) further on, where a stretched arm may come back on the
        other side of a singular configuration.
        """
        # A pose is part of a stream if the one before came a short time ago.
        elapsed = (stamp - self._stamps[POSE]) / NANO
        in_stream = self._last_pose is not None and 0.0 < elapsed <= LONGEST_PERIOD
        if not self._moves_freely or not in_stream:
            return False
        self._start[:] = self._last_pose
        self._compare()
        speeds = np.repeat(largest_of(self._difference), 3) / elapsed
        # The target is no faster than its limits, in the direction of the stream.
        share = np.minimum(1.0, self._fastest / np.maximum(speeds, TINY))
        twist = share * self._difference / elapsed
        # The distance in which the target would stop from this speed: v^2 / (2 a).
        self._advance[:] = share * speeds * twist / (2.0 * self._accelerations)
        if max(largest_of(self._advance)) <= REACHED:
            return False
        self._read_stop()
        return True

    def on_twist(self, data: bytes) -> None:
        """Move with a serialized TwistStamped, or refuse it with the reason."""
        message = self._accepted(TWIST, data, TwistStamped, _twist_numbers)
        if message is None:
            return
        # In world axes, and no faster than the limits.
        twist = self._in_axes(TWIST, message)
        if twist is None or not self._is_small(TWIST, message, self._fastest,
                                               'target.max_speed and '
                                               'target.max_angular_speed'):
            return
        if self._path.measured() is None:
            self._refuse(TWIST, NO_STATE, 'expected valid joint states before')
            return
        self._stamps[TWIST] = message.stamp
        self._target.move(*twist, self._path.now)

    def on_wrench(self, data: bytes) -> None:
        """Press with a serialized WrenchStamped, or refuse it with the reason."""
        message = self._accepted(WRENCH, data, WrenchStamped, wrench_array)
        if message is None:
            return
        wrench = self._in_axes(WRENCH, message)
        if wrench is None or not self._is_small(WRENCH, message, self._strongest,
                                                'cartesian.max_force and '
                                                'cartesian.max_moment'):
            return
        # As for ~/wrench: it begins at zero and grows with the time between messages.
        numbers, turns = wrench
        elapsed = message.stamp - self._stamps[WRENCH]
        previous, turned_before = self._pressed
        if elapsed > self._timeout or turns != turned_before:
            elapsed, previous = 0, np.zeros(6)
        if self._rise:
            change = self._strongest * elapsed / self._rise
            numbers = approached(previous, numbers, change)
        self._pressed = numbers, turns
        self._stamps[WRENCH] = message.stamp
        self._target.press(numbers, turns, self._path.now)

    def _accepted(self, topic: str, data: bytes, kind: Any,
                  numbers_of: Callable[[Any], Array]) -> StampedNumbers | None:
        """Return a message whose mode, numbers and stamp are valid, else None."""
        path = self._path
        # From the cheapest check to the dearest; each has its own reason.
        if not path.running:
            self._refuse(topic, INACTIVE, 'expected an active node')
            return None
        mode = path.controller.mode
        if mode is not Mode.CARTESIAN_IMPEDANCE:
            self._refuse(topic, OTHER_MODE,
                         f'{mode}; expected {Mode.CARTESIAN_IMPEDANCE}')
            return None
        try:
            message = read_stamped(data, kind, numbers_of)
        except InputError as error:
            self._refuse(topic, MALFORMED, str(error))
            return None
        if not np.isfinite(message.numbers).all():
            self._refuse(topic, NOT_FINITE, f'{message.numbers.tolist()}; expected '
                         'finite numbers')
            return None
        # Stamps: neither older than the timeout nor out of order.
        now = path.now
        if now < self._last_now:  # the clock jumped backward
            self.clear()
        self._last_now = now
        stamp = message.stamp or now
        fault = time_fault(stamp, now, self._stamps[topic], self._timeout, STALE)
        if fault is not None:
            self._refuse(topic, *fault)
            return None
        return message._replace(stamp=stamp)

    def _in_axes(self, topic: str, message: StampedNumbers) -> tuple[Array, bool] | None:
        """
        Return the numbers, and whether they are in the axes of the target, not the world's.

        None, and the message is refused, if its frame is unknown.
        """
        # Numbers in the controlled frame turn with the target.
        if message.frame == self._frame:
            return message.numbers, True
        try:
            frame = self._fixed_pose(message.frame)
        except InputError as error:
            self._refuse(topic, FRAME, f"{error}, or the controlled frame '{self._frame}'")
            return None
        halves = message.numbers.reshape(2, 3)
        return (halves @ frame[:3, :3].T).ravel(), False

    def _is_small(self, topic: str, message: StampedNumbers, most: Array,
                  limits: str) -> bool:
        """Return whether linear and angular part are within limits, else refuse."""
        linear, angular = largest_of(message.numbers)
        if linear <= most[0] and angular <= most[3]:
            return True
        self._refuse(topic, TOO_LARGE, f'{message.numbers.tolist()}; expected at most '
                     f'{most[0]:g} and {most[3]:g}, {limits}')
        return False

    def _fixed_pose(self, name: str) -> Array:
        """Return the pose (4, 4) of a frame that is fixed to the world, else InputError."""
        pose = self._fixed.get(name)
        if pose is not None:
            return pose
        # A frame that moves with the arm cannot hold a target.
        moves = name in self._path.controller.robot.frame_names
        if not moves and self._transforms is not None:
            frame = self._transforms.frame(name)
            moves = frame.body != WORLD
            if not moves:
                return _pose_of(frame)
        what = ', which moves' if moves else ''
        names = [fixed for fixed in self._fixed if fixed]
        raise InputError(f"frame_id '{name}'{what}; expected '' or {', '.join(names)}")

    def _refuse(self, topic: str, reason: str, detail: str) -> None:
        self._reject(f'{topic}: {reason}', detail)


def fixed_frames(robot: Robot) -> dict[str, Array]:
    """Return the poses (4, 4) of all frames that do not move, by name; '' is the world."""
    poses = {'': np.eye(4), WORLD_FRAME: np.eye(4)}
    for frame in robot.model.frames:
        if frame.body == WORLD:
            poses[frame.name] = _pose_of(frame)
    return poses


def _pose_of(frame: Frame) -> Array:
    """Return the pose (4, 4) of a frame on its body."""
    pose = np.eye(4)
    pose[:3, :3] = frame.rotation
    pose[:3, 3] = frame.translation
    return pose


def _pose_numbers(message: PoseStamped) -> Array:
    """Return position and quaternion of a message, (7,)."""
    p = message.pose.position
    r = message.pose.orientation
    return np.array([p.x, p.y, p.z, r.x, r.y, r.z, r.w])


def _twist_numbers(message: TwistStamped) -> Array:
    """Return the twist of a message, (6,): linear, then angular."""
    v = message.twist.linear
    w = message.twist.angular
    return np.array([v.x, v.y, v.z, w.x, w.y, w.z])
