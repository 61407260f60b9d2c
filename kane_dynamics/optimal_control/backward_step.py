"""
One step of the backward pass of differential dynamic programming with torque limits.

The cost-to-go at the end of an interval is v . dx + 1/2 dx . V dx in the change dx of the state,
of n_x entries: of the configuration, then of the speeds. The change of the m torques that
minimises it, plus the cost of the interval, is
``k + K dx``, within the limits (Tassa, Mansard, Todorov, Control-limited differential dynamic
programming, ICRA 2014), with Gauss-Newton Hessians (iLQR): second derivatives of the dynamics are
left out. Within the limits, the quadratic is minimised by Seidel sweeps and projected Newton steps
(Bertsekas, SIAM J. Control Optim. 20 (1982)) in turn, each step with the best of some lengths.
Their number is fixed, since programs do not branch. The result costs less than no change, unless
no change is the minimum.

The step of a tree is q+ = q + h w, w = u+ = u + h udot, so the cost-to-go is a function of q
and w, and only w depends on the dynamics: this halves the arithmetic.

All functions run over any scalar.
"""

from typing import Any, NamedTuple

from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
import numpy as np

ROUNDS = 3  # sweeps and projected Newton steps
SCALES = (1.0, 0.3, 0.1)  # lengths of each
Matrix = list[list[Any]]


class Expansion(NamedTuple):
    """Hessian, rows of its lower triangle, and gradient of a cost by the state and the torques."""

    H: Matrix
    g: Any


class TorqueCost(NamedTuple):
    """Torques of an interval, slopes and curvatures of their cost, and their bounds, (m,) each."""

    tau: Any
    gradient: Any
    hessian: Any
    lowest: Any
    highest: Any


class Policy(NamedTuple):
    """Change of torque k + K dx, its expected change of cost, and the cost-to-go before it."""

    k: Any  # (m,)
    K: Any  # (m, n_x)
    first: Any  # change of cost of `alpha` k: alpha first + alpha^2 second
    second: Any
    v: Any  # (n_x,)
    V: Any  # lower triangle by rows, (n_x (n_x + 1) / 2,)


def backward_step(cost_to_go: Expansion, torques: TorqueCost, regular: Any) -> Policy:
    """
    Return the policy of an interval.

    Parameters
    ----------
    cost_to_go : Expansion
        By the state and the torque at the beginning; with the cost of the state at the end.
    torques : TorqueCost
        Torque of the interval.
    regular : (m,) array
        Weights of the change of torque, which shorten it.

    """
    (H, g), (tau, gradient, hessian, lowest, highest) = cost_to_go, torques
    m = len(tau)
    n_x = len(g) - m
    Q = np.array([[H[n_x + max(i, j)][n_x + min(i, j)] for j in range(m)] for i in range(m)])
    Q = Q + np.diag(hessian + regular)
    Q_x = np.array([row[:n_x] for row in H[n_x:]])
    g_tau = g[n_x:] + gradient
    k, K = limited_minimum(Q, g_tau, Q_x, lowest - tau, highest - tau)
    Q_k = Q @ k
    return Policy(k, K, g_tau @ k, 0.5 * (k @ Q_k),
                  g[:n_x] + k @ Q_x + (Q_k + g_tau) @ K,
                  np.array([H[a][b] + Q_x[:, a] @ K[:, b]
                            for a in range(n_x) for b in range(a + 1)]))


