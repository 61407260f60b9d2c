"""
Joint trajectories as they come from the wire.

rclpy would convert a whole message without letting go of the interpreter: tens of milliseconds for
thousands of points, in which no joint state is answered. Here it is read point by point.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from kane_dynamics.control.controller import Mode
from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.conversion import (Array, check_points, motion_from_message, NANO,
                                                 nanoseconds)
from kane_dynamics.ros.torque_path.cdr import Reader
from kane_dynamics.ros.torque_path.torque_path import TorquePath


class Time(NamedTuple):
    """A Time or a Duration."""

    sec: int
    nanosec: int


@dataclass(frozen=True, eq=False)
class Header:
    """What is used of a Header."""

    stamp: Time


@dataclass(frozen=True, eq=False)
class Point:
    """What is used of a JointTrajectoryPoint."""

    positions: Array
    velocities: Array
    accelerations: Array
    time_from_start: Time


@dataclass(frozen=True, eq=False)
class ReceivedTrajectory:
    """The fields of a JointTrajectory."""

    header: Header
    joint_names: list[str]
    points: list[Point]


def read_trajectory(data: bytes, max_points: int) -> ReceivedTrajectory:
    """
    Read a serialised JointTrajectory.

    Raises
    ------
    InputError
        It is not what CDR says it must be, or has too many points; none is read then.

    """
    reader = Reader(data)
    stamp = Time(*reader.pair())
    reader.text()  # frame
    names = reader.texts()
    count = reader.word()
    if count:
        check_points(count, max_points)
    points = []
    for _ in range(count):
        positions, velocities, accelerations = (reader.doubles() for _ in range(3))
        reader.doubles()  # efforts
        points.append(Point(positions, velocities, accelerations, Time(*reader.pair())))
    return ReceivedTrajectory(Header(stamp), names, points)


def take_trajectory(path: TorquePath, data: bytes, received: int, values: Mapping[str, Any]
                    ) -> str:
    """
    Let the torque path follow a serialised JointTrajectory; without points, nothing any more.

    A motion whose first point lies ahead begins where the arm is wanted to be when it starts: in
    the motion before it, in the pose that is held, or where it was measured last.

    Parameters
    ----------
    path : TorquePath
        Running.
    data : bytes
        The message.
    received : int
        When the message came, ns of the system's time; 0 if that is not known.
    values : mapping
        The node's parameters.

    Returns
    -------
    str
        What to remark on it; empty: nothing.

    Raises
    ------
    InputError
        The message is not good, or nothing would follow it.

    """
    course, now = path.course, path.now
    generation = course.generation
    if 0 < received < course.forgotten:
        raise InputError('it came before the node was activated, ended its motion, lost its joint '
                         'states, or changed clock or mode')
    message = read_trajectory(data, values['trajectory.max_points'])
    if not message.points:
        course.forget()
        return 'it has no points: no motion is followed any more'
    if path.controller.mode is Mode.GRAVITY_COMPENSATION:
        raise InputError(f'the mode is {Mode.GRAVITY_COMPENSATION}, which follows no motion')
    if path.timed_out:
        raise InputError(f'no joint state has come for {path.silence:.3f} s')
    if not now:
        raise InputError('use_sim_time is set, and nothing has come on /clock')
    start = nanoseconds(message.header.stamp) or now
    motion = motion_from_message(message, path.controller.robot.joint_names,
                                 values['trajectory.max_points'], path.desired(start))
    if start != now and start + motion.duration * NANO < now:
        raise InputError(f'it ended {(now - start) / NANO - motion.duration:.3f} s ago')
    if not course.follow(motion, start, now, generation):
        raise InputError('while it was read the node was stopped, ended its motion, lost its '
                         'joint states, or changed clock or mode')
    limits = path.controller.robot.limits
    outside = (motion.positions < limits.lower) | (motion.positions > limits.upper)
    beyond = [name for name, points in zip(motion.joint_names, outside.T) if points.any()]
    return 'it goes beyond the position limits of ' + ', '.join(beyond) if beyond else ''
