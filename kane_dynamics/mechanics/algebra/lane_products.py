"""
Products of matrices, and functions of vectors, a row of the result at a time.

A row of A B is a sum of rows of B, each times an entry of A. Rows are rows of lanes: in
the program of one state each takes a few instructions, whatever its length. `lanes` is
the class `Lanes` or another object with its functions.
"""

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics._util.typing import Matrix, Vector
from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.mechanics.algebra.ltdl import Factors, solve
from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np


def product(A: Matrix, B: Matrix, lanes: Any) -> Matrix:
    """Return A B; A is a matrix (k, m), or a vector (m,) that stands for a row."""
    size = np.shape(B)[1]
    # Blocks of `LANES` columns of B:
    # a row of A B is a sum of its rows, whole blocks at once.
    columns = _blocks(B, lanes)
    rows = []
    # Zeros of A, which are known when the program is traced, cost nothing.
    for entries in np.atleast_2d(A):
        sums = []
        for block in columns:
            total: Any = 0.0
            for x, row in zip(entries, block):
                if not is_zero(x):
                    total = total + x * row
            sums.append(total)
        rows.append(_values(sums, size, lanes))
    result = np.array(rows)
    return result if np.ndim(A) > 1 else result[0]


def transpose(A: Matrix, lanes: Any) -> Matrix:
    """Return the transpose of a matrix of at most `LANES` rows."""
    rows = []
    for block in _blocks(A, lanes):
        for column in lanes.transposed(block):
            rows.append(_values([column], len(A), lanes))
    return np.array(rows[:np.shape(A)[1]])


def solutions(factors: Factors, order: Sequence[int], B: Matrix, lanes: Any) -> Matrix:
    """Return M^-1 B, (n, k), from the factors of M; see `ltdl.solve`."""
    columns = [solve(factors, order, np.array(block)) for block in _blocks(B, lanes)]
    rows = [_values(row, np.shape(B)[1], lanes) for row in zip(*columns)]
    return np.array(rows)


def by_entries(function: Callable[..., Any], lanes: Any, *vectors: Vector) -> Vector:
    """Return a function of vectors, entry by entry, (n,)."""
    size = len(vectors[0])
    blocks = []
    for first in range(0, size, LANES):
        rows = [lanes.beginning(list(x[first:first + LANES])) for x in vectors]
        blocks.append(function(*rows))
    return _values(blocks, size, lanes)


def _blocks(A: Matrix, lanes: Any) -> list[list[Any]]:
    """Return the rows of a matrix as rows of lanes, for each block of its columns."""
    blocks = []
    for first in range(0, np.shape(A)[1], LANES):
        blocks.append([lanes.beginning(list(row[first:first + LANES])) for row in A])
    return blocks


def _values(blocks: Sequence[Any], size: int, lanes: Any) -> Vector:
    """Return the values of a long row, (size,), from its rows of lanes."""
    values = [lanes.lane(blocks[k // LANES], k % LANES) for k in range(size)]
    return np.array(values)
