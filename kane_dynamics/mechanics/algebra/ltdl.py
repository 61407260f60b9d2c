"""
LTDL factorization M = L^T D L of symmetric positive definite matrices, without pivoting.

Eliminating a kinematic tree from the leaves to the root creates no fill-in: entries of the mass
matrix that are zero because two joints are on different branches stay zero (Featherstone, Rigid
Body Dynamics Algorithms, 6.5). Structurally zero entries cause no arithmetic.
"""

from collections.abc import Container, Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np


PIVOT = 16.0 * float(np.finfo(float).eps)  # over n: a pivot relative to its diagonal entry


def factorize(M: Any, order: Sequence[int],
              watched: Container[int] = ()) -> tuple[list[list[Any]], list[Any]]:
    """
    Return the LTDL factorization M = L^T D L.

    Parameters
    ----------
    M : (n, n) array
        Symmetric positive definite matrix.
    order : sequence of int
        Row indices in topological order: parents before children.
    watched : container of int
        Rows whose pivot may be rounding: its reciprocal is NaN then, because M is singular.

    Returns
    -------
    L : list of rows
        Unit lower triangular in `order`: L[i][j] for j before i.
    reciprocal : list
        1 / D.

    Raises
    ------
    ZeroDivisionError
        If a pivot is structurally zero; the argument is the row index.

    """
    A = [[M[r, s] for s in order] for r in order]
    n = len(order)
    L: list[list[Any]] = [[0.0] * n for _ in range(n)]
    reciprocal: list[Any] = [None] * n
    for i in reversed(range(n)):  # row by row: each entry is finished before the next begins
        later = [k for k in reversed(range(i + 1, n)) if not is_zero(L[k][i])]
        for j in reversed(range(i + 1)):
            for k in later:
                if not is_zero(A[k][j]):
                    A[i][j] = A[i][j] - L[k][i] * A[k][j]
        if is_zero(A[i][i]):
            raise ZeroDivisionError(order[i])
        reciprocal[i] = 1.0 / A[i][i]
        if order[i] in watched:
            reciprocal[i] = regular(reciprocal[i], A[i][i], M[order[i], order[i]], n)
        for j in range(i):
            if not is_zero(A[i][j]):
                L[i][j] = A[i][j] * reciprocal[i]
    return L, reciprocal


def regular(reciprocal: Any, pivot: Any, diagonal: Any, n: int) -> Any:
    """Return the reciprocal of a pivot, NaN if the pivot is rounding of the diagonal of M."""
    return select(n * PIVOT * diagonal < pivot, reciprocal, np.nan)


def solve(factors: tuple[list[list[Any]], list[Any]], order: Sequence[int], b: Any) -> Any:
    """Return M^-1 b from the result of `factorize`."""
    L, reciprocal = factors
    n = len(order)
    x: list[Any] = [b[r] for r in order]
    for k in reversed(range(n)):
        for i in range(k):
            if not (is_zero(L[k][i]) or is_zero(x[k])):
                x[i] = x[i] - L[k][i] * x[k]
    for k in range(n):
        if not is_zero(x[k]):
            x[k] = x[k] * reciprocal[k]
        for i in range(k):
            if not (is_zero(L[k][i]) or is_zero(x[i])):
                x[k] = x[k] - L[k][i] * x[i]
    result: list[Any] = [0.0] * n
    for k, r in enumerate(order):
        result[r] = x[k]
    return np.array(result)


def inverse(factors: tuple[list[list[Any]], list[Any]], order: Sequence[int]) -> Any:
    """Return M^-1, (n, n), exactly symmetric, from the result of `factorize`."""
    n = len(order)
    columns = [solve(factors, order, [1.0 if r == k else 0.0 for r in range(n)])
               for k in range(n)]
    rank = {r: k for k, r in enumerate(order)}
    return np.array([[columns[r][s] if rank[r] >= rank[s] else columns[s][r]
                      for s in range(n)] for r in range(n)])
