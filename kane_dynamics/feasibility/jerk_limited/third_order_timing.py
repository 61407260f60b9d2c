"""Fastest timing of a section with limits of jerk or of the rate of torque."""

import math

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.jerk_limited.interior_point import fastest_spline, LARGEST
from kane_dynamics.feasibility.jerk_limited.profile_spline import motion_points, ProfileSpline
from kane_dynamics.feasibility.jerk_limited.rate_peaks import jerks, torque_rates
from kane_dynamics.feasibility.jerk_limited.third_order_limits import ThirdOrderLimits
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.path_limits import Bounds, MARGIN
from kane_dynamics.feasibility.path_timing import checked, Checked, Coarse, excess
from kane_dynamics.feasibility.torque_demand import share
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.robot.robot import Robot
import numpy as np

ROUNDS = 8  # in which limits are tightened
HALVINGS, INSIDE = 200, 0.9  # of the first profile, and its largest share of a limit


def jerk_limited(robot: Robot, section: Section, bounds: Bounds, most: float
                 ) -> tuple[Checked, float]:
    """
    Return a section from rest to rest with its timing, and the duration before limits were tight.

    The limits are exceeded at most by `most`.

    Raises
    ------
    InputError
        If the motors cannot hold the robot on the path, or nothing bounds the motion.
    Coarse
        If no timing was found on this grid.

    """
    section.second[[0, -1]] = 0.0  # which is so for the third power of s, and is rounding here
    limits, first = ThirdOrderLimits(robot, section, bounds), math.inf
    limits.second_order.check_rest()
    spline = ProfileSpline((len(section.q) - 1) // 2)
    ends = np.zeros((len(bounds), spline.count + 1, robot.n))
    for _ in range(ROUNDS):
        coefficients, longer = fastest_spline(spline, limits, _slow(spline, limits))
        if longer > LARGEST:
            raise Coarse(f'path: duration {longer:.2g} above the least one, on a grid of '
                         f'{spline.count + 1} intervals; expected at most {LARGEST:g}')
        profile = spline.at(coefficients)
        if (profile[:, 0] >= 0.5 * limits.second_order.free).any():
            raise InputError('robot: no limit bounds the motion; expected limits of jerk, effort '
                             'or acceleration, which bound it everywhere')
        points = motion_points(section, profile, spline.step)
        found = checked(robot, points, bounds)
        for name, values in _rates(robot, points, bounds).items():
            limits.correct(name, profile, values[[0, -1]])
            uses = share(np.abs(values), getattr(bounds, name))
            found.largest[Bounds._fields.index(name)] = uses.max(axis=0)
            ends[Bounds._fields.index(name)] = uses[[0, -1]].max(axis=0)
        first = min(first, points.t[-1])
        if (found.largest <= 1.0).all():
            return found, first
        # An excess at the ends of a segment is corrected, which tighter limits need not repeat.
        worst = np.where(ends > 1.0, 0.0, found.largest)
        worst = np.pad(worst, ((0, 0), (1, 1), (0, 0)))
        worst = np.maximum(worst[:, 1:], worst[:, :-1])  # of both segments at a vertex
        limits.tight /= np.where(worst > 1.0 - 0.5 * MARGIN, worst / (1.0 - MARGIN), 1.0)
    if found.largest.max() <= 1.0 + most:
        return found, first
    raise excess(robot, found)


def _slow(spline: ProfileSpline, limits: ThirdOrderLimits) -> Array:
    """Return a profile of one small x that satisfies all limits with a distance."""
    x = limits.second_order.size
    rest = np.abs(limits.at(spline.at(np.full(spline.count, 1e-30 * x))).values)
    allowed = INSIDE + (1.0 - INSIDE) * rest
    for _ in range(HALVINGS):
        c = np.full(spline.count, x)
        if (np.abs(limits.at(spline.at(c)).values) < allowed).all():
            return c
        x *= 0.5
    raise Coarse('path: no slow motion satisfies the limits with a margin of '
                 f'{MARGIN:g}, on a grid of {spline.count + 1} intervals; expected limits that '
                 'are larger than the torques at rest')


def _rates(robot: Robot, points: ControllerPoints, bounds: Bounds) -> dict[str, Array]:
    """Return the jerks and rates of torques that are limited, at nodes within the segments."""
    found = {}
    if np.isfinite(bounds.jerk).any():
        found['jerk'] = jerks(points)
    if np.isfinite(bounds.torque_rate).any():
        found['torque_rate'] = torque_rates(robot, points)
    return found


def rate_uses(robot: Robot, parts: list[ControllerPoints], bounds: Bounds) -> dict[str, Array]:
    """Return the shares of the limits of jerk and torque rate at the points of all sections."""
    found: dict[str, list[Array]] = {}
    for points in parts:
        for name, values in _rates(robot, points, bounds).items():
            ends = np.pad(np.abs(values[[0, -1]]), ((0, 0), (1, 1), (0, 0)))
            found.setdefault(name, []).append(share(
                np.maximum(ends[0, 1:], ends[1, :-1]), getattr(bounds, name)))
    return {name: np.concatenate(rows) for name, rows in found.items()}
