"""
Semi-implicit Euler steps with implicit friction, and their derivatives, for long steps.

    M (u+ - u) / h + rigid(q, u) + friction(u+) = tau,    q+ = q + h u+

with the mass matrix M and the inverse dynamics without friction at rest acceleration, rigid, both
at the step's beginning. Friction follows its law, `friction.friction_torque`, at the speed u+ of
the step's end. So it neither limits the
step, nor reverses a joint that stops. u+ is the minimum of a convex function, found by Newton's
method, each step with the best of some lengths: full ones may cycle between two directions of
sliding. The number of iterations is fixed, since programs do not branch. Of first order.
"""

from typing import Any

from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.ltdl import factorize, inverse, solve
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
import numpy as np

ITERATIONS = 8
LENGTHS = (1.0, 0.5, 0.2)  # of each


def implicit_friction_step(equations: TreeEquations, q: Any, u: Any, tau: Any, h: Any,
                           parameters: Any) -> tuple[Any, Any]:
    """Return q and u after a step of length h, s, with the torque tau."""
    after = _speed_after(equations, q, u, tau, h, parameters)
    return q + h * after, after


def implicit_friction_slopes(equations: TreeEquations, q: Any, u: Any, tau: Any, h: Any,
                             parameters: Any) -> Any:
    """
    Return the derivatives of (u+ - u) / h by q, u and tau, (3, n, n).

    From the equation of the step and the derivatives of inverse dynamics, at a converged u+.
    """
    after = _speed_after(equations, q, u, tau, h, parameters)
    slope = np.diag(equations.friction_slope(after))
    by_q, by_u, M = equations.inverse_dynamics_derivatives(q, u, (1.0 / h) * (after - u),
                                                           parameters)
    by_u = by_u - np.diag(equations.friction_slope(u)) + slope
    W = inverse(factorize(M + h * slope, equations.order), equations.order)
    return np.stack([-(W @ by_q), -(W @ by_u), W])


def _speed_after(equations: TreeEquations, q: Any, u: Any, tau: Any, h: Any,
                 parameters: Any) -> Any:
    """Return u+, (n,)."""
    M = equations.mass_matrix(q, parameters)
    momentum = M @ u + h * (tau - equations.rigid_dynamics(q, u, equations.zeros, None,
                                                           parameters))
    coulomb = equations.friction and any(body.joint.friction for body in equations.model.bodies)
    if not coulomb:
        slope = np.diag(equations.friction_slope(u))  # constant
        return solve(factorize(M + h * slope, equations.order), equations.order,
                     momentum - h * (equations.friction_force(u) - slope @ u))
    after, excess = u, M @ u + h * equations.friction_force(u) - momentum
    for _ in range(ITERATIONS):
        left = M + h * np.diag(equations.friction_slope(after))
        way = -solve(factorize(left, equations.order), equations.order, excess)
        M_after, M_way, least = M @ after - momentum, M @ way, np.inf
        start = after
        for length in LENGTHS:
            there = start + length * way
            rest = M_after + length * M_way + h * equations.friction_force(there)
            slope = rest @ way  # 0 at the minimum along the way
            better = slope * slope < least if least is not np.inf else None
            if better is None:
                after, excess, least = there, rest, slope * slope
            else:
                after, excess = (np.array([select(better, x, y) for x, y in zip(new, old)])
                                 for new, old in ((there, after), (rest, excess)))
                least = select(better, slope * slope, least)
    return after
