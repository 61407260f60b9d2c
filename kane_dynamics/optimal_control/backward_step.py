"""
One step of the backward pass of differential dynamic programming with torque limits.

The cost-to-go at the end of an interval is v . dx + 1/2 dx . V dx in the change dx of
the state, of n_x entries: of the configuration, then of the speeds. The change of the m
torques that minimises it, plus the cost of the interval, is ``k + K dx``, within the
limits (Tassa, Mansard, Todorov, Control-limited differential dynamic programming, ICRA
2014), with Gauss-Newton Hessians (iLQR): second derivatives of the dynamics are left
out.

Within the limits, the quadratic is minimised by Seidel sweeps and projected Newton steps
(Bertsekas, SIAM J. Control Optim. 20 (1982)) in turn, each step with the best of some
lengths. Their number is fixed, since programs do not branch. The result costs less than
no change, unless no change is the minimum.

All functions run over any scalar.
"""

from collections.abc import Iterable
from itertools import chain
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.control.torque_limiter import clipped
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
import numpy as np

ROUNDS = 3  # sweeps and projected Newton steps
SCALES = (1.0, 0.3, 0.1)  # lengths of each
Rows = list[list[Any]]  # of scalars; rows of a lower triangle have different lengths


class Expansion(NamedTuple):
    """Lower triangle of the Hessian, and gradient, by the state and the torques."""

    H: Rows
    g: Vector


class TorqueCost(NamedTuple):
    """Torques of an interval, slopes and curvatures of their cost, bounds, (m,)."""

    tau: Vector
    gradient: Vector
    hessian: Vector
    lowest: Vector
    highest: Vector


class Policy(NamedTuple):
    """Change of torque k + K dx, its expected change of cost, the cost-to-go."""

    k: Vector  # (m,)
    K: Matrix  # (m, n_x)
    first: Scalar  # change of cost of `alpha` k: alpha first + alpha^2 second
    second: Scalar
    v: Vector  # (n_x,)
    V: Vector  # lower triangle by rows, (n_x (n_x + 1) / 2,)


def backward_step(cost_to_go: Expansion, torques: TorqueCost, regular: Vector) -> Policy:
    """
    Return the policy of an interval.

    Parameters
    ----------
    cost_to_go : Expansion
        By the state and the torque at the beginning; with the cost of the state at the
        end.
    torques : TorqueCost
        Torque of the interval.
    regular : (m,) array
        Weights of the change of torque, which shorten it.

    """
    H, g = cost_to_go
    tau, gradient, hessian, lowest, highest = torques
    m = len(tau)
    n_x = len(g) - m

    # The quadratic in the torques, with the terms that are mixed with the state.
    Q = symmetric_of_rows([row[n_x:] for row in H[n_x:]]) + np.diag(hessian + regular)
    Q_x = np.array([row[:n_x] for row in H[n_x:]])
    slope = g[n_x:] + gradient
    k, K = limited_minimum(Q, slope, Q_x, lowest - tau, highest - tau)

    # The cost-to-go with k + K dx in place of the torques.
    Q_k = Q @ k
    v = g[:n_x] + k @ Q_x + (Q_k + slope) @ K
    V = np.array([H[a][b] + Q_x[:, a] @ K[:, b] for a, b in lower_triangle(n_x)])
    return Policy(k, K, slope @ k, 0.5 * (k @ Q_k), v, V)


def lower_triangle(size: int) -> Iterable[tuple[int, int]]:
    """Yield row and column of each entry of a lower triangular matrix, row by row."""
    for a in range(size):
        for b in range(a + 1):
            yield a, b


def lower_product(A: Matrix, B: Matrix) -> Rows:
    """Return the rows of the lower triangle of A^T B, which is symmetric."""
    rows: Rows = []
    for a, column in enumerate(A.T):
        rows.append([column @ B[:, b] for b in range(a + 1)])
    return rows


def symmetric_of_rows(rows: Rows) -> Matrix:
    """Return a symmetric matrix from the rows of its lower triangle."""
    return from_triangle(list(chain.from_iterable(rows)), len(rows))


