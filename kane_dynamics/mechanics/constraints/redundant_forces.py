"""
Forces of redundant constraint rows: the minimum-norm solution.

Rigid-body dynamics does not determine these forces. Of all forces with the same effect, those with
the least sum of squares are chosen, with moments divided by the length of the mechanism.
"""

from typing import Any

from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np

SHARING = ('minimum_norm', 'kept')


def shared_forces(mechanism: Mechanism, J: Any, N: Any, held: Any, redundant: str) -> Any:
    """
    Return the forces of all rows, (m,), equivalent to forces of the kept rows.

    Rows left out are J_R = C J_K, and J_K N = 1 gives C = J_R N. The least sum of squares with
    the same effect is lambda = [1; C] (1 + C^T C)^-1 lambda_K.

    Parameters
    ----------
    mechanism : Mechanism
        Its rows kept and left out, and its length.
    J, N : (m, n_q), (n_q, k) arrays of scalars
        All rows; joint rates per unit of the auxiliary speed of each row kept.
    held : (k,) array of scalars
        Forces of the kept rows while all others are zero, N or N m.
    redundant : one of `SHARING`
        'kept': the forces of the other rows are zero.

    """
    kept, others = mechanism.kept, mechanism.left_out
    result = np.zeros(len(mechanism.labels)).astype(object)
    weight = np.array([1.0 / mechanism.length if turns else 1.0 for turns in mechanism.turning])
    C = (np.array([_product(row, N) for row in J[others]]).reshape(len(others), len(kept))
         * weight[kept] / weight[others][:, None])
    if redundant == 'kept' or all(is_zero(x) for x in C.ravel()):
        result[kept] = held
        return result
    order = list(range(len(kept)))
    share = solve(factorize(np.eye(len(order)) + _gram(C), order), order, weight[kept] * held)
    result[kept] = share / weight[kept]
    result[others] = (C @ share) / weight[others]
    return result


def _product(row: Any, matrix: Any) -> list[Any]:
    """Return row @ matrix without the terms that are zero by structure."""
    return [sum((x * y for x, y in zip(row, column) if not (is_zero(x) or is_zero(y))),
                start=0.0) for column in matrix.T]


def _gram(C: Any) -> Any:
    """Return C^T C, symmetric to the last bit."""
    n = C.shape[1]
    upper = {(r, s): _product(C[:, r], C[:, s:s + 1])[0] for r in range(n) for s in range(r, n)}
    return np.array([[upper[min(r, s), max(r, s)] for s in range(n)] for r in range(n)])
