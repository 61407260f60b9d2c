"""The motion along a path with squared path velocities, and its use of the limits."""

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import NamedTuple

from kane_dynamics._util.typing import Array, Flags, Scalar, Vector
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.feasibility.segment_peaks import (ACTIVE, DENSE, MIDDLE, MotionStates,
                                                     QUANTITIES, require_finite_flags,
                                                     SegmentPeaks)
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.friction import has_dry_friction
from kane_dynamics.model.model import Joint
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel
from kane_dynamics.robot.kernel_set import kernel_per_robot
from kane_dynamics.robot.robot import Robot
import numpy as np

PAUSE = 1e-6  # s of rest between two sections
STEP = 0.5  # of s between vertices
FLAT, TERMS = 0.1, 8  # largest argument of the series, exact to rounding, and its terms
SPARSE = 0.5  # share of changed vertices from which all points are computed again
TURNING = 4.0  # speeds of friction, below which friction changes


class Checked(NamedTuple):
    """
    The points of a section, and the largest uses of the limits between them.

    Attributes
    ----------
    points : ControllerPoints
        The N + 2 points.
    largest : (k, N + 1, n) array
        The largest shares in the segments, of k quantities.
    tau : (N + 2, n) array
        Torques at the points.

    """

    points: ControllerPoints
    largest: Array
    tau: Array


class SectionMotion:
    """
    The motion along a section with squared path velocities x at its vertices.

    Its points are both ends and the middles between vertices. There x and its slope are
    those of the polygon through the vertices, so x(s) is a quadratic spline, which
    rounds the corners of the polygon, and the acceleration is continuous. Between the
    points the motion is a quintic.

    A new profile often differs from the one before at a few vertices only. Just the
    points and segments that this concerns are computed again.

    Parameters
    ----------
    robot : Robot
        The robot.
    section : Section
        The path.
    peaks : SegmentPeaks
        Computes torques and shares of limits.

    Attributes
    ----------
    quantities : tuple of int
        The k quantities whose limits are checked, as places in `QUANTITIES`.
    shares : (N + 1, k, n) array
        The largest shares of the limits in the segments.
    largest : (N + 1,) array
        The largest of them in each segment.

    """

    def __init__(self, robot: Robot, section: Section, peaks: SegmentPeaks) -> None:
        self._section, self._peaks = section, peaks
        self._coulomb = coulomb_joints(robot)
        samples, n = section.q.shape
        count = (samples + 3) // 2
        self._n = n
        # The samples at the points: the first one, those between vertices, and the last.
        self._places = np.arange(-1, samples + 1, 2)
        self._places[0] = 0
        self._places[-1] = samples - 1
        # x, s'' and the step to the next point; one row in addition.
        self._profile = np.empty((count + 1, 3))
        self._profile[:, 2] = STEP
        self._profile[[0, -3], 2] = 0.5 * STEP
        self._profile[-2:, 2] = 0.0
        # q, u, udot, the time to the next point, and the torques.
        self._rows = np.empty((count, 4 * n + 1))
        self._kernel = point_kernel(n) if peaks.driving else tree_point_kernel(robot)
        self._x: Array | None = None
        self.quantities = peaks.quantities
        self.shares = np.empty((count - 1, len(self.quantities), n))
        self.largest = np.empty(count - 1)

    @property
    def duration(self) -> float:
        """Return the duration, s."""
        return float(self._rows[:-1, 3 * self._n].sum())

    @property
    def states(self) -> MotionStates:
        """Return the states at the points."""
        return MotionStates(self._rows, self._n)

    def checked(self) -> Checked:
        """Return the points with the shares of the limits between them."""
        q, u, udot, tau = self.states.state
        t = np.zeros(len(q))
        self.states.h.cumsum(out=t[1:])
        return Checked(ControllerPoints(t, q, u, udot), self.shares.swapaxes(0, 1), tau)

    def follow(self, x: Array) -> None:
        """Compute the motion with a profile x, (N + 1,), and its shares of limits."""
        points, segments = self._changed(x)
        if points is not None and not points.size:
            return
        self._x = x
        # The tables for the segments: mean and change of x, with the ends repeated
        # beyond the path.
        profile = self._profile
        profile[1:-2, 0] = 0.5 * (x[1:] + x[:-1])
        profile[1:-2, 1] = x[1:] - x[:-1]
        profile[0, :2] = x[0], profile[1, 1]
        profile[-2:, :2] = x[-1], profile[-3, 1]
        # Only the points whose profile changed are computed again.
        if points is None:
            self._compute(self._rows, None)
        else:
            rows = np.empty((len(points), self._rows.shape[1]))
            self._compute(rows, points)
            self._rows[points] = rows
        shares, largest = largest_shares(self._coulomb, self._peaks, self.states,
                                         segments)
        if segments is None:
            self.shares = shares
            self.largest = largest
        else:
            self.shares[segments] = shares
            self.largest[segments] = largest

    def _changed(self, x: Array) -> tuple[Segments | None, Segments | None]:
        """Return the points and segments that a profile changes; None for all."""
        if self._x is None:
            return None, None
        changed = x != self._x
        if np.count_nonzero(changed) > SPARSE * len(x):
            return None, None
        # Point k lies between the vertices k - 1 and k. The time to the next point
        # depends on the vertex k + 1 too, and the last point on the last two vertices.
        points = np.zeros(len(x) + 1, dtype=bool)
        points[:-1] = changed
        points[1:] |= changed
        points[:-2] |= changed[1:]
        points[-1] |= changed[-2]
        beside = points[1:] | points[:-1]
        return points.nonzero()[0], beside.nonzero()[0]

    def _compute(self, rows: Array, points: Segments | None) -> None:
        """Write the rows of points, of all for None."""
        n = self._n
        path = self._section[:3]
        # Rows of the kernel are chosen by number: places of the path, points of the profile.
        numbers = dict.fromkeys(Section._fields[:3], self._places)
        if points is not None:
            numbers = dict.fromkeys(Section._fields[:3], self._places[points])
            numbers |= {'profile': points, 'following': points}
        inputs = [*path, self._profile, self._profile[1:]]
        require_finite_flags(self._kernel.run(inputs, rows, len(rows), numbers))
        # Torques of closed loops need the closed configuration of each point.
        if self._peaks.driving:
            q, u, udot = (rows[:, k * n:(k + 1) * n] for k in range(3))
            rows[:, 3 * n + 1:] = self._peaks.torques(q, u, udot)


