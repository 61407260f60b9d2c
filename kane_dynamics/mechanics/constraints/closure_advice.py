"""Error texts for loops without degrees of freedom: singular values, kinds that would fit."""

from dataclasses import replace
from typing import get_args

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.ball_joints import moved
from kane_dynamics.mechanics.constraints.conditioning import (described, RANK, rank_of,
                                                              rows_in_speeds, scaled_rows, Stack,
                                                              stacked)
from kane_dynamics.mechanics.constraints.constraint_types.closure import Closure, Kind
from kane_dynamics.mechanics.constraints.loop_closure import closing_iterations
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np

SMALL = 1e-2  # relative singular value below which it may be rounding of the description
STARTS = 12  # initial guesses for nearly closed configurations
ITERATIONS = 30  # from each
OPEN = 0.1  # rad or lengths: largest residual from which another kind of closure is tried


def advice(mechanism: Mechanism, q: Array) -> str:
    """
    Return the singular values of the constraints at q, (n_q,), and remedies, as text.

    Remedies are a larger rank_tolerance, where a singular value or a residual may be rounding, and
    other kinds of closures that are closed at q and leave a degree of freedom.
    """
    size = _singular_values(mechanism, stacked(mechanism, q))
    shown = ', '.join(f'{x:.3g}' for x in size if x > 1e-15)
    words = [f'singular values of the rows, relative to the largest: {shown}']
    closed = _nearly_closed(mechanism, q)
    rounding = _rounding(mechanism, closed)
    if rounding > RANK:
        words.append(f'if singular values and residuals up to {rounding:.3g} are rounding of the '
                     f'description, rank_tolerance={2.0 * rounding:.1g} treats them as zero')
    words += _kinds(mechanism, closed[0] if closed else q)
    return '; '.join(words)


def _singular_values(mechanism: Mechanism, stack: Stack) -> Array:
    """Return the singular values of the rows in all speeds, relative to the largest."""
    C = rows_in_speeds(mechanism, stack)[0]
    size = np.linalg.svd(C, compute_uv=False)
    return np.asarray(size / max(float(size.max(initial=0.0)), 1e-300))


def _nearly_closed(mechanism: Mechanism, q: Array) -> list[Array]:
    """Return configurations where loops close but for residuals below `SMALL`, near q first."""
    loose = Mechanism(mechanism.model, mechanism.speeds, mechanism.constraints,
                      rank_tolerance=SMALL)
    model = mechanism.model
    moves, rng = np.ones(model.n, dtype=bool), np.random.default_rng(0)
    steps = rng.uniform(-np.pi, np.pi, (STARTS, model.n)) * mechanism.units
    starts = [q, *(moved(model, q, step) for step in steps)]
    ends = [closing_iterations(loose, start, moves, 0.0, ITERATIONS) for start in starts]
    return [here for here, _, _, closed in ends if closed]


def _rounding(mechanism: Mechanism, closed: list[Array]) -> float:
    """Return the largest small singular value or residual at nearly closed configurations."""
    largest = 0.0
    for q in closed:
        stack = stacked(mechanism, q)
        size = _singular_values(mechanism, stack)
        small = size[(size > 1e-15) & (size < SMALL)]
        if small.size:
            residual = np.abs(stack.residual / mechanism.row_units)
            largest = max(largest, small.max(), residual.max(initial=0.0))
    return largest


def _kinds(mechanism: Mechanism, q: Array) -> list[str]:
    """Return the strictest other kinds of one closure that leave a degree of freedom."""
    found: list[tuple[int, str]] = []
    for k, own in enumerate(mechanism.constraints):
        if not isinstance(own, Closure):
            continue
        for kind in get_args(Kind):
            if kind in ('distance', own.kind):
                continue
            others = list(mechanism.constraints)
            others[k] = replace(own, kind=kind, second_axis=None, length=None)
            changed = Mechanism(mechanism.model, mechanism.speeds, others)
            opened = np.abs(stacked(changed, q).residual / changed.row_units)
            if opened.max(initial=0.0) > OPEN:
                continue
            here, _, _, closed = closing_iterations(
                changed, q, np.ones(mechanism.model.n, dtype=bool), 0.0, ITERATIONS)
            freedom = mechanism.model.n - rank_of(scaled_rows(changed, stacked(changed, here))[1])
            if freedom > 0 and closed:
                found.append((freedom, f"'{own.name}' as kind {kind!r}"))
    least = min((freedom for freedom, _ in found), default=0)
    fitting = ', or '.join(text for freedom, text in found if freedom == least)
    return [f'{fitting} would leave {least}'] if found else []


def no_freedom(mechanism: Mechanism, q: Array, rows: int) -> ConstraintError:
    """Return the error for constraints that leave no degree of freedom."""
    return ConstraintError(
        f'constraints: {rows} independent rows ({", ".join(mechanism.labels)}); expected fewer '
        f'than the {mechanism.model.n} speeds, because these leave no degree of freedom at '
        f'{described(mechanism, q)}; configuration= chooses another assembly, which may move; '
        f'{advice(mechanism, q)}')
