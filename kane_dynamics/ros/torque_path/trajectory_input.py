"""
Read serialized joint trajectories and schedule them as desired motions.

rclpy converts a message without releasing the interpreter; for thousands of points this blocks the
torque path for tens of milliseconds. This module reads the message point by point.
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


class CdrTime(NamedTuple):
    """A Time or a Duration."""

    sec: int
    nanosec: int


@dataclass(frozen=True, eq=False)
class TrajectoryHeader:
    """The part of a Header that is used."""

    stamp: CdrTime
    frame_id: str


@dataclass(frozen=True, eq=False)
class ReceivedPoint:
    """The part of a JointTrajectoryPoint that is used."""

    positions: Array
    velocities: Array
    accelerations: Array
    time_from_start: CdrTime


@dataclass(frozen=True, eq=False)
class ReceivedTrajectory:
    """The part of a JointTrajectory that is used."""

    header: TrajectoryHeader
    joint_names: list[str]
    points: list[ReceivedPoint]


def read_trajectory(data: bytes, max_points: int) -> ReceivedTrajectory:
    """
    Read a serialized JointTrajectory.

    Raises
    ------
    InputError
        The message is not valid CDR or has too many points.

    """
    reader = Reader(data)
    stamp = CdrTime(*reader.pair())
    frame_id = reader.text()
    names = reader.texts()
    count = reader.word()
    if count:
        check_points(count, max_points)
    points = []
    for _ in range(count):
        positions, velocities, accelerations = (reader.doubles() for _ in range(3))
        reader.doubles()  # efforts
        points.append(ReceivedPoint(positions, velocities, accelerations,
                                    CdrTime(*reader.pair())))
    return ReceivedTrajectory(TrajectoryHeader(stamp, frame_id), names, points)


def follow_trajectory(path: TorquePath, data: bytes, received: int,
                      values: Mapping[str, Any]) -> str:
    """
    Make the torque path follow a serialized JointTrajectory; an empty one ends the motion.

    If the first point is later than 0, the motion begins at the desired state at its start time:
    that of the previous motion, the held pose, or the last measured state.

    Parameters
    ----------
    path : TorquePath
        The running torque path.
    data : bytes
        The serialized message.
    received : int
        System time of reception, ns; 0 if unknown.
    values : mapping
        The node's parameters.

    Returns
    -------
    str
        A warning about the motion; empty: none.

    Raises
    ------
    InputError
        The message is invalid, or no motion can be followed now.

    """
    active_motion, now = path.active_motion, path.now
    generation = active_motion.generation
    if 0 < received < active_motion.cleared_at:
        raise InputError('joint_trajectory: received before the node was activated, ended its '
                         'motion, timed out, or changed clock or mode; expected a later one')
    message = read_trajectory(data, values['trajectory.max_points'])
    if not message.points:
        active_motion.clear()
        return 'no points; the desired motion ends'
    if path.controller.mode is Mode.GRAVITY_COMPENSATION:
        raise InputError(f'mode: {Mode.GRAVITY_COMPENSATION}; expected a mode that follows '
                         'motions')
    if path.timed_out:
        raise InputError(f'joint states: none for {path.state_age:.3f} s; expected one within '
                         'state_timeout')
    if not now:
        raise InputError('use_sim_time: true without a message on /clock; expected simulated time')
    start = nanoseconds(message.header.stamp) or now
    motion = motion_from_message(message, path.controller.followed,
                                 values['trajectory.max_points'], path.desired(start))
    if start != now and start + motion.duration * NANO < now:
        raise InputError(f'end of the motion: {(now - start) / NANO - motion.duration:.3f} s ago; '
                         'expected a time in the future')
    if not active_motion.follow(motion, start, now, generation):
        raise InputError('joint_trajectory: received while the node was stopped, ended its '
                         'motion, timed out, or changed clock or mode; expected a later one')
    robot = path.controller.robot
    places, limits = [robot.joint_names.index(x) for x in motion.joint_names], robot.limits
    outside = (motion.positions < limits.lower[places]) | (
        motion.positions > limits.upper[places])
    beyond = [name for name, points in zip(motion.joint_names, outside.T) if points.any()]
    return 'exceeds the position limits of ' + ', '.join(beyond) if beyond else ''
