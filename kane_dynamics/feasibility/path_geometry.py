"""
Geometric paths q(s) with derivatives, on the uniform grid on which they are timed.

A path is that of a motion, without its timing. It is cut where the motion rests or all joints
reverse at once, since direction and friction jump there, and at dwells, which are left out. The
parameter s of a section is a mean of the time and of the length of the motion, so that both slow
and fast parts have their share of the grid. At an end where the path is to rest s is chosen such
that q(s) - q(end) begins with the power `order` of s: with the second power, a motion from rest
with finite acceleration has a positive, finite s' there, and with the third one with finite jerk.
Between the samples the path is a cubic spline in s, through positions of the motion.
"""

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
import math
from typing import Any, NamedTuple

from kane_dynamics._util.checks import finite_row
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.spline import free_velocities, segment_coefficients
from kane_dynamics.motion.motion import Motion
from kane_dynamics.motion.rests import AT_REST, rests
from kane_dynamics.motion.uniform_spline import spline_derivatives
from kane_dynamics.native.runtime.batch_kernel import batch_kernel
from kane_dynamics.native.runtime.kernel import Kernel
import numpy as np
from numpy.typing import ArrayLike

CLOSE = 1e-6  # distance of waypoints that count as one, of the length of the path
MESH, FINER = 200, 4  # intervals on which the parameter is computed, and more per segment
STEP = 0.25  # of s between samples
STILL = 1e-13  # range of a joint that does not move, relative to the largest range
FEWEST = 50  # intervals of a section


class Section(NamedTuple):
    """
    A path q(s) from s = 0 to N / 2, at 2 N + 1 samples: N + 1 vertices and the middles between.

    Between vertices, at a distance of 1/2, a squared path velocity x = s'^2 increases by s''.

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

    The spline has the distance of the waypoints as its time, and is one cubic along its first
    two and last two intervals, so that its ends are as smooth as the rest. A waypoint nearer to
    the last one than `CLOSE` of the length of the path is left out, since a spline through close
    waypoints that rounding has moved swings far off. The path passes it at no more than that.

    Raises
    ------
    InputError
        If the waypoints are invalid; the message names the waypoint and the joint.

    """
    if isinstance(path, Motion):
        if path.joint_names != tuple(names):
            raise InputError(f'path: joints {list(path.joint_names)}; expected {list(names)}')
        return path
    points = _waypoints(path, names)
    steps = _lengths(points)
    least = CLOSE * float(steps.sum())
    q = points
    if len(points) and (steps <= least).any():
        q = _apart(points, least)
        steps = _lengths(q)
    if len(q) < 2:
        raise InputError(f'path: {len(q)} different waypoints; expected at least 2')
    times = np.concatenate([[0.0], np.cumsum(steps)])
    return Motion(tuple(names), times, q, segment_coefficients(
        times, q, free_velocities(times, q), None))


def _waypoints(path: ArrayLike, names: Sequence[str]) -> Array:
    """Return checked waypoints, (K, n)."""
    if isinstance(path, np.ndarray) and path.dtype == np.float64 and (
            path.shape[1:] == (len(names),) and np.isfinite(path).all()):
        return np.array(path, order='C')  # thousands of rows would take milliseconds one by one
    try:
        rows = list(path)  # type: ignore[arg-type]
    except TypeError:
        raise InputError(f'path: a {type(path).__name__}; expected a Motion or (K, n) waypoints'
                         ) from None
    checked = [finite_row(row, f'waypoint {k}', names) for k, row in enumerate(rows)]
    return np.array(checked).reshape(len(checked), len(names))


def _apart(points: Array, least: float) -> Array:
    """Return the first and the last of the points, and those between that are apart."""
    kept = [points[0]]
    for point in points[1:]:
        if math.dist(point, kept[-1]) > least:
            kept.append(point)
    if len(kept) > 1:  # the path ends at the last point, whatever is near it
        if math.dist(points[-1], kept[-1]) <= least:
            kept.pop()
        kept.append(points[-1])
    return np.array(kept)


def _lengths(points: Array) -> Array:
    """Return the distances between successive rows."""
    steps = points[1:] - points[:-1]
    return np.asarray(np.sqrt(np.einsum('ij,ij->i', steps, steps)))


def sections(motion: Motion, points: int, order: int, ends: tuple[bool, bool]) -> list[Section]:
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
    cuts = rests(motion)
    parts = [Part(motion, *cut, (k > 0, k < len(cuts) - 2)) for k, cut in enumerate(
        pairwise(cuts))]
    total = sum(part.length for part in parts)
    parts = [part for part in parts if part.length > 1e-12 * total]
    if not parts:
        raise InputError(f'path: rests at {motion.positions[0].tolist()}; expected a path that '
                         'moves')
    return [part.sampled(max(FEWEST, round(points * part.length / total)),
                         order if k or ends[0] else 1,
                         order if k < len(parts) - 1 or ends[1] else 1)
            for k, part in enumerate(parts)]


