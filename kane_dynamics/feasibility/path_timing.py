"""The motion along a path with given squared path velocities, and its use of the limits."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.path_limits import Bounds, Flags
from kane_dynamics.feasibility.segment_peaks import SegmentPeaks
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.robot.robot import Robot
import numpy as np

PAUSE = 1e-6  # s of rest between two sections
# Places in a segment: as many where friction changes, and times the root of the range elsewhere,
# so that a smooth share is found to 3e-4 of the limit.
DENSE, SMOOTH = 200, 60.0
TURNING = 4.0  # speeds of friction, below which friction changes


class Checked(NamedTuple):
    """
    The points of a section, and the largest uses of the limits between them.

    Attributes
    ----------
    points : ControllerPoints
        The N + 2 points.
    largest : (4, N + 1, n) array
        The largest shares in the segments.

    """

    points: ControllerPoints
    largest: Array


def timed(section: Section, x: Array) -> ControllerPoints:
    """
    Return points of the motion along a section with squared path velocities x at its vertices.

    The points are both ends and the middles between vertices. There x and its slope are those of
    the polygon through the vertices, so x(s) is a quadratic spline, which rounds the corners of
    the polygon, and the acceleration is continuous.
    """
    h, count = section.step, len(x) + 1
    at, s2, steps = np.empty(count), np.empty(count), np.full(count - 1, h)
    at[0], at[1:-1], at[-1] = x[0], 0.5 * (x[1:] + x[:-1]), x[-1]
    s2[1:-1] = (x[1:] - x[:-1]) * (0.5 / h)  # s'' between the vertices
    s2[0], s2[-1] = s2[1], s2[-2]
    steps[0] = steps[-1] = 0.5 * h
    root = np.sqrt(at)
    t = np.zeros(count)
    np.cumsum(_durations(steps, root[:-1] + root[1:], (s2[1:] - s2[:-1]) / steps), out=t[1:])
    out = np.empty((3, count, section.q.shape[1]))
    # The middles, then both ends.
    for to, of in ((slice(1, -1), slice(1, None, 2)), (slice(0, 1), slice(0, 1)),
                   (slice(-1, None), slice(-1, None))):
        first, square = section.first[of], at[to, None]
        out[0, to] = section.q[of]
        np.multiply(first, root[to, None], out=out[1, to])
        np.multiply(section.second[of], square, out=out[2, to])
        out[2, to] += first * s2[to, None]
    return ControllerPoints(t, *out)


def duration(x: Array) -> float:
    """Return the duration along the polygon x, in intervals; an end may be near zero."""
    root = np.sqrt(x)
    return float((2.0 / (root[1:] + root[:-1])).sum())


def _durations(steps: Array, total: Array, square: Array) -> Array:
    """
    Return the integrals of ds / sqrt(x) for quadratics x(s), without cancellation.

    Parameters
    ----------
    steps : (K,) array
        Lengths of the intervals of s.
    total : (K,) array
        Sums of sqrt(x) at both ends.
    square : (K,) array
        Coefficients of s^2 in x.

    """
    root = np.sqrt(np.abs(square))
    ratio = root * steps / total
    with np.errstate(divide='ignore', invalid='ignore'):
        curved = np.where(square > 0.0, np.arctanh(ratio), np.arctan(ratio)) / ratio
    return np.asarray(2.0 * steps / total * np.where(ratio < 1e-9, 1.0, curved))


def checked(robot: Robot, points: ControllerPoints, bounds: Bounds,
            peaks_of: Callable[..., SegmentPeaks] = SegmentPeaks) -> Checked:
    """Return the uses of the limits along the quintics between points."""
    peaks = peaks_of(robot, np.array(bounds), points)
    found, turning = peaks.middles(), _turning(robot, points.u)
    segments = np.flatnonzero((found.estimate > 1.0) | turning)
    if not segments.size:
        return Checked(points, found.shares.swapaxes(0, 1))
    places = np.where(turning[segments], DENSE, np.minimum(
        1.0 + SMOOTH * np.sqrt(found.change[segments]), DENSE)).astype(np.intp)
    found.shares[segments] = np.maximum(found.shares[segments], peaks.inside(segments, places))
    return Checked(points, found.shares.swapaxes(0, 1))


def _turning(robot: Robot, u: Array) -> Flags:
    """Return whether the Coulomb friction of a joint changes much within each segment."""
    found = np.zeros(len(u) - 1, dtype=bool)
    for body in robot.model.bodies if robot.friction else ():
        joint = body.joint
        if joint.friction:
            rate = joint.multiplier * u[:, joint.coordinate]
            slow = np.abs(rate) < TURNING * joint.friction_speed
            found |= (rate[1:] * rate[:-1] <= 0.0) | slow[1:] | slow[:-1]
    return found


def joined(parts: Sequence[ControllerPoints]) -> tuple[ControllerPoints, Callable[[], Array]]:
    """Return the points of all sections, and a function that returns the coefficients between."""
    begin, times = 0.0, []
    for part in parts:
        times.append(begin + part.t)
        begin = times[-1][-1] + PAUSE
    return ControllerPoints(np.concatenate(times), *(
        np.concatenate(rows) for rows in list(zip(*parts))[1:])), partial(_coefficients, parts)


def _coefficients(parts: Sequence[ControllerPoints]) -> Array:
    """Return the coefficients of the sections and of the rests between them."""
    found = []
    for part in parts:
        rest = np.zeros((1, 6, part.q.shape[1]))
        rest[0, 0] = part.q[0]
        found += [rest, part.coefficients]
    return np.concatenate(found[1:])
