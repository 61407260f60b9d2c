"""
Semi-implicit Euler steps with implicit friction, and their derivatives, for long steps.

    M (u+ - u) / h + rigid(q, u) + friction(u+) = tau,    q+ = q + h u+

with the mass matrix M and the inverse dynamics without friction at rest acceleration, rigid, both
at the step's beginning. Friction follows its law, `friction.friction_torque`, at the speed u+ of
the step's end. So it neither limits the
step, nor reverses a joint that stops. u+ is the minimum of a convex function, found by Newton's
method, each step with the best of some lengths: full ones may cycle between two directions of
sliding. The number of iterations is fixed, since programs do not branch. Of first order.

`mechanism_step` has the steps of other robots than trees of rigid bodies.
"""

from typing import Any, NamedTuple

from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.ltdl import factorize, inverse, solve
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
import numpy as np

ITERATIONS = 8
LENGTHS = (1.0, 0.5, 0.2)  # of each


class Resistance(NamedTuple):
    """
    Forces that are those of the speed at the step's end, in the space of the speeds.

    `force` and `slope` take the speeds, (n,), and return (n,) and (n, n); `linear` is whether the
    slope is constant.
    """

    force: Any
    slope: Any
    linear: bool


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
    return resisted_speed(M, momentum, u, h, equations.order, Resistance(
        equations.friction_force, lambda v: np.diag(equations.friction_slope(v)),
        not slides(equations)))


def slides(equations: TreeEquations) -> bool:
    """Return whether a joint has Coulomb friction, for which an implicit step is linearized."""
    return equations.friction and any(body.joint.friction for body in equations.model.bodies)


def resisted_speed(M: Any, momentum: Any, u: Any, h: Any, order: list[int],
                   resistance: Resistance) -> Any:
    """
    Return the speeds u+, (n,), with M u+ + h resistance(u+) = momentum.

    u is the initial guess, and `order` that of the factorization of M.
    """
    force, slope_of, linear = resistance
    if linear:
        slope = slope_of(u)
        return solve(factorize(M + h * slope, order), order, momentum - h * (force(u) - slope @ u))
    after, excess = u, M @ u + h * force(u) - momentum
    for _ in range(ITERATIONS):
        left = M + h * slope_of(after)
        way = -solve(factorize(left, order), order, excess)
        M_after, M_way, least = M @ after - momentum, M @ way, np.inf
        start = after
        for length in LENGTHS:
            there = start + length * way
            rest = M_after + length * M_way + h * force(there)
            slope = rest @ way  # 0 at the minimum along the way
            better = slope * slope < least if least is not np.inf else None
            if better is None:
                after, excess, least = there, rest, slope * slope
            else:
                after, excess = (np.array([select(better, x, y) for x, y in zip(new, old)])
                                 for new, old in ((there, after), (rest, excess)))
                least = select(better, slope * slope, least)
    return after
