"""
Which speeds are independent and which constraint rows are: found once, at sample postures.

Numbers only. A row that follows from others (the out-of-plane rows of a planar loop) is left out
and carries no force; one that contradicts others is an error.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.constraints import Constraint
from kane_dynamics.mechanics.constraints.mechanism import Mechanism, speed_places
from kane_dynamics.model.model import Model
import numpy as np

CLOSED = 1e-11  # m or rad: a gap this small is closed
ITERATIONS = 100
STRIDE = 0.5  # rad or m: longest step of the search for a closed posture
RANK = 1e-9  # relative size at which a singular value counts as zero
STARTS = 12  # postures from which closing is tried
SAMPLES = 4  # closed postures at which the structure is looked at


def choose_independent(model: Model, speeds: Any, constraints: Sequence[Constraint],
                       independent: Sequence[str] | None = None) -> Mechanism:
    """
    Return the mechanism with its independent speeds and rows chosen.

    Parameters
    ----------
    model : Model
        The mechanism.
    speeds : None, Speeds or callable
        As `speeds.chosen` takes them.
    constraints : sequence of constraints
        What holds.
    independent : sequence of str, optional
        Names of the speeds to take as independent; the best conditioned by default.

    Raises
    ------
    ConstraintError
        A constraint names what the model does not have, the constraints contradict each other,
        cannot be met in any posture found, leave no freedom; Y is singular; or `independent`
        does not fit.

    """
    everything = Mechanism(model, speeds, constraints)
    for constraint in everything.constraints:
        try:
            constraint.rows(everything.posture(np.zeros(model.n)))
        except InputError as error:
            raise ConstraintError(f"constraint '{constraint.name}': {error}") from None
    samples = [_velocity_rows(everything, q) for q in _closed_postures(everything)]
    if not everything.labels and independent is None:
        return everything
    ranks = [_rank(C) for C, _ in samples]
    m = max(ranks)
    samples = [sample for sample, rank in zip(samples, ranks) if rank == m]
    kept = sorted(_pivots(samples[0][0].T, m))
    _check_consistent(everything, samples, kept)
    if m == model.n:
        raise ConstraintError(f'{m} independent constraint rows leave no freedom to '
                              f'{model.n} speeds: {", ".join(everything.labels)}')
    if independent is None:
        free = _best_free([C[kept] for C, _ in samples])
    else:
        free = _given_free(everything, independent, [C[kept] for C, _ in samples])
    return Mechanism(model, speeds, constraints, free, kept)


def closed_posture(mechanism: Mechanism, q: Any, *, t: float = 0.0,
                   fixed: Sequence[str] = ()) -> Array:
    """
    Return the posture near q at which every condition on positions is met.

    Parameters
    ----------
    mechanism : Mechanism
        Whose conditions to meet.
    q : (n_q,) array
        Where to start.
    t : float
        s.
    fixed : sequence of str
        Names of coordinates to leave as they are (a crank).

    Raises
    ------
    ConstraintError
        None is found; names the constraint with the largest remaining gap.

    """
    here = np.array(q, dtype=np.float64)
    names = mechanism.model.coordinate_names
    unknown = sorted(set(fixed) - set(names))
    if unknown:
        raise ConstraintError(f'no coordinate {unknown[0]!r}; valid: {", ".join(names)}')
    moves = np.array([name not in fixed for name in names])
    for _ in range(ITERATIONS):
        J, gap, labels = _gaps(mechanism, here, t)
        if np.abs(gap).max(initial=0.0) < CLOSED:
            return here
        step = np.linalg.lstsq(J[:, moves], -gap, rcond=1e-10)[0]
        longest = np.abs(step).max(initial=0.0)
        here[moves] += step * min(1.0, STRIDE / max(longest, STRIDE))
    worst = int(np.argmax(np.abs(gap)))
    raise ConstraintError(f"no posture found that closes '{labels[worst]}': {abs(gap[worst]):.3g} "
                          f'(m or rad) remain after {ITERATIONS} steps')


def _gaps(mechanism: Mechanism, q: Array, t: float) -> tuple[Array, Array, list[str]]:
    """Return the rows that have a condition on positions, their gaps, their labels."""
    rows = mechanism.rows(mechanism.posture(q, t))
    places = [k for k, gap in enumerate(rows.gap) if gap is not None]
    return (np.array(rows.J[places], dtype=np.float64),
            np.array([rows.gap[k] for k in places], dtype=np.float64),
            [mechanism.labels[k] for k in places])


def _closed_postures(mechanism: Mechanism) -> list[Array]:
    """Return up to `SAMPLES` closed postures, from the middle of the joints' range and about."""
    limits = [joint.limits for joint in mechanism.model.coordinate_joints]
    lower = np.array([max(limit.lower, -np.pi) for limit in limits])
    upper = np.array([min(limit.upper, np.pi) for limit in limits])
    rng = np.random.default_rng(0)
    starts = [np.clip(rng.uniform(-0.1, 0.1, len(lower)), lower, upper),
              *rng.uniform(lower, upper, (STARTS - 1, len(lower)))]
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
        raise failures[0]
    return found


