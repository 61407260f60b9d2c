"""
Linearly implicit integration (Rosenbrock) of friction, springs and bending.

Coulomb friction with a small onset speed, stiff springs and high modes of a beam restrict explicit
methods to small steps. Here each is linearized within a step and solved together with the
accelerations: with q' = T u + X, the mass matrix becomes M + T^T (g D + g^2 K) T with the damping
D and the stiffness K of the joints.

The method is the second-order Rosenbrock method of Verwer, Spee, Blom & Hundsdorfer (SIAM J. Sci.
Comput. 20 (1999), eq. 1.6). It is of second order for any linearization; a better linearization
allows larger steps. With linear friction and springs it is unconditionally stable. T is constant
in the linearization, and so are all other forces.
"""

from collections.abc import Callable
import math
from typing import Any

from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.constraints.mechanism import congruent
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.friction import friction_over_rate
from kane_dynamics.mechanics.integrators.held_joints import (Held, held_solution, linear_system,
                                                             Solution)
from kane_dynamics.mechanics.integrators.interface import System
import numpy as np

GAMMA = 1.0 - math.sqrt(0.5)  # the smaller of the two values for L-stability
Stage = Callable[[Any, Any, Any, Any, Any, int], tuple[Any, Any]]


class ImplicitStep:
    """
    Rosenbrock step for one robot.

    Parameters
    ----------
    equations : Equations
        Equations of motion.

    """

    def __init__(self, equations: Equations) -> None:
        """Collect the linear springs and dampers."""
        self.equations = equations
        self._tree = equations.tree
        self.n, model = self._tree.n, equations.model
        self._K, self._C = np.zeros((2, self.n, self.n))
        for body in model.bodies:
            joint = body.joint
            self._K[joint.coordinate, joint.coordinate] += joint.multiplier**2 * joint.stiffness
            if body.beam is not None:
                here = np.ix_(body.beam.coordinates, body.beam.coordinates)
                self._K[here] += body.beam.stiffness
                if self._tree.friction:
                    self._C[here] += body.beam.damping
        # Joints whose rates are implicit. Those of a loop remain compatible: all, or none.
        sprung = self._K.any(axis=0)
        self._sprung = (sprung if equations.in_joint_rates else
                        np.full(self.n, sprung.any())).astype(float)

    def resistance(self, v: Any) -> Any:
        """
        Return the friction of the joints divided by speed, (n_j,), N m s or N s/m.

        For Coulomb friction that is mu / sqrt(v^2 + u_s^2), within 8 % of mu tanh(v / u_s) / v.
        The slope of the law is not suitable: it vanishes in sliding, and large steps then
        oscillate about zero speed.
        """
        total: list[Any] = [0.0] * self.n
        for joint in (body.joint for body in self.equations.model.bodies):
            if self._tree.friction:
                ratio = friction_over_rate(joint, joint.multiplier * v[joint.coordinate])
                total[joint.coordinate] = total[joint.coordinate] + joint.multiplier**2 * ratio
        return np.array(total)

    def stage(self, q: Any, u: Any, tau: Any, before: tuple[Any, Any], g: Any, wrench: Any,
              parameters: Any, t: Any = 0.0, factors: Any = 1.0) -> tuple[Any, Any]:
        """
        Return the rates of the joints, (n_j,), and udot, (n,), of one stage of a step.

        Parameters
        ----------
        q, u, tau : arrays
            State and torque of the stage.
        before : two arrays
            Results of the first stage; zeros in the first. The sum of both stages is as in the
            reference, since this returns its second stage plus twice the first.
        g : scalar
            gamma times the step, s.
        wrench, parameters, t
            As in `equations.forward_dynamics`.
        factors : scalar or (n_j,) array
            Factors on the model's friction in the linearization.

        """
        v, found = self.held_stage(Held([], []), q, u, tau, before, g, wrench, parameters, t,
                                   factors)
        return v, found.w

    def held_stage(self, held: Held, q: Any, u: Any, tau: Any, before: tuple[Any, Any], g: Any,
                   wrench: Any, parameters: Any, t: Any = 0.0,
                   factors: Any = 1.0) -> tuple[Any, Solution]:
        """Return the results of `stage` while joints are held, with what holds them."""
        system = linear_system(self.equations, q, u, tau, wrench, parameters, t)
        T = np.eye(self.n) if system.T is None else system.T
        v = system.v
        K, k_v = self._K, before[0]
        # Each stage evaluates its own friction over speed; otherwise stopping joints reverse.
        D, turned = factors * self.resistance(v), T @ before[1]
        resisted = D * turned + self._C @ turned + K @ k_v
        force = (2.0 * g) * resisted - g * (K @ (v - (2.0 * g) * turned))
        A = np.diag(g * D) + _scaled(self._C, g) + _scaled(K, g * g)
        found = held_solution(system, system.M + congruent(A, T),
                              system.net + T.T @ force, held)
        return v + g * (self._sprung * (T @ found.w - 2.0 * turned)), found

    def step(self, stage: Stage, q: Any, u: Any, torque: Callable[[Any, Any, int], Any],
             h: Any) -> tuple[Any, Any]:
        """
        Return q and u after one step.

        Parameters
        ----------
        stage : callable
            ``stage(q, u, tau, before, g, moment)``: `ImplicitStep.stage` with the robot's
            wrenches, parameters and time; `moment` is 0 at the beginning of the step and 2 at
            its end.
        q, u : (n_q,), (n,) arrays
            The state.
        torque : callable
            ``torque(q, u, moment)``, (n,).
        h : scalar
            Step size, s.

        """
        model, g = self.equations.model, GAMMA * h
        none = np.zeros(self.n), np.zeros(self.equations.n)
        k_v, k_u = stage(q, u, torque(q, u, 0), none, g, 0)
        k_q = coordinate_rates(model, q, k_v)
        q_1, u_1 = q + h * k_q, u + h * k_u
        w_v, w_u = stage(q_1, u_1, torque(q_1, u_1, 2), (k_v, k_u), g, 2)
        w_q = coordinate_rates(model, q_1, w_v)
        return q + (0.5 * h) * (k_q + w_q), u + (0.5 * h) * (k_u + w_u)


class Rosenbrock:
    """The linearly implicit method of this module, behind the interface of all integrators."""

    name, damps = 'implicit', True

    def step(self, system: System, state: Any, h: Any) -> Any:
        """Return the state after one step of length h, s; quadratures by the trapezoidal rule."""
        equations = system.equations
        q, u, rest = np.split(state, [equations.n_q, equations.n_q + equations.n])
        q_1, u_1 = ImplicitStep(equations).step(system.implicit_stage, q, u, system.torque, h)
        if not len(rest):
            return np.concatenate([q_1, u_1])
        sums = rest + (0.5 * h) * (system.quadratures(q, u, 0) + system.quadratures(q_1, u_1, 2))
        return np.concatenate([q_1, u_1, sums])


def _scaled(A: Any, factor: Any) -> Any:
    """Return a constant matrix times a scalar; zero entries cause no arithmetic."""
    return np.array([[factor * x if x else 0.0 for x in row] for row in A.tolist()])
