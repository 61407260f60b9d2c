"""
Symmetric positive definite systems with three diagonals beside the main one.

They are factored as L D L^T, without pivots. The factorization with the forward
substitution, and the back substitution, are each a traced program of one row, repeated
natively.
"""

from functools import cache

from kane_dynamics._util.typing import Array, Vector
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel
import numpy as np

WIDE = (5,)  # shape of a row


def eliminated_row(third: Vector, second: Vector, first: Vector, row: Vector) -> Vector:
    """
    Return a row of the factors, from the three rows before it, from far to near.

    Rows of the factors are 1 / D[i], L[i, i-1], L[i, i-2], L[i, i-3] and the right side,
    substituted. `row` is A[i, i], A[i, i-1], A[i, i-2], A[i, i-3] and the right side.
    """
    # L D L^T of a band of three: entries of the row, then L = entries / pivots.
    far = row[3]
    middle = row[2] - far * second[1]
    near = row[1] - far * first[2] - middle * first[1]
    near_l = near * first[0]
    middle_l = middle * second[0]
    far_l = far * third[0]
    # The pivot and the right side lose the products with the rows before.
    pivot = row[0] - near_l * near - middle_l * middle - far_l * far
    right = row[4] - near_l * first[4] - middle_l * second[4] - far_l * third[4]
    return np.array([1.0 / pivot, near_l, middle_l, far_l, right])


def substituted(third: Vector, second: Vector, first: Vector, row: Vector) -> Vector:
    """Return a row of the factors with the solution in place of the right side."""
    value = row[4] * row[0] - first[1] * first[4]
    value = value - second[2] * second[4] - third[3] * third[4]
    return np.array([row[0], row[1], row[2], row[3], value])


@cache
def _kernels() -> tuple[Kernel, Kernel]:
    """Return the kernels of one row, of the elimination and of the substitution."""
    rows = [(name, WIDE) for name in ('third', 'second', 'first', 'row')]
    return (batch_kernel('eliminated_band', eliminated_row, rows, WIDE),
            batch_kernel('substituted_band', substituted, rows, WIDE))


def banded_system_solution(diagonals: Array, right: Array) -> Array:
    """
    Return the solution, (m,).

    Parameters
    ----------
    diagonals : (4, m) array
        A[i, i], A[i, i-1], A[i, i-2] and A[i, i-3] of the matrix A; entries of columns
        before the first one are ignored.
    right : (m,) array
        Right side.

    """
    m = len(right)
    rows = np.empty((m, 5))
    rows[:, :4] = diagonals.T
    rows[:, 4] = right
    # With three rows of zeros before the first and after the last.
    factors = np.zeros((m + 6, 5))
    for k in range(1, 4):
        rows[:k, k] = 0.0
    forward, back = _kernels()
    inner = factors[3:m + 3]
    # Elimination from the first row to the last, each by the three rows before it; then
    # substitution back, each by the three rows after it.
    forward.scan([factors[:m], factors[1:m + 1], factors[2:m + 2], rows], inner)
    back.scan([factors[6:], factors[5:m + 5], factors[4:m + 4], inner], inner,
              reverse=True)
    return inner[:, 4].copy()
