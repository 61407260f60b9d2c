"""Convert messages to arrays and back: reorder joints, check lengths and finiteness."""

from array import array
from collections.abc import Mapping, Sequence
from typing import Any

from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Vector3, Wrench
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.robot.robot import Robot
from kane_dynamics.simulation.trajectory import Trajectory
import numpy as np
from numpy.typing import ArrayLike, NDArray
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

Array = NDArray[np.float64]
Index = NDArray[np.intp]
NANO = 1_000_000_000


class JointNamesError(InputError):
    """The joints of a trajectory are not those of the robot."""


def read_message(data: bytes, kind: Any) -> Any:
    """Return a message of a type from its bytes; InputError if they are malformed."""
    try:
        return deserialize_message(data, kind)
    # RMWError is a RuntimeError
    except (RuntimeError, MemoryError, ValueError) as error:
        raise InputError(f'{kind.__name__} of {len(data)} bytes: {str(error)[:100]}; '
                         'expected a message in a valid encoding') from None


def nanoseconds(stamp: Time | Duration) -> int:
    """Return a stamp or a duration in nanoseconds."""
    return int(stamp.sec) * NANO + int(stamp.nanosec)


def duration(seconds: float) -> Duration:
    """Return a duration message, rounded to the nanosecond."""
    sec, nanosec = divmod(round(seconds * 1e9), NANO)
    return Duration(sec=sec, nanosec=nanosec)


def doubles(values: ArrayLike) -> 'array[float]':
    """Return values as the array of a float64[] field, row by row, with one copy."""
    return array('d', np.ascontiguousarray(values, dtype=np.float64).tobytes())


def as_wrench(values: ArrayLike) -> Wrench:
    """Return a wrench, (6,) force then moment, as a message."""
    fx, fy, fz, mx, my, mz = np.asarray(values, dtype=np.float64).tolist()
    return Wrench(force=Vector3(x=fx, y=fy, z=fz), torque=Vector3(x=mx, y=my, z=mz))


def order(names: Sequence[str], joints: Sequence[str], what: str) -> Index | None:
    """
    Return the index of each of `joints` in `names`; None if the lists are equal.

    Raises
    ------
    InputError
        A joint is missing, unknown, or named twice.

    """
    if not names or tuple(names) == tuple(joints):
        return None
    # The first fault in words.
    fault = ''
    if len(set(names)) < len(names):
        fault = 'a joint is named twice'
    for name in names:
        if name not in joints:
            fault = f"'{name}' is unknown"
            break
    for joint in joints:
        if joint not in names:
            fault = f"'{joint}' is missing"
            break
    if fault:
        raise InputError(f'{what}: {fault}; expected each of {", ".join(joints)} once, '
                         'or an empty list')
    return joint_places(joints, names)


def joint_places(joints: Sequence[str], names: Sequence[str]) -> Index:
    """Return the index of each joint in `names`, which has them all."""
    return np.array(list(map(names.index, joints)), dtype=np.intp)


def vector(values: Sequence[float], index: Index | None, n: int, what: str,
           empty: ArrayLike | None = None) -> Array:
    """
    Return a joint vector of a request as an (n,) array in the node's order.

    Raises
    ------
    InputError
        The length is not n (nor zero, where `empty` is given), or an entry is not
        finite.

    """
    # A field that may be empty has a default.
    if len(values) == 0 and empty is not None:
        return np.broadcast_to(np.asarray(empty, dtype=np.float64), (n,)).copy()
    if len(values) != n:
        or_none = '' if empty is None else ', or none'
        raise InputError(f'{what}: {len(values)} entries; expected {n}{or_none}')
    result = np.array(values, dtype=np.float64)
    if not np.isfinite(result).all():
        raise InputError(f'{what}: {result.tolist()}; expected finite numbers')
    return result if index is None else result[index]


def _column(message: JointTrajectory, field: str, index: Index) -> Array | None:
    """
    Return one field of all points, (K, n) in the node's order.

    The result is None if the field is unused.
    """
    rows = [getattr(point, field) for point in message.points]
    # A field that no point has is absent; one that some have is incomplete.
    if not any(len(row) for row in rows):
        return None
    for k, row in enumerate(rows):
        if len(row) != len(message.joint_names):
            raise InputError(f'point {k}: {len(row)} {field}; expected one for each of '
                             f'the {len(message.joint_names)} joint names')
    values = np.array(rows, dtype=np.float64)[:, index]
    finite_points = np.isfinite(values).all(axis=1)
    if not finite_points.all():
        k = int(np.flatnonzero(~finite_points)[0])
        raise InputError(f'point {k}: {field} {values[k].tolist()}; expected finite '
                         'numbers')
    return values


