"""
Convert wrench messages to joint torques.

A geometry_msgs/WrenchStamped is the wrench that the environment exerts on the robot:
force and torque in the axes of the frame `header.frame_id`, with the force at its
origin. Many force-torque sensors report the opposite sign; negate their wrenches.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from geometry_msgs.msg import WrenchStamped
from kane_dynamics.errors import InputError
from kane_dynamics.model.model import Frame, Model, WORLD
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, NANO
from kane_dynamics.ros.common.stamped_numbers import (MALFORMED, NOT_FINITE,
                                                      read_stamped, time_fault)
from kane_dynamics.ros.common.transform_tree import TransformTree
from kane_dynamics.ros.parameters.parameter_checks import per_joint
import numpy as np

CONFIGURATIONS = 200  # in which the effort limits must hold the largest wrench
STALE, FRAME, TIMED_OUT, LARGE, SHARED = (
    'stale (older than wrench.timeout)', 'frame not in wrench.frames',
    'timed out after wrench.timeout', 'above wrench.max_force or wrench.max_moment',
    'two frames at one of wrench.frames')


def largest_wrench(robot: Robot, values: Mapping[str, Any]) -> Array:
    """
    Return the largest accepted force, N, and moment, N m, of ~/wrench, (2,).

    A parameter of 0 stands for what the effort limits hold at each declared frame, in the
    worst direction and `CONFIGURATIONS` random configurations: a joint whose torque by a
    unit force is at most c and whose effort limit is e holds the force e / c.

    Raises
    ------
    InputError
        The effort limits do not bound a wrench whose parameter is 0.

    """
    stated = np.array([values['wrench.max_force'], values['wrench.max_moment']])
    frames = [frame.name for frame in robot.equations.wrench_frames]
    if stated.all() or not frames:
        return stated
    joints = robot.joint_names
    effort = np.minimum(robot.limits.effort,
                        per_joint(values, 'limits.effort', joints, np.inf))
    q = robot.random_configuration(0, CONFIGURATIONS)
    held = np.full(2, np.inf)
    for row in range(len(frames)):
        # Torques of unit forces and moments along the axes: (6, configurations, n_q).
        torques = []
        for component in range(6):
            wrench = np.zeros((len(q), len(frames), 6))
            wrench[:, row, component] = 1.0
            torques.append(robot.joint_torques(robot.external_force(q, wrench=wrench), q))
        sizes = np.linalg.norm(np.reshape(torques, (2, 3, len(q), -1)), axis=1).max(axis=1)
        with np.errstate(divide='ignore'):
            held = np.minimum(held, np.min(effort / sizes, axis=1))
    for name, value, limit in zip(('max_force', 'max_moment'), stated, held):
        if not value and not np.isfinite(limit):
            raise InputError(f"parameter 'wrench.{name}': 0, and no effort limit bounds it; "
                             'expected a number, or limits.effort')
    return np.where(stated > 0.0, stated, held)


def approached(previous: Array, wrench: Array, change: Array) -> Array:
    """Return the wrench nearest to one, (6,), within a change, (6,), of the previous one."""
    return np.asarray(previous + np.clip(wrench - previous, -change, change))


def check_frames(model: Model, frames: Sequence[str],
                 parameter: str = 'wrench.frames') -> None:
    """Raise InputError unless each of `frames` exists and moves."""
    for name in frames:
        if model.frame(name).body == WORLD:
            expected = ', '.join(sorted(f.name for f in model.frames if f.body != WORLD))
            raise InputError(f"parameter '{parameter}': '{name}', a frame that does not "
                             f'move; expected frames of {expected}')


class WrenchFrames:
    """
    Transforms wrenches from the axes of their frames to world axes.

    Parameters
    ----------
    robot : Robot
        A robot of the calling thread.
    transforms : TransformTree, optional
        Places further frames on the bodies of the declared ones.

    """

    def __init__(self, robot: Robot, transforms: TransformTree | None = None) -> None:
        self._declared = robot.equations.wrench_frames
        self._transforms = transforms
        self.names = tuple(frame.name for frame in self._declared)
        self._workspace = robot.bind()
        self._poses = [self._workspace.at_frame('frame_pose', name)
                       for name in self.names]

    def row(self, name: str) -> int:
        """
        Return the row of a frame.

        Raise InputError for a frame not in wrench.frames.
        """
        if name not in self.names:
            expected = ', '.join(self.names)
            if not self.names:
                expected = 'no wrench: parameter wrench.frames is empty'
            raise InputError(f"frame_id: '{name}'; expected {expected}")
        return self.names.index(name)

    def placed(self, name: str, wrench: Array) -> tuple[int, Array]:
        """
        Return the row of a declared frame, and the wrench moved to that frame.

        Parameters
        ----------
        name : str
            The frame of the wrench: declared, or fixed to the body of one that is.
        wrench : (6,) array
            Force and moment at the origin and in the axes of the frame.

        Raises
        ------
        InputError
            The frame is unknown, or on a body without a declared frame.

        """
        # A frame on the body of a declared one: the wrench is moved there.
        if self._transforms is None or name in self.names:
            return self.row(name), wrench
        source = self._transforms.frame(name)
        for row, declared in enumerate(self._declared):
            if declared.body == source.body:
                return row, _moved_wrench(wrench, source, declared)
        raise InputError(f"frame_id: '{name}', on a body without a frame of wrench.frames; "
                         f'expected one on a body of {", ".join(self.names) or "none"}')

    def in_world(self, q: Array, wrenches: Iterable[tuple[int, Array]]) -> Array:
        """Return (k, 6) in world axes, from rows and wrenches in axes of the frames."""
        rows = np.zeros((len(self.names), 6))
        self._workspace.q[:] = q
        for row, wrench in wrenches:
            rotation = self._poses[row]()[:3, :3]
            rows[row] = (rotation @ wrench.reshape(2, 3).T).T.ravel()
        return rows


class WrenchInput:
    """
    Converts the latest wrench of each frame to joint torques.

    Messages and states are processed in the same thread. A frame whose latest message is
    stale is unloaded.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path.
    now : callable
        Returns the node's clock, ns.
    values : mapping
        The node's parameters; wrench.* are used.
    reject : callable
        Called with the reason and the details of each dropped message and each timeout.
    transforms : TransformTree, optional
        As of `WrenchFrames`.

    Attributes
    ----------
    latest : dict of int to (int, array)
        Stamp, ns, and wrench, (6,), of frames by their row, in the axes of the frame.
    timeout : int
        Age after which a wrench is stale, ns.
    changed : callable
        Called after each change of `latest` by a message.

    """

    def __init__(self, robot: Robot, now: Callable[[], int], values: Mapping[str, Any],
                 reject: Callable[[str, str], None],
                 transforms: TransformTree | None = None) -> None:
        self._frames = WrenchFrames(robot, transforms)
        self._robot = robot
        self._now = now
        self._reject = reject
        self.changed: Callable[[], object] = bool
        self.world = np.zeros((len(self._frames.names), 6))  # at the latest state
        self.update(values)
        self.clear()

    def update(self, values: Mapping[str, Any]) -> None:
        """Use checked parameters from the next message on."""
        self.timeout = round(values['wrench.timeout'] * NANO)
        self._most = np.repeat(largest_wrench(self._robot, values), 3)
        rise = values['wrench.rise_time'] * NANO
        self._rate = self._most / rise if rise else np.full(6, np.inf)  # per ns

    def clear(self) -> None:
        """Remove the wrenches of all frames, and reset the stamps."""
        self.latest: dict[int, tuple[int, Array]] = {}
        self._stamps = [0] * len(self._frames.names)
        self._sources = list(self._frames.names)  # frames of the latest messages
        self.world[:] = 0.0

    def on_message(self, data: bytes) -> None:
        """Store one serialized WrenchStamped, or reject it with the reason."""
        # Each check has its own reason, which is counted and warned of.
        now = self._now()
        try:
            stamp, frame, wrench = read_stamped(data, WrenchStamped, wrench_array)
        except InputError as error:
            self._reject(MALFORMED, str(error))
            return
        if not np.isfinite(wrench).all():
            self._reject(NOT_FINITE, f"at frame '{frame}': {wrench.tolist()}")
            return
        if (np.abs(wrench) > self._most).any():
            self._reject(LARGE, f"at frame '{frame}': {wrench.tolist()}")
            return
        try:
            row, wrench = self._frames.placed(frame, wrench)
        except InputError as error:
            self._reject(FRAME, str(error))
            return
        # A stamp of zero means that the sender has no clock.
        stamp = stamp or now
        fault = time_fault(stamp, now, self._stamps[row], self.timeout, STALE)
        if fault is not None:
            self._reject(fault[0], f"at frame '{frame}': {fault[1]}")
            return
        # A declared frame has the wrench of one frame at a time, which times out as a whole.
        other = self._sources[row]
        if other != frame and row in self.latest and (
                now - self.latest[row][0] <= self.timeout):
            self._reject(SHARED, f"'{frame}' while '{self._frames.names[row]}' has the wrench "
                         f"of '{other}'; expected one of them, or both in wrench.frames")
            return
        self._sources[row] = frame
        self._stamps[row] = stamp
        # A wrench begins at zero and grows with the time between messages, so that no
        # single message moves the arm.
        since, previous = self.latest.get(row, (stamp, np.zeros(6)))
        elapsed = stamp - since
        if elapsed > self.timeout:
            elapsed, previous = 0, np.zeros(6)
        if np.isfinite(self._rate).all():
            wrench = approached(previous, wrench, self._rate * elapsed)
        self.latest[row] = stamp, wrench
        self.changed()

    def torques(self, q: Array, now: int) -> Array | None:
        """
        Return the joint torques of the active wrenches, (n,) N m or N; None without any.

        Parameters
        ----------
        q : (n,) array
            Measured positions, which give the rotation of the frames.
        now : int
            The node's clock, ns.

        Raises
        ------
        InputError
            The torques are not finite.

        """
        if not self.latest:
            return None
        # Each frame times out by itself.
        for row, (stamp, _) in list(self.latest.items()):
            if now - stamp > self.timeout:
                del self.latest[row]
                self._reject(TIMED_OUT,
                             f"'{self._frames.names[row]}': unloaded until the next "
                             'wrench')
        self.world[:] = self._frames.in_world(
            q, ((row, wrench) for row, (_, wrench) in self.latest.items()))
        return self._robot.external_force(q, wrench=self.world) if self.latest else None


def _moved_wrench(wrench: Array, source: Frame, target: Frame) -> Array:
    """Return a wrench, (6,), at another frame of the same body, with the same effect."""
    rotation = target.rotation.T @ source.rotation
    arm = target.rotation.T @ (source.translation - target.translation)
    force, moment = rotation @ wrench[:3], rotation @ wrench[3:]
    return np.concatenate([force, moment + np.cross(arm, force)])


def wrench_array(message: WrenchStamped) -> Array:
    """Return the numbers of a message, (6,): force, then torque."""
    force = message.wrench.force
    torque = message.wrench.torque
    return np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])


def wrenches_of_request(frames: WrenchFrames, q: Array,
                        messages: Sequence[WrenchStamped]) -> Array | None:
    """
    Return the wrenches of a request, (k, 6) in world axes; None without any.

    Raise InputError if a frame is unknown or used twice, or a number is not finite.
    """
    # Each frame has one wrench; their sum would not say which the sender meant.
    wrenches: dict[int, Array] = {}
    for message in messages:
        wrench = wrench_array(message)
        if not np.isfinite(wrench).all():
            raise InputError(f"wrench at frame '{message.header.frame_id}': "
                             f'{wrench.tolist()}; expected finite numbers')
        row, wrench = frames.placed(message.header.frame_id, wrench)
        if row in wrenches:
            raise InputError(f"wrenches: two at frame '{frames.names[row]}'; expected one")
        wrenches[row] = wrench
    return frames.in_world(q, wrenches.items()) if wrenches else None
