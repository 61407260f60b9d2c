"""
An integration step that takes friction, springs and bending implicitly.

Coulomb friction that sets in at a small speed, a stiff spring or a beam's high mode would let an
explicit method take only short steps. Here a linear law stands in for each within a step, and is
solved for together with the accelerations: the mass matrix becomes M + g D + g^2 K, and every
coefficient of friction makes its joint heavier for the step instead of making it tremble.

The method is the second-order Rosenbrock method of Verwer, Spee, Blom & Hundsdorfer (SIAM J. Sci.
Comput. 20 (1999), eq. 1.6), which has its order whatever the linear law; the better that is, the
longer the steps that are stable. For linear friction and springs no step is too long.
"""

from collections.abc import Callable
import math
from typing import Any

from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.friction import friction_over_rate
from kane_dynamics.mechanics.recursive.tree_equations import TreeEquations
import numpy as np

GAMMA = 1.0 - math.sqrt(0.5)  # the smaller of the two with which what is stiff dies out
Rates = Callable[[Any, Any, Any, Any, Any], Any]


class ImplicitStep:
    """
    The step for one robot.

    Parameters
    ----------
    equations : TreeEquations
        Whose speeds are the rates of the coordinates.

    """

    def __init__(self, equations: TreeEquations) -> None:
        """Gather the springs and dampers that are linear by themselves."""
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
        Return joints' friction over speed, (n,), N m s or N s/m.

        Of Coulomb friction that is mu / sqrt(u^2 + u_s^2), within 8 % of mu tanh(u / u_s) / u. A
        slope would vanish in sliding, and a long step then throw the joint back and forth; with
        friction over speed it slows down and stays.
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
             + _where(self._C, g) + _where(self._K, g * g))
        return solve(factorize(M, equations.order), equations.order, tau - held)

    def step(self, rates: Rates, q: Any, u: Any, torque: Callable[[Any, Any, int], Any], h: Any,
             resistance: Callable[[Any], Any] | None = None) -> tuple[Any, Any]:
        """
        Return q and u one step later.

        Parameters
        ----------
        rates : callable
            ``rates(q, u, tau, resistance, g)``: what `rates` is for the robot's wrenches and
            parameters.
        q, u : (n,) arrays
            The state.
        torque : callable
            ``torque(q, u, moment)``, (n,), at the step's beginning, 0, and its end, 1.
        h : scalar
            Length of the step, s.
        resistance : callable, optional
            ``resistance(u)``, (n,), if it is not that of the model.

        """
        K, sprung, g = self._K, self._sprung, GAMMA * h
        resistance = resistance or self.resistance
        k_u = rates(q, u, torque(q, u, 0) - g * (K @ u), resistance(u), g)
        turn = g * (sprung * k_u)
        k_q = u + turn
        q_1, u_1 = q + h * k_q, u + h * k_u
        # Friction over speed of its own: with the first one's, joints that stop would turn back.
        D = resistance(u_1)
        again = D * k_u + self._C @ k_u + K @ k_q
        w_u = rates(q_1, u_1, torque(q_1, u_1, 1) + (2.0 * g) * again
                    - g * (K @ (u_1 - 2.0 * turn)), D, g)
        w_q = u_1 - 2.0 * turn + g * (sprung * w_u)
        return q + (0.5 * h) * (k_q + w_q), u + (0.5 * h) * (k_u + w_u)


def _where(A: Any, factor: Any) -> Any:
    """Return a matrix of numbers times a scalar, with plain zeros where it has them."""
    return np.array([[factor * x if x else 0.0 for x in row] for row in A.tolist()])
