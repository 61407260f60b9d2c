"""
The choice of independent speeds and constraint rows, at sample configurations.

Numeric only. A redundant row (the out-of-plane rows of a planar loop) is left out; a
contradictory row is an error. The choice is valid near the samples: calls and
simulations check its conditioning (`conditioning`) and choose again where needed.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.algebra.user_functions import NotFiniteError
from kane_dynamics.mechanics.ball_joints import (balls, difference, moved as moved_by,
                                                 neutral, require_unit)
from kane_dynamics.mechanics.constraints import (checked_constraints, checked_names,
                                                 Constraint, DependentSpeeds,
                                                 PointVelocity, Prescribed)
from kane_dynamics.mechanics.constraints.closure_advice import advice, no_freedom
from kane_dynamics.mechanics.constraints.conditioning import (described, pivots, RANK,
                                                              rank_of, rows_in_speeds,
                                                              scaled_rows, stacked)
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import positive
from kane_dynamics.mechanics.constraints.loop_closure import (closed_configuration,
                                                              closing_iterations, STRIDE)
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.constraints.speeds import speed_places
from kane_dynamics.model.model import Model
import numpy as np

STARTS = 12  # initial guesses for loop closure
PROBE = 0.05  # rad, or lengths of the mechanism: a motion that is tried
SAMPLES = 4  # closed configurations at which the rank is computed


def choose_independent(model: Model, speeds: Any, constraints: Sequence[Constraint],
                       independent: Sequence[str] | None = None,
                       configuration: Any = None,
                       rank_tolerance: float = RANK) -> Mechanism:
    """
    Return the mechanism with a choice of independent speeds and rows.

    Parameters
    ----------
    model : Model
        The mechanism.
    speeds : None, Speeds or callable
        As in `speeds.chosen_speeds`.
    constraints : sequence of constraints
        The constraints on the motion.
    independent : sequence of str, optional
        Names of the independent speeds; the best conditioned by default.
    configuration : (n_q,) array_like, optional
        A closed or nearly closed configuration, rad or m. By default configurations
        within the joint limits are tried.
    rank_tolerance : float
        Singular values up to this fraction of the largest count as zero. A value above
        the default accepts loops with a rounded description: rows that are redundant
        within the tolerance are left out, and their residual may be up to the tolerance,
        rad or lengths of the mechanism.

    Raises
    ------
    ConstraintError
        A constraint names an unknown joint or frame; the constraints contradict each
        other, cannot be met, or leave no degree of freedom without prescribing a motion;
        Y is singular; or `independent` does not fit.

    """
    constraints = checked_constraints(constraints)
    independent = checked_names(independent, 'independent')
    tolerance = positive(rank_tolerance, 'rank_tolerance')
    mechanism = Mechanism(model, speeds, constraints, rank_tolerance=tolerance)
    if configuration is None:
        start = neutral(model)
    else:
        start = _checked(mechanism, configuration)
    if mechanism.in_joint_rates and independent is None:
        return mechanism

    # Closed configurations, and there C v = d, the constraints in all speeds v.
    _require_rows(mechanism, start, configuration is None)
    if configuration is None:
        places = _closed_configurations(mechanism)
    else:
        places = _configurations_near(mechanism, start)
    places = _finite_places(mechanism, places)
    samples = [_velocity_rows(mechanism, q) for q in places]
    if not mechanism.labels and independent is None:
        return mechanism

    # The number of independent rows is the largest rank: the rank falls at singular
    # configurations.
    sizes = _row_sizes(mechanism, places)
    ranks = [rank_of(C, tolerance) for C, _ in samples]
    m = max(ranks)
    if m == model.n and not any(_driven(constraint) for constraint in constraints):
        # Some assemblies may be rigid where others move, as parallel cranks do.
        movable = []
        for rank, q in zip(ranks, places):
            if rank < m and _moves(mechanism, q, rank):
                movable.append(rank)
        if not movable:
            rigid = _of_rank(samples, ranks, m)
            C, _ = rigid[0]
            _check_consistent(mechanism, rigid, sorted(pivots(C.T, m)))
            raise no_freedom(mechanism, places[ranks.index(m)], m)
        m = max(movable)

    # The best conditioned rows at the first sample, and the speeds that they determine.
    samples = _of_rank(samples, ranks, m)
    C, _ = samples[0]
    independent_rows = sorted(pivots(C.T, m))
    _check_consistent(mechanism, samples, independent_rows)
    rows = [C[independent_rows] for C, _ in samples]
    if independent is None:
        free = _best_free(rows)
    else:
        free = _named_free(mechanism, independent, rows)
    return Mechanism(model, speeds, constraints, free, independent_rows, sizes,
                     tolerance)


def _of_rank(samples: list[tuple[Array, Array]], ranks: list[int],
             m: int) -> list[tuple[Array, Array]]:
    """Return the samples with m independent rows."""
    return [sample for sample, rank in zip(samples, ranks) if rank == m]


def _driven(constraint: Constraint) -> bool:
    """Return whether a constraint may prescribe a nonzero motion."""
    if isinstance(constraint, PointVelocity):
        return callable(constraint.value) or constraint.value != 0.0
    return isinstance(constraint, Prescribed | DependentSpeeds)


def _row_sizes(mechanism: Mechanism, places: list[Array]) -> list[float]:
    """Return for each row the largest norm, in mechanism units, of rows of its kind."""
    norms = []
    for q in places:
        J = stacked(mechanism, q).J
        norms.append(np.linalg.norm(J * mechanism.units, axis=1))
    sizes = np.max(norms, axis=0) / mechanism.row_units

    # A kind is the translations, or the rotations, of one constraint.
    kinds = list(zip(mechanism.owners, mechanism.turning))
    size_of_kind: dict[tuple[str, bool], float] = {}
    for kind, size in zip(kinds, sizes):
        size_of_kind[kind] = max(float(size), size_of_kind.get(kind, float(size)))
    largest = [size_of_kind[kind] for kind in kinds]

    # Rows that are zero but for rounding have size 1.
    small = mechanism.rank_tolerance * max(largest, default=0.0)
    result = []
    for size, unit in zip(largest, mechanism.row_units.tolist()):
        if size <= small:
            size = 1.0
        result.append(unit * size)
    return result


def _require_rows(mechanism: Mechanism, start: Array, elsewhere: bool) -> None:
    """
    Raise ConstraintError unless the rows of all constraints have a value.

    At the configuration `start`, or, with `elsewhere`, at one of those that are tried: a
    user-defined function may not be finite at 0.
    """
    failures = []
    starts = [start]
    if elsewhere:
        starts += _starts(mechanism)
    # One configuration with values is enough: constraints may have singular points.
    for q in starts:
        state = mechanism.state(q)
        try:
            for constraint in mechanism.constraints:
                with np.errstate(all='ignore'):  # a distance of zero has no direction
                    constraint.rows(state)
            return
        except NotFiniteError as error:
            failures.append(error)
        except InputError as error:
            raise ConstraintError(f"constraint '{constraint.name}': {error}") from None
    if not elsewhere:
        raise failures[0]
    raise ConstraintError(
        f'{failures[0]} at one of the {STARTS + 1} configurations that are tried, or '
        'configuration= where they are finite')


def _finite_places(mechanism: Mechanism, places: list[Array]) -> list[Array]:
    """Return the configurations with all rows finite; ConstraintError if none."""
    regular = []
    for q in places:
        stack = stacked(mechanism, q)
        finite = np.isfinite(stack.J).all(axis=1) & np.isfinite(stack.b)
        if finite.all():
            regular.append(q)
    if regular:
        return regular
    # Nowhere finite: the error names the constraints whose rows have no value.
    names: dict[str, None] = {}  # in order, without repetition
    for owner, row_is_finite in zip(mechanism.owners, finite):
        if not row_is_finite:
            names[f"'{owner}'"] = None
    raise ConstraintError(
        f'constraint {", ".join(names)}: not finite at '
        f'{described(mechanism, places[0])}; expected another configuration=')


def _moves(mechanism: Mechanism, q: Array, rank: int) -> bool:
    """
    Return whether a closed configuration with dependent rows can move.

    Its loops close some distance along a motion that the rows admit, and the rows still
    depend on each other there, as they do not beside an isolated singular configuration.
    """
    # The speeds of the smallest singular value: a motion that the rows admit.
    model = mechanism.model
    C, _ = _velocity_rows(mechanism, q)
    _, _, V = np.linalg.svd(C)
    admitted = V[-1]

    # A probing step along it.
    Y, _ = scaled_rows(mechanism, stacked(mechanism, q))
    direction = mechanism.units * np.linalg.solve(Y, admitted)
    step = PROBE * direction / np.abs(direction / mechanism.units).max()
    try:
        closed = closed_configuration(mechanism, moved_by(model, q, step))
    except ConstraintError:
        return False

    # Loop closure may return to q, or reach a configuration of another rank.
    distance = np.abs(difference(model, q, closed) / mechanism.units).max()
    C, _ = _velocity_rows(mechanism, closed)
    rank_there = rank_of(C, mechanism.rank_tolerance)
    return bool(distance > 0.5 * PROBE and rank_there == rank)


def _starts(mechanism: Mechanism) -> list[Array]:
    """Return initial guesses for loop closure within the joint limits, first near 0."""
    model = mechanism.model
    # Within a turn of zero, and within the joint limits.
    units = mechanism.units
    lower = -np.pi * units
    upper = np.pi * units
    for k, joint in enumerate(model.coordinate_joints):
        lower[k] = max(lower[k], joint.limits.lower)
        upper[k] = min(upper[k], joint.limits.upper)

    rng = np.random.default_rng(0)
    near_zero = units * rng.uniform(-0.1, 0.1, len(lower))
    anywhere = rng.uniform(lower, upper, (STARTS - 1, len(lower)))
    steps = [np.clip(near_zero, lower, upper), *anywhere]
    return [moved_by(model, neutral(model), step) for step in steps]


def _closed_configurations(mechanism: Mechanism) -> list[Array]:
    """Return up to `SAMPLES` closed configurations within the joint limits."""
    starts = _starts(mechanism)
    # Random starts often end at different assemblies,
    # and ranks must hold for all of them.
    closed: list[Array] = []
    failures: list[ConstraintError] = []
    # A start that does not close is no error as long as another one does.
    for start in starts:
        try:
            closed.append(closed_configuration(mechanism, start))
        except ConstraintError as error:
            failures.append(error)
        if len(closed) == SAMPLES:
            return closed
    if not closed:
        nearest = _nearest_to_closed(mechanism, starts)
        raise ConstraintError(f'{failures[0]}; {advice(mechanism, nearest)}')
    return closed


def _nearest_to_closed(mechanism: Mechanism, starts: list[Array]) -> Array:
    """Return the end of loop closure with the least residual."""
    moves = np.ones(mechanism.model.n, bool)
    # Full iterations from each start, with every joint free to move.
    ends = [closing_iterations(mechanism, start, moves, 0.0) for start in starts]
    residuals = []
    for end in ends:
        residual = np.nan_to_num(np.abs(end.residual), nan=np.inf)
        residuals.append(residual.max(initial=0.0))
    return ends[int(np.argmin(residuals))].q


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
    # Part of a quaternion has no meaning: its length would be arbitrary.
    for ball in balls(model):
        entries = ball.quaternion(np.array(names)).tolist()
        count = sum(name in configuration for name in entries)
        if 0 < count < len(entries):
            raise ConstraintError(
                f"configuration: the quaternion of '{ball.name}' in part; expected all "
                f'of {", ".join(entries)}, or none')
    # Joints that are not named are at their neutral value.
    q = []
    for name, default in zip(names, neutral(model).tolist()):
        q.append(configuration.get(name, default))
    return np.array(q, dtype=np.float64)


def _checked(mechanism: Mechanism, configuration: Any) -> Array:
    """Return a configuration as an array, (n_q,); ConstraintError for anything else."""
    names = mechanism.model.coordinate_names
    try:
        q = np.array(configuration, dtype=np.float64)
    except (TypeError, ValueError):
        q = np.array(np.nan)
    if q.shape != (len(names),) or not np.isfinite(q).all():
        raise ConstraintError(f'configuration: {configuration!r}; expected '
                              f'{len(names)} finite numbers: {", ".join(names)}')
    return require_unit(mechanism.model, q, 'configuration')


def _configurations_near(mechanism: Mechanism, q: Array) -> list[Array]:
    """Return closed configurations at and near q; ConstraintError if far from closed."""
    model = mechanism.model
    try:
        closed = closed_configuration(mechanism, q)
    except ConstraintError as error:
        raise ConstraintError(f'{error}; {advice(mechanism, q)}') from None

    # A long correction may lead to another assembly than the one that q describes.
    change = np.abs(difference(model, q, closed))
    scaled_change = change / mechanism.units
    worst = int(np.argmax(scaled_change))
    if scaled_change[worst] > STRIDE:
        raise ConstraintError(
            f"configuration: closing its loops moves '{model.joint_names[worst]}' by "
            f'{change[worst]:.3g} rad or m; expected a configuration that is closed to '
            'within a small correction, so that it stays on its branch')

    result = [closed]
    rng = np.random.default_rng(0)
    for _ in range(SAMPLES - 1):
        step = 0.05 * mechanism.units * rng.uniform(-1.0, 1.0, model.n)
        try:
            start = moved_by(model, closed, step)
            result.append(closed_configuration(mechanism, start))
        except ConstraintError:
            continue  # it need not close there: a sample less
    return result


def _velocity_rows(mechanism: Mechanism, q: Array) -> tuple[Array, Array]:
    """Return C, d as `rows_in_speeds`; ConstraintError where the speeds are singular."""
    stack = stacked(mechanism, q)
    Y, _ = scaled_rows(mechanism, stack)
    if not np.linalg.cond(Y) < 1.0 / RANK:
        raise ConstraintError(
            f'speeds: {", ".join(mechanism.speeds.names)}, Y is singular at q = '
            f'{np.round(q, 6).tolist()}; expected speeds that determine the joint rates '
            'there')
    return rows_in_speeds(mechanism, stack)


def _check_consistent(mechanism: Mechanism, samples: list[tuple[Array, Array]],
                      independent_rows: list[int]) -> None:
    """Raise ConstraintError if a redundant row contradicts the independent rows."""
    # At every sample: rows that agree at one configuration may contradict at another.
    for C, d in samples:
        # C = W^T C_K, with the independent rows C_K: consistent if d = W^T d_K.
        W = np.linalg.lstsq(C[independent_rows].T, C.T, rcond=None)[0]
        excess = np.abs(d - W.T @ d[independent_rows])
        largest = mechanism.rank_tolerance * (1.0 + np.abs(d).max(initial=0.0))
        if excess.max(initial=0.0) > largest:
            k = int(np.argmax(excess))
            residual = excess[k] * mechanism.row_units[k]
            raise ConstraintError(
                f"constraint '{mechanism.labels[k]}' contradicts the others: its "
                f'velocity residual is {residual:.3g}; expected 0')


def _conditioning(rows: list[Array], dependent: Sequence[int]) -> float:
    """Return the least singular value of the dependent speeds' columns."""
    # Relative to the largest entry,
    # so that the scale of all rows together does not count.
    smallest = np.inf
    for C in rows:
        largest_entry = max(np.abs(C).max(initial=0.0), 1e-300)
        singular_values = np.linalg.svd(C[:, dependent], compute_uv=False)
        relative = float(singular_values.min(initial=np.inf) / largest_entry)
        smallest = min(smallest, relative)
    return smallest


