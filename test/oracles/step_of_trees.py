"""
The semi-implicit Euler step of a tree with implicit friction, and its derivatives.

    M (u+ - u) / h + rigid(q, u) + friction(u+) = tau,    q+ = q + h u+
"""

from kane_dynamics.mechanics.algebra.ltdl import factorize, inverse
from kane_dynamics.mechanics.integrators.implicit_friction import (
    has_linearized_friction, Resistance, resisted_speed)
import numpy as np


def implicit_friction_step(equations, q, u, tau, h, parameters):
    """Return q and u after a step of length h, s, with the torque tau."""
    # M u+ + h friction(u+) = M u + h (tau - rigid): friction at the end of the step.
    M = equations.mass_matrix(q, parameters)
    rigid = equations.rigid_dynamics(q, u, equations.zeros, None, parameters)
    momentum = M @ u + h * (tau - rigid)

    def slope(v):
        return np.diag(equations.friction_slope(v))
    friction = Resistance(equations.friction_force, slope,
                          not has_linearized_friction(equations))
    u_end = resisted_speed(M, momentum, u, h, equations.order, friction)
    return q + h * u_end, u_end


def implicit_friction_slopes(equations, q, u, tau, h, parameters):
    """
    Return the derivatives of (u+ - u) / h by q, u and tau, (3, n, n).

    From the equation of the step and the derivatives of inverse dynamics, at a converged
    u+.
    """
    _, u_end = implicit_friction_step(equations, q, u, tau, h, parameters)
    slope = np.diag(equations.friction_slope(u_end))

    # Inverse dynamics has the friction of u; in the step it is that of u+.
    udot = (1.0 / h) * (u_end - u)
    by_q, by_u, M = equations.inverse_dynamics_derivatives(q, u, udot, parameters)
    by_u = by_u - np.diag(equations.friction_slope(u)) + slope

    # W = (M + h dfriction/du)^-1 by implicit differentiation of the step.
    W = inverse(factorize(M + h * slope, equations.order), equations.order)
    return np.stack([-(W @ by_q), -(W @ by_u), W])
