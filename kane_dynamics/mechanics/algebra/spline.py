"""Piecewise polynomials: cubic and quintic segments, velocities of a cubic spline."""

from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.checks import constant
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.user_functions import Unknown
import numpy as np

# Of a traced polynomial: each call compares the argument with every piece.
MOST_PIECES = 5000

FEW = 16  # unknowns of a tridiagonal system that is solved as a full matrix

# Coefficients in x = (t - t0) / h of the quintic with given q, h u and h^2 udot, all at
# x = 0, then at x = 1.
_QUINTIC = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                     [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
                     [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
                     [-10.0, -6.0, -1.5, 10.0, -4.0, 0.5],
                     [15.0, 8.0, 1.5, -15.0, 7.0, -1.0],
                     [-6.0, -3.0, -0.5, 6.0, -3.0, 0.5]])
# The same with the difference of q at both ends in place of q at x = 1.
_BY_RISE = np.column_stack([np.eye(6)[0], _QUINTIC[:, 1:]])
# The same for the cubic with given q and h u at both ends.
_CUBIC = np.array([[1.0, 0.0, 0.0, 0.0],
                   [0.0, 1.0, 0.0, 0.0],
                   [-3.0, -2.0, 3.0, -1.0],
                   [2.0, 1.0, -2.0, 1.0]])


def spline_velocities(t: Array, q: Array, first: Array) -> Array:
    """
    Return the velocities, (K, n), for which udot is continuous at all inner points.

    The velocity is `first` at the first point and zero at the last. The inner velocities
    solve the tridiagonal, diagonally dominant system
    ``u[i-1] / h[i-1] + 2 (1 / h[i-1] + 1 / h[i]) u[i] + u[i+1] / h[i]
    = 3 (dq[i-1] / h[i-1]^2 + dq[i] / h[i]^2)``.
    """
    u = np.zeros_like(q)
    if len(t) < 2:
        return u
    u[0] = first
    if len(t) > 2:
        # The rows of the inner points; the known first velocity goes to the right.
        r = 1.0 / np.diff(t)[:, None]
        slope = 3.0 * np.diff(q, axis=0) * (r * r)
        right = slope[:-1] + slope[1:]
        right[0] -= r[0] * u[0]
        u[1:-1] = tridiagonal_solution(r[:-1], 2.0 * (r[:-1] + r[1:]), r[1:], right)
    return u


def tridiagonal_solution(a: Array, b: Array, c: Array, d: Array) -> Array:
    """
    Return x, (m, n), with ``a[i] x[i-1] + b[i] x[i] + c[i] x[i+1] = d[i]``.

    The system is diagonally dominant. By cyclic reduction: the equations with even
    numbers eliminate their unknowns from the others, which are half as many, until few
    are left. It needs a few operations on arrays where Thomas' elimination needs one for
    each row.

    Parameters
    ----------
    a, b, c : (m, 1) arrays
        Lower diagonal (its first entry is ignored), diagonal, and upper diagonal (its
        last entry is ignored).
    d : (m, n) array
        Right-hand sides.

    """
    count = len(b)
    if count <= FEW:
        matrix = np.zeros((count, count))
        diagonals = matrix.ravel()
        diagonals[::count + 1] = b[:, 0]
        diagonals[1::count + 1] = c[:-1, 0]
        diagonals[count::count + 1] = a[1:, 0]
        return np.asarray(np.linalg.solve(matrix, d))

    # Multiples of the rows before and after each odd row, which eliminate even unknowns.
    odd = slice(1, None, 2)
    previous = slice(0, count - 1, 2)
    following = slice(2, None, 2)
    down = a[odd] / b[previous]
    up = np.zeros_like(down)  # the last odd row may have no row after it
    up[:len(b[following])] = c[odd][:len(b[following])] / b[following]

    def after_odd(rows: Array) -> Array:
        """Return the row after each odd row; a row of zeros after the last."""
        if count % 2:
            return rows[following]
        return np.concatenate([rows[following], 0.0 * rows[:1]])

    # The system of the odd unknowns.
    lower = -down * a[previous]
    diagonal = b[odd] - down * c[previous] - up * after_odd(a)
    upper = -up * after_odd(c)
    right = d[odd] - down * d[previous] - up * after_odd(d)
    x = np.empty_like(d)
    x[odd] = tridiagonal_solution(lower, diagonal, upper, right)

    # Each even unknown from its own row.
    even = d[::2].copy()
    even[1:] -= a[following] * x[odd][:len(even) - 1]
    even[:len(x[odd])] -= c[previous] * x[odd]
    x[::2] = even / b[::2]
    return x


