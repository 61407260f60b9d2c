"""
The desired motion: a smooth curve through the points of a joint trajectory.

Interpolation follows joint_trajectory_controller: points with velocities are joined by cubics,
points with accelerations too by quintics. Points with positions only, which that controller joins
by straight lines, become one cubic spline here, because a feedforward torque needs accelerations.
"""

from bisect import bisect_right
from collections.abc import Sequence
import math

from kane_dynamics._util.checks import finite_row
from kane_dynamics._util.text import short
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.motion.spline import segment_coefficients, spline_velocities
import numpy as np
from numpy.typing import ArrayLike

Start = tuple[ArrayLike, ArrayLike | None, ArrayLike | None]
State = tuple[Array, Array, Array]


class Motion:
    """
    A desired motion q(t), u(t), udot(t) of named joints; immutable.

    Outside its points it stands still, at the nearest. Make one with `Motion.from_points`.

    Attributes
    ----------
    joint_names : tuple of str
    times : (K,) array
        Of the points, s from the beginning of the motion.
    positions : (K, n) array
        Of the points, rad or m.
    duration : float
        Time of the last point, s.

    """

    def __init__(self, joint_names: tuple[str, ...], times: Array, positions: Array,
                 coefficients: Array) -> None:
        """Take checked arrays; `coefficients` is (K - 1, 6, n), in each segment's own x."""
        self.joint_names = joint_names
        self.times = times
        self.positions = positions
        self.duration = float(times[-1])
        self._n = len(joint_names)
        # A row of powers times one (6, 3 n) matrix gives q, u and udot: fast at a single time.
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
        Return the motion through points, by the rules of joint_trajectory_controller.

        Parameters
        ----------
        times : (K,) array_like
            s from the beginning of the motion; not negative, strictly increasing, K >= 1.
        positions : (K, n) array_like
            rad or m. Alone: one cubic spline with continuous udot, at rest at both ends (or with
            the velocity of `start`).
        velocities : (K, n) array_like, optional
            rad/s or m/s: cubic Hermite segments, udot may jump at points. No rows, or only empty
            ones, are the same as None.
        accelerations : (K, n) array_like, optional
            rad/s^2 or m/s^2, only with velocities: quintic segments.
        joint_names : sequence of str
            Names of the columns.
        order : sequence of str, optional
            The joints that the motion shall have, in this order; columns that it does not name
            are left out. Default: `joint_names`.
        start : (q, u, udot), optional
            State at time 0, in the order of the motion, from which the first point is approached
            if its time is positive; u and udot may be None (rest). Without it the motion waits
            at the first point until that point's time.

        Raises
        ------
        InputError
            Names the point, the joint, the value and what is expected.

        """
        given = _names(joint_names, 'joint_names')
        names = given if order is None else _names(order, 'order')
        lacking = [name for name in names if name not in given]
        if lacking:
            raise InputError(f'the motion lacks the joints {lacking}; it names {list(given)}')
        columns = [given.index(name) for name in names]
        t = _times(times)
        rows = [_rows(values, what, len(t), given) for values, what in (
            (positions, 'positions'), (velocities, 'velocities'),
            (accelerations, 'accelerations'))]
        if rows[0] is None:
            raise InputError(f'positions is empty; every point needs those of {list(given)}')
        if rows[2] is not None and rows[1] is None:
            raise InputError('accelerations are given without velocities; give both or neither')
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
        raise InputError(f'the motion, up to {np.abs(q).max():g}, leaves the finite numbers')

    def scaled(self, speed: float) -> 'Motion':
        """
        Return the motion along the same path at another speed: q(speed t).

        Parameters
        ----------
        speed : float
            2 is twice as fast; positive.

        Raises
        ------
        InputError
            The speed is not a positive number, or leaves no time between two points.

        """
        if not 0.0 < speed < math.inf:
            raise InputError(f'speed is {speed}; expected a positive, finite number')
        times = _times(self.times / speed)
        return Motion(self.joint_names, times, self.positions, self._table[..., :self._n].copy())

    def sample(self, t: ArrayLike) -> State:
        """
        Return q, u, udot at time t from the beginning of the motion.

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
                raise InputError(f't is {t}; expected a finite time in s')
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
            raise InputError(f't has shape {t.shape}; expected one axis of finite times in s')
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
    """Return unique joint names as a tuple, or raise InputError."""
    names = tuple(names)
    if not names or not all(isinstance(name, str) for name in names) or (
            len(set(names)) != len(names)):
        raise InputError(f'{what} is {list(names)}; expected one or more different joint names')
    return names


def _times(times: ArrayLike) -> Array:
    """Return the times of the points as a (K,) array, or raise InputError."""
    try:
        t = np.array(times, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f'times is {times!r}; expected one number a point, in s') from None
    if t.ndim != 1 or not len(t):
        raise InputError(f'times has shape {t.shape}; expected one number a point, and at least '
                         'one point')
    for i, value in enumerate(t.tolist()):
        if not math.isfinite(value) or value < 0.0:
            raise InputError(f'point {i}: time is {value} s; expected a finite time >= 0 s')
        if i and value <= t[i - 1]:
            raise InputError(f'point {i}: time is {value} s; expected more than the {t[i - 1]} s '
                             f'of point {i - 1}')
    return t


def _rows(values: Sequence[ArrayLike] | ArrayLike | None, what: str, count: int,
          names: tuple[str, ...]) -> Array | None:
    """Return one row a point as a (K, n) array, None if nothing is given, or raise InputError."""
    if values is None:
        return None
    try:
        listed = [np.array(row, dtype=np.float64) for row in values]  # type: ignore[union-attr]
    except (TypeError, ValueError):
        raise InputError(f'{what} is {values!r}; expected one row of {len(names)} numbers a point '
                         f'({", ".join(names)})') from None
    if all(row.size == 0 for row in listed):
        return None
    if len(listed) != count:
        raise InputError(f'{what} has {len(listed)} rows; expected {count}, one a time')
    return np.array([finite_row(row, f'point {i}: {what}', names) for i, row in enumerate(listed)])


def _start(start: Start, names: tuple[str, ...]) -> State:
    """Return the state before the first point as three (n,) arrays, or raise InputError."""
    q, u, udot = start
    rest = np.zeros(len(names))
    return (finite_row(q, 'start: positions', names),
            finite_row(rest if u is None else u, 'start: velocities', names),
            finite_row(rest if udot is None else udot, 'start: accelerations', names))
