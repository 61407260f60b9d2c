"""
Desired motion: a smooth curve through the points of a joint trajectory.

Interpolation follows joint_trajectory_controller: cubic segments for points with velocities,
quintic segments for points with velocities and accelerations. Points with positions only, which
that controller interpolates linearly, give a cubic spline here, because a feedforward torque needs
accelerations.
"""

from bisect import bisect_right
from collections.abc import Sequence
import math

from kane_dynamics._util.attribute_hints import fixed
from kane_dynamics._util.checks import finite_row
from kane_dynamics._util.text import short
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.spline import (MOST_PIECES, PiecewisePolynomial,
                                                    segment_coefficients, spline_velocities)
import numpy as np
from numpy.typing import ArrayLike

Start = tuple[ArrayLike, ArrayLike | None, ArrayLike | None]
State = tuple[Array, Array, Array]


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
                 coefficients: Array) -> None:
        """Store checked arrays; `coefficients` is (K - 1, 6, n), in x from 0 to 1 per segment."""
        self.joint_names = joint_names
        self.times = times
        self.positions = positions
        self.duration = float(times[-1])
        self._n = len(joint_names)
        # One (6, 3 n) matrix per segment gives q, u and udot, which is fast for a single time.
        h = np.diff(times)[:, None, None]
        power = np.arange(6.0)[:, None]
        first, second = np.zeros_like(coefficients), np.zeros_like(coefficients)
        first[:, :5] = (power * coefficients)[:, 1:] / h
        second[:, :5] = (power * first)[:, 1:] / h
        self._table = np.concatenate([coefficients, first, second], axis=2)
        self._knots: list[float] = times.tolist()
        self._inverse_h: list[float] = (1.0 / h).ravel().tolist()
        for array in (times, positions, self._table):
            array.flags.writeable = False

    def __repr__(self) -> str:
        """Return size and joints on one line."""
        return (f'<Motion through {len(self.times)} points in {self.duration:g} s of '
                f'{short(self.joint_names)}>')

    @property
    def n(self) -> int:
        """Return the number of joints."""
        return self._n

    @classmethod
    def from_points(cls, times: ArrayLike, positions: Sequence[ArrayLike] | ArrayLike,
                    velocities: Sequence[ArrayLike] | ArrayLike | None = None,
                    accelerations: Sequence[ArrayLike] | ArrayLike | None = None, *,
                    joint_names: Sequence[str], order: Sequence[str] | None = None,
                    start: Start | None = None) -> 'Motion':
        """
        Return the motion through points, interpolated as joint_trajectory_controller does.

        Parameters
        ----------
        times : (K,) array_like
            s from the start of the motion; nonnegative, strictly increasing, K >= 1.
        positions : (K, n) array_like
            rad or m. Without velocities: a cubic spline with continuous udot, at rest at both
            ends (or with the velocity of `start`).
        velocities : (K, n) array_like, optional
            rad/s or m/s. Gives cubic Hermite segments; udot may jump at points. No rows, or only
            empty rows, are treated as None.
        accelerations : (K, n) array_like, optional
            rad/s^2 or m/s^2, only with velocities. Gives quintic segments.
        joint_names : sequence of str
            Names of the columns.
        order : sequence of str, optional
            The joints of the motion, in this order; other columns are ignored. Default:
            `joint_names`.
        start : (q, u, udot), optional
            State at time 0, in the order of the motion; u and udot may be None (rest). The
            motion begins there if the time of the first point is positive. Without it the
            motion rests at the first point until that point's time.

        Raises
        ------
        InputError
            If an argument is invalid; the message names the point, the joint and the value.

        """
        given = _names(joint_names, 'joint_names')
        names = given if order is None else _names(order, 'order')
        lacking = [name for name in names if name not in given]
        if lacking:
            raise InputError(f'motion: joints {list(given)}; expected {lacking} too')
        columns = [given.index(name) for name in names]
        t = _times(times)
        rows = [_rows(values, what, len(t), given) for values, what in (
            (positions, 'positions'), (velocities, 'velocities'),
            (accelerations, 'accelerations'))]
        if rows[0] is None:
            raise InputError(f'positions: none; expected one row per point for {list(given)}')
        if rows[2] is not None and rows[1] is None:
            raise InputError('accelerations: given without velocities; expected both or neither')
        q = rows[0][:, columns]
        u, udot = (None if row is None else row[:, columns] for row in rows[1:])
        rest = np.zeros(len(names))
        if start is not None and t[0] > 0.0:
            first = _start(start, names)
            t = np.concatenate([[0.0], t])
            q = np.vstack([first[0], q])
            u = None if u is None else np.vstack([first[1], u])
            udot = None if udot is None else np.vstack([first[2], udot])
            rest = first[1]
        with np.errstate(over='ignore', invalid='ignore'):
            u = spline_velocities(t, q, rest) if u is None else u
            motion = cls(names, t, q, segment_coefficients(t, q, u, udot))
        if np.isfinite(motion._table).all():
            return motion
        raise InputError(f'motion: positions up to {np.abs(q).max():g} overflow; expected a '
                         'finite motion')

    def scaled(self, speed: float) -> 'Motion':
        """
        Return the motion along the same path, scaled in time: q(speed t).

        Parameters
        ----------
        speed : float
            Factor on the velocities, positive; 2 is twice as fast.

        Raises
        ------
        InputError
            If the speed is not a positive, finite number, or two points get the same time.

        """
        if not 0.0 < speed < math.inf:
            raise InputError(f'speed: {speed}; expected a positive, finite number')
        times = _times(self.times / speed)
        return Motion(self.joint_names, times, self.positions, self._table[..., :self._n].copy())

    def joint_polynomial(self, joint: str) -> PiecewisePolynomial:
        """Return the position of one joint as a function over any scalar, for `Prescribed`."""
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
        if not isinstance(t, float | int):
            array = np.asarray(t, dtype=np.float64)
            if array.ndim:
                return self._sample_many(array)
            t = float(array)
        n = self._n
        knots = self._knots
        if not knots[0] <= t < knots[-1]:
            if not math.isfinite(t):
                raise InputError(f't: {t}; expected a finite time in s')
            return self.positions[0 if t < knots[0] else -1].copy(), np.zeros(n), np.zeros(n)
        k = bisect_right(knots, t) - 1
        x = (t - knots[k]) * self._inverse_h[k]
        x2 = x * x
        x3 = x2 * x
        state = np.array((1.0, x, x2, x3, x2 * x2, x2 * x3)).dot(self._table[k])
        return state[:n], state[n:2 * n], state[2 * n:]

    def _sample_many(self, t: Array) -> State:
        """Return (K, n) arrays for a (K,) array of times."""
        if t.ndim != 1 or not np.isfinite(t).all():
            raise InputError(f't: shape {t.shape}; expected one axis of finite times in s')
        out = np.zeros((len(t), 3 * self._n))
        inside = (t >= self.times[0]) & (t < self.times[-1])
        out[:, :self._n] = self.positions[np.where(t < self.times[0], 0, -1)]
        if inside.any():
            k = np.searchsorted(self.times, t[inside], side='right') - 1
            x = ((t[inside] - self.times[k]) * np.take(self._inverse_h, k))[:, None]
            value = self._table[k, 5]
            for power in (4, 3, 2, 1, 0):
                value = value * x + self._table[k, power]
            out[inside] = value
        q, u, udot = (np.ascontiguousarray(part) for part in np.split(out, 3, axis=1))
        return q, u, udot


