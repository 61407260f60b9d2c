"""
Linearly implicit integration (Rosenbrock) of friction, springs and bending.

Coulomb friction with a small onset speed, stiff springs and high modes of a beam restrict explicit
methods to small steps. Here each is linearized within a step and solved together with the
accelerations: the mass matrix becomes M + g D + g^2 K with damping D and stiffness K.

The method is the second-order Rosenbrock method of Verwer, Spee, Blom & Hundsdorfer (SIAM J. Sci.
Comput. 20 (1999), eq. 1.6). It is of second order for any linearization; a better linearization
allows larger steps. With linear friction and springs it is unconditionally stable.
"""

from collections.abc import Callable
import math
from typing import Any

from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.friction import friction_over_rate
from kane_dynamics.mechanics.integrators.interface import System
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
import numpy as np

GAMMA = 1.0 - math.sqrt(0.5)  # the smaller of the two values for L-stability
Rates = Callable[[Any, Any, Any, Any, Any], Any]


class ImplicitStep:
    """
    Rosenbrock step for one robot.

    Parameters
    ----------
    equations : TreeEquations
        Equations of motion with u = q'.

    """

    def __init__(self, equations: TreeEquations) -> None:
        """Collect the linear springs and dampers."""
        self.equations = equations
        n, model = equations.n, equations.model
        self._K, self._C = np.zeros((2, n, n))
        for body in model.bodies:
            joint = body.joint
            self._K[joint.coordinate, joint.coordinate] += joint.multiplier**2 * joint.stiffness
            if body.beam is not None:
                here = np.ix_(body.beam.coordinates, body.beam.coordinates)
                self._K[here] += body.beam.stiffness
                if equations.friction:
                    self._C[here] += body.beam.damping
        self._sprung = self._K.any(axis=0).astype(float)

    def resistance(self, u: Any) -> Any:
        """
        Return the friction of the joints divided by speed, (n,), N m s or N s/m.

        For Coulomb friction that is mu / sqrt(u^2 + u_s^2), within 8 % of mu tanh(u / u_s) / u.
        The slope of the law is not suitable: it vanishes in sliding, and large steps then
        oscillate about zero speed.
        """
        total: list[Any] = [0.0] * self.equations.n
        for joint in (body.joint for body in self.equations.model.bodies):
            if self.equations.friction:
                ratio = friction_over_rate(joint, joint.multiplier * u[joint.coordinate])
                total[joint.coordinate] = total[joint.coordinate] + joint.multiplier**2 * ratio
        return np.array(total)

    def rates(self, q: Any, u: Any, tau: Any, resistance: Any, g: Any, wrench: Any,
              parameters: Any) -> Any:
        """Return (M + g D + g^2 K)^-1 (tau + external - bias), (n,)."""
        equations = self.equations
        held = equations.inverse_dynamics(q, u, equations.zeros, wrench, parameters)
        M = (equations.mass_matrix(q, parameters) + np.diag(g * resistance)
             + _scaled(self._C, g) + _scaled(self._K, g * g))
        return solve(factorize(M, equations.order), equations.order, tau - held)

    def step(self, rates: Rates, q: Any, u: Any, torque: Callable[[Any, Any, int], Any], h: Any,
             resistance: Callable[[Any], Any] | None = None) -> tuple[Any, Any]:
        """
        Return q and u after one step.

        Parameters
        ----------
        rates : callable
            ``rates(q, u, tau, resistance, g)``: `ImplicitStep.rates` with the robot's wrenches
            and parameters.
        q, u : (n,) arrays
            The state.
        torque : callable
            ``torque(q, u, moment)``, (n,), at the beginning (0) and the end (1) of the step.
        h : scalar
            Step size, s.
        resistance : callable, optional
            ``resistance(u)``, (n,). Default: that of the model.

        """
        K, sprung, g = self._K, self._sprung, GAMMA * h
        resistance = resistance or self.resistance
        k_u = rates(q, u, torque(q, u, 0) - g * (K @ u), resistance(u), g)
        turn = g * (sprung * k_u)
        k_q = u + turn
        q_1, u_1 = q + h * k_q, u + h * k_u
        # Each stage evaluates its own friction over speed; otherwise stopping joints reverse.
        D = resistance(u_1)
        again = D * k_u + self._C @ k_u + K @ k_q
        w_u = rates(q_1, u_1, torque(q_1, u_1, 1) + (2.0 * g) * again
                    - g * (K @ (u_1 - 2.0 * turn)), D, g)
        w_q = u_1 - 2.0 * turn + g * (sprung * w_u)
        return q + (0.5 * h) * (k_q + w_q), u + (0.5 * h) * (k_u + w_u)


class Rosenbrock:
    """The linearly implicit method of this module, behind the interface of all integrators."""

    name, damps = 'implicit', True

    def supports(self, equations: object) -> bool:
        """Return whether these are a tree's equations in joint rates."""
        return isinstance(equations, TreeEquations)

    def step(self, system: System, state: Any, h: Any) -> Any:
        """Return the state after one step of length h, s; quadratures by the trapezoidal rule."""
        n = system.equations.n
        q, u, rest = np.split(state, [n, 2 * n])
        q_1, u_1 = ImplicitStep(system.equations).step(
            system.implicit_rates, q, u, lambda q, u, end: system.torque(q, u, 2 * end), h,
            system.resistance)
        if not len(rest):
            return np.concatenate([q_1, u_1])
        sums = rest + (0.5 * h) * (system.quadratures(q, u, 0) + system.quadratures(q_1, u_1, 2))
        return np.concatenate([q_1, u_1, sums])


def _scaled(A: Any, factor: Any) -> Any:
    """Return a constant matrix times a scalar; zero entries cause no arithmetic."""
    return np.array([[factor * x if x else 0.0 for x in row] for row in A.tolist()])
