"""The motion along a path with given squared path velocities, and its use of the limits."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.path_limits import Bounds
from kane_dynamics.feasibility.segment_peaks import QUANTITIES, segment_peaks
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
from kane_dynamics.robot.robot import Robot
import numpy as np

PAUSE = 1e-6  # s of rest between two sections
# Places in a segment where limits count: in all segments, and where much changes within one.
INSIDE = np.array([0.0, 0.5, 0.98])
CLOSELY = np.linspace(0.0, 1.0, 201)
CHANGING = 0.005  # of a limit
TURNING = 4.0  # speeds of friction, below which friction changes


FINEST = 16_000  # intervals of the grid
FINE = 4000  # intervals of a grid that is not fine yet


class Coarse(Exception):  # noqa: N818 - raised only inside this package
    """No timing was found on a grid; one may exist on a finer grid of at most `finest`."""

    def __init__(self, message: str, finest: int = FINE) -> None:
        super().__init__(message)
        self.finest = finest


class Checked(NamedTuple):
    """
    The points of a section, and the largest uses of the limits between them.

    Attributes
    ----------
    points : ControllerPoints
        The N + 2 points.
    largest : (6, N + 1, n) array
        The largest shares of the limits of `Bounds` in the segments.

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
    h, places = section.step, np.r_[0, 1:len(section.q):2, len(section.q) - 1]
    s2 = np.diff(x) / (2.0 * h)  # s'' between the vertices
    s2 = np.concatenate([s2[:1], s2, s2[-1:]])
    at = np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]])
    steps = np.full(len(at) - 1, h)
    steps[[0, -1]] = 0.5 * h
    root = np.sqrt(at)
    durations = _durations(steps, root[:-1] + root[1:], np.diff(s2) / steps)
    first, second = section.first[places], section.second[places]
    return ControllerPoints(
        np.concatenate([[0.0], np.cumsum(durations)]), section.q[places],
        first * root[:, None], second * at[:, None] + first * s2[:, None])


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
    """Return the uses of the limits of `QUANTITIES` along the quintics between points."""
    limits = {name: bound for name, bound in zip(QUANTITIES, bounds)
              if np.isfinite(bound).any()}
    largest = np.zeros((len(bounds), len(points.t) - 1, robot.n))
    if limits:
        peaks, ranges = segment_peaks(robot, limits, points, None, INSIDE)
        near = np.flatnonzero((peaks + ranges > 1.0) & (ranges > CHANGING)) // peaks.shape[1]
        changing = np.union1d(_turning(robot, points.u), near)
        if changing.size:
            peaks[changing] = np.maximum(peaks[changing], segment_peaks(
                robot, limits, points, changing, CLOSELY)[0])
        for k, name in enumerate(limits):
            largest[Bounds._fields.index(name)] = peaks[:, k * robot.n:(k + 1) * robot.n]
    return Checked(points, largest)


def excess(robot: Robot, found: Checked) -> Coarse:
    """Return the reason why a timing is not accepted: the limit that it exceeds most."""
    limit, k, j = np.unravel_index(int(found.largest.argmax()), found.largest.shape)
    count = found.largest.shape[1] - 1
    return Coarse(
        f"path: joint '{robot.joint_names[int(j)]}': {found.largest.max():.6g} times its "
        f'{Bounds._fields[int(limit)]} limit at {k / count:.3g} of the path, '
        f'{found.points.q[k].round(4).tolist()}, on a grid of {count} intervals; '
        'expected a path without sharp corners', FINEST)


def _turning(robot: Robot, u: Array) -> Segments:
    """Return the segments within which the Coulomb friction of a joint changes much."""
    found = np.zeros(len(u) - 1, dtype=bool)
    for body in robot.model.bodies if robot.friction else ():
        joint = body.joint
        if joint.friction:
            rate = joint.multiplier * u[:, joint.coordinate]
            slow = np.abs(rate) < TURNING * joint.friction_speed
            found |= (rate[1:] * rate[:-1] <= 0.0) | slow[1:] | slow[:-1]
    return np.flatnonzero(found)


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
