"""
Cubic splines through points at any distances, whose two cubics at each end are one.

At the inner points udot is continuous ("not-a-knot" spline). The velocities solve a
tridiagonal system, by Thomas' algorithm: the elimination from the first point to the
last, and the substitution back, are each a traced program of one point, repeated
natively.
"""

from functools import cache

from kane_dynamics._util.typing import Array, Matrix, Vector
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel, windows
import numpy as np


def free_eliminated(previous: Vector, t: Vector, q: Matrix) -> Vector:
    """
    Return the eliminated row of an inner point, (n + 1,), from the previous row.

    Rows are a factor f and values v with ``u + f u_following = v``. Of the point and its
    two neighbors, t (3,) and q (3, n) are times and positions. Continuous udot requires
    ``u[0] / h[0] + 2 (1 / h[0] + 1 / h[1]) u[1] + u[2] / h[1]
    = 3 (dq[0] / h[0]^2 + dq[1] / h[1]^2)``.
    """
    before = 1.0 / (t[1] - t[0])
    after = 1.0 / (t[2] - t[1])
    slopes = before * before * (q[1] - q[0]) + after * after * (q[2] - q[1])
    pivot = 1.0 / (2.0 * (before + after) - before * previous[0])
    values = pivot * (3.0 * slopes - before * previous[1:])
    return np.array([pivot * after, *values])


def free_substituted(row: Vector, following: Vector) -> Vector:
    """Return the velocities at a point, (n,), from those at the next one."""
    return row[1:] - row[0] * following


@cache
def free_kernels(n: int) -> tuple[Kernel, Kernel]:
    """Return the kernels of one point, for n joints."""
    row = ('row', (n + 1,))
    forward = batch_kernel('free_spline_eliminated', free_eliminated,
                           [('previous', (n + 1,)), ('t', (3,)), ('q', (3, n))],
                           (n + 1,))
    back = batch_kernel('free_spline_substituted', free_substituted,
                        [row, ('following', (n,))], (n,))
    return forward, back


def free_velocities(t: Array, q: Array) -> Array:
    """
    Return the velocities, (K, n), of a not-a-knot spline: one cubic for two intervals.

    With three points it is the parabola through them, with two the line.

    Parameters
    ----------
    t : (K,) array
        Times, increasing; C-contiguous, as is q.
    q : (K, n) array
        Positions.

    """
    count, n = q.shape
    if count < 4:
        return _few(t, q)
    # Where the two cubics at an end are one, h_beside u + (h + h_beside) u_beside is a
    # known condition. At the first point it is the first row.
    h_beside, both, condition = _end_condition(t[:3], q[:3])
    rows = np.empty((count, n + 1))
    rows[0, 0] = both / h_beside
    rows[0, 1:] = condition / h_beside
    forward, back = free_kernels(n)
    forward.scan([rows[:-2], windows(t, 3), windows(q, 3)], rows[1:-1])

    # At the last point, the row before it eliminates u_beside.
    h_beside, both, condition = _end_condition(t[:-4:-1], q[:-4:-1])
    factor, values = rows[-2, 0], rows[-2, 1:]
    u = np.empty_like(q)
    u[-1] = (condition - both * values) / (h_beside - both * factor)
    back.scan([rows[:-1], u[1:]], u[:-1], reverse=True)
    return u


def _few(t: Array, q: Array) -> Array:
    """Return the velocities of the line through two points, or the parabola."""
    h = (t[1:] - t[:-1])[:, None]
    slope = (q[1:] - q[:-1]) / h
    if len(t) == 2:
        return np.concatenate([slope, slope])
    bend = (slope[1] - slope[0]) / (h[0] + h[1])
    return np.stack([slope[0] - h[0] * bend, slope[0] + h[0] * bend,
                     slope[1] + h[1] * bend])


def _end_condition(t: Array, q: Array) -> tuple[float, float, Array]:
    """
    Return h_beside, h + h_beside and h_beside u + (h + h_beside) u_beside at an end.

    The arguments are of three points, from the end inwards.
    """
    # From two divided differences: the condition that the third derivative is
    # continuous at the neighbor of the end (not-a-knot).
    first, second, third = t.tolist()
    h = second - first
    h_beside = third - second
    slope = (q[1] - q[0]) / h
    slope_beside = (q[2] - q[1]) / h_beside
    both = h + h_beside
    weighted = (3.0 * h + 2.0 * h_beside) * h_beside * slope
    return h_beside, both, (weighted + h * h * slope_beside) / both