def _point(q: Vector, first: Vector, second: Vector, profile: Vector, following: Vector
           ) -> Vector:
    """Return q, u and udot at a point, and the time to the next one, (3 n + 1,)."""
    x, slope, step = profile
    root = np.sqrt(x)
    total = root + np.sqrt(following[0])
    curvature = step * (following[1] - slope) / (total * total)
    time = 2.0 * step / total * _lengthening(curvature)
    return np.array([*q, *(root * first), *(x * second + slope * first), time])


def _point_inputs(n: int) -> dict[str, tuple[int, ...]]:
    """Return the inputs of `_point`: the path, x and x' at the point and the next one."""
    return {**dict.fromkeys(Section._fields[:3], (n,)), 'profile': (3,),
            'following': (3,)}


@cache
def point_kernel(n: int) -> Kernel:
    """Return the kernel of state and time step at a point of a path, (3 n + 1,)."""
    return batch_kernel('path_point', _point, [*_point_inputs(n).items()], (3 * n + 1,))


@kernel_per_robot
def tree_point_kernel(robot: Robot) -> Kernel:
    """Return the kernel of `point_kernel` with the torques of a tree, (4 n + 1,)."""
    n = robot.n

    def values(*inputs: Vector, parameters: Vector) -> Vector:
        row = _point(*inputs)
        q, u, udot = row[:n], row[n:2 * n], row[2 * n:3 * n]
        tau = robot.equations.inverse_dynamics(q, u, udot, None, parameters)
        return np.concatenate([row, tau])
    return robot.kernels.compiled(values, 'path_tree_point', _point_inputs(n),
                                  (4 * n + 1,), ahead=False)


def _lengthening(z: Scalar) -> Scalar:
    """
    Return artanh(r) / r for z = r^2, and arctan(r) / r for z = -r^2.

    For a quadratic x(s) with the coefficient c of s^2, the integral of ds / sqrt(x) over
    a step h is 2 h / t times this with z = c h^2 / t^2, where t is the sum of sqrt(x) at
    both ends. A series avoids cancellation.
    """
    root = np.sqrt(select(z < 0.0, -z, z))
    series = 0.0
    for k in reversed(range(TERMS)):
        series = 1.0 / (2 * k + 1) + z * series
    hyperbolic = 0.5 * np.log((1.0 + root) / (1.0 - root))
    curved = select(z < 0.0, np.arctan(root), hyperbolic) / root
    return select(root < FLAT, series, curved)