class Part:
    """The part of a motion between two rests, the first and the last of which may be none."""

    def __init__(self, motion: Motion, begin: float, end: float, rests: tuple[bool, bool]) -> None:
        self.motion, self.begin, self.end, self.rests = motion, begin, end, rests
        self.span, knots = end - begin, motion.times
        first, last = int(np.searchsorted(knots, begin, 'right')) - 1, int(np.searchsorted(
            knots, end))
        knots = knots[first:last + 1]
        ends = np.concatenate([[begin], knots[1:-1], [end]])
        lengths, rates = ends[1:] - ends[:-1], 1.0 / (knots[1:] - knots[:-1])
        counts = FINER + (MESH / self.span * lengths).astype(np.intp)
        # Intervals on which the parameter is computed, none of them across a point of the motion.
        own = np.repeat(np.arange(len(counts)), counts)
        segments = np.stack([ends[:-1] - begin, lengths / counts, np.cumsum(counts) - counts,
                             ends[:-1] - knots[:-1], rates], axis=1)
        self.segment, self.coefficients = own + first, np.ascontiguousarray(motion.coefficients)
        self.intervals = np.empty((len(own), 7))
        kernels(motion.n)[0].run(
            [np.arange(float(len(own))), segments, self.coefficients], self.intervals, len(own),
            {'segment': own, 'coefficients': self.segment})
        self.arc = np.zeros(len(own) + 1)
        np.cumsum(self.intervals[:, -1], out=self.arc[1:])
        self.length = float(self.arc[-1])

    def _power(self, t: float, speed: float, rest: bool) -> int:
        """Return the power of the time with which the path leaves an end."""
        if not rest and speed * self.span > AT_REST * self.length:
            return 1
        udot = self.motion.sample(t)[2]
        return 2 if np.abs(udot).max() * self.span**2 > 1e-6 * self.length else 3

    def sampled(self, intervals: int, first: int, last: int) -> Section:
        """Return the section with orders `first` and `last` at its ends."""
        s = np.arange(2 * intervals + 1) / (2 * intervals)
        alpha, beta = (order / self._power(t, speed, rest) for order, t, speed, rest in zip(
            (first, last), (self.begin, math.nextafter(self.end, -math.inf)),
            (self.intervals[0, 4], self.intervals[-1, 5]), self.rests))
        left, right = s**alpha, (1.0 - s)**beta
        q = self._positions(left / (left + right))
        columns = q.T.copy()  # whose rows are reduced ten times as fast
        lowest, highest = columns.min(axis=1), columns.max(axis=1)
        ranges = highest - lowest
        still = ranges <= STILL * ranges.max()
        if still.any():
            q[:, still] = q[0, still]
        slopes = [np.where(still, 0.0, _slope(rows, step)) if order == 1 else np.zeros(len(still))
                  for rows, step, order in ((q[:4], STEP, first), (q[:-5:-1], -STEP, last))]
        return Section(q, *spline_derivatives(q, STEP, *slopes), lowest, highest, self.span)

    def _positions(self, share: Array) -> Array:
        """Return q at increasing shares, from 0 to 1, of the mean of time and length."""
        scales = 0.5 / self.span, 0.5 / self.length
        mean = scales[0] * np.append(self.intervals[:, 0], self.span) + scales[1] * self.arc
        first = np.zeros(len(mean), dtype=np.intp)
        first[1:-1], first[-1] = np.searchsorted(share, mean[1:-1]), len(share)
        own = np.repeat(np.arange(len(mean) - 1), first[1:] - first[:-1])
        q = np.empty((len(share), self.motion.n))
        kernels(self.motion.n)[1].run(
            [share, mean, mean[1:], self.intervals, self.coefficients, np.array(scales)], q,
            len(q), {**dict.fromkeys(('before', 'after', 'interval'), own),
                     'coefficients': self.segment[own]})
        return q


def _slope(q: Array, step: float) -> Array:
    """Return dq/ds at the first of four rows, by differences of third order."""
    return np.asarray(np.array([-11.0, 18.0, -9.0, 2.0]) / (6.0 * step) @ q)


@cache
def kernels(n: int) -> tuple[Kernel, Kernel]:
    """
    Return the kernels of the intervals of a part, and of positions in them.

    The numbers of an interval are the time at its start, from that of the part, the fraction of
    the segment there, the interval's share of the segment, its duration, the speeds at both ends,
    and its length.
    """
    def intervals(number: Any, segment: Any, coefficients: Any) -> Any:
        begin, step, first, inside, rate = segment
        since, width, speeds = step * (number[()] - first), step * rate, []
        t, place = begin + since, (inside + since) * rate
        for part in (0.0, 0.5, 1.0):
            x, u = place + part * width, 5.0 * coefficients[5]
            for k in (4, 3, 2, 1):
                u = k * coefficients[k] + x * u
            speeds.append(np.sqrt(u @ u) * rate)
        return np.array([t, place, width, step, speeds[0], speeds[2],
                         step / 6.0 * (speeds[0] + 4.0 * speeds[1] + speeds[2])])

    def positions(share: Any, before: Any, after: Any, interval: Any, coefficients: Any,
                  scales: Any) -> Any:
        _, begin, width, step, *speeds, _ = interval
        rise = after[()] - before[()]
        z = (share[()] - before[()]) / rise
        z = select(z < 1.0, z, 1.0)  # also of an interval of no length
        a, b = (rise / (step * (scales[0] + scales[1] * speed)) for speed in speeds)
        part = z * (a + z * (3.0 - 2.0 * a - b + z * (a + b - 2.0)))
        part = select(part < 0.0, 0.0, select(part > 1.0, 1.0, part))
        x, q = begin + width * part, 0.0
        for row in coefficients[::-1]:
            q = row + x * q
        return q
    coefficients = ('coefficients', (6, n))
    return (batch_kernel('path_intervals', intervals, [
        ('number', ()), ('segment', (5,)), coefficients], (7,)),
            batch_kernel('path_positions', positions, [
                ('share', ()), ('before', ()), ('after', ()), ('interval', (7,)), coefficients,
                ('scales', (2,))], (n,)))
