"""
Semi-implicit Euler steps of robots with constraints, ball joints or beams.

With the joint rates v = T u + X of the independent speeds and the torques f of
actuators,

    M (u+ - u) / h + T^T (rigid(q, u) + resistance(v+)) = T_f^T f,    v+ = T u+ + X

all at the configuration q of the step's beginning, but for u+. The resistance is
friction, as in `implicit_friction`, and the change of the elastic forces of beams, whose
vibrations limit explicit steps: h K v+. Then q moves with v+ for h, along N until the
positions that constraints hold are closed, q+ = q + h v+ + N lambda, and quaternions get
the length 1. For a tree of rigid bodies with linear maps u = Y q' that is its step in
joint rates. Of first order.

All functions run over any scalar.
"""

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.ltdl import factorize, solve
from kane_dynamics.mechanics.ball_joints import (coordinate_rates, neutral,
                                                 on_unit_quaternions)
from kane_dynamics.mechanics.constraints.mechanism import congruent
from kane_dynamics.mechanics.elastic_joints import linear_drives
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.integrators.implicit_friction import (
    has_linearized_friction, Resistance, resisted_speed)
import numpy as np

# Of the closure, with N at its beginning: each reduces the residual by that distance.
ITERATIONS = 8


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
        Number of directions in which the configuration can change: the independent
        speeds, and those that constraints of velocities alone exclude.
    held : int
        Number of positions that constraints hold, the entries of lambda.

    """

    def __init__(self, equations: Equations, actuators: list[int]) -> None:
        """Find the constraint rows that hold positions."""
        self.equations = equations
        self.actuators = actuators
        mechanism = equations.mechanism
        model = equations.model

        # Rows of the system: those of the speeds, then those of the constraints, some of
        # which hold positions, others only velocities.
        residual = mechanism.rows(mechanism.state(neutral(model))).residual
        self._positions: list[int] = []  # constraint rows that hold positions
        self._closing: list[int] = []  # their rows in the system
        self._moving = list(range(mechanism.n))  # all other rows of the system
        for place, row in enumerate(mechanism.kept, mechanism.n):
            if residual[row] is None:
                self._moving.append(place)
            else:
                self._positions.append(row)
                self._closing.append(place)
        self.directions = len(self._moving)
        self.held = len(self._positions)

        # Stiffness and damping of the beams, in the coordinates of the joints.
        self._K, self._C = np.zeros((2, model.n, model.n))
        for body in model.bodies:
            beam = body.beam
            if beam is not None:
                block = np.ix_(beam.coordinates, beam.coordinates)
                self._K[block] = beam.stiffness
                if equations.tree.friction:
                    self._C[block] = beam.damping
        stiffness, damping = linear_drives(model)
        self._K += stiffness
        if equations.tree.friction:
            self._C += damping

    def step(self, q: Vector, u: Vector, torques: Vector, t: Scalar, h: Scalar,
             parameters: Vector) -> tuple[Vector, Vector, Vector]:
        """
        Return q, u and lambda at t + h, s, after a step of length h.

        `torques`, (m,), are those of the actuators.
        """
        equations = self.equations
        tree = equations.tree

        # The terms of the equation at the step's beginning, projected by T.
        motion = equations.joint_motion(q, u, equations.zeros, t)
        T = motion.T
        X = equations.joint_speeds(q, equations.zeros, t)
        rigid = tree.rigid_dynamics(q, motion.qdot, motion.qddot, None, parameters)
        M = congruent(tree.mass_matrix(q, parameters), T)
        momentum = M @ u + h * (T[self.actuators].T @ torques - T.T @ rigid)

        # u+, with the resistance of v+ = T u+ + X.
        def force(w: Vector) -> Vector:
            return T.T @ self._resistance(T @ w + X, h)

        def slope(w: Vector) -> Matrix:
            friction = np.diag(tree.friction_slope(T @ w + X))
            return congruent(friction + self._C + _scaled(self._K, h), T)
        resistance = Resistance(force, slope, not has_linearized_friction(tree))
        order = list(range(equations.n))
        w = resisted_speed(M, momentum, u, h, order, resistance)

        # lambda, by iteration with N at its beginning.
        multipliers: Vector = np.zeros(self.held).astype(object)
        if self.held:
            for _ in range(ITERATIONS):
                end = self.moved(q, w, multipliers, t, h)
                multipliers = multipliers - self.residual(end, t + h)
        return self.moved(q, w, multipliers, t, h), w, multipliers

    def excess(self, q: Vector, u: Vector, torques: Vector, w: Vector, t: Scalar,
               h: Scalar, parameters: Vector) -> Vector:
        """Return the residual force of a step's equation, (n,): 0 where w is u+."""
        equations = self.equations
        # u' = (u+ - u) / h, the forces at the beginning, friction at the rates u+ of the
        # end.
        motion = equations.joint_motion(q, u, (1.0 / h) * (w - u), t)
        tree = equations.tree
        rigid = tree.rigid_dynamics(q, motion.qdot, motion.qddot, None, parameters)
        resistance = self._resistance(equations.joint_speeds(q, w, t), h)
        needed = motion.T.T @ (rigid + resistance)
        return needed - motion.T[self.actuators].T @ torques

    def moved(self, q: Vector, w: Vector, multipliers: Vector, t: Scalar,
              h: Scalar) -> Vector:
        """Return q+ for u+ = w and lambda, (n_q,)."""
        model = self.equations.model
        rates = self.equations.joint_speeds(q, w, t)
        end = on_unit_quaternions(model, q + h * coordinate_rates(model, q, rates))
        if not self.held:
            return end

        # Close the loops along N.
        N = self._inverse(end, t + h)[:, self._closing]
        closing_step = coordinate_rates(model, end, N @ multipliers)
        return on_unit_quaternions(model, end + closing_step)

    def residual(self, q: Vector, t: Scalar) -> Vector:
        """Return the residuals of the positions that constraints hold, m or rad."""
        mechanism = self.equations.mechanism
        rows = mechanism.rows(mechanism.state(q, t, self.equations.tree.geometry))
        return np.array([rows.residual[k] for k in self._positions], dtype=object)

    @property
    def residual_units(self) -> Vector:
        """Return the units of `residual`: 1 rad, or the length of the loop."""
        return self.equations.mechanism.closure_units[self._positions]

    def tangent(self, q: Vector, t: Scalar) -> Matrix:
        """Return joint speeds per unit of each direction, (n_j, n_p)."""
        return self._inverse(q, t)[:, self._moving]

    def along(self, q: Vector, t: Scalar) -> Matrix:
        """Return directions' shares of joint speeds, (n_p, n_j): `tangent` undone."""
        return self._system(q, t)[self._moving]

    def _system(self, q: Vector, t: Scalar) -> Matrix:
        """Return the matrix S of speeds and constraints: S v = (u, 0) but for X."""
        mechanism = self.equations.mechanism
        state = mechanism.state(q, t, self.equations.tree.geometry)
        S, _ = mechanism.system(state)
        return S

    def _inverse(self, q: Vector, t: Scalar) -> Matrix:
        S = self._system(q, t)
        return self.equations.mechanism.solved(S, np.eye(len(S)))

    def _resistance(self, v: Vector, h: Scalar) -> Vector:
        """Return friction and the change of the elastic forces of beams, (n_j,)."""
        return self.equations.tree.friction_force(v) + _scaled(self._K, h) @ v


def solved(M: Matrix, right: Matrix) -> Matrix:
    """Return M^-1 times a matrix, for a positive definite M."""
    order = list(range(len(M)))
    factors = factorize(M, order)
    return np.stack([solve(factors, order, column) for column in right.T], axis=1)


def _scaled(A: Array, factor: Scalar) -> Matrix:
    """Return a constant matrix times a scalar; zero entries cause no arithmetic."""
    result = np.zeros(A.shape, dtype=object)
    for place in zip(*np.nonzero(A)):
        result[place] = factor * float(A[place])
    return result
