"""Loop closure: the configuration that satisfies all position constraints, by Newton's method."""

from collections.abc import Callable, Sequence
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.mechanics.ball_joints import (balls, difference, moved as moved_by,
                                                 on_unit_quaternions)
from kane_dynamics.mechanics.constraints import checked_names
from kane_dynamics.mechanics.constraints.conditioning import RANK
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np

CLOSED = 1e-11  # rad, or lengths of the mechanism: a smaller constraint residual counts as zero
NEARLY_CLOSED = 0.01  # rad or lengths: residual with errors of encoders and of assembly
ITERATIONS = 100
STRIDE = 0.5  # rad or lengths: longest step of the search for a closed configuration
SMALL = 0.05  # rad, or lengths of the mechanism: steps along a branch
FARTHEST = 1e3  # rad, or lengths of the mechanism: moves along a branch

# At q, (n_q,), and t, s: J, (m, n_j), the residuals, (m,), and 1 in (m,) where a row has one. The
# arrays stay valid until the next call.
Rows = Callable[[Array, float], tuple[Array, Array, Array]]


def defined_rows(mechanism: Mechanism) -> Rows:
    """Return the rows of the definition."""
    def rows(q: Array, t: float) -> tuple[Array, Array, Array]:
        with np.errstate(all='ignore'):
            here = mechanism.rows(mechanism.state(q, t))
        residual = [0.0 if x is None else x for x in here.residual]
        of_positions = [x is not None for x in here.residual]
        return (np.array(here.J, dtype=np.float64), np.array(residual, dtype=np.float64),
                np.array(of_positions, dtype=np.float64))
    return rows


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
    model, here = mechanism.model, _checked(mechanism, q, t)
    if not all(ball.quaternion(here).any() for ball in balls(model)):
        raise InputError(f'q: {here.tolist()}; expected nonzero quaternions')
    here = np.asarray(on_unit_quaternions(model, here), dtype=np.float64)
    stays = _joints(mechanism, checked_names(fixed, 'fixed') or ())
    moves = np.array([k not in stays for k in range(model.n)])
    here, residual, labels, closed = closing_iterations(mechanism, here, moves, t, rows=rows)
    if closed:
        return here
    unit_of = dict(zip(mechanism.labels, mechanism.row_units))
    worst = int(np.argmax(np.abs(residual / [unit_of[label] for label in labels])))
    raise ConstraintError(f"loop closure: no configuration found for '{labels[worst]}', its "
                          f'residual is {abs(residual[worst]):.3g} (m or rad); expected a start '
                          'near a closed configuration')


def _checked(mechanism: Mechanism, q: Any, t: Any) -> Array:
    """Return a copy of a configuration, (n_q,); InputError unless it and the time are finite."""
    names = mechanism.model.coordinate_names
    try:
        here, at = np.array(q, dtype=np.float64), float(t)
    except (TypeError, ValueError):
        raise InputError(f'q: {q!r}, t: {t!r}; expected {len(names)} numbers and a time in s'
                         ) from None
    if here.shape != (len(names),) or not np.isfinite([*here, at]).all():
        raise InputError(f'q: {here.tolist()}, t: {at}; expected {len(names)} finite numbers '
                         f'({", ".join(names)}) and a time in s')
    return here


def _joints(mechanism: Mechanism, names: Sequence[str]) -> list[int]:
    """Return the indices in u of coordinates; ConstraintError lists the valid names."""
    model = mechanism.model
    valid = [name for name, place in zip(model.joint_names, model.places) if place is not None]
    unknown = sorted(set(names) - set(valid))
    if unknown:
        raise ConstraintError(f'no coordinate {unknown[0]!r}; expected one of {", ".join(valid)}')
    return [k for k, name in enumerate(model.joint_names) if name in names]


def closing_iterations(mechanism: Mechanism, start: Array, moves: Array, t: float,
                       most: int = ITERATIONS, rows: Rows | None = None
                       ) -> tuple[Array, Array, list[str], bool]:
    """
    Iterate by Newton's method; return q, residuals, their labels, and whether it converged.

    `moves`, (n_j,), says of each joint whether it moves; ball joints rotate on their sphere.
    Residuals and steps are judged in units of the mechanism, so that its size does not matter.
    """
    here, tolerance = start.copy(), mechanism.rank_tolerance
    rows = rows or defined_rows(mechanism)
    for _ in range(most):
        J, residual, of_positions = rows(here, t)
        places = np.flatnonzero(of_positions)
        J, residual, labels = J[places], residual[places], [mechanism.labels[k] for k in places]
        row_units = mechanism.row_units[places]
        missed = np.abs(residual / row_units).max(initial=0.0)
        if missed < CLOSED:
            return here, residual, labels, True
        finite = np.isfinite(J).all(axis=1) & np.isfinite(residual)
        if not finite.all():
            return here, np.where(finite, residual, np.nan), labels, False
        scaled = J[:, moves] * mechanism.units[moves] / row_units[:, None]
        step = np.linalg.lstsq(scaled, -residual / row_units, rcond=max(1e-10, tolerance))[0]
        longest = np.abs(step).max(initial=0.0)
        if tolerance > RANK and missed < tolerance and longest < CLOSED:
            return here, residual, labels, True  # the rest is within the tolerance
        change = np.zeros(len(moves))
        change[moves] = step * mechanism.units[moves] * min(1.0, STRIDE / max(longest, STRIDE))
        here = moved_by(mechanism.model, here, change)
    return here, residual, labels, False


def followed_configuration(mechanism: Mechanism, start: Any, q: Any, *, t: float = 0.0,
                           fixed: Sequence[str] = (), rows: Rows | None = None) -> Array:
    """
    Return a closed configuration in the assembly mode of another closed configuration.

    The fixed coordinates move in small steps from their values at the start to those of q; loop
    closure after each step gives the other coordinates.

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
    wanted = _checked(mechanism, q, t)
    rows = rows or defined_rows(mechanism)
    here = closed_configuration(mechanism, start, t=t, rows=rows)
    model = mechanism.model
    joints = _joints(mechanism, fixed)
    places = [place for k in joints if (place := model.places[k]) is not None]
    first, last = here[places], wanted[places]
    way = np.abs(last - first) / mechanism.units[joints]
    if way.max(initial=0.0) > FARTHEST:
        raise ConstraintError(f"closed configuration: {', '.join(fixed)} at {last.tolist()}, from "
                              f'{first.tolist()}; expected moves of at most {FARTHEST:g} rad, or '
                              'lengths of the mechanism')
    count = int(np.ceil(way.max(initial=0.0) / SMALL)) or 1
    units, side = np.eye(model.n)[joints], 0.0
    for share in np.arange(1, count + 1) / count:
        ahead = here.copy()
        ahead[places] = first + share * (last - first)
        closed = closed_configuration(mechanism, ahead, t=t, fixed=fixed, rows=rows)
        change = np.abs(difference(model, here, closed))
        moved = change / mechanism.units
        worst = int(np.argmax(moved))
        before, side = side, 0.0
        if len(places) == mechanism.n:
            J = rows(closed, t)[0][mechanism.kept]
            side = float(np.sign(np.linalg.det(np.concatenate([units, J]))))
        if moved[worst] > STRIDE or before * side < 0.0:
            raise ConstraintError(
                f"closed configuration: with {', '.join(fixed)} at {ahead[places].tolist()} "
                f"'{model.joint_names[worst]}' jumps by {change[worst]:.3g} rad or m; expected "
                'values on this branch, which ends there')
        here = closed
    return here
