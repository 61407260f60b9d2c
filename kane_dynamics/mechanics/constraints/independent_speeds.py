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
from kane_dynamics.mechanics.algebra.user_functions import NotFiniteError
from kane_dynamics.mechanics.ball_joints import (balls, difference, moved as moved_by, neutral,
                                                 require_unit)
from kane_dynamics.mechanics.constraints import (checked_constraints, checked_names, Constraint,
                                                 DependentSpeeds, PointVelocity, Prescribed)
from kane_dynamics.mechanics.constraints.closure_advice import advice, no_freedom
from kane_dynamics.mechanics.constraints.conditioning import (described, pivots, RANK, rank_of,
                                                              rows_in_speeds, scaled_rows,
                                                              stacked)
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import positive
from kane_dynamics.mechanics.constraints.loop_closure import (closed_configuration,
                                                              closing_iterations,
                                                              STRIDE)
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.constraints.speeds import speed_places
from kane_dynamics.model.model import Model
import numpy as np

STARTS = 12  # initial guesses for loop closure
PROBE = 0.05  # rad, or lengths of the mechanism: a motion that is tried
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
        left out, and their residual may be up to the tolerance, rad or lengths of the mechanism.

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
    if everything.in_joint_rates and independent is None:
        return everything
    _require_rows(everything, start, configuration is None)
    places = (_closed_configurations(everything) if configuration is None
              else _configurations_near(everything, start))
    places = _finite_places(everything, places)
    samples = [_velocity_rows(everything, q) for q in places]
    if not everything.labels and independent is None:
        return everything
    sizes = _row_sizes(everything, places)
    ranks = [rank_of(C, tolerance) for C, _ in samples]
    m = max(ranks)
    if m == model.n and not any(_driven(constraint) for constraint in constraints):
        # Some assemblies may be rigid where others move, as parallel cranks do.
        movable = [rank for rank, q in zip(ranks, places)
                   if rank < m and _moves(everything, q, rank)]
        if not movable:
            samples = [sample for sample, rank in zip(samples, ranks) if rank == m]
            _check_consistent(everything, samples, sorted(pivots(samples[0][0].T, m)))
            raise no_freedom(everything, places[ranks.index(m)], m)
        m = max(movable)
    samples = [sample for sample, rank in zip(samples, ranks) if rank == m]
    kept = sorted(pivots(samples[0][0].T, m))
    _check_consistent(everything, samples, kept)
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
    norms = np.max([np.linalg.norm(stacked(mechanism, q).J * mechanism.units, axis=1)
                    for q in places], axis=0)
    found = norms / mechanism.row_units
    kinds = list(zip(mechanism.owners, mechanism.turning))
    largest = [max(float(size) for size, kind in zip(found, kinds) if kind == own)
               for own in kinds]
    small = mechanism.rank_tolerance * max(largest, default=0.0)
    return [unit * (size if size > small else 1.0)
            for size, unit in zip(largest, mechanism.row_units.tolist())]


def _require_rows(mechanism: Mechanism, start: Array, elsewhere: bool) -> None:
    """
    Raise ConstraintError unless the rows of all constraints have a value.

    At the configuration `start`, or, with `elsewhere`, at one of those that are tried: a
    user-defined function may not be finite at 0.
    """
    failures = []
    starts = [start, *_starts(mechanism)] if elsewhere else [start]
    for q in starts:
        here = mechanism.state(q)
        try:
            for constraint in mechanism.constraints:
                with np.errstate(all='ignore'):  # a distance of zero has no direction
                    constraint.rows(here)
            return
        except NotFiniteError as error:
            failures.append(error)
        except InputError as error:
            raise ConstraintError(f"constraint '{constraint.name}': {error}") from None
    if not elsewhere:
        raise failures[0]
    raise ConstraintError(f'{failures[0]}, there or at one of {STARTS} other configurations, or '
                          'configuration= where they are finite')


def _finite_places(mechanism: Mechanism, places: list[Array]) -> list[Array]:
    """Return the configurations at which all rows are finite; ConstraintError if none is."""
    regular = []
    for q in places:
        stack = stacked(mechanism, q)
        finite = np.isfinite(stack.J).all(axis=1) & np.isfinite(stack.b)
        if finite.all():
            regular.append(q)
    if regular:
        return regular
    names = ', '.join(dict.fromkeys(
        f"'{owner}'" for owner, good in zip(mechanism.owners, finite) if not good))
    raise ConstraintError(f'constraint {names}: not finite at {described(mechanism, places[0])}; '
                          'expected another configuration=')


