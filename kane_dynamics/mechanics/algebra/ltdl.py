"""
LTDL factorization M = L^T D L of symmetric positive definite matrices, without pivoting.

Eliminating a kinematic tree from the leaves to the root creates no fill-in: entries of
the mass matrix that are zero because two joints are on different branches stay zero
(Featherstone, Rigid Body Dynamics Algorithms, 6.5). Structurally zero entries cause no
arithmetic.
"""

from collections.abc import Container, Sequence

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np

# Of a pivot that may be rounding, over n, relative to its diagonal entry.
PIVOT = 16.0 * float(np.finfo(float).eps)
Factors = tuple[list[list[Scalar]], list[Scalar]]  # L by rows, and 1 / D


def factorize(M: Matrix, order: Sequence[int], watched: Container[int] = (),
              least: float = PIVOT) -> Factors:
    """
    Return the LTDL factorization M = L^T D L.

    Parameters
    ----------
    M : (n, n) array
        Symmetric positive definite matrix.
    order : sequence of int
        Row indices in topological order: parents before children.
    watched : container of int
        Rows whose pivot may be rounding: its reciprocal is NaN then, because M is
        singular.
    least : float
        Of a watched pivot that is no rounding, over n, relative to its diagonal entry.

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
    n = len(order)
    A = M[np.ix_(order, order)].tolist()
    L: list[list[Scalar]] = np.zeros((n, n)).tolist()
    reciprocal: list[Scalar] = [None] * n
    for i in reversed(range(n)):
        # Row i loses the multiples of the rows k that eliminated an entry of column i.
        # Each entry is finished before the next one begins.
        for j in reversed(range(i + 1)):
            for k in reversed(range(i + 1, n)):
                if not (is_zero(L[k][i]) or is_zero(A[k][j])):
                    A[i][j] = A[i][j] - L[k][i] * A[k][j]

        # Its pivot, and row i of L.
        if is_zero(A[i][i]):
            raise ZeroDivisionError(order[i])
        reciprocal[i] = 1.0 / A[i][i]
        if order[i] in watched:
            reciprocal[i] = regular(reciprocal[i], A[i][i], M[order[i], order[i]],
                                    n * least)
        for j in range(i):
            if not is_zero(A[i][j]):
                L[i][j] = A[i][j] * reciprocal[i]
    return L, reciprocal


def regular(reciprocal: Scalar, pivot: Scalar, diagonal: Scalar,
            least: float) -> Scalar:
    """Return the reciprocal of a pivot, NaN below a share of M's diagonal entry."""
    return select(least * diagonal < pivot, reciprocal, np.nan)


def solve(factors: Factors, order: Sequence[int], b: Vector) -> Vector:
    """Return M^-1 b from the result of `factorize`."""
    L, reciprocal = factors
    n = len(order)
    x: list[Scalar] = list(b[list(order)])

    # L^T x' = b, from the leaves to the root.
    for k in reversed(range(n)):
        for i in range(k):
            if not (is_zero(L[k][i]) or is_zero(x[k])):
                x[i] = x[i] - L[k][i] * x[k]

    # L x = D^-1 x', from the root to the leaves.
    for k in range(n):
        if not is_zero(x[k]):
            x[k] = x[k] * reciprocal[k]
        for i in range(k):
            if not (is_zero(L[k][i]) or is_zero(x[i])):
                x[k] = x[k] - L[k][i] * x[i]
    result: list[Scalar] = [0.0] * n
    for k, r in enumerate(order):
        result[r] = x[k]
    return np.array(result)


def inverse(factors: Factors, order: Sequence[int]) -> Matrix:
    """Return M^-1, (n, n), exactly symmetric, from the result of `factorize`."""
    n = len(order)
    columns = []
    for unit in np.eye(n):
        columns.append(solve(factors, order, unit))

    # Both triangles get the entries of one,
    # in which a descendant's column is solved for its ancestors.
    rank = {r: k for k, r in enumerate(order)}
    rows: list[list[Scalar]] = [[None] * n for _ in range(n)]
    for r in range(n):
        for s in range(n):
            if rank[r] >= rank[s]:
                rows[r][s] = columns[r][s]
            else:
                rows[r][s] = columns[s][r]
    return np.array(rows)