def check_points(count: int, max_points: int) -> None:
    """Raise InputError unless a trajectory has 1 to `max_points` points."""
    if not 1 <= count <= max_points:
        raise InputError(f'trajectory: {count} points; expected 1 to {max_points}')


def motion_from_message(message: JointTrajectory, joints: Sequence[str], max_points: int,
                        start: State | None = None) -> Motion:
    """
    Return the desired motion that a JointTrajectory describes.

    Ignore joints not in `joints`.

    If `start` is given and the first point is later than 0, the motion begins at
    `start`.

    Raises
    ------
    InputError
        The trajectory has no or too many points, lacks a joint, has arrays of the wrong
        length, times that do not increase, or non-finite numbers.

    """
    times, q, u, udot = point_columns(message, joints, max_points)
    return Motion.from_points(times, q, u, udot, joint_names=joints, start=start)


def point_columns(message: JointTrajectory, joints: Sequence[str], max_points: int
                  ) -> tuple[Array, Array, Array | None, Array | None]:
    """
    Return times (K,), s, and positions, velocities, accelerations (K, n) of some joints.

    Velocities and accelerations are None if no point has any.

    Raises
    ------
    InputError
        As `motion_from_message`.

    """
    check_points(len(message.points), max_points)
    # Joints of the message may be in any order, and more than those asked for.
    names = list(message.joint_names)
    fault = ''
    missing = [joint for joint in joints if joint not in names]
    if missing:
        fault = f'{", ".join(missing)} missing'
    elif len(set(names)) < len(names):
        repeated = [name for name in dict.fromkeys(names) if names.count(name) > 1]
        fault = f'{", ".join(repeated)} named more than once'
    if fault:
        raise JointNamesError(f'joint_names of the trajectory: {fault}; expected each '
                              f'of {", ".join(joints)} once')
    index = joint_places(joints, names)
    # Times increase from zero or later.
    times = np.array([nanoseconds(p.time_from_start) for p in message.points]) * 1e-9
    if times[0] < 0.0:
        raise InputError(f'point 0: time_from_start {times[0]:g} s; expected 0 or more')
    late = np.flatnonzero(np.diff(times) <= 0.0)
    if late.size:
        k = int(late[0])
        raise InputError(f'point {k + 1}: time_from_start {times[k + 1]:g} s; expected '
                         f'more than that of point {k}, {times[k]:g} s')
    positions = _column(message, 'positions', index)
    if positions is None:
        raise InputError('positions of the trajectory: none; expected one per joint in '
                         'each point')
    return (times, positions, _column(message, 'velocities', index),
            _column(message, 'accelerations', index))


def trajectory_message(trajectory: Trajectory, robot: Robot,
                       names: Sequence[str] = ()) -> JointTrajectory:
    """
    Return a simulated trajectory as a message with the torques as `effort`.

    The columns follow the order of `names`, which holds each of the robot's joints once;
    default: the robot's order. Velocities, accelerations and torques are those of all
    joints, whatever the speeds.
    """
    names = list(names) or list(trajectory.joint_names)
    order = list(map(trajectory.joint_names.index, names))
    t = trajectory.t
    q = trajectory.q
    u = trajectory.u
    # Messages have the motion of joints, whatever the speeds of the robot are.
    rows = {'positions': q, 'velocities': robot.joint_rates(q, u, t=t),
            'accelerations': robot.joint_accelerations(q, u, trajectory.udot, t=t),
            'effort': robot.joint_torques(trajectory.tau, q, t=t)}
    ordered = {field: table[:, order] for field, table in rows.items()}
    return message_of_points(names, t, ordered)


def message_of_points(names: Sequence[str], t: Array, rows: Mapping[str, Array]
                      ) -> JointTrajectory:
    """Return a message with times, (K,), s, and (K, n) rows of each field."""
    # array(typecode, bytes) is several times faster than a conversion from a list of
    # floats; the torque path shares the interpreter.
    columns = {field: np.ascontiguousarray(table) for field, table in rows.items()}
    message = JointTrajectory(joint_names=list(names))
    for k, moment in enumerate(t.tolist()):
        point = JointTrajectoryPoint(time_from_start=duration(moment))
        for field, column in columns.items():
            setattr(point, field, array('d', column[k].tobytes()))
        message.points.append(point)
    return message
