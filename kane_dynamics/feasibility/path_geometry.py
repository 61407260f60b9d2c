"""
Geometric paths q(s) with derivatives, on the uniform grid on which they are timed.

A path is that of a motion, without its timing. It is cut where the motion rests or all
joints reverse at once, since direction and friction jump there, and at dwells, which are
left out. The parameter s of a section is a mean of the time and of the length of the
motion, so that both slow and fast parts have their share of the grid. At an end where
the path is to rest s is chosen such that q(s) - q(end) begins with the power `order` of
s: with the second power, a motion from rest with finite acceleration has a positive,
finite s' there, and with the third one with finite jerk. Between the samples the path is
a cubic spline in s, through positions of the motion.
"""

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
import math
from typing import NamedTuple

from kane_dynamics._util.checks import finite_row
from kane_dynamics._util.typing import Array, Flags, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import largest, select
from kane_dynamics.mechanics.algebra.spline import segment_coefficients
from kane_dynamics.motion.controller_points import Segments
from kane_dynamics.motion.free_spline import free_velocities
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.rests import AT_REST, rests
from kane_dynamics.motion.uniform_spline import spline_derivatives
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel
import numpy as np
from numpy.typing import ArrayLike

SHORTEST = 1e-8  # rad or m, of a path: of shorter ones little but rounding is left
CLOSE = 1e-6  # distance of waypoints that count as one, of the length of the path
# Intervals on which the parameter is computed: of a section, more per segment, and more
# where the speed varies within a segment. q_ss would jump between too long ones.
MESH, FINER, VARIED = 200, 4, 16
STEP = 0.25  # of s between samples
STILL = 1e-13  # range of a joint that does not move, relative to the largest range
FEWEST = 50  # intervals of a section
# Of an interval of the mesh: the time at its start, from that of the part; the fraction
# of the segment there; its share of the segment; its duration; the speeds at both ends;
# and its length.
BEGIN, PLACE, WIDTH, DURATION, FIRST_SPEED, LAST_SPEED, LENGTH = range(7)


class Section(NamedTuple):
    """
    A path q(s) from s = 0 to N / 2, at vertices and the middles between.

    Between the N + 1 vertices, at a distance of 1/2, a squared path velocity x = s'^2
    increases by s''.

    Attributes
    ----------
    q, first, second : (2 N + 1, n) arrays
        Positions and their derivatives with respect to s.
    lowest, highest : (n,) arrays
        Least and largest positions.
    span : float
        Duration of the section in the motion, s.

    """

    q: Array
    first: Array
    second: Array
    lowest: Array
    highest: Array
    span: float


def path_of(path: Motion | ArrayLike, names: Sequence[str]) -> Motion:
    """
    Return a motion along a path: the motion itself, or the spline through waypoints.

    The spline has the distance of the waypoints as its time, and is one cubic along its
    first two and last two intervals, so that its ends are as smooth as the others. A
    waypoint nearer to the last one than `CLOSE` of the length of the path is left out,
    since a spline through close waypoints that rounding has moved swings far off. The
    path passes it at no more than that.

    Raises
    ------
    InputError
        If the waypoints are invalid; the message names the waypoint and the joint.

    """
    if isinstance(path, Motion):
        if path.joint_names != tuple(names):
            raise InputError(f'path: joints {list(path.joint_names)}; expected '
                             f'{list(names)}')
        _require_long(_lengths(path.positions))
        return path
    q = _waypoints(path, names)
    # Waypoints that almost coincide would turn a spline sharply: they become one.
    steps = _lengths(q)
    least = CLOSE * float(steps.sum())
    if len(q) and (steps <= least).any():
        q = _apart(q, least)
        steps = _lengths(q)
    if len(q) < 2:
        raise InputError(f'path: {len(q)} different waypoints; expected at least 2')
    _require_long(steps)
    # Time is the length of the polygon, a parametrisation that keeps the spline near it.
    times = np.zeros(len(q))
    steps.cumsum(out=times[1:])
    coefficients = segment_coefficients(times, q, free_velocities(times, q), None)
    return Motion(tuple(names), times, q, coefficients)


