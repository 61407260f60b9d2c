"""
The choice of independent speeds and constraint rows, at sample configurations.

Numeric only. A redundant row (the out-of-plane rows of a planar loop) is left out; a contradictory
row is an error. The choice is valid near the samples: calls and simulations check its conditioning
(`conditioning`) and choose again where needed.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.ball_joints import (balls, difference, moved as moved_by, neutral,
                                                 require_unit)
from kane_dynamics.mechanics.constraints import (checked_constraints, checked_names, Constraint,
                                                 DependentSpeeds, PointVelocity, Prescribed)
from kane_dynamics.mechanics.constraints.closure_advice import advice, no_freedom
from kane_dynamics.mechanics.constraints.conditioning import pivots, RANK, rank_of, stacked
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import positive
from kane_dynamics.mechanics.constraints.loop_closure import (closed_posture, closing_iterations,
                                                              STRIDE)
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.constraints.speeds import speed_places
from kane_dynamics.model.model import Model
import numpy as np

STARTS = 12  # initial guesses for loop closure
SAMPLES = 4  # closed configurations at which the rank is computed


def choose_independent(model: Model, speeds: Any, constraints: Sequence[Constraint],
                       independent: Sequence[str] | None = None,
                       configuration: Any = None, rank_tolerance: float = RANK) -> Mechanism:
    """
    Return the mechanism with a choice of independent speeds and rows.

    Parameters
    ----------
    model : Model
        The mechanism.
    speeds : None, Speeds or callable
        As in `speeds.chosen`.
    constraints : sequence of constraints
        The constraints on the motion.
    independent : sequence of str, optional
        Names of the independent speeds; the best conditioned by default.
    configuration : (n_q,) array_like, optional
        A closed or nearly closed configuration, rad or m. By default configurations within the
        joint limits are tried.
    rank_tolerance : float
        Singular values up to this fraction of the largest count as zero. A value above the default
        accepts loops with a rounded description: rows that are redundant within the tolerance are
        left out, and their residual may be up to the tolerance, m or rad.

    Raises
    ------
    ConstraintError
        A constraint names an unknown joint or frame; the constraints contradict each other, cannot
        be met, or leave no degree of freedom without prescribing a motion; Y is singular; or
        `independent` does not fit.

    """
    constraints = checked_constraints(constraints)
    independent = checked_names(independent, 'independent')
    tolerance = positive(rank_tolerance, 'rank_tolerance')
    everything = Mechanism(model, speeds, constraints, rank_tolerance=tolerance)
    start = neutral(model) if configuration is None else _checked(everything, configuration)
    for constraint in everything.constraints:
        try:
            with np.errstate(all='ignore'):  # a distance of zero has no direction
                constraint.rows(everything.state(start))
        except InputError as error:
            raise ConstraintError(f"constraint '{constraint.name}': {error}") from None
    places = (_closed_postures(everything) if configuration is None
              else _postures_near(everything, start))
    samples = [_velocity_rows(everything, q) for q in places]
    if not everything.labels and independent is None:
        return everything
    sizes = _row_sizes(everything, places)
    ranks = [rank_of(C, tolerance) for C, _ in samples]
    m = max(ranks)
    place = places[ranks.index(m)]
    samples = [sample for sample, found in zip(samples, ranks) if found == m]
    kept = sorted(pivots(samples[0][0].T, m))
    _check_consistent(everything, samples, kept)
    if m == model.n and not any(_driven(constraint) for constraint in constraints):
        raise no_freedom(everything, place, m)
    if independent is None:
        free = _best_free([C[kept] for C, _ in samples])
    else:
        free = _given_free(everything, independent, [C[kept] for C, _ in samples])
    return Mechanism(model, speeds, constraints, free, kept, sizes, tolerance)


def _driven(constraint: Constraint) -> bool:
    """Return whether a constraint may prescribe a nonzero motion."""
    if isinstance(constraint, PointVelocity):
        return callable(constraint.value) or constraint.value != 0.0
    return isinstance(constraint, Prescribed | DependentSpeeds)


def _row_sizes(mechanism: Mechanism, places: list[Array]) -> list[float]:
    """Return for each row the largest norm, in mechanism units, of rows of its kind."""
    found = np.max([np.linalg.norm(stacked(mechanism, q).J * mechanism.units, axis=1)
                    for q in places], axis=0)
    kinds = list(zip(mechanism.owners, mechanism.turning))
    largest = [max(float(size) for size, kind in zip(found, kinds) if kind == own)
               for own in kinds]
    return [size if size > mechanism.rank_tolerance * max(largest) else 1.0 for size in largest]


def _closed_postures(mechanism: Mechanism) -> list[Array]:
    """Return up to `SAMPLES` closed configurations within the joint limits."""
    limits = [joint.limits for joint in mechanism.model.coordinate_joints]
    lower = np.array([max(limit.lower, -np.pi) for limit in limits])
    upper = np.array([min(limit.upper, np.pi) for limit in limits])
    rng = np.random.default_rng(0)
    starts = [np.clip(rng.uniform(-0.1, 0.1, len(lower)), lower, upper),
              *rng.uniform(lower, upper, (STARTS - 1, len(lower)))]
    starts = [moved_by(mechanism.model, neutral(mechanism.model), start) for start in starts]
    found: list[Array] = []
    failures: list[ConstraintError] = []
    for start in starts:
        try:
            found.append(closed_posture(mechanism, start))
        except ConstraintError as error:
            failures.append(error)
        if len(found) == SAMPLES:
            return found
    if not found:
        nearest = min((closing_iterations(mechanism, start, np.ones(len(lower), bool), 0.0)
                       for start in starts), key=lambda end: np.nan_to_num(
                           np.abs(end[1]), nan=np.inf).max(initial=0.0))
        raise ConstraintError(f'{failures[0]}; {advice(mechanism, nearest[0])}')
    return found


def coordinates_by_name(model: Model, configuration: Any) -> Any:
    """
    Return a configuration given by joint as an array, (n_q,); anything else unchanged.

    Joints that are not named are at 0, ball joints not rotated.
    """
    if not isinstance(configuration, Mapping):
        return configuration
    names = model.coordinate_names
    unknown = [name for name in configuration if name not in names]
    if unknown:
        raise ConstraintError(f"configuration: joint '{unknown[0]}'; expected one of "
                              f'{", ".join(names)}')
    for ball in balls(model):
        entries = ball.quaternion(np.array(names)).tolist()
        if 0 < sum(name in configuration for name in entries) < len(entries):
            raise ConstraintError(f"configuration: the quaternion of '{ball.name}' in part; "
                                  f'expected all of {", ".join(entries)}, or none')
    return np.array([configuration.get(name, value) for name, value in zip(
        names, neutral(model).tolist())], dtype=np.float64)


def _checked(mechanism: Mechanism, configuration: Any) -> Array:
    """Return a configuration as an array, (n_q,); ConstraintError for anything else."""
    names = mechanism.model.coordinate_names
    try:
        q = np.array(configuration, dtype=np.float64)
    except (TypeError, ValueError):
        q = np.array(np.nan)
    if q.shape != (len(names),) or not np.isfinite(q).all():
        raise ConstraintError(f'configuration: {configuration!r}; expected {len(names)} finite '
                              f'numbers: {", ".join(names)}')
    return require_unit(mechanism.model, q, 'configuration')


def _postures_near(mechanism: Mechanism, q: Array) -> list[Array]:
    """Return closed configurations at and near q; ConstraintError if q is far from closed."""
    try:
        closed = closed_posture(mechanism, q)
    except ConstraintError as error:
        raise ConstraintError(f'{error}; {advice(mechanism, q)}') from None
    change = np.abs(difference(mechanism.model, q, closed))
    moved = change / mechanism.units
    worst = int(np.argmax(moved))
    if moved[worst] > STRIDE:
        raise ConstraintError(
            f"configuration: closing its loops moves '{mechanism.model.joint_names[worst]}' "
            f'by {change[worst]:.3g} rad or m; expected a configuration that is closed '
            'to within a small correction, so that it stays on its branch')
    found, rng = [closed], np.random.default_rng(0)
    for _ in range(SAMPLES - 1):
        try:
            step = 0.05 * mechanism.units * rng.uniform(-1.0, 1.0, mechanism.model.n)
            found.append(closed_posture(mechanism, moved_by(mechanism.model, closed, step)))
        except ConstraintError:
            continue
    return found


def _velocity_rows(mechanism: Mechanism, q: Array) -> tuple[Array, Array]:
    """Return C and d of C u = d, the constraints in all generalized speeds."""
    here = mechanism.state(q)
    rows = mechanism.rows(here)
    Y, Z = (np.array(x, dtype=np.float64) for x in mechanism.speeds.of(q, 0.0))
    if not np.linalg.cond(Y) < 1.0 / RANK:
        raise ConstraintError(f'speeds: {", ".join(mechanism.speeds.names)}, Y is singular at q = '
                              f'{np.round(q, 6).tolist()}; expected speeds that determine the '
                              'joint rates there')
    C: Array = np.linalg.solve(Y.T, np.array(rows.J, dtype=np.float64).T).T.astype(np.float64)
    return C, np.array(rows.b, dtype=np.float64) + C @ Z


def _check_consistent(mechanism: Mechanism, samples: list[tuple[Array, Array]],
                      kept: list[int]) -> None:
    """Raise ConstraintError if a redundant row contradicts the kept rows."""
    for C, d in samples:
        weights = np.linalg.lstsq(C[kept].T, C.T, rcond=None)[0]  # rows in terms of kept rows
        excess = np.abs(d - weights.T @ d[kept])
        if excess.max(initial=0.0) > mechanism.rank_tolerance * (1.0 + np.abs(d).max(initial=0.0)):
            k = int(np.argmax(excess))
            raise ConstraintError(f"constraint '{mechanism.labels[k]}' contradicts the others: "
                                  f'its velocity residual is {excess[k]:.3g}; expected 0')


def _conditioning(rows: list[Array], dependent: Sequence[int]) -> float:
    """Return the smallest singular value of the dependent speeds' columns over all samples."""
    return min(float(np.linalg.svd(C[:, dependent], compute_uv=False).min(initial=np.inf)
                     / max(np.abs(C).max(initial=0.0), 1e-300)) for C in rows)


def _best_free(rows: list[Array]) -> list[int]:
    """Return the independent speeds with the best conditioned dependent ones."""
    count, n = rows[0].shape
    choices = [sorted(pivots(C, count)) for C in rows]
    best = max(choices, key=lambda dependent: _conditioning(rows, dependent))
    return [r for r in range(n) if r not in best]


def _given_free(mechanism: Mechanism, names: Sequence[str], rows: list[Array]) -> list[int]:
    """Return the indices of the user-defined independent speeds."""
    free = speed_places(mechanism.speeds, names)
    count, n = rows[0].shape
    if len(set(free)) != n - count:
        raise ConstraintError(f'independent: {len(set(free))} speeds ({", ".join(names)}); '
                              f'expected exactly {n - count} of '
                              f'{", ".join(mechanism.speeds.names)}, because {count} '
                              'constraint rows are independent')
    dependent = [r for r in range(n) if r not in free]
    if _conditioning(rows, dependent) < RANK:
        raise ConstraintError(f'independent: {", ".join(names)}, which do not determine the other '
                              'speeds under the constraints; expected others, or None')
    return free
