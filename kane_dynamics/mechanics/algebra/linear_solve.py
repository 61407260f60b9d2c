"""
Solve small structured linear systems over any scalar type, without branches.

Elimination uses only constant entries as pivots, which do not depend on the state. The
rest of the matrix is permuted to block triangular form and solved block by block: loops
that follow from one another are solved in their order. The inverse of a diagonal block
is a part of the inverse of the matrix, so no block is worse conditioned than the whole.
Blocks of up to three rows are solved by cofactors, larger ones by modified Gram-Schmidt.
Both fail only if the block is singular, so no pivoting is needed at run time. Source of
the form: R. Tarjan, Depth-first search and linear graph algorithms, 1972; Duff, Erisman,
Reid, Direct Methods for Sparse Matrices, chapter 6.
"""

from collections.abc import Sequence
from itertools import chain
from typing import Any

from kane_dynamics._util.typing import Flags, Scalar
from kane_dynamics.mechanics.algebra.vector import dot, is_zero
import numpy as np

Row = list[Scalar]
Matrix = list[Row]
# Least size of a pivot relative to the largest constant of its row.
PIVOT_THRESHOLD = 0.1
# Relative size below which a constant is treated as zero after elimination.
ROUNDING = 1e-12
# Least size of a constant pivot beside traced entries, whose size is unknown: direction
# cosines that are zero but for the digits of a file must not be pivots.
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
    # Constant pivots first, then the blocks of what remains.
    left: Matrix = np.asarray(A, dtype=object).tolist()
    right: Matrix = np.asarray(B, dtype=object).tolist()
    pivot_rows = _eliminate_constants(left, right)
    by_blocks = _solve_blocks(left, right, pivot_rows)

    # The unknowns of constant pivots follow from those of the blocks.
    X: Matrix = []
    for c in range(len(left)):
        if c in by_blocks:
            X.append(by_blocks[c])
        else:
            r = pivot_rows[c]
            X.append(_minus_products(right[r], left[r], by_blocks))
    return np.array(X)


def _eliminate_constants(left: Matrix, right: Matrix) -> dict[int, int]:
    """Eliminate by Gauss-Jordan, in place; return the pivot rows of solved columns."""
    # Constants up to rounding of the row's largest one are no pivots.
    smallest = []
    for row_of_left in left:
        constants = filter(_is_constant, row_of_left)
        smallest.append(ROUNDING * max(map(abs, constants), default=0.0))
    pivot_rows: dict[int, int] = {}
    while (pivot := _constant_pivot(left, pivot_rows, smallest)) is not None:
        row, column = pivot
        pivot_rows[column] = row

        # The pivot's row gets the pivot 1; all other rows lose its multiples.
        scale = 1.0 / left[row][column]
        left[row] = _scaled(scale, left[row])
        right[row] = _scaled(scale, right[row])
        for r in range(len(left)):
            factor = left[r][column]
            if r != row and not is_zero(factor):
                left[r] = _minus_multiple(left[r], factor, left[row])
                right[r] = _minus_multiple(right[r], factor, right[row])
                left[r][column] = 0.0
    return pivot_rows


def _solve_blocks(left: Matrix, right: Matrix,
                  pivot_rows: dict[int, int]) -> dict[int, Row]:
    """Return the unknowns that no constant pivot has solved, by their columns."""
    X: dict[int, Row] = {}
    for rows, columns in _triangular_blocks(left, pivot_rows):
        diagonal = _part(left, rows, columns)
        right_of_block = [right[r] for r in rows]

        # Unknowns of earlier blocks that the rows of this block contain.
        earlier = []
        known = []
        for c in sorted(X):
            column = _part(left, rows, [c])
            if not all(map(is_zero, chain(*column))):
                earlier.append(c)
                known.append(X[c])
        # A y = b - C x: what the earlier unknowns x contribute goes to the right side.
        coupling = _part(left, rows, earlier)
        unknowns = _block_unknowns(diagonal, right_of_block, coupling, known)
        X.update(zip(columns, unknowns))
    return X


def _part(A: Matrix, rows: list[int], columns: list[int]) -> Matrix:
    """Return the submatrix of some rows and columns."""
    part = []
    for r in rows:
        part.append([A[r][c] for c in columns])
    return part


def _minus_products(row: Row, factors: Row, X: dict[int, Row]) -> Row:
    """Return row - sum over c of factors[c] X[c]."""
    for c in sorted(X):
        if not is_zero(factors[c]):
            row = _minus_multiple(row, factors[c], X[c])
    return row


