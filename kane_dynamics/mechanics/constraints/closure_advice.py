"""Error texts for loops without degrees of freedom: singular values, kinds that would fit."""

from dataclasses import replace
from typing import get_args

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.constraints.conditioning import rank_of, scaled_rows, stacked
from kane_dynamics.mechanics.constraints.constraint_types.closure import Closure, Kind
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np

SMALL = 1e-2  # relative singular value below which it may be rounding of the description
OPEN = 1e-3  # m or rad: largest residual with which another kind of closure fits


def advice(mechanism: Mechanism, q: Array) -> str:
    """
    Return the singular values of the constraints at q, (n_q,), and remedies, as text.

    Remedies are a larger rank_tolerance, where a singular value or a residual may be rounding, and
    other kinds of closures that are closed at q and leave a degree of freedom.
    """
    stack = stacked(mechanism, q)
    size = np.linalg.svd(scaled_rows(mechanism, stack)[1], compute_uv=False)
    size = size / max(float(size.max(initial=0.0)), 1e-300)
    shown = ', '.join(f'{x:.3g}' for x in size if x > 1e-15)
    words = [f'singular values of the rows, relative to the largest: {shown}']
    small = size[(size > 1e-15) & (size < SMALL)]
    if small.size and np.abs(stack.residual).max(initial=0.0) < OPEN:
        figure = 2.0 * max(float(small.max()), float(np.abs(stack.residual).max(initial=0.0)))
        words.append(f'if {small.max():.3g} is rounding of the description, rank_tolerance='
                     f'{figure:.1g} treats it as zero')
    words += _kinds(mechanism, q)
    return '; '.join(words)


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
            stack = stacked(changed, q)
            freedom = mechanism.model.n - rank_of(scaled_rows(changed, stack)[1])
            if freedom > 0 and np.abs(stack.residual).max(initial=0.0) < OPEN:
                found.append((freedom, f"'{own.name}' as kind {kind!r}"))
    least = min((freedom for freedom, _ in found), default=0)
    fitting = ', or '.join(text for freedom, text in found if freedom == least)
    return [f'{fitting} would leave {least}'] if found else []


def no_freedom(mechanism: Mechanism, q: Array, rows: int) -> ConstraintError:
    """Return the error for constraints that leave no degree of freedom."""
    return ConstraintError(
        f'constraints: {rows} independent rows ({", ".join(mechanism.labels)}); expected fewer '
        f'than the {mechanism.model.n} speeds, because these leave no degree of freedom; '
        f'{advice(mechanism, q)}')
