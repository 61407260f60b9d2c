"""
Symmetric positive definite systems with three diagonals beside the main one, and one right side.

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

WIDE = (5,)  # shape of a row
ROW = 40  # bytes of a row


def eliminated(third: Any, second: Any, first: Any, row: Any) -> Any:
    """
    Return a row of the factors, from the three rows before it, the first of which is the nearest.

    Rows of the factors are 1 / D[i], L[i, i-1], L[i, i-2], L[i, i-3] and the right side,
    substituted. `row` is A[i, i], A[i, i-1], A[i, i-2], A[i, i-3] and the right side.
    """
    far = row[3]
    middle = row[2] - far * second[1]
    near = row[1] - far * first[2] - middle * first[1]
    near_l, middle_l, far_l = near * first[0], middle * second[0], far * third[0]
    pivot = row[0] - near_l * near - middle_l * middle - far_l * far
    return np.array([1.0 / pivot, near_l, middle_l, far_l,
                     row[4] - near_l * first[4] - middle_l * second[4] - far_l * third[4]])


def substituted(third: Any, second: Any, first: Any, row: Any) -> Any:
    """Return a row of the factors with the solution in place of the right side."""
    value = row[4] * row[0] - first[1] * first[4] - second[2] * second[4] - third[3] * third[4]
    return np.array([row[0], row[1], row[2], row[3], value])


@cache
def _kernels() -> tuple[Kernel, Kernel]:
    found = []
    for function in (eliminated, substituted):
        name = f'{function.__name__}_band'
        inputs = [(each, WIDE) for each in ('third', 'second', 'first', 'row')]
        found.append(Kernel(name, partial(trace_program, name, function, inputs), name,
                            [Argument(*each) for each in inputs[:-1]], np.zeros(WIDE), WIDE))
    return found[0], found[1]


def banded_system_solution(diagonals: Array, right: Array) -> Array:
    """
    Return the solution, (m,).

    Parameters
    ----------
    diagonals : (4, m) array
        A[i, i], A[i, i-1], A[i, i-2] and A[i, i-3] of the matrix A; entries of columns before the
        first one are ignored.
    right : (m,) array
        Right side.

    """
    m = len(right)
    rows, factors = np.empty((m, 5)), np.zeros((m + 6, 5))
    rows[:, :4], rows[:, 4] = diagonals.T, right
    for k in range(1, 4):
        rows[:k, k] = 0.0
    forward, back = _kernels()
    start = factors.ctypes.data
    repeat(forward.address, [start, start + ROW, start + 2 * ROW, rows.ctypes.data,
                             start + 3 * ROW], [ROW] * 5, m)
    last = start + (m + 2) * ROW
    repeat(back.address, [last + 3 * ROW, last + 2 * ROW, last + ROW, last, last], [-ROW] * 5, m)
    return factors[3:m + 3, 4].copy()
