"""The motion along a path with given squared path velocities, and its use of the limits."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.path_limits import Bounds, Flags
from kane_dynamics.feasibility.segment_peaks import coarse_peaks, segment_peaks
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.robot.robot import Robot
import numpy as np

PAUSE = 1e-6  # s of rest between two sections
CHANGING = 0.005  # range of a share within a segment from which it counts between points, too
# Places in a segment: as many where friction changes, and times the root of the range elsewhere,
# so that a smooth share is found to 1e-4 of the limit.
DENSE, SMOOTH = 200, 120.0
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
    places = np.arange(-1, 2 * count - 1, 2)
    places[[0, -1]] = 0, 2 * count - 4
    q, first, second = (each.take(places, axis=0) for each in section[:3])
    udot = second * at[:, None]
    udot += first * s2[:, None]
    return ControllerPoints(t, q, first * root[:, None], udot)


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


def checked(robot: Robot, points: ControllerPoints, bounds: Bounds) -> Checked:
    """Return the uses of the limits along the quintics between points."""
    limits = {name: bound for name, bound in zip(Bounds._fields, bounds)
              if np.isfinite(bound).any()}
    largest = np.zeros((len(bounds), len(points.t) - 1, robot.n))
    if limits:
        peaks, ranges = coarse_peaks(robot, limits, points)
        near = ((peaks + ranges > 1.0) & (ranges > CHANGING)).any(axis=1)
        near[-1] = True  # its end is the start of no segment
        turning = _turning(robot, points.u)
        segments = np.flatnonzero(near | turning)
        places = np.where(turning[segments], DENSE, np.minimum(
            2.0 + SMOOTH * np.sqrt(ranges[segments].max(axis=1)), DENSE)).astype(np.intp)
        peaks[segments] = np.maximum(peaks[segments], segment_peaks(
            robot, limits, points, segments, places))
        for k, name in enumerate(limits):
            largest[Bounds._fields.index(name)] = peaks[:, k * robot.n:(k + 1) * robot.n]
    return Checked(points, largest)


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
