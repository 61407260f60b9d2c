"""
Solve small structured linear systems over any scalar type, without branches on traced values.

Elimination uses only constant entries as pivots, which do not depend on the state. The rest of
the matrix is permuted to block triangular form and solved block by block: loops that follow from
one another are solved in their order. The inverse of a diagonal block is a part of the inverse of
the matrix, so no block is worse conditioned than the whole. Blocks of up to three rows are solved
by cofactors, larger ones by modified Gram-Schmidt. Both fail only if the block is singular, so no
pivoting is needed at run time. Source of the form: R. Tarjan, Depth-first search and linear graph
algorithms, 1972; Duff, Erisman, Reid, Direct Methods for Sparse Matrices, chapter 6.
"""

from typing import Any

from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np

Matrix = list[list[Any]]
PIVOT_THRESHOLD = 0.1  # least size of a pivot relative to the largest constant of its row
ROUNDING = 1e-12  # relative size below which a constant is treated as zero after elimination
# Least size of a constant pivot beside traced entries, whose size is unknown: direction cosines
# that are zero but for the digits of a file must not be pivots.
ALONE = 1e-3


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
    for rows, columns in _triangular_blocks(left, solved):
        block = [[left[r][c] for c in columns] for r in rows]
        before = [c for c in range(n) if rest[c] and not all(is_zero(left[r][c]) for r in rows)]
        given, factors = [right[r] for r in rows], [[left[r][c] for c in before] for r in rows]
        known = [rest[c] for c in before]
        for c, unknown in zip(columns, _block_unknowns(block, given, factors, known)):
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
        traced = any(c not in solved and not isinstance(x, (int, float))
                     for c, x in enumerate(row))
        if traced and top < ALONE:
            continue
        for c, size in constants.items():
            if size > least[r] and size >= PIVOT_THRESHOLD * top:
                filled = sum(not is_zero(x) for x in row)
                rank = (size / top - filled, r, c)
                if best is None or rank[0] > best[0]:
                    best = rank
    return None if best is None else best[1:]


def _triangular_blocks(A: Matrix,
                       solved: dict[int, int]) -> list[tuple[list[int], list[int]]]:
    """Return rows and columns of the diagonal blocks; each depends on earlier columns only."""
    n, taken = len(A), set(solved.values())
    columns = {r: [c for c in range(n) if c not in solved and not is_zero(A[r][c])]
               for r in range(n) if r not in taken}
    owner: dict[int, int] = {}  # of a column: its row on the diagonal
    for r in columns:
        if not _matched(r, columns, owner, set()):
            raise ZeroDivisionError(r)
    column = {r: c for c, r in owner.items()}
    blocks = _components({r: [owner[c] for c in columns[r]] for r in columns})
    return [(sorted(block), sorted(column[r] for r in block)) for block in blocks]


def _matched(row: int, columns: dict[int, list[int]], owner: dict[int, int],
             seen: set[int]) -> bool:
    """Give a row a column of its own, moving other rows if needed; return whether it has one."""
    for c in columns[row]:
        if c not in seen:
            seen.add(c)
            if c not in owner or _matched(owner[c], columns, owner, seen):
                owner[c] = row
                return True
    return False


def _components(needs: dict[int, list[int]]) -> list[list[int]]:
    """Return the strongly connected components of a graph, those needed by others first."""
    number: dict[int, int] = {}
    lowest: dict[int, int] = {}
    open_: list[int] = []
    found: list[list[int]] = []

    def visit(node: int) -> None:
        number[node] = lowest[node] = len(number)
        open_.append(node)
        for other in needs[node]:
            if other not in number:
                visit(other)
                lowest[node] = min(lowest[node], lowest[other])
            elif other in open_:
                lowest[node] = min(lowest[node], number[other])
        if lowest[node] == number[node]:
            place = open_.index(node)
            found.append(open_[place:])
            del open_[place:]
    for node in needs:
        if node not in number:
            visit(node)
    return found


def _block_unknowns(A: Matrix, B: Matrix, C: Matrix, X: Matrix) -> Matrix:
    """Return A^-1 (B - C X) or A^-1 B - (A^-1 C) X, whichever takes fewer multiplications."""
    m = len(A)
    b, c, x = ([[not is_zero(entry) for entry in row] for row in part] for part in (B, C, X))
    products = [[c[r][k] and x[k][s] for k in range(len(X))] for r in range(m)
                for s in range(len(B[0]))]
    filled = sum(any(row) or b[r][s] for row, (r, s) in zip(products, np.ndindex(m, len(B[0]))))
    apart = m * (np.sum(b) + np.sum(c) + np.sum(x))
    if apart < np.sum(products) + m * filled:
        both = _block_solution(A, [[*row, *factors] for row, factors in zip(B, C)])
        k = len(B[0])
        return [_minus_combination(row[:k], row[k:], X) for row in both]
    return _block_solution(A, [_minus_combination(*row, X) for row in zip(B, C)])


def _minus_combination(row: list[Any], factors: list[Any], X: Matrix) -> list[Any]:
    """Return row - factors @ X."""
    for factor, known in zip(factors, X):
        row = [_minus_product(x, factor, y) for x, y in zip(row, known)]
    return row


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
