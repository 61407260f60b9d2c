"""Piecewise polynomials: cubic and quintic segments, and velocities of a cubic spline."""

from kane_dynamics._util.typing import Array
import numpy as np

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