def _velocity_rows(mechanism: Mechanism, q: Array) -> tuple[Array, Array]:
    """Return C and d of C u = d, the constraints in terms of all speeds."""
    here = mechanism.posture(q)
    rows = mechanism.rows(here)
    Y, Z = (np.array(x, dtype=np.float64) for x in mechanism.speeds.of(q, 0.0))
    if not np.linalg.cond(Y) < 1.0 / RANK:
        raise ConstraintError(f'Y is singular at q = {np.round(q, 6).tolist()}: the speeds '
                              f'{", ".join(mechanism.speeds.names)} do not determine the joint '
                              'rates there')
    C: Array = np.linalg.solve(Y.T, np.array(rows.J, dtype=np.float64).T).T.astype(np.float64)
    return C, np.array(rows.b, dtype=np.float64) + C @ Z


def _rank(C: Array) -> int:
    size = np.linalg.svd(C, compute_uv=False)
    return int(np.sum(size > RANK * max(size.max(initial=0.0), 1e-300))) if len(size) else 0


def _pivots(C: Array, count: int) -> list[int]:
    """Return the columns that Gram-Schmidt with pivoting takes first."""
    rest = C.copy()
    taken: list[int] = []
    for _ in range(count):
        size = np.linalg.norm(rest, axis=0)
        size[taken] = -1.0
        k = int(np.argmax(size > (1.0 - 1e-9) * size.max()))  # ties: the first
        taken.append(k)
        direction = rest[:, k] / np.linalg.norm(rest[:, k])
        rest = rest - np.outer(direction, direction @ rest)
    return taken


def _check_consistent(mechanism: Mechanism, samples: list[tuple[Array, Array]],
                      kept: list[int]) -> None:
    """Raise where a row left out asks for another velocity than the rows kept allow."""
    for C, d in samples:
        weights = np.linalg.lstsq(C[kept].T, C.T, rcond=None)[0]  # rows in terms of those kept
        excess = np.abs(d - weights.T @ d[kept])
        if excess.max(initial=0.0) > RANK * (1.0 + np.abs(d).max(initial=0.0)):
            k = int(np.argmax(excess))
            raise ConstraintError(f"constraint '{mechanism.labels[k]}' contradicts the others: "
                                  f'its velocity is off by {excess[k]:.3g}')


def _conditioning(rows: list[Array], dependent: Sequence[int]) -> float:
    """Return the smallest singular value, over samples, of the dependent speeds' columns."""
    return min(float(np.linalg.svd(C[:, dependent], compute_uv=False).min(initial=np.inf)
                     / max(np.abs(C).max(initial=0.0), 1e-300)) for C in rows)


def _best_free(rows: list[Array]) -> list[int]:
    """Return the independent speeds that leave the dependent ones best determined."""
    count, n = rows[0].shape
    choices = [sorted(_pivots(C, count)) for C in rows]
    best = max(choices, key=lambda dependent: _conditioning(rows, dependent))
    return [r for r in range(n) if r not in best]


def _given_free(mechanism: Mechanism, names: Sequence[str], rows: list[Array]) -> list[int]:
    """Return the numbers of the independent speeds that the user names."""
    free = speed_places(mechanism.speeds, names)
    count, n = rows[0].shape
    if len(set(free)) != n - count:
        raise ConstraintError(f'independent names {len(set(free))} speeds ({", ".join(names)}); '
                              f'{count} independent constraint rows leave exactly {n - count} of '
                              f'{", ".join(mechanism.speeds.names)}')
    dependent = [r for r in range(n) if r not in free]
    if _conditioning(rows, dependent) < RANK:
        raise ConstraintError(f'the independent speeds {", ".join(names)} do not determine the '
                              'others under the constraints; try independent=None')
    return free
