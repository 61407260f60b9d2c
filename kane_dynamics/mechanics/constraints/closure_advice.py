"""Error texts for loops without degrees of freedom: singular values, other kinds."""

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.ball_joints import moved
from kane_dynamics.mechanics.constraints import Closure, Constraint
from kane_dynamics.mechanics.constraints.conditioning import (described, RANK, rank_of,
                                                              rows_in_speeds,
                                                              scaled_rows, Stack,
                                                              stacked)
from kane_dynamics.mechanics.constraints.constraint_types.closure import Kind
from kane_dynamics.mechanics.constraints.loop_closure import closing_iterations
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np

SMALL = 1e-2  # relative singular value below which it may be rounding of the description
ROUNDING = 1e-15  # relative singular value up to which it is zero
STARTS = 12  # initial guesses for nearly closed configurations
ITERATIONS = 30  # from each
OPEN = 0.1  # rad or lengths: largest residual for another kind of closure to be tried


def advice(mechanism: Mechanism, q: Array) -> str:
    """
    Return the singular values of the constraints at q, (n_q,), and remedies, as text.

    Remedies are a larger rank_tolerance, where a singular value or a residual may be
    rounding, and other kinds of closures that are closed at q and leave a degree of
    freedom.
    """
    stack = stacked(mechanism, q)
    C, _ = rows_in_speeds(mechanism, stack)
    finite = np.asarray(np.isfinite(C).all(axis=1))
    if not finite.all():
        undefined = [mechanism.labels[k] for k in np.flatnonzero(~finite)]
        return (f'rows {", ".join(undefined)}: undefined at {described(mechanism, q)}; '
                'expected configuration= at which they have a direction')
    singular_values = _singular_values(mechanism, stack)
    shown = ', '.join(f'{x:.3g}' for x in singular_values if x > ROUNDING)
    sentences = [f'singular values of the rows, relative to the largest: {shown}']

    # A remedy for a description that was rounded: the tolerance that absorbs it.
    nearly_closed = _nearly_closed(mechanism, q)
    rounding = _rounding(mechanism, nearly_closed)
    if rounding > RANK:
        sentences.append(
            f'if singular values and residuals up to {rounding:.3g} are rounding of the '
            f'description, rank_tolerance={2.0 * rounding:.1g} treats them as zero')

    # A remedy for a joint stated too strictly:
    # kinds that leave freedom at the same place.
    kinds = _kinds(mechanism, nearly_closed[0] if nearly_closed else q)
    if kinds:
        sentences.append(kinds)
    return '; '.join(sentences)


def _singular_values(mechanism: Mechanism, stack: Stack) -> Array:
    """Return the singular values of the rows in all speeds, relative to the largest."""
    C, _ = rows_in_speeds(mechanism, stack)
    singular_values = np.linalg.svd(C, compute_uv=False)
    largest = max(float(singular_values.max(initial=0.0)), 1e-300)
    return np.asarray(singular_values / largest)


def _nearly_closed(mechanism: Mechanism, q: Array) -> list[Array]:
    """Return configurations with residuals below `SMALL`, that near q first."""
    model = mechanism.model
    # Loop closure in which rows that almost depend on others count as dependent.
    loose = Mechanism(model, mechanism.speeds, mechanism.constraints,
                      rank_tolerance=SMALL)
    moves = np.ones(model.n, dtype=bool)
    rng = np.random.default_rng(0)
    steps = rng.uniform(-np.pi, np.pi, (STARTS, model.n)) * mechanism.units
    starts = [q, *(moved(model, q, step) for step in steps)]
    nearly_closed = []
    # A random start finds configurations that the stated one does not lead to.
    for start in starts:
        result = closing_iterations(loose, start, moves, 0.0, ITERATIONS)
        if result.converged:
            nearly_closed.append(result.q)
    return nearly_closed


def _rounding(mechanism: Mechanism, nearly_closed: list[Array]) -> float:
    """Return the largest small singular value or residual at these configurations."""
    largest = 0.0
    for q in nearly_closed:
        stack = stacked(mechanism, q)
        singular_values = _singular_values(mechanism, stack)
        # A value that is neither zero nor regular belongs to a row that is redundant
        # but for rounded lengths.
        small = singular_values[(singular_values > ROUNDING) & (singular_values < SMALL)]
        if small.size:
            residual = np.abs(stack.residual / mechanism.closure_units)
            largest = max(largest, small.max(), residual.max(initial=0.0))
    return largest


def _kinds(mechanism: Mechanism, q: Array) -> str:
    """Return, as text, the strictest kinds of a closure that leave freedom to move."""
    candidates: list[tuple[int, str]] = []
    for k, closure in enumerate(mechanism.constraints):
        if not isinstance(closure, Closure):
            continue
        for kind in get_args(Kind):
            if kind in ('distance', closure.kind):
                continue
            # The same closure with fewer rows: was it too strict?
            constraints = list(mechanism.constraints)
            constraints[k] = replace(closure, kind=kind, second_axis=None, length=None)
            freedom = _freedom_near(mechanism, constraints, q)
            if freedom > 0:
                candidates.append((freedom, f"'{closure.name}' as kind {kind!r}"))
    if not candidates:
        return ''
    # The strictest kind is nearest to the one that was stated.
    least = min(freedom for freedom, _ in candidates)
    fitting = [text for freedom, text in candidates if freedom == least]
    return f'{", or ".join(fitting)} would leave {least}'


def _freedom_near(mechanism: Mechanism, constraints: Sequence[Constraint],
                  q: Array) -> int:
    """Return the degrees of freedom under other constraints; 0 if not closed near q."""
    model = mechanism.model
    changed = Mechanism(model, mechanism.speeds, constraints)
    # Only kinds whose loop is almost closed at q describe this mechanism.
    residual = np.abs(stacked(changed, q).residual / changed.closure_units)
    if residual.max(initial=0.0) > OPEN:
        return 0
    moves = np.ones(model.n, dtype=bool)
    result = closing_iterations(changed, q, moves, 0.0, ITERATIONS)
    if not result.converged:
        return 0
    # Degrees of freedom: joints less the rank of the rows, in comparable units.
    _, J = scaled_rows(changed, stacked(changed, result.q))
    return model.n - rank_of(J)


def no_freedom(mechanism: Mechanism, q: Array, rows: int) -> ConstraintError:
    """Return the error for constraints that leave no degree of freedom."""
    return ConstraintError(
        f'constraints: {rows} independent rows ({", ".join(mechanism.labels)}); '
        f'expected fewer than the {mechanism.model.n} speeds, because these leave no '
        f'degree of freedom at {described(mechanism, q)}; configuration= chooses '
        f'another assembly, which may move; {advice(mechanism, q)}')