def from_triangle(packed: Any, size: int) -> Matrix:
    """Return a symmetric matrix from the entries of its lower triangle, row by row."""
    result = np.empty((size, size), dtype=object)
    for x, (a, b) in zip(packed, lower_triangle(size), strict=True):
        result[a, b] = x
        result[b, a] = x
    return result


def expansion(F: Matrix, v: Vector, V: Matrix) -> Expansion:
    """Return the cost-to-go before a step with dx+ = F (dx, dtau), (n_x, n_x + m)."""
    return Expansion(lower_product(F, V @ F), v @ F)


def limited_minimum(Q: Matrix, g: Vector, Q_x: Matrix, lower: Vector, upper: Vector
                    ) -> tuple[Vector, Matrix]:
    """
    Return k that minimises g . k + 1/2 k . Q k within bounds, and its feedback.

    By projected Newton steps from 0, each after a sweep over the torques. The feedback
    solves Q K = -Q_x for the free torques, and is 0 for those at a bound.
    """
    n = len(g)
    k: Vector = np.zeros(n)
    inverse = [1.0 / x for x in np.diag(Q)]
    # A sweep finds most of the torques that are at a bound, a Newton step solves for the
    # others.
    for _ in range(ROUNDS):
        k, slope = _swept(Q, k, g + Q @ k, inverse, lower, upper)
        k = _newton_step(Q, g, k, slope, lower, upper)
    # The feedback of the torques that are free in the end.
    free, factors = _free(Q, k, g + Q @ k, lower, upper)
    columns = [solve(factors, range(n), -(free * column)) for column in Q_x.T]
    return k, np.stack(columns, axis=1)


def _swept(Q: Matrix, k: Vector, slope: Vector, inverse: list[Scalar], lower: Vector,
           upper: Vector) -> tuple[Vector, Vector]:
    """Return k and the slope of the cost after a sweep over the torques (Seidel)."""
    torques = list(k)
    for i in range(len(torques)):
        best = clipped(torques[i] - inverse[i] * slope[i], lower[i], upper[i])
        slope = slope + (best - torques[i]) * Q[:, i]
        torques[i] = best
    return np.array(torques), slope


def _newton_step(Q: Matrix, g: Vector, k: Vector, slope: Vector, lower: Vector,
                 upper: Vector) -> Vector:
    """Return k after a projected Newton step of the length that costs least, or none."""
    n = len(k)
    free, factors = _free(Q, k, slope, lower, upper)
    # The Newton direction of the torques that are not at a bound.
    step = solve(factors, range(n), -(free * slope))
    least: Scalar = 0.0
    result = k
    # Of a few lengths the one with the least cost, by selection: programs have no
    # branch.
    for scale in SCALES:
        candidate = clipped_all(k + scale * step, lower, upper)
        gain = (g + 0.5 * (Q @ candidate)) @ candidate - (g + 0.5 * (Q @ k)) @ k
        better = gain < least
        least = select(better, gain, least)
        result = np.array([select(better, new, old)
                           for new, old in zip(candidate, result)])
    return result


def _free(Q: Matrix, k: Vector, slope: Vector, lower: Vector, upper: Vector
          ) -> tuple[Vector, Any]:
    """
    Return 1 for free torques, else 0, and factors of Q with unit rows for the others.

    A torque is at a bound, not free, if it is there and the slope of the cost keeps it
    there.
    """
    flags = []
    for x, s, low, high in zip(k, slope, lower, upper):
        held_below = (1.0 - (low < x)) * (s > 0.0)
        held_above = (1.0 - (x < high)) * (s < 0.0)
        flags.append(1.0 - held_below - held_above)
    free = np.array(flags)
    matrix = np.outer(free, free) * Q + np.diag(1.0 - free)
    return free, factorize(matrix, range(len(free)))


def clipped_all(x: Vector, lower: Vector, upper: Vector) -> Vector:
    """Return the numbers within bounds that are nearest to those of x, (n,)."""
    return np.array([clipped(*bounded) for bounded in zip(x, lower, upper)])
