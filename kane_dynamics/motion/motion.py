"""
Desired motion: a smooth curve through the points of a joint trajectory.

Interpolation follows joint_trajectory_controller: cubic segments for points with
velocities, quintic segments for points with velocities and accelerations. Points with
positions only, which that controller interpolates linearly, give a cubic spline here,
because a feedforward torque needs accelerations.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import cached_property
import math
from typing import NamedTuple

from kane_dynamics._util.checks import number
from kane_dynamics._util.fixed_attributes import fixed
from kane_dynamics._util.notebook import html_table
from kane_dynamics._util.text import short
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.spline import (MOST_PIECES, PiecewisePolynomial,
                                                    segment_coefficients,
                                                    spline_velocities)
from kane_dynamics.motion.points import (checked_joint_names, point_times, Start,
                                         start_state, State, trajectory_points)
import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ['Motion', 'Start', 'State']

SAMPLES = 500  # of a motion, for the table of a notebook
MANY = 20  # times per segment from which a product for each segment is faster


@fixed
class Motion:
    """
    Desired motion q(t), u(t), udot(t) of named joints; immutable.

    Before the first and after the last point the motion rests there. Create one with
    `Motion.from_points`.

    Attributes
    ----------
    joint_names : tuple of str
    times : (K,) array
        Times of the points, s from the start of the motion.
    positions : (K, n) array
        Positions of the points, rad or m.
    duration : float
        Time of the last point, s.

    """

    def __init__(self, joint_names: tuple[str, ...], times: Array, positions: Array,
                 coefficients: Array | Callable[[], Array]) -> None:
        """
        Store checked arrays; `coefficients` is (K - 1, 6, n), in x from 0 to 1.

        Instead of coefficients, a function may return them when they are needed.
        """
        self.joint_names = joint_names
        self.times = times
        self.positions = positions
        self.duration = float(times[-1])
        self._n = len(joint_names)
        self._coefficients = coefficients
        # Kernels read these arrays: they must not change.
        times.flags.writeable = False
        positions.flags.writeable = False
        if not callable(coefficients):
            coefficients.flags.writeable = False

    @cached_property
    def _table(self) -> Array:
        """One (6, 3 n) matrix per segment for q, u and udot, fast for a single time."""
        coefficients = self.coefficients
        n = self._n
        rate = (1.0 / np.diff(self.times))[:, None, None]  # dx/dt of each segment
        power = np.arange(1.0, 6.0)[:, None]
        table = np.zeros((len(rate), 6, 3 * n))
        table[:, :, :n] = coefficients
        # d/dt (c_k x^k) = k c_k x^(k-1) dx/dt, twice.
        np.multiply(coefficients[:, 1:], power * rate, out=table[:, :5, n:2 * n])
        np.multiply(table[:, 1:5, n:2 * n], power[:4] * rate, out=table[:, :4, 2 * n:])
        table.flags.writeable = False
        self._coefficients = table[:, :, :n]
        return table

    @property
    def coefficients(self) -> Array:
        """Return the coefficients of q in x, 0 to 1, of all segments, (K - 1, 6, n)."""
        # Read once, since another thread may replace it.
        coefficients = self._coefficients
        if callable(coefficients):
            coefficients = coefficients()
            coefficients.flags.writeable = False
            self._coefficients = coefficients
        return coefficients

    # Lists: their numbers are read faster than those of arrays.
    @cached_property
    def _knots(self) -> list[float]:
        return self.times.tolist()  # type: ignore[no-any-return]

    @cached_property
    def _rates(self) -> list[float]:
        return (1.0 / np.diff(self.times)).tolist()  # type: ignore[no-any-return]

    def __repr__(self) -> str:
        """Return size and joints on one line."""
        return (f'<Motion through {len(self.times)} points in {self.duration:g} s of '
                f'{short(self.joint_names)}>')

    def _repr_html_(self) -> str:
        """Return start, end and largest speed of each joint as a table for notebooks."""
        # Polynomials may be fastest between the points: sampled.
        largest_speeds = np.zeros(self._n)
        if len(self.times) > 1:
            t = np.linspace(self.times[0], self.times[-1], SAMPLES)
            largest_speeds = np.abs(self.velocities_at(t)).max(axis=0)
        columns = (self.joint_names, self.positions[0], self.positions[-1], largest_speeds)
        rows = [list(row) for row in zip(*columns)]
        headings = ['joint', 'start', 'end', 'largest speed']
        return html_table(repr(self)[1:-1], headings, rows)

    @property
    def n(self) -> int:
        """Return the number of joints."""
        return self._n

    @classmethod
    def from_points(cls, times: ArrayLike, positions: Sequence[ArrayLike] | ArrayLike,
                    velocities: Sequence[ArrayLike] | ArrayLike | None = None,
                    accelerations: Sequence[ArrayLike] | ArrayLike | None = None, *,
                    joint_names: Sequence[str], order: Sequence[str] | None = None,
                    start: Start | None = None) -> Motion:
        """
        Return the motion through points, as joint_trajectory_controller moves.

        Parameters
        ----------
        times : (K,) array_like
            s from the start of the motion; nonnegative, strictly increasing, K >= 1.
        positions : (K, n) array_like
            rad or m. Without velocities: a cubic spline with continuous udot, at rest at
            both ends (or with the velocity of `start`).
        velocities : (K, n) array_like, optional
            rad/s or m/s. Gives cubic Hermite segments; udot may jump at points. No rows,
            or only empty rows, are treated as None.
        accelerations : (K, n) array_like, optional
            rad/s^2 or m/s^2, only with velocities. Gives quintic segments.
        joint_names : sequence of str
            Names of the columns.
        order : sequence of str, optional
            The joints of the motion, in this order; other columns are ignored. Default:
            `joint_names`.
        start : (q, u, udot), optional
            State at time 0, in the order of the motion; u and udot may be None (rest).
            The motion begins there if the time of the first point is positive. Without
            it the motion rests at the first point until that point's time.

        Raises
        ------
        InputError
            If an argument is invalid; the message names the point, the joint and the
            value.

        """
        stated_names = checked_joint_names(joint_names, 'joint_names')
        names = stated_names if order is None else checked_joint_names(order, 'order')
        lacking = [name for name in names if name not in stated_names]
        if lacking:
            raise InputError(f'motion: joints {list(stated_names)}; expected {lacking} '
                             'too')

        # The columns in the order of the caller's joints.
        columns = list(map(stated_names.index, names))
        t, q, u, udot = trajectory_points(times, positions, velocities, accelerations,
                                          stated_names)
        q = q[:, columns]
        if u is not None:
            u = u[:, columns]
        if udot is not None:
            udot = udot[:, columns]

        # A start before the first point is one more point.
        first_velocity = np.zeros(len(names))
        if start is not None and t[0] > 0.0:
            q0, u0, udot0 = start_state(start, names)
            t = np.concatenate([[0.0], t])
            q = np.vstack([q0, q])
            if u is not None:
                u = np.vstack([u0, u])
            if udot is not None:
                udot = np.vstack([udot0, udot])
            first_velocity = u0
        # Numbers that overflow are found by their result.
        with np.errstate(over='ignore', invalid='ignore'):
            if u is None:
                u = spline_velocities(t, q, first_velocity)
            motion = cls(names, t, q, segment_coefficients(t, q, u, udot))
            finite = np.isfinite(motion._table).all()
        if not finite:
            raise InputError(f'motion: positions up to {np.abs(q).max():g} overflow; '
                             'expected a finite motion')
        return motion

    def scaled(self, speed: float) -> Motion:
        """
        Return the motion along the same path, scaled in time: q(speed t).

        Parameters
        ----------
        speed : float
            Factor on the velocities, positive; 2 is twice as fast.

        Raises
        ------
        InputError
            If the speed is not a positive, finite number, or two points get the same
            time.

        """
        speed = number(speed, 'speed', 'a positive, finite number',
                       lambda x: 0.0 < x < math.inf)
        times = point_times(self.times / speed)
        return Motion(self.joint_names, times, self.positions,
                      self._table[..., :self._n].copy())

    def joint_polynomial(self, joint: str) -> PiecewisePolynomial:
        """Return the position of a joint as a function over any scalar."""
        if joint not in self.joint_names:
            raise InputError(f"motion: no joint '{joint}'; expected one of "
                             f'{", ".join(self.joint_names)}')
        if not 2 <= len(self.times) <= MOST_PIECES:
            raise InputError(f'motion: {len(self.times)} points; expected 2 to '
                             f'{MOST_PIECES} for a prescribed joint')
        k = self.joint_names.index(joint)
        return PiecewisePolynomial(self.times, self._table[:, :, k])

    def sample(self, t: ArrayLike) -> State:
        """
        Return q, u, udot at time t from the start of the motion.

        Parameters
        ----------
        t : float or (K,) array_like
            s, finite.

        Returns
        -------
        q, u, udot : (n,) arrays, or (K, n) for an array of times

        """
        # Plain numbers take the short way below, since control asks every cycle.
        if not isinstance(t, float | int):
            try:
                array = np.asarray(t, dtype=np.float64)
            except (TypeError, ValueError):
                raise InputError(f't: {t!r}; expected a time in s, or (K,) '
                                 'times') from None
            if array.ndim:
                return self._sample_many(array)
            t = float(array)
        n = self._n
        knots = self._knots
        # Outside the motion it rests at its ends.
        if not knots[0] <= t < knots[-1]:
            if not math.isfinite(t):
                raise InputError(f't: {t}; expected a finite time in s')
            end = 0 if t < knots[0] else -1
            return self.positions[end].copy(), np.zeros(n), np.zeros(n)
        k = bisect_right(knots, t) - 1
        # A quintic polynomial of the share of the segment; its rates are rows of the
        # same table.
        x = (t - knots[k]) * self._rates[k]
        x2 = x * x
        x3 = x2 * x
        state = np.array((1.0, x, x2, x3, x2 * x2, x2 * x3)).dot(self._table[k])
        return state[:n], state[n:2 * n], state[2 * n:]

    def positions_at(self, t: Array) -> Array:
        """Return q, (K, n), at finite times t, (K,), s; faster than `sample`."""
        return self._values(t, 0, self._n)

    def velocities_at(self, t: Array) -> Array:
        """Return u, (K, n), at finite times t, (K,), s; faster than `sample`."""
        return self._values(t, self._n, 2 * self._n)

    def velocities_inside(self, x: Array) -> Array:
        """Return u, (K - 1, m, n), at the fractions x, (m,), of each segment."""
        rate = 1.0 / (self.times[1:] - self.times[:-1])[:, None, None]
        powers = np.arange(1.0, 6.0) * x[:, None] ** np.arange(5)
        return np.asarray(powers @ self.coefficients[:, 1:] * rate)

    def _sample_many(self, t: Array) -> State:
        """Return (K, n) arrays for a (K,) array of times."""
        if t.ndim != 1 or not np.isfinite(t).all():
            raise InputError(f't: shape {t.shape}; expected one axis of finite times in '
                             's')
        states = self._values(t, 0, 3 * self._n)
        q, u, udot = (np.ascontiguousarray(part) for part in np.split(states, 3, axis=1))
        return q, u, udot

    def _values(self, t: Array, begin: int, end: int) -> Array:
        """Return some columns of q, u and udot, (K, end - begin)."""
        inside = (t >= self.times[0]) & (t < self.times[-1])
        if not inside.all():
            # Outside it rests at its first or last point.
            states = np.zeros((len(t), 3 * self._n))
            states[:, :self._n] = self.positions[np.where(t < self.times[0], 0, -1)]
            columns = states[:, begin:end]
            if inside.any():
                columns[inside] = self._values(t[inside], begin, end)
            return columns
        k = np.searchsorted(self.times, t, side='right') - 1
        x = (t - self.times[k]) * np.take(self._rates, k)
        table = self._table[:, :, begin:end]
        if len(t) > MANY * len(table) and (k[1:] >= k[:-1]).all():
            ends = np.searchsorted(k, np.arange(len(table) + 1))
            return self._segment_by_segment(x, ends, table)
        # Horner's rule, with the coefficients of each time's segment.
        x = x[:, None]
        value = table[:, 5].take(k, axis=0)
        for power in (4, 3, 2, 1, 0):
            value *= x
            value += table[:, power].take(k, axis=0)
        return value

    @staticmethod
    def _segment_by_segment(x: Array, ends: NDArray[np.intp], table: Array) -> Array:
        """Return the polynomials of a table at many fractions x, segment by segment."""
        powers = np.ones((len(x), 6))
        for k in range(1, 6):
            np.multiply(powers[:, k - 1], x, out=powers[:, k])
        values = np.empty((len(x), table.shape[2]))
        for coefficients, begin, end in zip(table, ends, ends[1:]):
            np.matmul(powers[begin:end], coefficients, out=values[begin:end])
        return values


class SegmentTable(NamedTuple):
    """
    The segments of a motion as arrays, with a rest before and one after.

    Segment k is the one with k points not after its time; its fraction of time is
    ``x = (t - origins[k]) rates[k]``.

    Attributes
    ----------
    times : (K,) array
        Times of the points, s.
    origins, rates : (K + 1,) arrays
        Begin of each segment, s, and the inverse of its duration, 1/s; 0 at rest.
    rows : (K + 1, 6, 3 n) array
        Polynomials in x: coefficients of q, u and udot.

    """

    times: Array
    origins: Array
    rates: Array
    rows: Array


def segment_table(motion: Motion) -> SegmentTable:
    """Return the segments of a motion as arrays."""
    # One row more at either end: the motion rests before its begin and after its end.
    times = np.array(motion.times)
    count = len(times)
    rates = np.zeros(count + 1)
    rates[1:count] = 1.0 / np.diff(times)
    rows = np.zeros((count + 1, 6, 3 * motion.n))
    rows[0, 0, :motion.n] = motion.positions[0]
    rows[1:count] = motion._table
    rows[count, 0, :motion.n] = motion.positions[-1]
    return SegmentTable(times, np.concatenate([times[:1], times]), rates, rows)
