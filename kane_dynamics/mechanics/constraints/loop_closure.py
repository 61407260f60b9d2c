"""
Loop closure: the configuration that satisfies all position constraints.

Newton's method, with the least step, in units of the mechanism, that solves the
linearised constraints: J dq = -residual.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.checks import real_numbers
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.ball_joints import (balls, difference, moved as moved_by,
                                                 on_unit_quaternions)
from kane_dynamics.mechanics.constraints import checked_names
from kane_dynamics.mechanics.constraints.conditioning import RANK
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np

CLOSED = 1e-11  # rad, or lengths of the mechanism: a smaller residual counts as zero
NEARLY_CLOSED = 0.01  # rad or lengths: residual with errors of encoders and of assembly
ITERATIONS = 100
STRIDE = 0.5  # rad or lengths: longest step of the search for a closed configuration
SMALL = 0.05  # rad, or lengths of the mechanism: steps along a branch
FARTHEST = 1e3  # rad, or lengths of the mechanism: moves along a branch

# At q, (n_q,), and t, s: J, (m, n_j), the residuals, (m,), and 1 in (m,) where a row has
# one. The arrays stay valid until the next call.
Rows = Callable[[Array, float], tuple[Array, Array, Array]]


def defined_rows(mechanism: Mechanism) -> Rows:
    """Return the rows of the definition."""
    def rows(q: Array, t: float) -> tuple[Array, Array, Array]:
        # Where a row is singular it may divide by zero; its numbers are then not finite.
        with np.errstate(all='ignore'):
            all_rows = mechanism.rows(mechanism.state(q, t))
        J = np.array(all_rows.J, dtype=np.float64)
        # Rows of velocities alone have no residual.
        residual = np.zeros(len(J))
        of_positions = np.zeros(len(J))
        for k, x in enumerate(all_rows.residual):
            if x is not None:
                residual[k] = x
                of_positions[k] = 1.0
        return J, residual, of_positions
    return rows


class ClosingResult(NamedTuple):
    """
    The last configuration of Newton's method.

    Attributes
    ----------
    q : (n_q,) array
    residual : (k,) array
        Residuals of the position constraints there, m or rad; NaN where not finite.
    labels : list of str
        Names of these rows.
    converged : bool

    """

    q: Array
    residual: Array
    labels: list[str]
    converged: bool


def closed_configuration(mechanism: Mechanism, q: Any, *, t: float = 0.0,
                         fixed: Sequence[str] = (),
                         rows: Rows | None = None) -> Array:
    """
    Return the configuration near q that satisfies all position constraints.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism with its constraints.
    q : (n_q,) array
        Initial guess, rad or m.
    t : float
        s.
    fixed : sequence of str
        Names of coordinates that keep their values (a crank).
    rows : callable, optional
        The compiled rows; default: those of the definition.

    Raises
    ------
    ConstraintError
        The iteration does not converge; names the constraint with the largest residual.

    """
    model = mechanism.model
    start = _checked(mechanism, q, t)
    # Directions of quaternions are unknown at zero;
    # elsewhere only their length is corrected.
    for ball in balls(model):
        quaternion = ball.quaternion(start)
        largest = np.abs(quaternion).max()
        if not largest:
            raise InputError(f'q: {start.tolist()}; expected nonzero quaternions')
        quaternion /= largest  # the square of any length is finite, and not zero
    start = np.asarray(on_unit_quaternions(model, start), dtype=np.float64)
    fixed_joints = _joints(mechanism, checked_names(fixed, 'fixed') or ())
    moves = np.ones(model.n, dtype=bool)
    moves[list(fixed_joints)] = False

    # Newton steps on the residuals; the fixed joints keep their values.
    result = closing_iterations(mechanism, start, moves, t, rows=rows)
    if result.converged:
        return result.q
    # The worst row, each relative to its unit: rad, or lengths of its loop.
    unit_of_label = dict(zip(mechanism.labels, mechanism.closure_units))
    units = [unit_of_label[label] for label in result.labels]
    worst = int(np.argmax(np.abs(result.residual / units)))
    raise ConstraintError(
        f"loop closure: no configuration found for '{result.labels[worst]}', its "
        f'residual is {abs(result.residual[worst]):.3g} (m or rad); expected a start '
        'near a closed configuration')


def _checked(mechanism: Mechanism, q: Any, t: Any) -> Array:
    """Return a copy of q, (n_q,); InputError unless it and the time are finite."""
    names = mechanism.model.coordinate_names
    try:
        configuration = np.array(real_numbers(q))
        time = float(t)
    except (TypeError, ValueError):
        raise InputError(f'q: {q!r}, t: {t!r}; expected {len(names)} numbers and a time '
                         'in s') from None
    # NaN would pass the comparisons of the iteration and end as an answer.
    finite = np.isfinite(configuration).all() and np.isfinite(time)
    if configuration.shape != (len(names),) or not finite:
        raise InputError(
            f'q: {configuration.tolist()}, t: {time}; expected {len(names)} finite '
            f'numbers ({", ".join(names)}) and a time in s')
    return configuration


def _joints(mechanism: Mechanism, names: Sequence[str]) -> list[int]:
    """Return the indices in u of coordinates; ConstraintError lists the valid names."""
    model = mechanism.model
    valid = []
    for name, place in zip(model.joint_names, model.places):
        if place is not None:  # a ball joint has no angle
            valid.append(name)
    unknown = sorted(set(names) - set(valid))
    if unknown:
        raise ConstraintError(f'no coordinate {unknown[0]!r}; expected one of '
                              f'{", ".join(valid)}')
    return [k for k, name in enumerate(model.joint_names) if name in names]


def closing_iterations(mechanism: Mechanism, start: Array, moves: Array, t: float,
                       iterations: int = ITERATIONS,
                       rows: Rows | None = None) -> ClosingResult:
    """
    Iterate by Newton's method from a start, (n_q,).

    `moves`, (n_j,), says of each joint whether it moves; ball joints rotate on their
    sphere. Steps are judged in units of the mechanism and residuals in lengths of their
    own loops, so that sizes have no influence.
    """
    q = start.copy()
    tolerance = mechanism.rank_tolerance
    rows = rows or defined_rows(mechanism)
    last_largest = np.inf
    for _ in range(iterations):
        # The rows of position constraints, and the largest residual.
        J, residual, of_positions = rows(q, t)
        places = np.flatnonzero(of_positions)
        J = J[places]
        residual = residual[places]
        labels = [mechanism.labels[k] for k in places]
        row_units = mechanism.row_units[places]
        largest = np.abs(residual / mechanism.closure_units[places]).max(initial=0.0)
        in_mechanism = np.abs(residual / row_units).max(initial=0.0)
        # A loop that is far smaller than the mechanism is closed when rounding of the
        # mechanism's positions keeps the residual from decreasing further.
        stays = in_mechanism < CLOSED and largest > 0.5 * last_largest
        if largest < CLOSED or stays:
            return ClosingResult(q, residual, labels, True)
        last_largest = largest
        finite = np.isfinite(J).all(axis=1) & np.isfinite(residual)
        if not finite.all():
            return ClosingResult(q, np.where(finite, residual, np.nan), labels, False)

        # The step of least norm with J dq = -residual, or as nearly so as possible.
        scaled = J[:, moves] * mechanism.units[moves] / row_units[:, None]
        cutoff = max(1e-10, tolerance)
        step = np.linalg.lstsq(scaled, -residual / row_units, rcond=cutoff)[0]
        longest = np.abs(step).max(initial=0.0)
        if tolerance > RANK and largest < tolerance and longest < CLOSED:
            # No step reduces the residual, and the tolerance admits it.
            return ClosingResult(q, residual, labels, True)

        # A step is at most STRIDE long, since the constraints are linearised.
        shortened = min(1.0, STRIDE / max(longest, STRIDE))
        change = np.zeros(len(moves))
        change[moves] = step * mechanism.units[moves] * shortened
        q = moved_by(mechanism.model, q, change)
    return ClosingResult(q, residual, labels, False)


def followed_configuration(mechanism: Mechanism, start: Any, q: Any, *, t: float = 0.0,
                           fixed: Sequence[str] = (), rows: Rows | None = None) -> Array:
    """
    Return a closed configuration in the assembly mode of another closed configuration.

    The fixed coordinates move in small steps from their values at the start to those of
    q; loop closure after each step gives the other coordinates.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism with its constraints.
    start : (n_q,) array
        A closed configuration on the branch, rad or m.
    q : (n_q,) array
        The final values of the fixed coordinates; other entries are ignored.
    t, fixed, rows
        As in `closed_configuration`.

    Raises
    ------
    ConstraintError
        Loop closure fails, or jumps to another branch.

    """
    target = _checked(mechanism, q, t)
    rows = rows or defined_rows(mechanism)
    closed = closed_configuration(mechanism, start, t=t, rows=rows)
    model = mechanism.model
    joints = _joints(mechanism, fixed)
    places = [place for k in joints if (place := model.places[k]) is not None]

    # The fixed coordinates move on a straight line, in steps of at most SMALL.
    first = closed[places]
    last = target[places]
    distance = np.abs(last - first) / mechanism.units[joints]
    farthest = distance.max(initial=0.0)
    if farthest > FARTHEST:
        raise ConstraintError(
            f"closed configuration: {', '.join(fixed)} at {last.tolist()}, from "
            f'{first.tolist()}; expected moves of at most {FARTHEST:g} rad, or lengths '
            'of the mechanism')
    count = int(np.ceil(farthest / SMALL)) or 1

    # On one branch the determinant of [fixed coordinates; J] keeps its sign,
    # if it is square.
    fixed_rows = np.eye(model.n)[joints]
    last_sign = 0.0
    for share in np.arange(1, count + 1) / count:
        # The fixed coordinates move on,
        # all others start from the last closed configuration.
        guess = closed.copy()
        guess[places] = first + share * (last - first)
        next_closed = closed_configuration(mechanism, guess, t=t, fixed=fixed, rows=rows)
        change = np.abs(difference(model, closed, next_closed))
        scaled_change = change / mechanism.units
        worst = int(np.argmax(scaled_change))
        sign = 0.0
        if len(places) == mechanism.n:
            J, _, _ = rows(next_closed, t)
            square = np.concatenate([fixed_rows, J[mechanism.kept]])
            sign = float(np.sign(np.linalg.det(square)))
        if scaled_change[worst] > STRIDE or last_sign * sign < 0.0:
            raise ConstraintError(
                f"closed configuration: with {', '.join(fixed)} at "
                f"{guess[places].tolist()} '{model.joint_names[worst]}' jumps by "
                f'{change[worst]:.3g} rad or m; expected values on this branch, which '
                'ends there')
        closed = next_closed
        last_sign = sign
    return closed
