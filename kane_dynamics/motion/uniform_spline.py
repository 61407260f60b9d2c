"""
Cubic splines through points at equal distances, with given slopes at both ends.

The slopes s satisfy s[i-1] + 4 s[i] + s[i+1] = 3 (q[i+1] - q[i-1]) / h. The elimination
from the first point to the last, and the substitution back, are each a traced program of
one point, repeated natively. The factors of the elimination are the same for all
splines, and soon constant.
"""

from functools import cache, partial
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loop_support import address, repeat
from kane_dynamics.native.tracing.program import trace_program
import numpy as np

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
def kernels(n: int) -> tuple[Kernel, Kernel]:
    """Return the kernels of one point, for n splines."""
    out = []
    for function, rows, shape in (
            (spline_eliminated, [('previous', (n,)), ('q', (3, n))], (n,)),
            (spline_substituted, [('row',
                                   (n,)), ('following', (n,)), ('q', (2, n))], (2, n))):
        name, inputs = function.__name__, [*rows, ('rate', ()), ('factor', ())]
        out.append(Kernel(
            name, partial(trace_program, name, function, inputs), f'{name} {n}',
            [Argument(*each) for each in inputs[:-1]], np.zeros(()), shape))
    return out[0], out[1]


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
    out, rate = np.empty((count, 2, n)), np.array(1.0 / step)
    out[0, 0], out[-1, 0] = first, last
    factors = np.full(count, FACTORS[-1])
    factors[:len(FACTORS)] = FACTORS[:count]
    forward, back = kernels(n)
    row, at = 8 * n, 8 * (count - 2)
    begin, table, constants = address(out), address(q), address(factors)
    repeat(forward.address,
           [begin, table, address(rate), constants + 8, begin + 2 * row],
           [2 * row, row, 0, 8, 2 * row], count - 2)
    end = begin + (count - 2) * 2 * row
    repeat(back.address,
           [end, end + 2 * row, table + (count - 2) * row, address(rate), constants + at,
            end],
           [-2 * row, -2 * row, -row, 0, -8, -2 * row], count - 1)
    rise = (q[-1] - q[-2]) / step
    out[-1, 1] = (2.0 * out[-2, 0] + 4.0 * last - 6.0 * rise) / step
    return out[:, 0], out[:, 1]
