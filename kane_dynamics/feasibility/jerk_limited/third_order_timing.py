"""
Fastest timing of a path between rests with limits of jerk or of the rate of torque.

The profile satisfies the limits at the vertices of its grid. Where the motion exceeds
one between them, that limit is tightened there, in a bounded number of rounds. The
excess that remains is removed by a uniform slow-down, so a timing that is returned
satisfies all limits wherever they are checked: at the places of `path_timing` and
`rate_peaks`.
"""

from collections.abc import Callable
import math
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.jerk_limited.interior_point import fastest_spline
from kane_dynamics.feasibility.jerk_limited.profile_spline import (motion_points,
                                                                   ProfileSpline)
from kane_dynamics.feasibility.jerk_limited.rate_peaks import rate_uses
from kane_dynamics.feasibility.jerk_limited.smooth_path import (smooth_sections,
                                                                SmoothSection)
from kane_dynamics.feasibility.jerk_limited.third_order_limits import (
    LIMITS, RateBounds, ThirdOrderLimits, UNBOUNDED)
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.path_limits import Bounds
from kane_dynamics.feasibility.path_timing import Checked, with_checked_uses
from kane_dynamics.feasibility.segment_peaks import ACTIVE, MARGIN
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
import numpy as np

ROUNDS = 6  # in which limits are tightened
FINER, GRIDS, FINE = 2, 3, 4000  # factor of the points, grids, and points of the last
CHANGE = 3e-3  # of the duration, relative, by the last grid
# Cost of tighter limits and the slow-down on the last grid; at all.
GOOD, WORST = 2e-3, 3e-2
LARGEST = 2e-3  # excess at which the interior-point method has converged
FAR, NEAR = 1.0, 0.01  # with which it begins, from a slow and from a fast profile
HALVINGS, INSIDE = 200, 0.9  # of the first profile, and its largest share of a limit
FASTEST = 16.0  # x of the first profile, relative to its size
SLOWER, STRETCHES = 0.98, 6  # x of a profile from which the next round begins; attempts
SLOWDOWNS = 16  # of a timing that exceeds a limit


REFUSAL = ('path: no timing satisfies the limits of effort and torque rate with a '
           f'margin of {MARGIN:g}; expected limits that are larger than the torques at '
           'rest with friction')


class ThirdOrderTiming(NamedTuple):
    """
    A timing within all limits, with the faster profile from which its grid was made.

    Attributes
    ----------
    checked : Checked
        The points of the timing.
    least : float
        Duration without tighter limits, s.
    s : (N + 1,) array
        Vertices of the profile without tighter limits.
    profile : (N - 1,) array
        Its coefficients.

    """

    checked: Checked
    least: float
    s: Array
    profile: Array

    @property
    def duration(self) -> float:
        """Return the duration, s."""
        return float(self.checked.points.t[-1])

    @property
    def cost(self) -> float:
        """Return the relative increase of the duration by the tighter limits."""
        return self.duration / self.least - 1.0


def rate_limited(robot: Robot, motion: Motion, bounds: Bounds, rates: RateBounds,
                 points: int, check: Callable[[Section], None]) -> list[Checked]:
    """
    Return the sections of a path with their fastest timings.

    Parameters
    ----------
    robot : Robot
        A robot in joint rates.
    motion : Motion
        The path; its timing is ignored.
    bounds, rates : Bounds, RateBounds
        The limits.
    points : int
        Intervals of the first grid, about.
    check : callable
        Called with each section, before it is timed.

    Raises
    ------
    InputError
        If the path or a limit is invalid, the motors cannot hold the robot on the path,
        nothing bounds the motion, or no timing was found.

    """
    best: dict[int, ThirdOrderTiming] = {}
    done: set[int] = set()
    reason = ''
    # Grids get finer until the duration of every section settles.
    for _ in range(GRIDS):
        parts = smooth_sections(motion, points)
        for k, path in enumerate(parts):
            if k in done:
                continue
            check(path.section)
            timing = _timed(robot, path, bounds, rates, best.get(k))
            if isinstance(timing, str):
                reason = timing
                continue
            # The next grid starts from the best timing of the coarser one.
            change = math.inf
            if k in best:
                change = best[k].duration / timing.duration - 1.0
            if abs(change) <= CHANGE and timing.cost <= GOOD:
                done.add(k)
            if change > 0.0:
                best[k] = timing
        # A section that settled is not repeated.
        if len(done) == len(parts) or points >= FINE:
            break
        points *= FINER
    if len(best) < len(parts):
        raise InputError(reason)
    cost = max(timing.cost for timing in best.values())
    if cost > WORST:
        raise InputError(f'path: a timing within the limits takes {cost:.2%} more time '
                         'than one that satisfies them at the points of the finest '
                         f'grid; expected at most {WORST:.0%}, on a path without sharp '
                         'corners that is not much shorter than the positions on it, '
                         'which are rounded')
    return [best[k].checked for k in range(len(parts))]


