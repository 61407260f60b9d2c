"""Error texts for loops without degrees of freedom: the singular values of their rows."""

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.constraints.conditioning import (described, rows_in_speeds,
                                                              stacked)
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np


def advice(mechanism: Mechanism, q: Array) -> str:
    """Return the singular values of the constraints at q, (n_q,), and remedies, as text."""
    C, _ = rows_in_speeds(mechanism, stacked(mechanism, q))
    finite = np.asarray(np.isfinite(C).all(axis=1))
    if not finite.all():
        undefined = [mechanism.labels[k] for k in np.flatnonzero(~finite)]
        return (f'rows {", ".join(undefined)}: undefined at {described(mechanism, q)}; '
                'expected configuration= at which they have a direction')
    values = np.linalg.svd(C, compute_uv=False)
    shown = ', '.join(f'{x / max(values.max(), 1e-300):.3g}' for x in values)
    return (f'singular values of the rows, relative to the largest: {shown}; small ones that '
            'are rounding of the description are treated as zero by a larger '
            "rank_tolerance=; a closure of a kind with fewer rows, such as 'inline', leaves "
            'more degrees of freedom')


def no_freedom(mechanism: Mechanism, q: Array, rows: int) -> ConstraintError:
    """Return the error for constraints that leave no degree of freedom."""
    return ConstraintError(
        f'constraints: {rows} independent rows ({", ".join(mechanism.labels)}); '
        f'expected fewer than the {mechanism.model.n} speeds, because these leave no '
        f'degree of freedom at {described(mechanism, q)}; configuration= chooses '
        f'another assembly, which may move; {advice(mechanism, q)}')