def _names(names: Sequence[str], what: str) -> tuple[str, ...]:
    """Return the joint names as a tuple; raise InputError if empty or not unique."""
    names = tuple(names)
    if not names or not all(isinstance(name, str) for name in names) or (
            len(set(names)) != len(names)):
        raise InputError(f'{what}: {list(names)}; expected one or more different joint names')
    return names


def _times(times: ArrayLike) -> Array:
    """Return the times of the points as a (K,) array; raise InputError if invalid."""
    try:
        t = np.array(times, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f'times: {times!r}; expected one number per point, in s') from None
    if t.ndim != 1 or not len(t):
        raise InputError(f'times: shape {t.shape}; expected one number per point, and at least '
                         'one point')
    for i, value in enumerate(t.tolist()):
        if not math.isfinite(value) or value < 0.0:
            raise InputError(f'point {i}: time {value} s; expected a finite time >= 0 s')
        if i and value <= t[i - 1]:
            raise InputError(f'point {i}: time {value} s; expected more than the {t[i - 1]} s '
                             f'of point {i - 1}')
    return t


def _rows(values: Sequence[ArrayLike] | ArrayLike | None, what: str, count: int,
          names: tuple[str, ...]) -> Array | None:
    """Return one row per point as a (K, n) array, or None if there are no values."""
    if values is None:
        return None
    try:
        listed = [np.array(row, dtype=np.float64) for row in values]  # type: ignore[union-attr]
    except (TypeError, ValueError):
        raise InputError(f'{what}: {values!r}; expected one row of {len(names)} numbers per point '
                         f'({", ".join(names)})') from None
    if all(row.size == 0 for row in listed):
        return None
    if len(listed) != count:
        raise InputError(f'{what}: {len(listed)} rows; expected {count}, one per time')
    return np.array([finite_row(row, f'point {i}: {what}', names) for i, row in enumerate(listed)])


def _start(start: Start, names: tuple[str, ...]) -> State:
    """Return the start state as three (n,) arrays; raise InputError if invalid."""
    q, u, udot = start
    rest = np.zeros(len(names))
    return (finite_row(q, 'start: positions', names),
            finite_row(rest if u is None else u, 'start: velocities', names),
            finite_row(rest if udot is None else udot, 'start: accelerations', names))
