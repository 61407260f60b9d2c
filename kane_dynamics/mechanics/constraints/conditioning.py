"""
Conditioning of the system of independent speeds and constraint rows.

The system of a mechanism, S q' = s with S = [Y_I; J_kept], is ill-conditioned where its
rows are nearly dependent. The conditioning figure (`figure` below, similar to a
condition number) is the Frobenius norm of S^-1 in scaled units: rates of sliding joints
relative to the mechanism's length, each row relative to its size at the sample
configurations. Every kernel computes S^-1, so the figure only adds a sum of squares.

`margin` is traced into the kernels of constrained robots. The other functions are
numeric: they choose speeds and rows, and write the errors for a state without a positive
margin.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.vector import dot, is_zero
from kane_dynamics.mechanics.constraints import ConstraintRows, Rolling
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.recursive.link import Link
import numpy as np

SINGULAR = 1e4  # largest figure: accelerations lose twice its digits, eight of sixteen
EXCESS = 1e-3  # relative: largest violation of redundant rows before it is an error
ROUNDED = 4.0  # rank tolerances: largest violation of several rows left out within it
WELL_CHOSEN = 8.0  # largest figure over sqrt(n_q) for a simulation to keep its speeds
RANK = 1e-9  # relative size of a singular value that counts as zero
LIMITS = 4  # number of limits of `margin`
SHARE = 0.5  # of a limit: above it, that limit is the reason for a negative margin
TINY = 1e-300  # least divisor of a norm that may be zero


def squared_figure(mechanism: Mechanism, S: Matrix, inverse: Matrix) -> Scalar:
    """Return the squared conditioning figure of S, (n_q, n_q), from its inverse."""
    # The sum over r, s of (size_r / unit_s)^2 (S^-1)_sr^2. Entries of the same weight
    # are summed first, which takes fewer multiplications.
    sums: dict[Scalar, Scalar] = {}
    n = mechanism.n
    for r in range(len(S)):
        if r < n:
            row = S[r] * mechanism.units
            size_2 = dot(row, row)  # a speed: its own norm
        else:
            size_2 = mechanism.sizes[mechanism.kept[r - n]]**2
        for unit, x in zip(mechanism.units, inverse[:, r]):
            if not is_zero(x):
                weight = size_2 * (1.0 / unit**2)
                sums[weight] = sums.get(weight, 0.0) + x * x
    figure_2: Scalar = 0.0
    for weight, total in sums.items():
        figure_2 = figure_2 + weight * total
    return figure_2


def margin(mechanism: Mechanism, q: Vector, t: Scalar, limits: Vector,
           links: Sequence[Link] | None = None) -> Scalar:
    """
    Return the margin of a state, which is positive within all limits, over any scalar.

    It is 1 minus the squares, relative to their limits, of the figure, of the residuals
    of positions, and of the violation of redundant rows.

    Parameters
    ----------
    mechanism : Mechanism
        Speeds and constraints.
    q, t : (n_q,) array, scalar
        Configuration and time; rad or m, and s.
    limits : (4,) array
        One over the square of the largest figure, of the largest residual of positions
        in m (of the largest loop), in rad, and of the largest violation of redundant
        rows; 0 for no limit.
    links : sequence of Link, optional
        Use the kinematics of these links, which are compiled.

    """
    # S q' = [u; 0] + s: rows of the independent speeds, then of the constraints.
    state = mechanism.state(q, t, links)
    S, s = mechanism.system(state)
    inverse = mechanism.solved(S, np.eye(len(S)))
    rows = mechanism.rows(state)

    # Residuals of translations, m^2, and of rotations, rad^2.
    length_2: Scalar = 0.0
    angle_2: Scalar = 0.0
    for residual, turning, unit in zip(rows.residual, mechanism.turning,
                                       mechanism.closure_units.tolist()):
        if residual is None or is_zero(residual):
            continue
        if turning:
            angle_2 = angle_2 + residual * residual
        else:
            # A smaller loop than the largest is judged in its own length.
            if unit != mechanism.closure_length:
                residual = residual * (mechanism.closure_length / unit)
            length_2 = length_2 + residual * residual

    # Each figure, divided by its limit, uses a part of the margin 1.
    return 1.0 - (limits[0] * squared_figure(mechanism, S, inverse)
                  + limits[1] * length_2 + limits[2] * angle_2
                  + limits[3] * squared_excess(mechanism, S, s, inverse, rows))


def squared_excess(mechanism: Mechanism, S: Matrix, s: Vector, inverse: Matrix,
                   rows: ConstraintRows) -> Scalar:
    """Return the squared violation of redundant rows, relative to their size."""
    total: Scalar = 0.0
    qdot_at_zero = inverse @ s  # at zero independent speeds
    for k in mechanism.left_out:
        # A row that equals a kept one is never violated: for example that of the second
        # wheel on an axle, across it.
        row = rows.J[k]
        repeats = False
        for j in mechanism.kept:
            repeats |= _identical([*row, rows.b[k]], [*rows.J[j], rows.b[j]])
        if repeats:
            continue

        # The velocity residual for unit independent speeds, and at zero speeds.
        weight = 1.0 / mechanism.sizes[k]**2
        by_speed = []
        for r in range(mechanism.n):
            by_speed.append(dot(row, inverse[:, r]))
        moving_2: Scalar = 0.0
        for r, x in enumerate(by_speed):
            if not is_zero(x):
                row_of_speed = S[r] * mechanism.units
                moving_2 = moving_2 + x * x * dot(row_of_speed, row_of_speed)
        at_zero = dot(row, qdot_at_zero) - rows.b[k]
        total = total + weight * (moving_2 + at_zero * at_zero)
    return total


def guarded(values: Any, condition: Scalar) -> Any:
    """Return values with NaN as the first entry unless a condition is positive."""
    result = np.array(values, dtype=object)
    if isinstance(condition, float) or not result.size:
        return values
    first = (0,) * result.ndim
    result[first] = select(condition > 0.0, result[first], np.nan)
    return result


def _identical(a: Sequence[Scalar], b: Sequence[Scalar]) -> bool:
    """Return whether two vectors have the same entries."""
    for x, y in zip(a, b):
        # Equal traced values are one object.
        same_number = isinstance(x, float) and isinstance(y, float) and x == y
        if x is not y and not same_number:
            return False
    return True


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
    """Indices of the independent speeds and of the kept rows, with their figure."""

    free: tuple[int, ...]
    kept: tuple[int, ...]
    figure: float


def stacked(mechanism: Mechanism, q: Array, t: float = 0.0) -> Stack:
    """Return speeds and rows at a configuration, (n_q,), and time; may be non-finite."""
    with np.errstate(all='ignore'):
        state = mechanism.state(np.asarray(q, dtype=np.float64), t)
        rows = mechanism.rows(state)
        Y, Z = mechanism.speeds.of(state.q, t)
    parts = Y, Z, rows.J, rows.b, rows.residual_or_zero
    return Stack(*(np.array(part, dtype=np.float64) for part in parts))


def system(stack: Stack, free: Sequence[int], kept: Sequence[int]) -> Array:
    """Return S of a choice, (n_q, n_q)."""
    return np.concatenate([stack.Y[list(free)], stack.J[list(kept)]])


def scaled_rows(mechanism: Mechanism, stack: Stack) -> tuple[Array, Array]:
    """Return Y and J in units of the mechanism, with entries of order 1."""
    Y = stack.Y * mechanism.units
    Y = Y / np.maximum(np.linalg.norm(Y, axis=1, keepdims=True), TINY)
    J = stack.J * mechanism.units / np.array(mechanism.sizes)[:, None]
    return Y, J


def rows_in_speeds(mechanism: Mechanism, stack: Stack) -> tuple[Array, Array]:
    """
    Return C, (m, n_q), and d, (m,), of C v = d: the constraints in all speeds.

    In units of the mechanism: each generalized speed v is relative to the norm of its
    row of Y, each row relative to its `row_units`.
    """
    Y = stack.Y * mechanism.units
    norms = np.maximum(np.linalg.norm(Y, axis=1), TINY)
    J = stack.J * mechanism.units / mechanism.row_units[:, None]

    # J q' = b with v = Y q' + Z: C Y = J, d = b + C Z.
    C: Array = np.linalg.lstsq((Y / norms[:, None]).T, J.T, rcond=None)[0].T
    d = stack.b / mechanism.row_units + C @ (stack.Z / norms)
    return C, d


def figure(mechanism: Mechanism, stack: Stack, free: Sequence[int],
           kept: Sequence[int]) -> float:
    """Return the conditioning figure of a choice; infinite for a singular system."""
    Y, J = scaled_rows(mechanism, stack)
    S = np.concatenate([Y[list(free)], J[list(kept)]])
    if not np.isfinite(S).all():
        return np.inf
    singular_values = np.linalg.svd(S, compute_uv=False)
    if singular_values.min(initial=1.0) <= TINY:
        return np.inf
    # The Frobenius norm of S^-1.
    return float(np.sqrt((singular_values**-2.0).sum()))


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

    # The rows that are pivots among all rows; the speeds that are pivots of these rows,
    # C in all speeds, are dependent.
    independent_rows = tuple(sorted(pivots(J.T, count)))
    if free is None:
        try:
            C = np.linalg.solve(Y.T, J[list(independent_rows)].T).T.astype(np.float64)
        except np.linalg.LinAlgError:
            return Choice(tuple(mechanism.free), independent_rows, np.inf)
        dependent = pivots(C, count)
        free = [r for r in range(len(Y)) if r not in dependent]
    value = figure(mechanism, stack, free, independent_rows)
    return Choice(tuple(free), independent_rows, value)


def loosened(mechanism: Mechanism, limit: float) -> float:
    """Return a limit of residuals or redundant rows, at least that of rank_tolerance."""
    return max(limit, ROUNDED * mechanism.rank_tolerance)


def in_lengths(mechanism: Mechanism, limit: float) -> tuple[float, float]:
    """Return a limit of residuals: `limit` lengths of the largest loop, m, and rad."""
    return limit * mechanism.closure_length, limit


def largest_residuals(mechanism: Mechanism, tolerance: tuple[float, float]) -> Array:
    """Return the largest residual of each row, (m,), for those of `closure_tolerance`."""
    lengths = tolerance[0] * mechanism.closure_units / mechanism.closure_length
    return np.where(mechanism.turning, tolerance[1], lengths)


def pivots(C: Array, count: int) -> list[int]:
    """Return the first pivot columns of Gram-Schmidt with column pivoting."""
    remainder = C.copy()
    columns: list[int] = []
    for _ in range(count):
        # The largest column that is left; of equal ones, to rounding, the first.
        norms = np.linalg.norm(remainder, axis=0)
        norms[columns] = -1.0
        k = int(np.argmax(norms > (1.0 - 1e-9) * norms.max()))
        columns.append(k)

        # Remove its direction from all columns.
        norm = max(float(np.linalg.norm(remainder[:, k])), TINY)
        direction = remainder[:, k] / norm
        remainder = remainder - np.outer(direction, direction @ remainder)
    return columns


def rank_of(C: Array, tolerance: float = RANK) -> int:
    """Return the numerical rank: singular values above a fraction of the largest."""
    singular_values = np.linalg.svd(C, compute_uv=False)
    if not len(singular_values):
        return 0
    smallest = tolerance * max(singular_values.max(initial=0.0), TINY)
    return int(np.sum(singular_values > smallest))


def constraints_at_fault(mechanism: Mechanism, stack: Stack, free: Sequence[int],
                         kept: Sequence[int]) -> str:
    """Return the quoted names of the constraints with nearly dependent rows."""
    Y, J = scaled_rows(mechanism, stack)
    S = np.concatenate([Y[list(free)], J[list(kept)]])
    if not np.isfinite(S).all():
        return ', '.join(f"'{constraint.name}'" for constraint in mechanism.constraints)

    # The left singular vector of the smallest singular value: the combination of rows
    # that is nearly zero.
    U, _, _ = np.linalg.svd(S)
    share = np.abs(U[:, -1][len(free):])
    names: dict[str, None] = {}  # in order, without repetition
    for k, x in zip(kept, share):
        if x > 0.1 * share.max(initial=0.0):
            names[mechanism.owners[k]] = None
    return ', '.join(f"'{name}'" for name in names) or 'none'


def described(mechanism: Mechanism, q: Array) -> str:
    """Return a configuration as text, coordinates by name."""
    values = np.round(q, 9).tolist()
    return str(dict(zip(mechanism.model.coordinate_names, values)))


def _are_tangents_of_wheels(mechanism: Mechanism, places: Sequence[int]) -> bool:
    """Return whether these rows are tangents of rolling without an axle."""
    wheels = []
    for constraint in mechanism.constraints:
        if isinstance(constraint, Rolling) and constraint.axis is None:
            wheels.append(constraint.name)
    return all(mechanism.owners[k] in wheels and '/tangent_' in mechanism.labels[k]
               for k in places)


def singular_error(mechanism: Mechanism, stack: Stack, q: Array, t: float,
                   where: str = '', u: Array | None = None) -> ConstraintError:
    """Return the error for a singular system of speeds and constraints."""
    speeds = ', '.join(mechanism.speed_names)
    at = f'{described(mechanism, q)}, t = {t:.6g} s'
    # Without constraint rows only the chosen speeds can be at fault.
    if not stack.J.size:
        return ConstraintError(
            f'{where}speeds: {speeds}, Y is singular at {at}; expected speeds that '
            'determine the joint rates there (speeds=)')

    if u is not None:
        at += f', u = {np.round(u, 9).tolist()}'

    # Rows that are not finite have no rank to judge.
    infinite = ~np.isfinite(stack.J).all(axis=1)
    if infinite.any():
        places = np.flatnonzero(infinite).tolist()
        rows = ', '.join(f"'{mechanism.labels[k]}'" for k in places)
        advice = ''
        if _are_tangents_of_wheels(mechanism, places):
            advice = ('; tangents of a ball are not defined where it touches the surface '
                      'opposite to `normal` of Rolling')
        return ConstraintError(
            f'{where}constraints: the rows {rows} are not finite at {at}; expected a '
            f'configuration at which they are defined{advice}')

    # A dead point if even the best choice of speeds is singular;
    # otherwise another choice helps.
    singular = f'{where}speeds and constraints are singular at {at}'
    loop = constraints_at_fault(mechanism, stack, mechanism.free, mechanism.kept)
    if best_choice(mechanism, stack).figure >= SINGULAR:
        return ConstraintError(
            f'{singular}: a kinematic singularity (dead point) of {loop}, whose rows '
            'depend on each other there, so that no choice of speeds '
            f'({speeds} or others) determines the motion')
    return ConstraintError(
        f'{singular}: under {loop} the speeds {speeds} do not determine the joint rates '
        'there; choose others (speeds=, independent=)')


def limits_of(figure: float, residual: tuple[float, float] | None = None,
              excess: float = EXCESS) -> Array:
    """
    Return the four limits of `margin`.

    The largest residuals are in m and rad; None for no limit of residuals.
    """
    others = np.zeros(3) if residual is None else np.array([*residual, excess])**-2.0
    return np.array([figure**-2.0, *others])
