"""The motion along a path with given squared path velocities, and its use of the limits."""

from collections.abc import Sequence
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.path_limits import Bounds, Flags
from kane_dynamics.feasibility.segment_peaks import segment_peaks
from kane_dynamics.feasibility.torque_demand import share
from kane_dynamics.motion.controller_points import ControllerPoints
from kane_dynamics.robot.robot import Robot
import numpy as np

PAUSE = 1e-6  # s of rest between two sections
# Places in a segment where limits count: in all segments, and where much changes within one.
INSIDE = np.array([0.02, 0.25, 0.5, 0.75, 0.98])
CLOSELY = np.linspace(0.0, 1.0, 200, endpoint=False)
CHANGING = 0.02  # of a limit
TURNING = 4.0  # speeds of friction, below which friction changes


class Checked(NamedTuple):
    """
    The points of a section, and the uses of the limits at points and between them.

    Attributes
    ----------
    points : ControllerPoints
        The N + 2 points.
    coefficients : (N + 1, 6, n) array
        Coefficients of the positions in the segments between them.
    tau : (N + 2, n) array
        Torques at the points.
    at_points : (4, N + 2, n) array
        Shares of `Bounds` at the points.
    largest : (4, N + 1, n) array
        The largest shares in the segments.

    """

    points: ControllerPoints
    coefficients: Array
    tau: Array
    at_points: Array
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
    """Return the uses of the limits along the quintics between points."""
    tau, coefficients = robot.inverse_dynamics(*points[1:]), points.coefficients
    at_points = np.zeros((len(bounds), *tau.shape))
    largest = np.zeros((len(bounds), len(coefficients), robot.n))
    used = np.flatnonzero([np.isfinite(bound).any() for bound in bounds])
    if used.size:
        names, durations = [Bounds._fields[k] for k in used], np.diff(points.t)
        limits = np.array([bounds[k] for k in used])[:, None]
        peaks, ranges = segment_peaks(robot, names, coefficients, durations, INSIDE)
        changing = _turning(robot, points.u) | (
            (ranges > CHANGING * limits) & (peaks + ranges > limits)).any(axis=(0, 2))
        if changing.any():
            peaks[:, changing] = np.maximum(peaks[:, changing], segment_peaks(
                robot, names, coefficients[changing], durations[changing], CLOSELY)[0])
        values = np.stack([(tau, points.u, tau * points.u, points.udot)[k] for k in used])
        at_points[used] = share(np.abs(values), limits)
        largest[used] = np.maximum(share(peaks, limits), at_points[used, 1:])
    return Checked(points, coefficients, tau, at_points, largest)


def _turning(robot: Robot, u: Array) -> Flags:
    """Return whether the Coulomb friction of a joint changes much within a segment."""
    found = np.zeros(len(u) - 1, dtype=bool)
    for body in robot.model.bodies if robot.friction else ():
        joint = body.joint
        if joint.friction:
            rate = joint.multiplier * u[:, joint.coordinate]
            slow = np.abs(rate) < TURNING * joint.friction_speed
            found |= (rate[1:] * rate[:-1] <= 0.0) | slow[1:] | slow[:-1]
    return found


def joined(parts: Sequence[Checked]) -> tuple[ControllerPoints, Array]:
    """Return the points of all sections, one after the other, and the coefficients between."""
    begin, times, coefficients = 0.0, [], []
    for part in parts:
        rest = np.zeros((1, *part.coefficients.shape[1:]))
        rest[0, 0] = part.points.q[0]
        coefficients += [rest, part.coefficients]
        times.append(begin + part.points.t)
        begin = times[-1][-1] + PAUSE
    return (ControllerPoints(np.concatenate(times), *(
        np.concatenate(rows) for rows in list(zip(*(part.points for part in parts)))[1:])),
        np.concatenate(coefficients[1:]))
