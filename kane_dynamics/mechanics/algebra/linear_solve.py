"""
Solve small structured linear systems over any scalar type, without branches on traced values.

Elimination uses only constant entries as pivots, which do not depend on the state. The rest of
the matrix splits into independent blocks. Blocks of up to three rows are solved by cofactors,
larger ones by modified Gram-Schmidt. Both fail only if the block is singular, so no pivoting is
needed at run time.
"""

from typing import Any

from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np

Matrix = list[list[Any]]
PIVOT_THRESHOLD = 0.1  # least size of a pivot relative to the largest constant of its row
ROUNDING = 1e-12  # relative size below which a constant is treated as zero after elimination


def inverse(A: Any) -> Any:
    """Return A^-1; see `solution`."""
    return solution(A, np.eye(len(A)))


def solution(A: Any, B: Any) -> Any:
    """
    Return X, (n, k), with A X = B.

    Parameters
    ----------
    A, B : (n, n), (n, k) arrays of scalars
        Matrix and right-hand sides; structurally zero entries cause no arithmetic.

    Raises
    ------
    ZeroDivisionError
        If A is structurally singular; the argument is the index of an unsolvable row.

    """
    n = len(A)
    left: Matrix = [list(row) for row in np.asarray(A, dtype=object)]
    right: Matrix = [list(row) for row in np.asarray(B, dtype=object)]
    least = [ROUNDING * _largest_constant(row) for row in left]
    solved: dict[int, int] = {}  # column of an unknown: its pivot row
    while (pivot := _constant_pivot(left, solved, least)) is not None:
        row, column = pivot
        solved[column] = row
        scale = 1.0 / left[row][column]
        left[row] = [_product(scale, x) for x in left[row]]
        right[row] = [_product(scale, x) for x in right[row]]
        for r in range(n):
            factor = left[r][column]
            if r != row and not is_zero(factor):
                left[r] = [_minus_product(x, factor, y) for x, y in zip(left[r], left[row])]
                right[r] = [_minus_product(x, factor, y) for x, y in zip(right[r], right[row])]
                left[r][column] = 0.0
    rest: Matrix = [[] for _ in range(n)]  # rows of X that the blocks determine
    for rows, columns in _blocks(left, solved):
        if len(rows) != len(columns):
            raise ZeroDivisionError(min(rows) if rows else min(columns))
        found = _block_solution([[left[r][c] for c in columns] for r in rows],
                                [right[r] for r in rows])
        for c, unknown in zip(columns, found):
            rest[c] = unknown
    answer: Matrix = []
    for c in range(n):
        if c in solved:
            row = solved[c]
            known = right[row]
            for k in range(n):
                if k not in solved and not is_zero(left[row][k]):
                    known = [_minus_product(x, left[row][k], y) for x, y in zip(known, rest[k])]
            answer.append(known)
        else:
            answer.append(rest[c])
    return np.array(answer)


def _largest_constant(row: list[Any]) -> float:
    return max((abs(x) for x in row if isinstance(x, (int, float))), default=0.0)


def _constant_pivot(A: Matrix, solved: dict[int, int],
                    least: list[float]) -> tuple[int, int] | None:
    """Return (row, column) of the best constant pivot, or None if there is none."""
    best: tuple[float, int, int] | None = None
    taken = set(solved.values())
    for r, row in enumerate(A):
        if r in taken:
            continue
        constants = {c: abs(x) for c, x in enumerate(row)
                     if c not in solved and isinstance(x, (int, float))}
        top = max(constants.values(), default=0.0)
        for c, size in constants.items():
            if size > least[r] and size >= PIVOT_THRESHOLD * top:
                filled = sum(not is_zero(x) for x in row)
                rank = (size / top - filled, r, c)
                if best is None or rank[0] > best[0]:
                    best = rank
    return None if best is None else best[1:]


def _blocks(A: Matrix, solved: dict[int, int]) -> list[tuple[list[int], list[int]]]:
    """Return the unsolved rows and columns as independent blocks."""
    n, taken = len(A), set(solved.values())
    rows = [r for r in range(n) if r not in taken]
    columns = [c for c in range(n) if c not in solved]
    groups: list[tuple[set[int], set[int]]] = [({r}, {c for c in columns
                                                      if not is_zero(A[r][c])}) for r in rows]
    merged: list[tuple[set[int], set[int]]] = []
    for group in groups:
        touching = [other for other in merged if other[1] & group[1]]
        merged = [other for other in merged if not other[1] & group[1]]
        for other in touching:
            group = (group[0] | other[0], group[1] | other[1])
        merged.append(group)
    unseen = set(columns) - {c for group in merged for c in group[1]}
    return [(sorted(r), sorted(c)) for r, c in merged] + ([([], sorted(unseen))] if unseen else [])


def _block_solution(A: Matrix, B: Matrix) -> Matrix:
    """Solve a block without constant pivots."""
    n = len(A)
    if n > 3:
        return _solve_by_gram_schmidt(A, B)
    minors = ([[1.0]] if n == 1 else
              [[_minor(A, r, c) for r in range(n)] for c in range(n)])
    scale = 1.0 / sum(A[0][c] * minors[c][0] for c in range(n))
    return [_combination([_product(scale, x) for x in row], B) for row in minors]


def _minor(A: Matrix, row: int, column: int) -> Any:
    """Return the cofactor of an entry of a 2 x 2 or 3 x 3 matrix."""
    rest = [[x for c, x in enumerate(line) if c != column] for r, line in enumerate(A) if r != row]
    value = rest[0][0]
    if len(rest) == 2:
        value = rest[0][0] * rest[1][1] - rest[0][1] * rest[1][0]
    return value if (row + column) % 2 == 0 else -value


def _solve_by_gram_schmidt(A: Matrix, B: Matrix) -> Matrix:
    """Solve by modified Gram-Schmidt, A^T = Q R: X = Q R^-T B."""
    n = len(A)
    basis: Matrix = []  # rows of Q^T
    weights: Matrix = []  # rows of R^-T B
    for k in range(n):
        row, weight = list(A[k]), list(B[k])
        for _ in range(2):  # twice: orthogonal to rounding even for nearly dependent rows
            for unit, share in zip(basis, weights):
                along = _dot(row, unit)
                row = [_minus_product(x, along, y) for x, y in zip(row, unit)]
                weight = [_minus_product(x, along, y) for x, y in zip(weight, share)]
        scale = 1.0 / np.sqrt(_dot(row, row))
        basis.append([_product(scale, x) for x in row])
        weights.append([_product(scale, x) for x in weight])
    return [_combination([unit[c] for unit in basis], weights) for c in range(n)]


def _dot(a: list[Any], b: list[Any]) -> Any:
    total: Any = 0.0
    for x, y in zip(a, b):
        if not (is_zero(x) or is_zero(y)):
            total = total + x * y
    return total


def _combination(weights: list[Any], rows: Matrix) -> list[Any]:
    return [_dot(weights, [row[c] for row in rows]) for c in range(len(rows[0]))]


def _product(a: Any, b: Any) -> Any:
    return 0.0 if is_zero(a) or is_zero(b) else a * b


def _minus_product(x: Any, factor: Any, y: Any) -> Any:
    """Return x - factor y."""
    return x if is_zero(factor) or is_zero(y) else x - factor * y
