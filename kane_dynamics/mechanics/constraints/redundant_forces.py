"""
Forces of redundant constraint rows: the minimum-norm solution.

Rigid-body dynamics does not determine these forces. Of all forces with the same effect,
those with the least sum of squares are chosen, with moments divided by the length of the
mechanism.
"""

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.algebra.vector import dot, is_zero
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
import numpy as np


def shared_forces(mechanism: Mechanism, J: Matrix, N: Matrix, held: Vector) -> Vector:
    """
    Return the forces of all rows, (m,), equivalent to forces of the kept rows.

    Rows left out are J_R = C J_K, and J_K N = 1 gives C = J_R N. The least sum of
    squares with the same effect is lambda = [1; C] (1 + C^T C)^-1 lambda_K.

    Parameters
    ----------
    mechanism : Mechanism
        Its rows kept and left out, and its length.
    J, N : (m, n_q), (n_q, k) arrays of scalars
        All rows; joint rates per unit of the auxiliary speed of each row kept.
    held : (k,) array of scalars
        Forces of the kept rows while all others are zero, N or N m.

    """
    kept = mechanism.kept
    left_out = mechanism.left_out
    weight = np.where(mechanism.turning, 1.0 / mechanism.length, 1.0)
    result = np.zeros(len(mechanism.labels)).astype(object)

    # C = J_R N, with the forces of both kinds of rows in units of force.
    products = []
    for row in J[left_out]:
        for column in N.T:
            products.append(dot(row, column))
    C: Matrix = np.array(products).reshape(len(left_out), len(kept))
    C = C * weight[kept] / weight[left_out][:, None]
    if all(map(is_zero, C.ravel())):
        result[kept] = held
        return result

    # lambda_K = (1 + C^T C)^-1 held, lambda_R = C lambda_K
    order = list(range(len(kept)))
    factors = factorize(np.eye(len(order)) + _gram(C), order)
    share = solve(factors, order, weight[kept] * held)
    result[kept] = share / weight[kept]
    result[left_out] = (C @ share) / weight[left_out]
    return result


def _gram(C: Matrix) -> Matrix:
    """Return C^T C, symmetric to the last bit."""
    n = C.shape[1]
    result: list[list[Scalar]] = np.zeros((n, n)).tolist()
    for r in range(n):
        for s in range(r, n):
            entry = dot(C[:, r], C[:, s])
            result[r][s] = entry
            result[s][r] = entry
    return np.array(result)