def segment_ends(t: Array, q: Array, u: Array, udot: Array | None) -> Array:
    """
    Return q, h u and h^2 udot at both ends of all segments, (6, K - 1, n).

    Without udot the shape is (4, K - 1, n).
    """
    h = (t[1:] - t[:-1])[:, None]
    if udot is None:
        return np.array([q[:-1], h * u[:-1], q[1:], h * u[1:]])
    return np.array([q[:-1], h * u[:-1], h * h * udot[:-1],
                     q[1:], h * u[1:], h * h * udot[1:]])


def segment_coefficients(t: Array, q: Array, u: Array, udot: Array | None) -> Array:
    """Return the coefficients of all segments in x from 0 to 1, (K - 1, 6, n)."""
    # Positions, scaled velocities and accelerations at both ends,
    # then their polynomial.
    ends = segment_ends(t, q, u, udot)
    basis = _CUBIC if udot is None else _QUINTIC
    size = len(basis)
    coefficients = (basis @ ends.reshape(size, -1)).reshape(ends.shape)
    result = np.zeros((len(t) - 1, 6, q.shape[1]))
    result[:, :size] = coefficients.swapaxes(0, 1)
    return result


def inside_segments(ends: Array, h: Array, x: Array) -> tuple[Array, Array, Array]:
    """
    Return q, u and udot inside quintic segments, (m, S, n) each.

    Parameters
    ----------
    ends : (6, S, n) array
        As `segment_ends` returns them.
    h : (S,) array
        Durations of the segments, s.
    x : (m,) array
        Fractions of the durations, from 0 to 1.

    """
    # Powers of x, and their first and second derivatives.
    powers = x[:, None] ** np.arange(6)
    first, second = np.zeros((2, *powers.shape))
    first[:, 1:] = np.arange(1, 6) * powers[:, :5]
    second[:, 2:] = np.arange(2, 6) * np.arange(1, 5) * powers[:, :4]
    known = ends.copy()
    # Rises, so that a joint that does not move has no velocity by rounding.
    known[3] -= known[0]

    def combined(factors: Array) -> Array:
        values = factors @ _BY_RISE @ known.reshape(6, -1)
        return np.asarray(values.reshape(len(x), *ends.shape[1:]))

    # Each time derivative divides by h.
    rate = (1.0 / h)[:, None]
    q = combined(powers)
    known *= rate
    u = combined(first)
    known *= rate
    udot = combined(second)
    return q, u, udot


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """
    Piecewise polynomial in time, constant before its first time and after its last.

    Parameters
    ----------
    times : (K,) array
        s, increasing.
    coefficients : (K - 1, 6) array
        Of each piece, in x from 0 to 1.

    """

    times: Array
    coefficients: Array

    def __call__(self, t: Any) -> Any:
        """Return the value at t, a number or an `Unknown`."""
        if not isinstance(t, Unknown):
            return self(Unknown(t)).inner
        t = np.clip(t, self.times[0], self.times[-1])
        rates = 1.0 / np.diff(self.times)
        table = np.column_stack([self.times[:-1], rates, self.coefficients])

        # The row of the piece at t: of the last one that begins before it.
        chosen = list(table[0])
        for start, row in zip(self.times[1:-1], table[1:]):
            later = t >= start
            chosen = [np.where(later, x, earlier) for x, earlier in zip(row, chosen)]
        start_time, rate, *coefficients = chosen

        # Its polynomial in x, by Horner's rule.
        x = (t - start_time) * rate
        value = coefficients[-1]
        for coefficient in reversed(coefficients[:-1]):
            value = value * x + coefficient
        return value


def clamped_spline(times: Any, positions: Any) -> PiecewisePolynomial:
    """Return the cubic spline through a checked table, at rest at both ends."""
    t = constant(times, (np.size(times),), 'times')
    q = constant(positions, t.shape, 'positions')
    if len(t) < 2 or len(t) > MOST_PIECES or not (np.diff(t) > 0.0).all():
        raise InputError(f'times: {len(t)}, from {t[:1].tolist()} to {t[-1:].tolist()}; '
                         f'expected 2 to {MOST_PIECES}, strictly increasing')
    column = q[:, None]
    u = spline_velocities(t, column, np.zeros(1))
    coefficients = segment_coefficients(t, column, u, None)
    return PiecewisePolynomial(t, coefficients[:, :, 0])