def _require_long(steps: Array) -> None:
    """Raise InputError for steps, rad or m, whose sum is so short that rounding prevails."""
    length = float(steps.sum())
    if length < SHORTEST:
        raise InputError(f'path: {length:.3g} rad or m long; expected a path that '
                         f'moves by at least {SHORTEST:g}')


def _waypoints(path: ArrayLike, names: Sequence[str]) -> Array:
    """Return checked waypoints, (K, n)."""
    if isinstance(path, np.ndarray) and path.dtype == np.float64 and (
            path.shape[1:] == (len(names),) and np.isfinite(path).all()):
        return np.array(path, order='C')  # thousands of rows would take milliseconds
    try:
        rows = list(path)  # type: ignore[arg-type]
    except TypeError:
        raise InputError(f'path: a {type(path).__name__}; expected a Motion or (K, n) '
                         'waypoints') from None
    checked = [finite_row(row, f'waypoint {k}', names) for k, row in enumerate(rows)]
    return np.array(checked).reshape(len(checked), len(names))


def _apart(points: Array, least: float) -> Array:
    """Return the points without those too near to the one before; the ends stay."""
    distant = [points[0]]
    for point in points[1:]:
        if math.dist(point, distant[-1]) > least:
            distant.append(point)
    if len(distant) > 1:  # the path ends at the last point, whatever is near it
        if math.dist(points[-1], distant[-1]) <= least:
            distant.pop()
        distant.append(points[-1])
    return np.array(distant)


def _lengths(points: Array) -> Array:
    """Return the distances between successive rows."""
    steps = points[1:] - points[:-1]
    return np.asarray(np.sqrt(np.einsum('ij,ij->i', steps, steps)))


def sections(motion: Motion, points: int, order: int, ends: tuple[bool, bool]
             ) -> list[Section]:
    """
    Return the sections of a motion between rests, without dwells.

    Parameters
    ----------
    motion : Motion
        The motion.
    points : int
        Intervals between vertices of all sections together, about.
    order : int
        Power of s with which a section begins and ends at rest, 2 or 3.
    ends : (bool, bool)
        Whether the path begins and ends at rest.

    Raises
    ------
    InputError
        If the motion does not move.

    """
    # Cut at the rests, and leave out what does not move.
    cuts = rests(motion)
    parts = []
    for k, (begin, end) in enumerate(pairwise(cuts)):
        parts.append(Part(motion, begin, end, (k > 0, k < len(cuts) - 2)))
    total = sum(part.length for part in parts)
    parts = [part for part in parts if part.length > 1e-12 * total]
    if not parts:
        raise InputError(f'path: rests at {motion.positions[0].tolist()}; expected a '
                         'path that moves')
    # At a rest the path begins as a power of s; where it moves through an end, as s.
    sampled = []
    for k, part in enumerate(parts):
        from_rest = k > 0 or ends[0]
        to_rest = k < len(parts) - 1 or ends[1]
        first_order = order if from_rest else 1
        last_order = order if to_rest else 1
        intervals = max(FEWEST, round(points * part.length / total))
        sampled.append(part.sampled(intervals, first_order, last_order))
    return sampled


