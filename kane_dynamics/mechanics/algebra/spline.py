"""Piecewise polynomials: cubic and quintic segments, and velocities of a cubic spline."""

from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.checks import constant
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.user_functions import Unknown
import numpy as np

MOST_PIECES = 5000  # of a traced polynomial: each call compares the argument with every piece

# Coefficients in x = (t - t0) / h of the quintic with given q, h u, h^2 udot at x = 0 and x = 1.
_QUINTIC = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                     [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
                     [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
                     [-10.0, -6.0, -1.5, 10.0, -4.0, 0.5],
                     [15.0, 8.0, 1.5, -15.0, 7.0, -1.0],
                     [-6.0, -3.0, -0.5, 6.0, -3.0, 0.5]])
# The same for the cubic with given q and h u at both ends.
_CUBIC = np.array([[1.0, 0.0, 0.0, 0.0],
                   [0.0, 1.0, 0.0, 0.0],
                   [-3.0, -2.0, 3.0, -1.0],
                   [2.0, 1.0, -2.0, 1.0]])


def spline_velocities(t: Array, q: Array, first: Array) -> Array:
    """
    Return the velocities, (K, n), for which udot is continuous at all inner points.

    The velocity is `first` at the first point and zero at the last. The inner velocities solve
    the tridiagonal, diagonally dominant system
    ``u[i-1] / h[i-1] + 2 (1 / h[i-1] + 1 / h[i]) u[i] + u[i+1] / h[i]
    = 3 (dq[i-1] / h[i-1]^2 + dq[i] / h[i]^2)`` by Thomas' elimination.
    """
    count = len(t)
    u = np.zeros_like(q)
    if count < 2:
        return u
    u[0] = first
    r = 1.0 / np.diff(t)
    slope = 3.0 * np.diff(q, axis=0) * (r * r)[:, None]
    ratio = np.zeros(count)  # upper diagonal after elimination
    for i in range(1, count - 1):
        pivot = 2.0 * (r[i - 1] + r[i]) - r[i - 1] * ratio[i - 1]
        ratio[i] = r[i] / pivot
        u[i] = (slope[i - 1] + slope[i] - r[i - 1] * u[i - 1]) / pivot
    for i in range(count - 2, 0, -1):
        u[i] -= ratio[i] * u[i + 1]
    return u


def segment_coefficients(t: Array, q: Array, u: Array, udot: Array | None) -> Array:
    """Return the polynomial coefficients of all segments in x from 0 to 1, (K - 1, 6, n)."""
    h = np.diff(t)[:, None]
    ends = [q[:-1], h * u[:-1], q[1:], h * u[1:]]
    if udot is not None:
        ends = [q[:-1], h * u[:-1], h * h * udot[:-1], q[1:], h * u[1:], h * h * udot[1:]]
    basis = _CUBIC if udot is None else _QUINTIC
    out = np.zeros((len(t) - 1, 6, q.shape[1]))
    out[:, :len(basis)] = np.einsum('pe,esn->spn', basis, np.array(ends))
    return out


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
        table = np.column_stack([self.times[:-1], 1.0 / np.diff(self.times), self.coefficients])
        chosen = list(table[0])
        for start, row in zip(self.times[1:-1], table[1:]):
            later = t >= start
            chosen = [np.where(later, value, before) for value, before in zip(row, chosen)]
        x = (t - chosen[0]) * chosen[1]
        value = chosen[-1]
        for coefficient in chosen[-2:1:-1]:
            value = value * x + coefficient
        return value


def clamped_spline(times: Any, positions: Any) -> PiecewisePolynomial:
    """Check the times and return the cubic spline through a table, at rest at both ends."""
    t = constant(times, (np.size(times),), 'times')
    q = constant(positions, t.shape, 'positions')
    if len(t) < 2 or len(t) > MOST_PIECES or not (np.diff(t) > 0.0).all():
        raise InputError(f'times: {len(t)}, from {t[:1].tolist()} to {t[-1:].tolist()}; '
                         f'expected 2 to {MOST_PIECES}, strictly increasing')
    u = spline_velocities(t, q[:, None], np.zeros(1))
    return PiecewisePolynomial(t, segment_coefficients(t, q[:, None], u, None)[:, :, 0])