def symmetric(packed: Any, size: int) -> Any:
    """Return a symmetric matrix from the rows of its lower triangle."""
    return np.array([[packed[max(a, b) * (max(a, b) + 1) // 2 + min(a, b)] for b in range(size)]
                     for a in range(size)])


def expansion(F: Any, v: Any, V: Any) -> Expansion:
    """Return the cost-to-go before a step with dx+ = F (dx, dtau), (n_x, n_x + m)."""
    T = V @ F
    return Expansion([[F[:, a] @ T[:, b] for b in range(a + 1)] for a in range(F.shape[1])],
                     v @ F)


def expansion_of_tree(slopes: Any, h: Any, v: Any, V: Any) -> Expansion:
    """
    Return the cost-to-go before the step of a tree.

    `slopes` are the derivatives of udot by q, u and tau, (3, n, n).
    """
    n = len(slopes[0])
    by_w = V[n:, n:] + h * (V[:n, n:] + V[n:, :n] + h * V[:n, :n])
    mixed = V[:n, n:] + h * V[:n, :n]  # by q and w
    D = np.concatenate([h * slopes[0], np.eye(n) + h * slopes[1], h * slopes[2]], axis=1)
    T = by_w @ D
    T[:, :n] = T[:, :n] + mixed.T
    across = mixed @ D[:, :n]
    H = [[D[:, a] @ T[:, b] for b in range(a + 1)] for a in range(3 * n)]
    for a in range(n):
        for b in range(a + 1):
            H[a][b] = H[a][b] + across[a, b] + V[a, b]
    g = (v[n:] + h * v[:n]) @ D
    return Expansion(H, np.concatenate([g[:n] + v[:n], g[n:]]))


def limited_minimum(Q: Any, g: Any, Q_x: Any, lower: Any, upper: Any) -> tuple[Any, Any]:
    """
    Return k that minimises g . k + 1/2 k . Q k within bounds, (m,), and its feedback, (m, n_x).

    By projected Newton steps from 0, each after a sweep over the torques. The feedback solves
    Q K = -Q_x for the free torques, and is 0 for those at a bound.
    """
    n = len(g)
    k: Any = np.zeros(n)
    inverse = [1.0 / Q[i, i] for i in range(n)]
    for _ in range(ROUNDS):
        k, slope = _relaxed(Q, k, g + Q @ k, inverse, lower, upper)
        free, factors = _free(Q, k, slope, lower, upper)
        step = solve(factors, range(n), -(free * slope))
        best: Any = 0.0
        found = k
        for scale in SCALES:
            there = [clipped(a + scale * b, *bounds)
                     for a, b, *bounds in zip(k, step, lower, upper)]
            value = (g + 0.5 * (Q @ there)) @ there - (g + 0.5 * (Q @ k)) @ k
            better = value < best
            best = select(better, value, best)
            found = np.array([select(better, a, b) for a, b in zip(there, found)])
        k = found
    free, factors = _free(Q, k, g + Q @ k, lower, upper)
    return k, np.stack([solve(factors, range(n), -(free * column)) for column in Q_x.T], axis=1)


def _relaxed(Q: Any, k: Any, slope: Any, inverse: Any, lower: Any, upper: Any) -> tuple[Any, Any]:
    """Return k and the slope of the cost after each torque has been set to its best (Seidel)."""
    k = list(k)
    for i in range(len(k)):
        new = clipped(k[i] - inverse[i] * slope[i], lower[i], upper[i])
        slope = slope + (new - k[i]) * Q[:, i]
        k[i] = new
    return np.array(k), slope


def _free(Q: Any, k: Any, slope: Any, lower: Any, upper: Any) -> tuple[Any, Any]:
    """
    Return 1 for each torque that is free, else 0, and the factors of Q with unit rows for these.

    A torque is at a bound, not free, if it is there and the slope of the cost keeps it there.
    """
    free = np.array([1.0 - (1.0 - (low < x)) * (s > 0.0) - (1.0 - (x < high)) * (s < 0.0)
                     for x, s, low, high in zip(k, slope, lower, upper)])
    kept = np.outer(free, free) * Q + np.diag(1.0 - free)
    return free, factorize(kept, range(len(free)))


def clipped(x: Any, lower: Any, upper: Any) -> Any:
    """Return the number within bounds that is nearest to x."""
    return select(x < lower, lower, select(upper < x, upper, x))
