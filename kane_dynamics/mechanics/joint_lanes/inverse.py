"""
Inverse of the mass matrix M = L^T D L from the inverse W of L, a block of rows at a time.

W_ja is zero unless joint a carries joint j, like L. M^-1 = W D^-1 W^T sums over the joints that
carry both, which are few in a tree.
"""

from collections.abc import Container, Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.ltdl import regular
from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np

Row = dict[int, Any]  # lanes by the number of their block; blocks of zeros are left out


def factorize(M: Any, order: Sequence[int], lanes: Any = Lanes, rows: Any = None,
              watched: Container[int] = ()) -> tuple[list[list[Any]], list[Any]]:
    """
    Return `ltdl.factorize` of M, computed a block of each row at a time.

    `rows`, (n, n), has the values of M, if they are values of rows of lanes already.
    """
    n = len(order)
    nonzero = np.array([[not is_zero(M[r, s]) for s in order] for r in order])
    rows = M if rows is None else rows
    A: list[Row] = [{g: lanes.pack([rows[r, s] for s in order[g * LANES:(g + 1) * LANES]])
                     for g in range(k // LANES + 1)} for k, r in enumerate(order)]
    L: list[list[Any]] = [[0.0] * n for _ in range(n)]
    reciprocal: list[Any] = [None] * n
    for k in reversed(range(n)):
        if not nonzero[k, k]:
            raise ZeroDivisionError(order[k])
        pivot = lanes.lane(A[k][k // LANES], k % LANES)
        reciprocal[k] = 1.0 / pivot
        if order[k] in watched:
            reciprocal[k] = regular(reciprocal[k], pivot, M[order[k], order[k]], n)
        left = np.flatnonzero(nonzero[k, :k]).tolist()
        scaled = {g: A[k][g] * reciprocal[k] for g in {i // LANES for i in left}}
        for i in reversed(left):
            L[k][i] = lanes.lane(scaled[i // LANES], i % LANES)
            nonzero[i, left] = True
            for g in sorted({j // LANES for j in left if j <= i}):
                A[i][g] = A[i][g] - A[k][g] * L[k][i]
    return L, reciprocal


def inverse_mass_matrix(factors: tuple[list[list[Any]], list[Any]], order: Sequence[int],
                        lanes: Any = Lanes) -> Any:
    """
    Return M^-1, (n, n), exactly symmetric, from the result of `ltdl.factorize`.

    `lanes` has the functions of `Lanes`.
    """
    n = len(order)
    L, reciprocal = factors
    carries = _pattern(L)
    columns = _inverse_columns(L, lanes)
    scaled = [{g: x * reciprocal[a] for g, x in column.items()}
              for a, column in enumerate(columns)]
    result = np.zeros((n, n), dtype=object)
    for g in range(-(-n // LANES)):
        for block in range(g + 1):
            rows = [_entries(columns, scaled, carries[r], r, block, lanes)
                    for r in range(g * LANES, min((g + 1) * LANES, n))]
            if all(is_zero(row) for row in rows):
                continue
            mirrored = lanes.transposed(rows)
            if block == g:
                rows = [lanes.blend([k <= r for k in range(LANES)], row, mirrored[r])
                        for r, row in enumerate(rows)]
            else:
                _place(result, mirrored, block, g, order, lanes)
            _place(result, rows, g, block, order, lanes)
    return result


def _pattern(L: Sequence[Sequence[Any]]) -> Any:
    """Return where W is not structurally zero, (n, n) booleans."""
    n = len(L)
    found = np.eye(n, dtype=bool)
    nonzero = np.array([[k > a and not is_zero(L[k][a]) for a in range(n)] for k in range(n)])
    for a in reversed(range(n)):
        found[:, a] |= (found & nonzero[:, a]).any(axis=1)
    return found


def _inverse_columns(L: Sequence[Sequence[Any]], lanes: Any) -> list[Row]:
    """Return the columns of W: W_ja = -sum W_jk L_ka over the joints k that a carries."""
    columns: list[Row] = [{} for _ in L]
    for a in reversed(range(len(L))):
        own = columns[a]
        own[a // LANES] = lanes.pack([1.0 if k == a % LANES else 0.0 for k in range(LANES)])
        for k in range(a + 1, len(L)):
            if not is_zero(L[k][a]):
                for g, x in columns[k].items():
                    own[g] = own.get(g, 0.0) - x * L[k][a]
    return columns


def _entries(columns: Sequence[Row], scaled: Sequence[Row], carriers: Any, r: int, block: int,
             lanes: Any) -> Any:
    """Return a block of row r of W D^-1 W^T; `carriers` is row r of `_pattern`."""
    total: Any = 0.0
    for a in np.flatnonzero(carriers).tolist():
        if block in columns[a]:
            total = total + columns[a][block] * lanes.lane(scaled[a][r // LANES], r % LANES)
    return total


def _place(result: Any, rows: Sequence[Any], above: int, left: int, order: Sequence[int],
           lanes: Any) -> None:
    """Write a block of rows to the matrix."""
    n = len(order)
    for r in range(above * LANES, min((above + 1) * LANES, n)):
        for c in range(left * LANES, min((left + 1) * LANES, n)):
            result[order[r], order[c]] = lanes.lane(rows[r % LANES], c % LANES)
