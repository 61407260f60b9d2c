"""
Conditioning of the system of independent speeds and constraint rows, and its best choice.

The system of a mechanism, S q' = s with S = [Y_I; J_kept], is ill-conditioned where its rows are
nearly dependent. The conditioning figure (`figure` below, similar to a condition number) is the
Frobenius norm of S^-1 in scaled units: rates of sliding joints relative to the mechanism's length,
each row relative to its size at the sample configurations. Every kernel computes S^-1, so the
figure only adds a sum of squares.

`margin` is traced into the kernels of constrained robots. The other functions are numeric: they
choose speeds and rows, and write the errors for a state without a positive margin.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np

SINGULAR = 1e4  # largest figure: accelerations lose twice its digits, eight of sixteen
EXCESS = 1e-3  # relative: largest violation of redundant rows before it is an error
ROUNDED = 4.0  # rank tolerances: norm of what rows left out within it may miss, several together
WELL_CHOSEN = 8.0  # largest figure over sqrt(n_q) with which a simulation keeps its speeds
RANK = 1e-9  # relative size of a singular value that counts as zero
LIMITS = 4  # number of limits of `margin`
SHARE = 0.5  # of a limit: above it, that limit is the reason for a negative margin


def squared_figure(mechanism: Mechanism, S: Any, inverse: Any) -> Any:
    """Return the squared conditioning figure of S, (n_q, n_q), from its inverse."""
    alike: dict[Any, Any] = {}  # sums of squares of entries with the same weight
    n = mechanism.n
    for r in range(len(S)):  # a speed is scaled by its own norm
        size_2 = (_square(S[r] * mechanism.units) if r < n else
                  mechanism.sizes[mechanism.kept[r - n]]**2)
        for unit, x in zip(mechanism.units, inverse[:, r]):
            if not is_zero(x):
                weight = size_2 * (1.0 / unit**2)
                alike[weight] = alike.get(weight, 0.0) + x * x
    return sum((weight * total for weight, total in alike.items()), start=0.0)


def margin(mechanism: Mechanism, q: Any, t: Any, limits: Any, links: Any = None) -> Any:
    """
    Return the margin of a state, which is positive within all limits, over any scalar.

    It is 1 minus the squares, relative to their limits, of the figure, of the residuals of
    positions, and of the violation of redundant rows.

    Parameters
    ----------
    mechanism : Mechanism
        Speeds and constraints.
    q, t : (n_q,) array, scalar
        Configuration and time; rad or m, and s.
    limits : (4,) array
        One over the square of the largest figure, of the largest residual of positions in m, in
        rad, and of the largest violation of redundant rows; 0 for no limit.
    links : sequence of Link, optional
        Use the kinematics of these links, which are compiled.

    """
    here = mechanism.state(q, t, links)
    S, s = mechanism.system(here)
    inverse = mechanism.solved(S, np.eye(len(S)))
    rows = mechanism.rows(here)
    missed: list[Any] = [0.0, 0.0]  # m^2, rad^2
    for residual, turning in zip(rows.residual, mechanism.turning):
        if residual is not None and not is_zero(residual):
            missed[turning] = missed[turning] + residual * residual
    return 1.0 - (limits[0] * squared_figure(mechanism, S, inverse)
                  + limits[1] * missed[0] + limits[2] * missed[1]
                  + limits[3] * squared_excess(mechanism, S, s, inverse, rows))


def squared_excess(mechanism: Mechanism, S: Any, s: Any, inverse: Any, rows: Any) -> Any:
    """Return the squared violation of redundant rows, relative to their size."""
    total: Any = 0.0
    n = mechanism.n
    at_zero = inverse @ s
    for k in mechanism.left_out:
        row = rows.J[k]
        if any(_identical([*row, rows.b[k]], [*rows.J[j], rows.b[j]]) for j in mechanism.kept):
            continue  # for example the second wheel on an axle, across it
        weight = 1.0 / mechanism.sizes[k]**2
        through = [_dot(row, inverse[:, r]) for r in range(n)]
        moved = sum((x * x * _square(S[r] * mechanism.units) for r, x in enumerate(through)
                     if not is_zero(x)), start=0.0)
        given = _dot(row, at_zero) - rows.b[k]
        total = total + weight * (moved + given * given)
    return total


def guarded(values: Any, condition: Any) -> Any:
    """Return values with NaN as the first entry unless a condition is positive."""
    result = np.array(values, dtype=object)
    if isinstance(condition, float) or not result.size:
        return values
    first = (0,) * result.ndim
    result[first] = select(condition > 0.0, result[first], np.nan)
    return result


def _identical(a: Any, b: Any) -> bool:
    """Return whether two vectors have the same entries: equal traced values are one object."""
    return all(x is y or (isinstance(x, float) and isinstance(y, float) and x == y)
               for x, y in zip(a, b))


def _square(vector: Any) -> Any:
    return sum((x * x for x in vector if not is_zero(x)), start=0.0)


def _dot(a: Any, b: Any) -> Any:
    return sum((x * y for x, y in zip(a, b) if not (is_zero(x) or is_zero(y))), start=0.0)


@dataclass(frozen=True, eq=False)
class Stack:
    """
    All speeds and all constraint rows at one configuration and time, numeric.

    Attributes
    ----------
    Y, Z : (n_q, n_q), (n_q,) arrays
        u = Y q' + Z.
    J, b : (m, n_q), (m,) arrays
        J q' = b.
    residual : (m,) array
        Residuals of positions, m or rad; 0 where a row has none.

    """

    Y: Array
    Z: Array
    J: Array
    b: Array
    residual: Array


@dataclass(frozen=True)
class Choice:
    """Indices of the independent speeds and of the kept rows, with their conditioning figure."""

    free: tuple[int, ...]
    kept: tuple[int, ...]
    figure: float


def stacked(mechanism: Mechanism, q: Array, t: float = 0.0) -> Stack:
    """Return speeds and rows at a configuration, (n_q,), and time; may be non-finite."""
    with np.errstate(all='ignore'):
        here = mechanism.state(np.asarray(q, dtype=np.float64), t)
        rows = mechanism.rows(here)
        Y, Z = mechanism.speeds.of(here.q, t)
        return Stack(*(np.array(x, dtype=np.float64) for x in (Y, Z, rows.J, rows.b, [
            0.0 if residual is None else residual for residual in rows.residual])))


def system(stack: Stack, free: Sequence[int], kept: Sequence[int]) -> Array:
    """Return S of a choice, (n_q, n_q)."""
    return np.concatenate([stack.Y[list(free)], stack.J[list(kept)]])


def scaled_rows(mechanism: Mechanism, stack: Stack) -> tuple[Array, Array]:
    """Return Y and J in units of the mechanism, with entries of order 1."""
    Y = stack.Y * mechanism.units
    Y = Y / np.maximum(np.linalg.norm(Y, axis=1, keepdims=True), 1e-300)
    return Y, stack.J * mechanism.units / np.array(mechanism.sizes)[:, None]


def rows_in_speeds(mechanism: Mechanism, stack: Stack) -> tuple[Array, Array]:
    """
    Return C, (m, n_q), and d, (m,), of C v = d: the constraints in all generalized speeds.

    In units of the mechanism: each speed v is relative to the norm of its row of Y, each row
    relative to its `row_units`.
    """
    Y = stack.Y * mechanism.units
    norms = np.maximum(np.linalg.norm(Y, axis=1), 1e-300)
    J = stack.J * mechanism.units / mechanism.row_units[:, None]
    C: Array = np.linalg.lstsq((Y / norms[:, None]).T, J.T, rcond=None)[0].T
    return C, stack.b / mechanism.row_units + C @ (stack.Z / norms)


def figure(mechanism: Mechanism, stack: Stack, free: Sequence[int], kept: Sequence[int]) -> float:
    """Return the conditioning figure of a choice; infinite for a singular system."""
    Y, J = scaled_rows(mechanism, stack)
    S = np.concatenate([Y[list(free)], J[list(kept)]])
    if not np.isfinite(S).all():
        return np.inf
    smallest = np.linalg.svd(S, compute_uv=False)
    if smallest.min(initial=1.0) <= 1e-300:
        return np.inf
    return float(np.sqrt((smallest**-2.0).sum()))


def best_choice(mechanism: Mechanism, stack: Stack,
                free: Sequence[int] | None = None) -> Choice:
    """
    Return the best conditioned choice.

    Parameters
    ----------
    mechanism : Mechanism
        The choice has as many rows as this mechanism.
    stack : Stack
        Speeds and rows at a configuration and time.
    free : sequence of int, optional
        Given independent speeds; then only rows are chosen.

    """
    Y, J = scaled_rows(mechanism, stack)
    count = len(mechanism.kept)
    if not (np.isfinite(Y).all() and np.isfinite(J).all()):
        return Choice(tuple(mechanism.free), tuple(mechanism.kept), np.inf)
    kept = tuple(sorted(pivots(J.T, count)))
    if free is None:
        try:
            C: Array = np.linalg.solve(Y.T, J[list(kept)].T).T.astype(np.float64)
        except np.linalg.LinAlgError:
            return Choice(tuple(mechanism.free), kept, np.inf)
        dependent = pivots(C, count)
        free = [r for r in range(len(Y)) if r not in dependent]
    return Choice(tuple(free), kept, figure(mechanism, stack, free, kept))


def loosened(mechanism: Mechanism, limit: float) -> float:
    """Return a limit of residuals or redundant rows, but no less than rank_tolerance admits."""
    return max(limit, ROUNDED * mechanism.rank_tolerance)


def in_lengths(mechanism: Mechanism, limit: float) -> tuple[float, float]:
    """Return a limit of residuals of the mechanism: `limit` lengths in m, and `limit` rad."""
    return limit * mechanism.length, limit


def pivots(C: Array, count: int) -> list[int]:
    """Return the first pivot columns of Gram-Schmidt with column pivoting."""
    rest = C.copy()
    taken: list[int] = []
    for _ in range(count):
        size = np.linalg.norm(rest, axis=0)
        size[taken] = -1.0
        k = int(np.argmax(size > (1.0 - 1e-9) * size.max()))  # ties: the first
        taken.append(k)
        direction = rest[:, k] / max(float(np.linalg.norm(rest[:, k])), 1e-300)
        rest = rest - np.outer(direction, direction @ rest)
    return taken


def rank_of(C: Array, tolerance: float = RANK) -> int:
    """Return the numerical rank: singular values above a fraction of the largest."""
    size = np.linalg.svd(C, compute_uv=False)
    return int(np.sum(size > tolerance * max(size.max(initial=0.0), 1e-300))) if len(size) else 0


def constraints_at_fault(mechanism: Mechanism, stack: Stack, free: Sequence[int],
                         kept: Sequence[int]) -> str:
    """Return the quoted names of the constraints with nearly dependent rows."""
    Y, J = scaled_rows(mechanism, stack)
    S = np.concatenate([Y[list(free)], J[list(kept)]])
    if not np.isfinite(S).all():
        return ', '.join(f"'{c.name}'" for c in mechanism.constraints)
    share = np.abs(np.linalg.svd(S)[0][:, -1][len(free):])
    owners = mechanism.owners
    named = dict.fromkeys(owners[k] for k, x in zip(kept, share)
                          if x > 0.1 * share.max(initial=0.0))
    return ', '.join(f"'{name}'" for name in named) or 'none'


def described(mechanism: Mechanism, q: Array) -> str:
    """Return a configuration as text, coordinates by name."""
    return str(dict(zip(mechanism.model.coordinate_names, np.round(q, 9).tolist())))


def singular_error(mechanism: Mechanism, stack: Stack, q: Array, t: float, where: str = '',
                   u: Array | None = None) -> ConstraintError:
    """Return the error for a singular system of speeds and constraints."""
    if not stack.J.size:
        return ConstraintError(f'{where}speeds: {", ".join(mechanism.speed_names)}, Y is singular '
                               f'at {described(mechanism, q)}, t = {t:.6g} s; expected speeds '
                               'that determine the joint rates there (speeds=)')
    at = f'{where}speeds and constraints are singular at {described(mechanism, q)}, t = {t:.6g} s'
    if u is not None:
        at += f', u = {np.round(u, 9).tolist()}'
    loop = constraints_at_fault(mechanism, stack, mechanism.free, mechanism.kept)
    if best_choice(mechanism, stack).figure >= SINGULAR:
        return ConstraintError(
            f'{at}: a kinematic singularity (dead point) of {loop}, whose rows depend on each '
            f'other there, so that no choice of speeds ({", ".join(mechanism.speed_names)} or '
            'others) determines the motion')
    return ConstraintError(
        f'{at}: under {loop} the speeds {", ".join(mechanism.speed_names)} do not determine the '
        'joint rates there; choose others (speeds=, independent=)')