def _best_free(rows: list[Array]) -> list[int]:
    """Return the independent speeds with the best conditioned dependent ones."""
    count, n = rows[0].shape
    # One choice for each sample; the one whose worst sample is best conditioned.
    choices = [sorted(pivots(C, count)) for C in rows]
    best = max(choices, key=lambda dependent: _conditioning(rows, dependent))
    return [r for r in range(n) if r not in best]


def _named_free(mechanism: Mechanism, names: Sequence[str],
                rows: list[Array]) -> list[int]:
    """Return the indices of the independent speeds that the user names."""
    free = speed_places(mechanism.speeds, names)
    count, n = rows[0].shape
    # As many independent speeds as degrees of freedom, n less the rank of the rows.
    if len(set(free)) != n - count:
        raise ConstraintError(
            f'independent: {len(set(free))} speeds ({", ".join(names)}); expected '
            f'exactly {n - count} of {", ".join(mechanism.speeds.names)}, because '
            f'{count} constraint rows are independent')
    # J_D of the dependent speeds must be invertible, since J_D u_D = b - J_I u_I.
    dependent = [r for r in range(n) if r not in free]
    if _conditioning(rows, dependent) < RANK:
        raise ConstraintError(
            f'independent: {", ".join(names)}, which do not determine the other speeds '
            'under the constraints; expected others, or None')
    return free