class Part:
    """The part of a motion between two rests, or to an end that moves."""

    def __init__(self, motion: Motion, begin: float, end: float,
                 at_rests: tuple[bool, bool]) -> None:
        self.motion, self.begin, self.end, self.rests = motion, begin, end, at_rests
        self.span = end - begin
        self.coefficients = np.ascontiguousarray(motion.coefficients)
        # The segments of the motion that the part touches, cut at its begin and end.
        first = int(np.searchsorted(motion.times, begin, 'right')) - 1
        last = int(np.searchsorted(motion.times, end))
        knots = motion.times[first:last + 1]
        ends = np.concatenate([[begin], knots[1:-1], [end]])
        lengths = ends[1:] - ends[:-1]
        # Intervals on which the parameter is computed, none across a point of the
        # motion.
        varied = np.empty(last - first)
        by_segment, by_interval, _ = segment_kernels(motion.n)
        by_segment.run([self.coefficients[first:last]], varied, len(varied))
        # More intervals where a segment is long or its speed varies.
        counts = FINER + (MESH / self.span * lengths + VARIED * varied).astype(np.intp)
        number = np.arange(len(counts)).repeat(counts)
        self.segment = number + first
        # For each segment: begin, interval length, number of earlier intervals, offset
        # of the begin within the segment, and 1 / duration.
        segments = np.empty((len(counts), 5))
        segments[:, 0] = ends[:-1] - begin
        segments[:, 1] = lengths / counts
        segments[:, 2] = counts.cumsum() - counts
        segments[:, 3] = ends[:-1] - knots[:-1]
        segments[:, 4] = 1.0 / (knots[1:] - knots[:-1])
        self.intervals = np.empty((len(number), LENGTH + 1))
        inputs = [np.arange(float(len(number))), segments, self.coefficients]
        numbers = {'segment': number, 'coefficients': self.segment}
        by_interval.run(inputs, self.intervals, len(number), numbers)
        # The length of arc at each interval's end, as parameter of the path.
        self.arc = np.zeros(len(number) + 1)
        self.intervals[:, LENGTH].cumsum(out=self.arc[1:])
        self.length = float(self.arc[-1])

    def sampled(self, intervals: int, first: int, last: int) -> Section:
        """Return the section with orders `first` and `last` at its ends."""
        # Places at the ends of the intervals and in their middle.
        s = np.arange(2 * intervals + 1) / (2 * intervals)
        before_end = math.nextafter(self.end, -math.inf)
        first_speed = self.intervals[0, FIRST_SPEED]
        last_speed = self.intervals[-1, LAST_SPEED]
        begin_power = self._power(self.begin, first_speed, self.rests[0])
        end_power = self._power(before_end, last_speed, self.rests[1])
        # s^a / (s^a + (1 - s)^b) is 0 and 1 at the ends, and of the stated orders there.
        left = s**(first / begin_power)
        right = (1.0 - s)**(last / end_power)
        q = self._positions(left / (left + right))
        columns = q.T.copy()  # whose rows are reduced ten times as fast
        lowest = columns.min(axis=1)
        highest = columns.max(axis=1)
        # Joints that move by rounding alone stand still, so that they limit nothing.
        ranges = highest - lowest
        still = ranges <= STILL * ranges.max()
        if still.any():
            q[:, still] = q[0, still]
        # Derivatives with respect to s by a spline, with one-sided differences at both
        # ends.
        begin_slope = _end_slope(q[:4], STEP, first, still)
        end_slope = _end_slope(q[:-5:-1], -STEP, last, still)
        derivatives = spline_derivatives(q, STEP, begin_slope, end_slope)
        return Section(q, *derivatives, lowest, highest, self.span)

    def _power(self, t: float, speed: float, at_rest: bool) -> int:
        """Return the exponent p of s ~ t^p near an end: 1, 2, or 3 from rest."""
        if not at_rest and speed * self.span > AT_REST * self.length:
            return 1
        udot = self.motion.sample(t)[2]
        return 2 if np.abs(udot).max() * self.span**2 > 1e-6 * self.length else 3

    def _positions(self, share: Array) -> Array:
        """Return q at increasing shares, from 0 to 1, of the mean of time and length."""
        # The place is the mean of time and arc length, each from 0 to 1; within an
        # interval the share is inverted by a kernel.
        by_time, by_length = 0.5 / self.span, 0.5 / self.length
        mean = by_length * self.arc
        mean[:-1] += by_time * self.intervals[:, BEGIN]
        mean[-1] += 0.5
        interval = _intervals_of(share, mean)
        numbers: dict[str, Segments] = dict.fromkeys(
            ('before', 'following', 'interval'), interval)
        numbers['coefficients'] = self.segment[interval]
        inputs = [share, mean, mean[1:], self.intervals, self.coefficients,
                  np.array([by_time, by_length])]
        q = np.empty((len(share), self.motion.n))
        segment_kernels(self.motion.n)[2].run(inputs, q, len(q), numbers)
        return q