def _timed(robot: Robot, path: SmoothSection, bounds: Bounds, rates: RateBounds,
           coarse: ThirdOrderTiming | None) -> ThirdOrderTiming | str:
    """
    Return the fastest timing of a section, or the reason why there is none on its grid.

    `coarse` is that on a coarser grid, from which to begin.
    """
    limits = ThirdOrderLimits(robot, path, bounds, rates)
    spline = ProfileSpline(path.s, path.place, path.size)
    # Start inside all limits: slow, or the coarse profile moved below them.
    if coarse is None:
        start = _slow(spline, limits)
    else:
        x = ProfileSpline(coarse.s, path.s[1:-1], spline.count).at(coarse.profile)[0]
        start = _below(spline, limits, x)
    best: Checked | None = None
    least, reason = math.inf, REFUSAL
    for _ in range(ROUNDS):
        if start is None:
            break

        # Each round solves for the fastest spline, then checks it between the grid's
        # points.
        c, excess = fastest_spline(spline, limits, *start)
        if (spline.at(c)[0] >= 0.5 * limits.free).any():
            raise InputError(UNBOUNDED)
        if excess > LARGEST:
            reason = (f'path: the duration is still {excess:.2g} above the least one '
                      f'after all steps, on a grid of {spline.size} points; expected at '
                      f'most {LARGEST:g}')
            break
        timing = _checked(robot, motion_points(path, spline, c), bounds, rates)
        if math.isinf(least):
            least, profile = float(timing.points.t[-1]), c
        # A timing that exceeds a limit in between is slowed to respect it, and the
        # limits are tightened for the next round.
        slower = _slowed(robot, timing, bounds, rates)
        if slower is not None and (
                best is None or slower.points.t[-1] < best.points.t[-1]):
            best = slower
        if timing.largest.max() <= 1.0:
            break
        _tighten(limits, timing.largest)
        start = _below(spline, limits, c)
    return reason if best is None else ThirdOrderTiming(best, least, path.s, profile)


def _tighten(limits: ThirdOrderLimits, largest: Array) -> None:
    """Tighten the limits at both ends of the segments that exceed them."""
    worst = np.pad(largest, ((0, 0), (1, 1), (0, 0)))
    worst = np.maximum(worst[:, 1:], worst[:, :-1])[:, limits.path.vertex]
    limits.tight /= np.where(worst > ACTIVE, worst / (1.0 - MARGIN), 1.0)


def _slow(spline: ProfileSpline, limits: ThirdOrderLimits) -> tuple[Array, float] | None:
    """Return a profile of constant x within the limits, and its distance from fast."""
    x = FASTEST * limits.size
    at_rest = limits.at(spline.at(np.full(spline.count, 1e-30 * x))).values
    allowed = INSIDE + (1.0 - INSIDE) * np.abs(at_rest)
    for _ in range(HALVINGS):
        c = np.full(spline.count, x)
        if (np.abs(limits.at(spline.at(c)).values) < allowed).all():
            return c, FAR
        x *= 0.5
    return None


def _below(spline: ProfileSpline, limits: ThirdOrderLimits, c: Array
           ) -> tuple[Array, float] | None:
    """Return a profile within the limits, slower than c, and its distance from fast."""
    factor = SLOWER
    for _ in range(STRETCHES):
        uses = limits.at(spline.at(factor * c)).values
        if (c > 0.0).all() and (np.abs(uses) < 1.0).all():
            return factor * factor * c, max(NEAR, 0.5 / factor - 0.5)
        factor *= factor
    return _slow(spline, limits)


def _checked(robot: Robot, points: ControllerPoints, bounds: Bounds, rates: RateBounds
             ) -> Checked:
    """Return the largest uses of all `LIMITS` between the points, (6, N, n)."""
    timing = with_checked_uses(robot, points, np.array(bounds))
    largest = np.zeros((len(LIMITS), *timing.largest.shape[1:]))
    largest[:len(bounds)] = timing.largest
    for name, uses in rate_uses(robot, points, rates).items():
        largest[LIMITS.index(name)] = uses.max(axis=0)
    return Checked(points, largest, timing.tau)


def _slowed(robot: Robot, timing: Checked, bounds: Bounds, rates: RateBounds
            ) -> Checked | None:
    """Return a timing, slowed down uniformly until it satisfies the limits."""
    points = timing.points
    slower = 1.0
    strength = 1.0
    for _ in range(SLOWDOWNS):
        worst = float(timing.largest.max())
        if worst <= 1.0:
            return timing
        slower *= 1.0 + strength * (worst - 1.0)
        strength *= 1.5  # the torques at rest remain
        stretched = ControllerPoints(slower * points.t, points.q, points.u / slower,
                                     points.udot / slower**2)
        timing = _checked(robot, stretched, bounds, rates)
    return None
