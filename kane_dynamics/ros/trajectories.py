"""
Joint trajectories as they come from the wire.

rclpy would convert a whole message without letting go of the interpreter: tens of milliseconds for
thousands of points, in which no joint state is answered. Here it is read point by point.
"""

from dataclasses import dataclass
from typing import NamedTuple

from kane_dynamics.ros.cdr import Reader
from kane_dynamics.ros.conversion import Array, check_points


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
        It is not what CDR says it must be, or has no or too many points; none is read then.

    """
    reader = Reader(data)
    stamp = Time(*reader.pair())
    reader.text()  # frame
    names = reader.texts()
    count = reader.word()
    check_points(count, max_points)
    points = []
    for _ in range(count):
        positions, velocities, accelerations = (reader.doubles() for _ in range(3))
        reader.doubles()  # efforts
        points.append(Point(positions, velocities, accelerations, Time(*reader.pair())))
    return ReceivedTrajectory(Header(stamp), names, points)
