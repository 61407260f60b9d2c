"""A robot along a path: the sections of the path, their limits, and the motion along them."""

from collections.abc import Callable, Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.path_geometry import path_of, Section, sections
from kane_dynamics.feasibility.path_limits import Bounds, PathLimits
from kane_dynamics.feasibility.path_timing import SectionMotion
from kane_dynamics.feasibility.samples import ROUNDING
from kane_dynamics.feasibility.segment_peaks import SegmentPeaks
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.points import point_times
from kane_dynamics.robot.robot import Robot
import numpy as np
from numpy.typing import ArrayLike


class PathRobot:
    """
    A tree along a path of its joints.

    Parameters
    ----------
    robot : Robot
        A robot in joint rates.
    path : Motion or (K, n) array_like
        As in `time_optimal`.

    Attributes
    ----------
    motion : Motion
        A motion along the path, whose timing is ignored.

    """

    def __init__(self, robot: Robot, path: Motion | ArrayLike) -> None:
        self.names = robot.joint_names
        self.robot, self.motion = robot, path_of(path, self.names)

    def sections(self, points: int, ends: tuple[bool, bool]) -> list[Section]:
        """Return the sections of the path, of all joints; arguments as of the function."""
        return sections(self.motion, points, 2, ends)

    def check(self, bounds: Bounds, section: Section) -> None:
        """Raise InputError if a path exceeds a position limit, or a limit of 0 forbids it."""
        _check_positions(self.robot, self.names, section)
        _check_motion(bounds, section, self.names)

    def limits(self, section: Section, bounds: Bounds) -> PathLimits:
        """Return the limits at the vertices of a section."""
        return PathLimits(self.robot, section, bounds)

    def motion_along(self, section: Section, bounds: Bounds) -> SectionMotion:
        """Return the motion along a section, for profiles to follow."""
        return SectionMotion(self.robot, section, SegmentPeaks(self.robot, np.array(bounds)))

    def motion_of(self, points: ControllerPoints, coefficients: Callable[[], Array]) -> Motion:
        """Return the motion of the path's joints; arguments as from `joined`."""
        return Motion(self.names, point_times(points.t), points.q, coefficients)


def _check_positions(robot: Robot, names: Sequence[str], section: Section) -> None:
    """Raise InputError if a path exceeds a position limit."""
    for what, bound, sign in (('lower', robot.limits.lower, -1.0),
                              ('upper', robot.limits.upper, 1.0)):
        ends = section.highest if sign > 0.0 else section.lowest
        if (sign * ends <= sign * bound).all():
            continue
        excess = sign * (section.q - bound) - ROUNDING * np.maximum(1.0, np.abs(bound))
        k, j = np.unravel_index(int(excess.argmax()), excess.shape)
        if excess[k, j] > 0.0:
            raise InputError(f"path: joint '{names[int(j)]}': position "
                             f'{section.q[k, j]:.6g}; expected within its {what} limit '
                             f'{bound[j]:.6g}')


def _check_motion(bounds: Bounds, section: Section, names: Sequence[str]) -> None:
    """Raise InputError if a joint moves that has no speed, power or acceleration."""
    for what in ('velocity', 'power', 'acceleration'):
        still = getattr(bounds, what) == 0.0
        if still.any():
            still &= section.first.any(axis=0)
        if still.any():
            raise InputError(f"{what} of joint '{names[int(still.argmax())]}': limit 0; expected "
                             'a positive limit, since the joint moves along the path')
