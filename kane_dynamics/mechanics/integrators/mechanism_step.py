"""
Semi-implicit Euler steps of robots with chosen speeds, constraints, ball joints or beams.

With the joint rates v = T u + X of the independent speeds and the torques f of actuators,

    M (u+ - u) / h + T^T (rigid(q, u) + resistance(v+)) = T_f^T f,    v+ = T u+ + X

all at the configuration q of the step's beginning, but for u+. The resistance is friction, as in
`implicit_friction`, and the change of the elastic forces of beams, whose vibrations limit explicit
steps: h K v+. Then q moves with v+ for h, along N until the positions that constraints hold are
closed, q+ = q + h v+ + N lambda, and quaternions get the length 1. For a tree of rigid bodies
with linear maps u = Y q' that is its step in joint rates. Of first order.

All functions run over any scalar.
"""

from typing import Any

from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.ball_joints import coordinate_rates, neutral, on_unit_quaternions
from kane_dynamics.mechanics.constraints.mechanism import congruent
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.integrators.implicit_friction import (Resistance, resisted_speed,
                                                                   slides)
import numpy as np

ITERATIONS = 8  # of the closure, with N at its beginning: each reduces it by that distance


class MechanismStep:
    """
    Step of a robot in its independent speeds.

    Parameters
    ----------
    equations : Equations
        The equations of motion.
    actuators : sequence of m int
        Indices of the joints with actuators.

    Attributes
    ----------
    directions : int
        Number of directions in which the configuration can change: the independent speeds, and
        those that constraints of velocities alone exclude.
    held : int
        Number of positions that constraints hold, the entries of lambda.

    """

    def __init__(self, equations: Equations, actuators: list[int]) -> None:
        """Find the constraint rows that hold positions."""
        self.equations, self.actuators = equations, actuators
        mechanism, model = equations.mechanism, equations.model
        n, residual = mechanism.n, mechanism.rows(mechanism.state(neutral(model))).residual
        places = list(enumerate(mechanism.kept, n))
        self._positions = [row for _, row in places if residual[row] is not None]
        self._closing = [k for k, row in places if residual[row] is not None]
        self._moving = [*range(n), *(k for k, row in places if residual[row] is None)]
        self.directions, self.held = len(self._moving), len(self._positions)
        self._K, self._C = np.zeros((2, model.n, model.n))
        for beam in (body.beam for body in model.bodies if body.beam is not None):
            here = np.ix_(beam.coordinates, beam.coordinates)
            self._K[here] = beam.stiffness
            self._C[here] = beam.damping if equations.tree.friction else 0.0

    def step(self, q: Any, u: Any, torques: Any, t: Any, h: Any,
             parameters: Any) -> tuple[Any, Any, Any]:
        """Return q, u and lambda at t + h, s, after a step with torques of the actuators, (m,)."""
        equations, tree = self.equations, self.equations.tree
        motion = equations.joint_motion(q, u, equations.zeros, t)
        T, still = motion.T, equations.joint_speeds(q, equations.zeros, t)
        rigid = tree.rigid_dynamics(q, motion.qdot, motion.qddot, None, parameters)
        M = congruent(tree.mass_matrix(q, parameters), T)
        momentum = M @ u + h * (T[self.actuators].T @ torques - T.T @ rigid)

        def slope(w: Any) -> Any:
            along = np.diag(tree.friction_slope(T @ w + still)) + self._C + _scaled(self._K, h)
            return congruent(along, T)
        w = resisted_speed(M, momentum, u, h, list(range(equations.n)), Resistance(
            lambda w: T.T @ self._resistance(T @ w + still, h), slope, not slides(tree)))
        found: Any = np.zeros(self.held).astype(object)
        for _ in range(ITERATIONS if self.held else 0):
            found = found - self.residual(self.moved(q, w, found, t, h), t + h)
        return self.moved(q, w, found, t, h), w, found

    def excess(self, q: Any, u: Any, torques: Any, w: Any, t: Any, h: Any,
               parameters: Any) -> Any:
        """Return the force, (n,), that the equation of the step lacks: 0 where w is u+."""
        equations = self.equations
        motion = equations.joint_motion(q, u, (1.0 / h) * (w - u), t)
        force = (equations.tree.rigid_dynamics(q, motion.qdot, motion.qddot, None, parameters)
                 + self._resistance(equations.joint_speeds(q, w, t), h))
        return motion.T.T @ force - motion.T[self.actuators].T @ torques

    def moved(self, q: Any, w: Any, found: Any, t: Any, h: Any) -> Any:
        """Return q+ for u+ = w and lambda, (n_q,)."""
        model, rates = self.equations.model, self.equations.joint_speeds(q, w, t)
        end = on_unit_quaternions(model, q + h * coordinate_rates(model, q, rates))
        if not self.held:
            return end
        N = self._inverse(end, t + h)[:, self._closing]
        return on_unit_quaternions(model, end + coordinate_rates(model, end, N @ found))

    def residual(self, q: Any, t: Any) -> Any:
        """Return the residuals of the positions that constraints hold, m or rad."""
        mechanism = self.equations.mechanism
        rows = mechanism.rows(mechanism.state(q, t, self.equations.tree.geometry))
        return np.array([rows.residual[k] for k in self._positions], dtype=object)

    @property
    def residual_units(self) -> Any:
        """Return the unit of each entry of `residual`: 1 rad, or the mechanism's length."""
        return self.equations.mechanism.row_units[self._positions]

    def tangent(self, q: Any, t: Any) -> Any:
        """Return joint speeds per unit of each direction of the configuration, (n_j, n_p)."""
        return self._inverse(q, t)[:, self._moving]

    def along(self, q: Any, t: Any) -> Any:
        """Return the directions' shares of joint speeds, (n_p, n_j): `tangent` undone."""
        return self._system(q, t)[self._moving]

    def _system(self, q: Any, t: Any) -> Any:
        mechanism = self.equations.mechanism
        return mechanism.system(mechanism.state(q, t, self.equations.tree.geometry))[0]

    def _inverse(self, q: Any, t: Any) -> Any:
        S = self._system(q, t)
        return self.equations.mechanism.solved(S, np.eye(len(S)))

    def _resistance(self, v: Any, h: Any) -> Any:
        """Return friction and the change of the elastic forces of beams, (n_j,)."""
        return self.equations.tree.friction_force(v) + _scaled(self._K, h) @ v


def solved(M: Any, right: Any) -> Any:
    """Return M^-1 times a matrix, for a positive definite M."""
    order = list(range(len(M)))
    factors = factorize(M, order)
    return np.stack([solve(factors, order, column) for column in right.T], axis=1)


def _scaled(A: Any, factor: Any) -> Any:
    """Return a constant matrix times a scalar; zero entries cause no arithmetic."""
    return np.array([[factor * x if x else 0.0 for x in row] for row in A.tolist()], dtype=object)