def _intervals_of(share: Array, mean: Array) -> Segments:
    """Return the interval of each of increasing shares; `mean` are their ends."""
    first = np.zeros(len(mean), dtype=np.intp)
    first[1:-1] = share.searchsorted(mean[1:-1])
    first[-1] = len(share)
    return np.arange(len(mean) - 1).repeat(first[1:] - first[:-1])


def _end_slope(q: Array, step: float, order: int, still: Flags) -> Array:
    """Return dq/ds at the first of four rows, by differences of third order."""
    if order != 1:
        return np.zeros(len(still))
    slope = np.array([-11.0, 18.0, -9.0, 2.0]) / (6.0 * step) @ q
    return np.where(still, 0.0, slope)


@cache
def segment_kernels(n: int) -> tuple[Kernel, Kernel, Kernel]:
    """
    Return the kernels of a segment, of an interval of a part, and of positions in it.

    The first one's result is how much the speed varies within a segment, from 0 for not
    at all to 1.
    """
    def speed(coefficients: Matrix, x: Scalar) -> Scalar:
        """Return the speed at the fraction x of a segment, times its duration."""
        # Horner's scheme of the derivative of the quintic.
        u = 5.0 * coefficients[5]
        for k in (4, 3, 2, 1):
            u = k * coefficients[k] + x * u
        return np.sqrt(u @ u)

    def variation(coefficients: Matrix) -> Scalar:
        speeds = [speed(coefficients, x) for x in (0.0, 0.5, 1.0)]
        high = largest(speeds)
        low = -largest([-value for value in speeds])
        return (high - low) / select(high > 0.0, high, 1.0)

    def intervals(number: Scalar, segment: Vector, coefficients: Matrix) -> Vector:
        begin, step, first, inside, rate = segment
        since = step * (number[()] - first)
        width = step * rate
        place = (inside + since) * rate
        speeds = []
        for part in (0.0, 0.5, 1.0):
            speeds.append(speed(coefficients, place + part * width) * rate)
        length = step / 6.0 * (speeds[0] + 4.0 * speeds[1] + speeds[2])  # Simpson's rule
        return np.array([begin + since, place, width, step, speeds[0], speeds[2],
                         length])

    def positions(share: Scalar, before: Scalar, following: Scalar, interval: Vector,
                  coefficients: Matrix, scales: Vector) -> Vector:
        _, begin, width, step, *speeds, _ = interval
        rise = following[()] - before[()]
        z = (share[()] - before[()]) / rise
        z = select(z < 1.0, z, 1.0)  # also of an interval of no length
        # The fraction of the time as a cubic of that of the share, with its end slopes.
        a, b = (rise / (step * (scales[0] + scales[1] * speed)) for speed in speeds)
        part = z * (a + z * (3.0 - 2.0 * a - b + z * (a + b - 2.0)))
        part = select(part < 0.0, 0.0, select(part > 1.0, 1.0, part))
        x, q = begin + width * part, 0.0
        for row in coefficients[::-1]:
            q = row + x * q
        return q
    coefficients = ('coefficients', (6, n))
    of_interval = [('number', ()), ('segment', (5,)), coefficients]
    of_position = [('share', ()), ('before', ()), ('following', ()), ('interval', (7,)),
                   coefficients, ('scales', (2,))]
    return (batch_kernel('path_variation', variation, [coefficients], ()),
            batch_kernel('path_intervals', intervals, of_interval, (7,)),
            batch_kernel('path_positions', positions, of_position, (n,)))