def _moves(mechanism: Mechanism, q: Array, rank: int) -> bool:
    """
    Return whether a closed configuration with dependent rows can move, not in theory alone.

    Its loops close some way along a motion that the rows admit, and the rows still depend on each
    other there, as they do not beside an isolated singular configuration.
    """
    C = _velocity_rows(mechanism, q)[0]
    stack = stacked(mechanism, q)
    admitted = np.linalg.svd(C)[2][-1]
    Y = scaled_rows(mechanism, stack)[0]
    way = mechanism.units * np.linalg.solve(Y, admitted)
    step = PROBE * way / np.abs(way / mechanism.units).max()
    try:
        there = closed_configuration(mechanism, moved_by(mechanism.model, q, step))
    except ConstraintError:
        return False
    gone = np.abs(difference(mechanism.model, q, there) / mechanism.units).max()
    there_rank = rank_of(_velocity_rows(mechanism, there)[0], mechanism.rank_tolerance)
    return bool(gone > 0.5 * PROBE and there_rank == rank)


def _starts(mechanism: Mechanism) -> list[Array]:
    """Return initial guesses for loop closure, the first near 0, within the joint limits."""
    limits = [joint.limits for joint in mechanism.model.coordinate_joints]
    units = mechanism.units
    lower = np.maximum([limit.lower for limit in limits], -np.pi * units)
    upper = np.minimum([limit.upper for limit in limits], np.pi * units)
    rng = np.random.default_rng(0)
    starts = [np.clip(units * rng.uniform(-0.1, 0.1, len(lower)), lower, upper),
              *rng.uniform(lower, upper, (STARTS - 1, len(lower)))]
    return [moved_by(mechanism.model, neutral(mechanism.model), start) for start in starts]


def _closed_configurations(mechanism: Mechanism) -> list[Array]:
    """Return up to `SAMPLES` closed configurations within the joint limits."""
    starts = _starts(mechanism)
    found: list[Array] = []
    failures: list[ConstraintError] = []
    for start in starts:
        try:
            found.append(closed_configuration(mechanism, start))
        except ConstraintError as error:
            failures.append(error)
        if len(found) == SAMPLES:
            return found
    if not found:
        nearest = min((closing_iterations(mechanism, start, np.ones(mechanism.model.n, bool), 0.0)
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


def _configurations_near(mechanism: Mechanism, q: Array) -> list[Array]:
    """Return closed configurations at and near q; ConstraintError if q is far from closed."""
    try:
        closed = closed_configuration(mechanism, q)
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
            found.append(closed_configuration(mechanism, moved_by(mechanism.model, closed, step)))
        except ConstraintError:
            continue
    return found


def _velocity_rows(mechanism: Mechanism, q: Array) -> tuple[Array, Array]:
    """Return C and d as `rows_in_speeds`; ConstraintError where the speeds are singular."""
    stack = stacked(mechanism, q)
    Y = scaled_rows(mechanism, stack)[0]
    if not np.linalg.cond(Y) < 1.0 / RANK:
        raise ConstraintError(f'speeds: {", ".join(mechanism.speeds.names)}, Y is singular at q = '
                              f'{np.round(q, 6).tolist()}; expected speeds that determine the '
                              'joint rates there')
    return rows_in_speeds(mechanism, stack)


def _check_consistent(mechanism: Mechanism, samples: list[tuple[Array, Array]],
                      kept: list[int]) -> None:
    """Raise ConstraintError if a redundant row contradicts the kept rows."""
    for C, d in samples:
        weights = np.linalg.lstsq(C[kept].T, C.T, rcond=None)[0]  # rows in terms of kept rows
        excess = np.abs(d - weights.T @ d[kept])
        if excess.max(initial=0.0) > mechanism.rank_tolerance * (1.0 + np.abs(d).max(initial=0.0)):
            k = int(np.argmax(excess))
            raise ConstraintError(f"constraint '{mechanism.labels[k]}' contradicts the others: "
                                  f'its velocity residual is '
                                  f'{excess[k] * mechanism.row_units[k]:.3g}; expected 0')


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