def _is_constant(entry: Scalar) -> bool:
    """Return whether an entry is a number, the same in every state."""
    return isinstance(entry, (int, float))


def _constant_pivot(A: Matrix, pivot_rows: dict[int, int],
                    smallest: list[float]) -> tuple[int, int] | None:
    """
    Return (row, column) of the best constant pivot, or None if there is none.

    The best one is large beside the other constants of its row, and its row has few
    entries, so that elimination fills few zeros.
    """
    pivot: tuple[int, int] | None = None
    best_rank = -np.inf
    for r, row in enumerate(A):
        if r in pivot_rows.values():
            continue
        # Constants of the row in unsolved columns; a traced entry may be of any size.
        sizes: dict[int, float] = {}
        has_traced = False
        for c, entry in enumerate(row):
            if c in pivot_rows:
                continue
            if _is_constant(entry):
                sizes[c] = abs(entry)
            else:
                has_traced = True
        largest = max(sizes.values(), default=0.0)
        # A traced entry may turn out much larger, and the pivot then loses digits.
        if has_traced and largest < ALONE:
            continue
        # Of large enough entries, one in a row with few entries, then a large one.
        filled = list(map(is_zero, row)).count(False)
        for c, size in sizes.items():
            if size <= smallest[r] or size < PIVOT_THRESHOLD * largest:
                continue
            rank = size / largest - filled
            if rank > best_rank:
                best_rank = rank
                pivot = (r, c)
    return pivot


def _triangular_blocks(A: Matrix, pivot_rows: dict[int, int]
                       ) -> list[tuple[list[int], list[int]]]:
    """Return rows and columns of the diagonal blocks, in the order of their solution."""
    n = len(A)
    columns: dict[int, list[int]] = {}  # of a row: those in which it has an entry
    for r in range(n):
        if r in pivot_rows.values():
            continue
        columns[r] = []
        for c in range(n):
            if not (c in pivot_rows or is_zero(A[r][c])):
                columns[r].append(c)

    # A permutation with a full diagonal: each row owns a column in which it has an entry.
    owner: dict[int, int] = {}  # of a column: its row
    for r in columns:
        if not _match(r, columns, owner, set()):
            raise ZeroDivisionError(r)

    # A row needs the rows that own the other columns in which it has entries. Rows that
    # need one another are a block.
    needs: dict[int, list[int]] = {}
    for r, entries in columns.items():
        needs[r] = [owner[c] for c in entries]
    column_of = dict(zip(owner.values(), owner))
    blocks = []
    for rows in _components(needs):
        own_columns = [column_of[r] for r in rows]
        blocks.append((sorted(rows), sorted(own_columns)))
    return blocks


def _match(row: int, columns: dict[int, list[int]], owner: dict[int, int],
           visited: set[int]) -> bool:
    """
    Give a row a column of its own; return whether it has one.

    The rows that own its columns move to others if they can (augmenting path).
    """
    for c in columns[row]:
        if c in visited:
            continue
        visited.add(c)
        if c not in owner or _match(owner[c], columns, owner, visited):
            owner[c] = row
            return True
    return False


def _components(needs: dict[int, list[int]]) -> list[list[int]]:
    """
    Return the strongly connected components of a graph, those needed by others first.

    Tarjan's algorithm: `lowest` is the smallest number of an open node that a node
    reaches.
    """
    # `number` counts nodes in the order of the visit.
    number: dict[int, int] = {}
    lowest: dict[int, int] = {}
    open_nodes: list[int] = []
    components: list[list[int]] = []

    def visit(node: int) -> None:
        number[node] = lowest[node] = len(number)
        open_nodes.append(node)
        for neighbour in needs[node]:
            if neighbour not in number:
                visit(neighbour)
                lowest[node] = min(lowest[node], lowest[neighbour])
            elif neighbour in open_nodes:
                lowest[node] = min(lowest[node], number[neighbour])
        if lowest[node] == number[node]:  # the first node of its component
            place = open_nodes.index(node)
            components.append(open_nodes[place:])
            del open_nodes[place:]

    for node in needs:
        if node not in number:
            visit(node)
    return components


