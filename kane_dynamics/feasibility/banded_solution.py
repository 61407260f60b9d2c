"""
Symmetric positive definite systems with two diagonals beside the main one.

They are factored as L D L^T, without pivots. The factorization with the forward substitution, and
the back substitution, are each a traced program of one row, repeated natively.
"""

from functools import cache, partial
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loop_support import repeat
from kane_dynamics.native.tracing.program import trace_program
import numpy as np


def eliminated(before: Any, previous: Any, row: Any) -> Any:
    """
    Return a row of the factors, from the two rows before it.

    Rows of the factors are 1 / D[i], L[i, i-1], L[i, i-2] and the right-hand sides, substituted.
    `row` is A[i, i], A[i, i-1], A[i, i-2] and the right-hand sides.
    """
    beside = row[1] - row[2] * previous[1]
    near, far = beside * previous[0], row[2] * before[0]
    pivot = row[0] - near * beside - far * row[2]
    return np.array([1.0 / pivot, near, far,
                     *(row[3:] - near * previous[3:] - far * before[3:])])


def substituted(after: Any, following: Any, factors: Any, factors_after: Any, row: Any) -> Any:
    """Return a row of the solution, from the two rows behind it and the factors of all three."""
    return row[3:] * row[0] - factors[1] * following - factors_after[2] * after


@cache
def kernels(n: int) -> tuple[Kernel, Kernel]:
    """Return the kernels of one row, for n right-hand sides."""
    wide, narrow = (3 + n,), (n,)
    out = []
    for function, inputs, shape in (
            (eliminated, [('before', wide), ('previous', wide), ('row', wide)], wide),
            (substituted, [('after', narrow), ('following', narrow), ('factors', wide),
                           ('factors_after', wide), ('row', wide)], narrow)):
        name = function.__name__
        out.append(Kernel(
            name, partial(trace_program, name, function, inputs), f'{name} {n}',
            [Argument(*each) for each in inputs[:-1]], np.zeros(wide), shape))
    return out[0], out[1]


def banded_solution(diagonals: Array, right: Array) -> Array:
    """
    Return the solutions, (m, n), of a system with m unknowns and n right-hand sides.

    Parameters
    ----------
    diagonals : (3, m) array
        A[i, i], A[i, i-1] and A[i, i-2] of the matrix A; the first entry of the second row and
        the first two of the third are ignored.
    right : (m, n) array
        Right-hand sides.

    """
    m, n = right.shape
    rows, factors = np.empty((m, 3 + n)), np.zeros((m + 4, 3 + n))
    rows[:, :3], rows[:, 3:] = diagonals.T, right
    rows[0, 1], rows[:2, 2] = 0.0, 0.0
    x = np.zeros((m + 2, n))
    forward, back = kernels(n)
    wide, narrow = 8 * (3 + n), 8 * n
    start = factors.ctypes.data
    repeat(forward.address, [start, start + wide, rows.ctypes.data, start + 2 * wide],
           [wide] * 4, m)
    last, end = start + (m + 1) * wide, x.ctypes.data + (m - 1) * narrow
    repeat(back.address, [end + 2 * narrow, end + narrow, last + wide, last + 2 * wide, last, end],
           [-narrow, -narrow, -wide, -wide, -wide, -narrow], m)
    return x[:m]
