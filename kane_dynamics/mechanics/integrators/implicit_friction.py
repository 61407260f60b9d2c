"""
Semi-implicit Euler steps with implicit friction, and their derivatives, for long steps.

    M (u+ - u) / h + rigid(q, u) + friction(u+) = tau,    q+ = q + h u+

with the mass matrix M and the inverse dynamics without friction at rest acceleration, rigid, both
at the step's beginning. Friction follows its law, `friction.friction_torque`, at the speed u+ of
the step's end. So it neither limits the step, nor reverses a joint that stops. u+ follows by
Newton's method from u+ = 0: friction is concave in |u+|, so each iteration comes nearer from the
side of rest and none overshoots (for one joint; the coupling by M is mild). The number of
iterations is fixed; what remains is an excess of friction. Of first order.
"""

from typing import Any

from kane_dynamics.mechanics.algebra.ltdl import factorize, inverse, solve
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
import numpy as np

ITERATIONS = 4  # with Coulomb friction; viscous friction needs one


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
    after = np.zeros(equations.n)
    for _ in range(ITERATIONS if coulomb else 1):
        excess = M @ after + h * equations.friction_force(after) - momentum
        factors = factorize(M + h * np.diag(equations.friction_slope(after)), equations.order)
        after = after - solve(factors, equations.order, excess)
    return after