def profile_duration(x: Array) -> float:
    """Return the duration along the polygon x, in intervals; an end may be near zero."""
    root = np.sqrt(x)
    return float((2.0 / (root[1:] + root[:-1])).sum())


def with_checked_uses(robot: Robot, points: ControllerPoints, limits: Array) -> Checked:
    """Return the uses of limits, (4, n), along the quintics between points of a tree."""
    peaks = SegmentPeaks(robot, limits)
    t, q, u, udot = points
    tau = peaks.torques(q, u, udot)
    states = MotionStates.of(q, u, udot, tau, t[1:] - t[:-1])
    shares, _ = largest_shares(coulomb_joints(robot), peaks, states)
    largest = np.zeros((len(QUANTITIES), *q[1:].shape))
    largest[list(peaks.quantities)] = shares.swapaxes(0, 1)
    return Checked(points, largest, tau)


def largest_shares(coulomb: Sequence[Joint], peaks: SegmentPeaks, states: MotionStates,
                   segments: Segments | None = None) -> tuple[Array, Array]:
    """
    Return the largest shares of limits in all segments, or in some, and their largest.

    They are (S, k, n) and (S,) arrays. Each segment is examined at its ends and its
    middle, and at more places where a share may exceed its limit between these, or the
    Coulomb friction of a joint changes. The shares count these places where the largest
    one is `ACTIVE`.
    """
    # An estimate at the middle of each segment; only segments that may exceed 1 are
    # examined inside.
    shares, largest, smooth_places, estimate = peaks.at(states, MIDDLE, segments)
    examined = estimate > 1.0
    # Coulomb friction jumps where a joint turns around.
    turning = _turning(coulomb, states.u, segments) if coulomb else None
    if turning is not None:
        examined |= turning
    closer = examined.nonzero()[0]
    if not closer.size:
        return shares, largest
    places = smooth_places[closer].astype(np.intp)
    if turning is not None:
        places[turning[closer]] = int(DENSE)
    numbers = closer if segments is None else segments[closer]
    # The worst place inside those segments, and the shares where a limit is active.
    worst, active, inside = peaks.inside(states, numbers, places, ACTIVE)
    largest[closer] = np.maximum(largest[closer], worst)
    if active.size:
        closest = closer[active]
        shares[closest] = np.maximum(shares[closest], inside)
    return shares, largest


def coulomb_joints(robot: Robot) -> list[Joint]:
    """Return the joints with Coulomb friction."""
    if not robot.friction:
        return []
    return [body.joint for body in robot.model.bodies if has_dry_friction(body.joint)]


def _turning(coulomb: Sequence[Joint], u: Array, segments: Segments | None) -> Flags:
    """Return whether the Coulomb friction of a joint changes much in each segment."""
    # Friction changes much where a joint reverses, or is slow at one end.
    begin = u[:-1]
    end = u[1:]
    if segments is not None:
        begin = u[segments]
        end = u[segments + 1]
    turning = np.zeros(len(begin), dtype=bool)
    for joint in coulomb:
        slow = TURNING * joint.friction_speed
        first = joint.multiplier * begin[:, joint.coordinate]
        last = joint.multiplier * end[:, joint.coordinate]
        turning |= (first * last <= 0.0) | (np.abs(first) < slow) | (np.abs(last) < slow)
    return turning


def joined_sections(parts: Sequence[ControllerPoints]
                    ) -> tuple[ControllerPoints, Callable[[], Array]]:
    """Return the points of all sections, and a function for the coefficients."""
    if len(parts) == 1:
        return parts[0], partial(_coefficients, parts)
    begin, times = 0.0, []
    for part in parts:
        times.append(begin + part.t)
        begin = times[-1][-1] + PAUSE
    rows = [np.concatenate(columns) for columns in list(zip(*parts))[1:]]
    return ControllerPoints(np.concatenate(times), *rows), partial(_coefficients, parts)


def _coefficients(parts: Sequence[ControllerPoints]) -> Array:
    """Return the coefficients of the sections and of the rests between them."""
    blocks = [parts[0].coefficients]
    for part in parts[1:]:
        at_rest = np.zeros((1, 6, part.q.shape[1]))
        at_rest[0, 0] = part.q[0]
        blocks += [at_rest, part.coefficients]
    return np.concatenate(blocks)
