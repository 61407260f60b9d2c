"""
Cubic splines through points at equal distances, with given slopes at both ends.

The slopes s satisfy s[i-1] + 4 s[i] + s[i+1] = 3 (q[i+1] - q[i-1]) / h. The elimination
from the first point to the last, and the substitution back, are each a traced program of
one point, repeated natively. The factors of the elimination are the same for all
splines, and soon constant.
"""

from functools import cache
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel, windows
from kane_dynamics.native.tracing.program import Shape
import numpy as np

# 1 / (4 - the previous one): the inverse pivots of the tridiagonal system.
FACTORS = [0.0]
while len(FACTORS) < 32:  # those behind are equal to rounding
    FACTORS.append(1.0 / (4.0 - FACTORS[-1]))


def spline_eliminated(previous: Any, q: Any, rate: Any, factor: Any) -> Any:
    """Return an eliminated row, (n,), from the previous one and positions, (3, n)."""
    return (3.0 * rate[()] * (q[2] - q[0]) - previous) * factor[()]


def spline_substituted(row: Any, following: Any, q: Any, rate: Any, factor: Any) -> Any:
    """Return the first and second derivatives, (2, n), at the first of two points."""
    slope = row - factor[()] * following
    second = 6.0 * rate[()] * (q[1] - q[0]) - 4.0 * slope - 2.0 * following
    return np.array([slope, rate[()] * second])


@cache
def uniform_kernels(n: int) -> tuple[Kernel, Kernel]:
    """Return the kernels of one point, for n splines."""
    scalars: list[tuple[str, Shape]] = [('rate', ()), ('factor', ())]
    forward = batch_kernel('spline_eliminated', spline_eliminated,
                           [('previous', (n,)), ('q', (3, n)), *scalars], (n,))
    rows = [('row', (n,)), ('following', (n,)), ('q', (2, n))]
    back = batch_kernel('spline_substituted', spline_substituted, [*rows, *scalars],
                        (2, n))
    return forward, back


def spline_derivatives(q: Array, step: float, first: Array,
                       last: Array) -> tuple[Array, Array]:
    """
    Return the first and second derivatives at the points, two (K, n) arrays.

    Parameters
    ----------
    q : (K, n) array
        Positions, C-contiguous; K at least 3.
    step : float
        Distance of the points.
    first, last : (n,) arrays
        Slopes at the first and the last point.

    """
    count, n = q.shape
    rate = np.array(1.0 / step)
    derivatives = np.empty((count, 2, n))
    slopes = derivatives[:, 0]
    slopes[0] = first
    slopes[-1] = last
    factors = np.full(count, FACTORS[-1])
    factors[:len(FACTORS)] = FACTORS[:count]
    forward, back = uniform_kernels(n)
    # Elimination, from the second point to the last but one; then substitution, back to
    # the first. Until it is substituted, a point's slope is its eliminated row.
    forward.scan([slopes[:-2], windows(q, 3), rate, factors[1:-1]], slopes[1:-1])
    back.scan([slopes[:-1], slopes[1:], windows(q, 2), rate, factors[:-1]],
              derivatives[:-1], reverse=True)
    # The last point has no segment behind it: its second derivative is that of the last.
    rise = (q[-1] - q[-2]) / step
    derivatives[-1, 1] = (2.0 * slopes[-2] + 4.0 * last - 6.0 * rise) / step
    return slopes, derivatives[:, 1]