def _block_unknowns(A: Matrix, B: Matrix, C: Matrix, X: Matrix) -> Matrix:
    """
    Return A^-1 (B - C X).

    Or A^-1 B - (A^-1 C) X, whichever takes fewer multiplications.
    """
    m = len(A)
    k = len(B[0])

    # Multiplications of both forms, by the entries that are not structurally zero.
    b = _filled(B, k)
    c = _filled(C, len(X))
    x = _filled(X, k)
    products = c.astype(int) @ x.astype(int)  # of each entry of C X
    together = products.sum() + m * np.sum((products > 0) | b)
    apart = m * (b.sum() + c.sum() + x.sum())
    if apart < together:
        # A^-1 [B C], then the combination of its rows with X.
        both = np.concatenate([np.array(B, dtype=object), np.array(C, dtype=object)], axis=1)
        unknowns = []
        for row in _block_solution(A, both.tolist()):
            unknowns.append(_minus_combination(row[:k], row[k:], X))
        return unknowns
    right = []
    for row, factors in zip(B, C):
        right.append(_minus_combination(row, factors, X))
    return _block_solution(A, right)


def _filled(A: Matrix, columns: int) -> Flags:
    """Return which entries are not structurally zero; A may have no rows."""
    flags = np.zeros((len(A), columns), dtype=bool)
    for r, row in enumerate(A):
        for c, entry in enumerate(row):
            flags[r, c] = not is_zero(entry)
    return flags


def _minus_combination(row: Row, factors: Row, X: Matrix) -> Row:
    """Return row - factors @ X."""
    for factor, known in zip(factors, X):
        row = _minus_multiple(row, factor, known)
    return row


def _block_solution(A: Matrix, B: Matrix) -> Matrix:
    """Return A^-1 B of a block without constant pivots."""
    n = len(A)
    if n > 3:
        return _solve_by_gram_schmidt(A, B)

    # The adjugate, and the determinant from its first column.
    adjugate = np.ones((n, n), dtype=object)
    if n > 1:
        for r in range(n):
            for c in range(n):
                adjugate[c, r] = _cofactor(A, r, c)
    # Cramer's rule: A^-1 is the adjugate over the determinant,
    # here expanded by the first row.
    scale = 1.0 / dot(A[0], adjugate[:, 0])
    X = []
    for row in adjugate.tolist():
        X.append(_combination(_scaled(scale, row), B))
    return X


def _cofactor(A: Matrix, row: int, column: int) -> Scalar:
    """Return the cofactor of an entry of a 2 x 2 or 3 x 3 matrix."""
    rows = list(range(len(A)))
    columns = list(range(len(A)))
    rows.remove(row)
    columns.remove(column)
    # The minor: one entry, or a 2 x 2 determinant.
    minor = _part(A, rows, columns)
    value = minor[0][0]
    if len(minor) == 2:
        value = minor[0][0] * minor[1][1] - minor[0][1] * minor[1][0]
    return value if (row + column) % 2 == 0 else -value


def _solve_by_gram_schmidt(A: Matrix, B: Matrix) -> Matrix:
    """Return A^-1 B by modified Gram-Schmidt, A^T = Q R: X = Q R^-T B."""
    n = len(A)
    basis: Matrix = []  # rows of Q^T
    weights: Matrix = []  # rows of R^-T B
    for k in range(n):
        row = list(A[k])
        weight = list(B[k])

        # Twice: orthogonal to rounding even for nearly dependent rows.
        for _ in range(2):
            for unit, unit_weight in zip(basis, weights):
                along = dot(row, unit)
                row = _minus_multiple(row, along, unit)
                weight = _minus_multiple(weight, along, unit_weight)
        scale = 1.0 / np.sqrt(dot(row, row))
        basis.append(_scaled(scale, row))
        weights.append(_scaled(scale, weight))

    # X = Q times the weights, row by row.
    X = []
    for row_of_basis in zip(*basis):
        X.append(_combination(row_of_basis, weights))
    return X


# ------------------------------------------------------- rows without zero arithmetic

def _combination(weights: Sequence[Scalar], rows: Matrix) -> Row:
    """Return weights @ rows."""
    result = []
    for column in zip(*rows):
        result.append(dot(weights, column))
    return result


def _scaled(scale: Scalar, row: Row) -> Row:
    """Return a row times a scalar; zeros cause no arithmetic."""
    result: Row = [0.0] * len(row)
    if not is_zero(scale):
        for k, x in enumerate(row):
            if not is_zero(x):
                result[k] = scale * x
    return result


def _minus_multiple(row: Row, factor: Scalar, subtracted: Row) -> Row:
    """Return row - factor subtracted."""
    if is_zero(factor):
        return row
    result = list(row)
    for k, y in enumerate(subtracted):
        if not is_zero(y):
            result[k] = row[k] - factor * y
    return result
