"""
Inverse of the mass matrix M = L^T D L from the inverse W of L, by blocks of rows.

W_ja is zero unless joint a carries joint j, like L. M^-1 = W D^-1 W^T sums over the
joints that carry both, which are few in a tree.
"""

from collections.abc import Container, Sequence
from typing import Any

from kane_dynamics._util.typing import Flags, Matrix, Scalar
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.ltdl import PIVOT, regular
from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np

Factors = tuple[list[list[Scalar]], list[Scalar]]
Row = dict[int, Any]  # lanes by the number of their block; blocks of zeros are left out


def factorize(M: Matrix, order: Sequence[int], lanes: Any = Lanes,
              rows: Matrix | None = None, watched: Container[int] = ()) -> Factors:
    """
    Return `ltdl.factorize` of M, computed a block of each row at a time.

    `rows`, (n, n), has the values of M, if they are values of rows of lanes already.
    """
    n = len(order)
    # Entries of M that are not zero by structure, in the order of elimination.
    ordered = np.ix_(order, order)
    nonzero = ~np.vectorize(is_zero, otypes=[bool])(M[ordered])
    if rows is None:
        rows = M
    A = _lower_blocks(rows[ordered], lanes)
    L: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    reciprocal: list[Scalar] = [None] * n
    for k in reversed(range(n)):
        if not nonzero[k, k]:
            raise ZeroDivisionError(order[k])
        pivot = lanes.lane(A[k][k // LANES], k % LANES)
        reciprocal[k] = 1.0 / pivot
        if order[k] in watched:
            reciprocal[k] = regular(reciprocal[k], pivot, M[order[k], order[k]], n * PIVOT)

        # Row k of L, a block at a time.
        left = np.flatnonzero(nonzero[k, :k]).tolist()
        scaled: Row = {}
        for g in sorted({i // LANES for i in left}):
            scaled[g] = A[k][g] * reciprocal[k]

        # Row i of A loses the multiple L_ki of row k, which fills its zeros.
        for i in reversed(left):
            L[k][i] = lanes.lane(scaled[i // LANES], i % LANES)
            nonzero[i, left] = True
            for g in sorted({j // LANES for j in left if j <= i}):
                A[i][g] = A[i][g] - A[k][g] * L[k][i]
    return L, reciprocal


def _lower_blocks(A: Matrix, lanes: Any) -> list[Row]:
    """Return the blocks of the lower triangle of a matrix, by rows."""
    blocks: list[Row] = []
    for k, row in enumerate(A):
        # Row k has entries up to column k alone.
        block_of: Row = {}
        for g in range(k // LANES + 1):
            block_of[g] = lanes.pack(list(row[g * LANES:(g + 1) * LANES]))
        blocks.append(block_of)
    return blocks


def inverse_mass_matrix(factors: Factors, order: Sequence[int],
                        lanes: Any = Lanes) -> Matrix:
    """
    Return M^-1, (n, n), exactly symmetric, from the result of `ltdl.factorize`.

    `lanes` has the functions of `Lanes`.
    """
    n = len(order)
    L, reciprocal = factors
    carries = _pattern(L)

    # W and W D^-1, by columns.
    columns = _inverse_columns(L, lanes)
    scaled: list[Row] = []
    for a, column in enumerate(columns):
        scaled.append({g: x * reciprocal[a] for g, x in column.items()})

    # Blocks of the lower triangle of W D^-1 W^T, mirrored to the upper one.
    result = np.zeros((n, n), dtype=object)
    for g in range(-(-n // LANES)):
        in_block = range(g * LANES, min((g + 1) * LANES, n))
        for block in range(g + 1):
            rows = [_entries(columns, scaled, carries[r], r, block, lanes)
                    for r in in_block]
            # Blocks that are zero by structure stay zero.
            if all(is_zero(row) for row in rows):
                continue
            mirrored = lanes.transposed(rows)
            if block == g:
                rows = _symmetric(rows, mirrored, lanes)
            else:
                _place(result, mirrored, block, g, order, lanes)
            _place(result, rows, g, block, order, lanes)
    return result


def _symmetric(rows: Sequence[Any], mirrored: Sequence[Any], lanes: Any) -> list[Any]:
    """Return the rows of a diagonal block, the upper triangle from the lower one."""
    result = []
    for r, row in enumerate(rows):
        lower = [k <= r for k in range(LANES)]
        result.append(lanes.blend(lower, row, mirrored[r]))
    return result


def _pattern(L: Sequence[Sequence[Scalar]]) -> Flags:
    """Return where W is not structurally zero, (n, n) booleans."""
    n = len(L)
    nonzero = np.zeros((n, n), dtype=bool)
    for k in range(n):
        for a in range(k):
            nonzero[k, a] = not is_zero(L[k][a])
    # W_ja is not zero where joint a carries joint j, at any distance.
    pattern = np.eye(n, dtype=bool)
    for a in reversed(range(n)):
        pattern[:, a] |= (pattern & nonzero[:, a]).any(axis=1)
    return pattern


def _inverse_columns(L: Sequence[Sequence[Scalar]], lanes: Any) -> list[Row]:
    """Return the columns of W: W_ja = -sum W_jk L_ka over k that a carries."""
    columns: list[Row] = [{} for _ in L]
    # From the last joint: the columns of the joints that a carries are known then.
    for a in reversed(range(len(L))):
        column = columns[a]
        unit = [0.0] * LANES
        unit[a % LANES] = 1.0
        column[a // LANES] = lanes.pack(unit)
        for k in range(a + 1, len(L)):
            if not is_zero(L[k][a]):
                for g, x in columns[k].items():
                    column[g] = column.get(g, 0.0) - x * L[k][a]
    return columns


def _entries(columns: Sequence[Row], scaled: Sequence[Row], carriers: Flags, r: int,
             block: int, lanes: Any) -> Any:
    """Return a block of row r of W D^-1 W^T; `carriers` is row r of `_pattern`."""
    total: Any = 0.0
    for a in np.flatnonzero(carriers).tolist():
        if block in columns[a]:
            factor = lanes.lane(scaled[a][r // LANES], r % LANES)
            total = total + columns[a][block] * factor
    return total


def _place(result: Matrix, rows: Sequence[Any], above: int, left: int,
           order: Sequence[int], lanes: Any) -> None:
    """Write a block of rows to the matrix."""
    n = len(order)
    for r in range(above * LANES, min((above + 1) * LANES, n)):
        for c in range(left * LANES, min((left + 1) * LANES, n)):
            result[order[r], order[c]] = lanes.lane(rows[r % LANES], c % LANES)
