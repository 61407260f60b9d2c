"""
One step of the backward pass of differential dynamic programming with torque limits.

The cost-to-go at the end of an interval is v . dx + 1/2 dx . V dx in the change dx = (dq, du) of
the state. The change of torque that minimises it, plus the cost of the interval, is
``k + K dx``, within the limits (Tassa, Mansard, Todorov, Control-limited differential dynamic
programming, ICRA 2014), with Gauss-Newton Hessians (iLQR): second derivatives of the dynamics are
left out. The limits are met by a primal-dual active set method (Hintermueller, Ito, Kunisch, SIAM
J. Optim. 13 (2002)): torques at a limit are set, the others follow from a linear system, and those
that exceed a limit, or want to leave theirs, change sides. The number of these rounds is fixed,
since programs do not branch.

The step of the horizon is q+ = q + h w, w = u+ = u + h udot, so the cost-to-go is a function of q
and w, and only w depends on the dynamics: this halves the arithmetic.

All functions run over any scalar.
"""

from typing import Any, NamedTuple

from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.optimal_control.stage_cost import Limits
import numpy as np

ROUNDS = 6  # of the active set, which begins with that of the previous iteration
Matrix = list[list[Any]]


class Policy(NamedTuple):
    """Change of torque k + K dx, its expected change of cost, and the cost-to-go before it."""

    k: Any  # (n,)
    K: Any  # (n, 2 n)
    first: Any  # change of cost of `alpha` k: alpha first + alpha^2 second
    second: Any
    v: Any  # (2 n,)
    V: Any  # lower triangle by rows, (n (2 n + 1),)


def backward_step(slopes: Any, tau: Any, h: Any, gradient: Any, hessian: Any, limits: Limits,
                  v: Any, V: Any) -> Policy:
    """
    Return the policy of an interval.

    Parameters
    ----------
    slopes : (3, n, n) array
        Derivatives of udot by q, u and tau.
    tau : (n,) array
    h : scalar
        Length of the interval, s.
    gradient, hessian : (3 n,) arrays
        `stage_cost.cost_slopes`.
    limits : Limits
    v, V
        The cost-to-go at the end of the interval, as in `Policy`.

    """
    n = len(tau)
    H, g = _expanded(slopes, h, v + gradient[:2 * n], _symmetric(V, 2 * n)
                     + np.diag(hessian[:2 * n]), n)
    Q = np.array([[H[2 * n + max(i, j)][2 * n + min(i, j)] for j in range(n)] for i in range(n)])
    Q = Q + np.diag(hessian[2 * n:])
    Q_x = np.array([row[:2 * n] for row in H[2 * n:]])
    g_tau = g[2 * n:] + gradient[2 * n:]
    k, K = _limited(Q, g_tau, Q_x, -limits.torque - tau, limits.torque - tau)
    Q_k = Q @ k
    return Policy(k, K, g_tau @ k, 0.5 * (k @ Q_k),
                  g[:2 * n] + k @ Q_x + (Q_k + g_tau) @ K,
                  np.array([H[a][b] + Q_x[:, a] @ K[:, b]
                            for a in range(2 * n) for b in range(a + 1)]))


def _symmetric(packed: Any, size: int) -> Any:
    """Return a symmetric matrix from the rows of its lower triangle."""
    return np.array([[packed[max(a, b) * (max(a, b) + 1) // 2 + min(a, b)] for b in range(size)]
                     for a in range(size)])


def _expanded(slopes: Any, h: Any, v: Any, V: Any, n: int) -> tuple[Matrix, Any]:
    """Return Hessian (lower triangle) and gradient of the cost-to-go by q, u and tau."""
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
    return H, np.concatenate([g[:n] + v[:n], g[n:]])


def _limited(Q: Any, g: Any, Q_x: Any, lower: Any, upper: Any) -> tuple[Any, Any]:
    """Return k that minimises g . k + 1/2 k . Q k within bounds, and K, which is 0 at them."""
    n = len(g)
    order = range(n)
    above = np.array([(1.0 - (0.0 < upper[i])) * (g[i] < 0.0) for i in order])
    below = np.array([(1.0 - (lower[i] < 0.0)) * (0.0 < g[i]) for i in order])
    for _ in range(ROUNDS):
        free = 1.0 - above - below
        held = np.array([select(above[i] > 0.5, upper[i], select(below[i] > 0.5, lower[i], 0.0))
                         for i in order])
        factors = factorize(np.array([
            [free[i] * free[j] * Q[i, j] if i != j else free[i] * Q[i, i] + (1.0 - free[i])
             for j in order] for i in order]), order)
        k = held + solve(factors, order, -(free * (g + Q @ held)))
        slope = g + Q @ k
        last = free
        above, below = (
            np.array([free[i] * (upper[i] < k[i]) + above[i] * (slope[i] < 0.0) for i in order]),
            np.array([free[i] * (k[i] < lower[i]) + below[i] * (0.0 < slope[i]) for i in order]))
    k = np.array([clipped(k[i], lower[i], upper[i]) for i in order])
    K = np.stack([solve(factors, order, -(last * Q_x[:, c])) for c in range(2 * n)], axis=1)
    return k, K


def clipped(x: Any, lower: Any, upper: Any) -> Any:
    """Return the number within bounds that is nearest to x."""
    return select(x < lower, lower, select(upper < x, upper, x))
