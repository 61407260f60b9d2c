"""
Linearly implicit integration (Rosenbrock) of friction, springs and bending.

Coulomb friction with a small onset speed, stiff springs and high modes of a beam
restrict explicit methods to small steps. Here each is linearized within a step and
solved together with the accelerations: with q' = T u + X, the mass matrix becomes M +
T^T (g D + g^2 K) T with the damping D and the stiffness K of the joints.

The method is the second-order Rosenbrock method of Verwer, Spee, Blom & Hundsdorfer
(SIAM J. Sci. Comput. 20 (1999), eq. 1.6). It is of second order for any linearization; a
better linearization allows larger steps. With linear friction and springs it is
unconditionally stable. T is constant in the linearization, and so are all other forces.
"""

from collections.abc import Callable
import math

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.ball_joints import coordinate_rates, joint_positions
from kane_dynamics.mechanics.constraints.mechanism import congruent
from kane_dynamics.mechanics.elastic_joints import (damping_slope, drive_matrix,
                                                    spring_slope)
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.friction import friction_over_rate, viscous_over_rate
from kane_dynamics.mechanics.integrators.held_joints import (
    Held, held_solution, linear_system, Solution)
from kane_dynamics.mechanics.integrators.interface import System
import numpy as np

GAMMA = 1.0 - math.sqrt(0.5)  # the smaller of the two values for L-stability
Pair = tuple[Vector, Vector]  # rates of the joints, (n_j,), and udot, (n,)
Stage = Callable[[Vector, Vector, Vector, Pair, Scalar, int], Pair]


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
        self.n = self._tree.n
        self._K, self._C = np.zeros((2, self.n, self.n))
        for body in equations.model.bodies:
            joint = body.joint
            spring = joint.multiplier**2 * joint.stiffness
            self._K[joint.coordinate, joint.coordinate] += spring
            if body.beam is not None:
                block = np.ix_(body.beam.coordinates, body.beam.coordinates)
                self._K[block] += body.beam.stiffness
                if self._tree.friction:
                    self._C[block] += body.beam.damping
        if self._tree.friction:
            self._C += drive_matrix(equations.model, damping_slope).astype(float)

        # Joints whose rates are implicit. Those of a loop remain compatible: all, or
        # none.
        sprung = np.array([column.any() for column in self._K.T], dtype=bool)
        for elastic in equations.model.drives:
            sprung[[elastic.link, elastic.motor]] = True
        if not equations.in_joint_rates:
            sprung = np.full(self.n, sprung.any())
        self._sprung = sprung.astype(float)

    def _stiffness(self, q: Vector) -> Matrix:
        """Return the stiffness of springs, beams and drives at q, (n_j, n_j)."""
        model = self.equations.model
        if not model.drives:
            return self._K
        return self._K + drive_matrix(model, spring_slope, joint_positions(model, q))

    def resistance(self, v: Vector, loads: Vector | None = None, *,
                   viscous: bool = False) -> Vector:
        """
        Return the friction of the joints divided by speed, (n_j,), N m s or N s/m.

        For Coulomb friction that is mu / sqrt(v^2 + u_s^2), within 8 % of mu tanh(v /
        u_s) / v. The slope of the law is not suitable: it vanishes in sliding, and large
        steps then oscillate about zero speed. `loads`, (n_j,), are those of the drives;
        `viscous` leaves out what depends on the direction of sliding.
        """
        total: list[Scalar] = [0.0] * self.n
        if not self._tree.friction:
            return np.array(total)
        for body in self.equations.model.bodies:
            joint = body.joint
            r = joint.coordinate
            load = 0.0 if loads is None else loads[r]
            rate = joint.multiplier * v[r]
            if viscous:
                ratio = viscous_over_rate(joint, rate)
            else:
                ratio = friction_over_rate(joint, rate, load)
            total[r] = total[r] + joint.multiplier**2 * ratio
        return np.array(total)

    def stage(self, q: Vector, u: Vector, tau: Vector, first: Pair, g: Scalar,
              wrench: Matrix | None, parameters: Vector, t: Scalar = 0.0,
              factors: Vector | float = 1.0) -> Pair:
        """
        Return the rates of the joints, (n_j,), and udot, (n,), of one stage of a step.

        Parameters
        ----------
        q, u, tau : arrays
            State and torque of the stage.
        first : two arrays
            Results of the first stage; zeros in the first. The sum of both stages is as
            in the reference, since this returns its second stage plus twice the first.
        g : scalar
            gamma times the step, s.
        wrench, parameters, t
            As in `equations.forward_dynamics`.
        factors : scalar or (n_j,) array
            Factors on the model's friction in the linearization.

        """
        v, solution = self.held_stage(Held([], []), q, u, tau, first, g, wrench,
                                      parameters, t, factors)
        return v, solution.w

    def held_stage(self, held: Held, q: Vector, u: Vector, tau: Vector, first: Pair,
                   g: Scalar, wrench: Matrix | None, parameters: Vector, t: Scalar = 0.0,
                   factors: Vector | float = 1.0,
                   directions: Vector | None = None) -> tuple[Vector, Solution]:
        """
        Return the results of `stage` while joints are held, with what holds them.

        With `directions` of sliding, (n_j,), Coulomb friction is constant in the stage.
        """
        system = linear_system(self.equations, q, u, tau, wrench, parameters, t,
                               directions)
        T = system.T
        if T is None:
            T = np.eye(self.n)
        v = system.v
        first_v, first_udot = first
        K = self._stiffness(q)

        # Each stage evaluates its own friction over speed; otherwise stopping joints
        # reverse.
        loads = None
        if self.equations.carries_loads and directions is None:
            torques = self.equations.drive_torques(q, tau, t)
            loads = self._tree.drive_loads(v, torques)
        D = factors * self.resistance(v, loads, viscous=directions is not None)

        # Forces of dampers and springs that the first stage's results change.
        first_qddot = T @ first_udot
        resisted = D * first_qddot + self._C @ first_qddot + K @ first_v
        force = (2.0 * g) * resisted - g * (K @ (v - (2.0 * g) * first_qddot))

        # (M + T^T (g D + g^2 K) T) w = net + T^T force.
        A = np.diag(g * D) + _scaled(self._C, g) + _scaled(K, g * g)
        solution = held_solution(system, system.M + congruent(A, T),
                                 system.net + T.T @ force, held)

        # Only rates of joints with springs are implicit.
        change = T @ solution.w - 2.0 * first_qddot
        return v + g * (self._sprung * change), solution

    def step(self, stage: Stage, q: Vector, u: Vector,
             torque: Callable[[Vector, Vector, int], Vector],
             h: Scalar) -> tuple[Vector, Vector]:
        """
        Return q and u after one step.

        Parameters
        ----------
        stage : callable
            ``stage(q, u, tau, first, g, moment)``: `ImplicitStep.stage` with the robot's
            wrenches, parameters and time; `moment` is 0 at the beginning of the step and
            2 at its end.
        q, u : (n_q,), (n,) arrays
            The state.
        torque : callable
            ``torque(q, u, moment)``, (n,).
        h : scalar
            Step size, s.

        """
        model = self.equations.model
        g = GAMMA * h

        # First stage, at the step's beginning.
        zeros = np.zeros(self.n), np.zeros(self.equations.n)
        k_v, k_u = stage(q, u, torque(q, u, 0), zeros, g, 0)
        k_q = coordinate_rates(model, q, k_v)

        # Second stage, at the end of an Euler step with the first; then their mean.
        q_1 = q + h * k_q
        u_1 = u + h * k_u
        w_v, w_u = stage(q_1, u_1, torque(q_1, u_1, 2), (k_v, k_u), g, 2)
        w_q = coordinate_rates(model, q_1, w_v)
        return q + (0.5 * h) * (k_q + w_q), u + (0.5 * h) * (k_u + w_u)


class Rosenbrock:
    """The linearly implicit method, behind the interface of all integrators."""

    name = 'implicit'
    damps = True

    def step(self, system: System, state: Vector, h: Scalar) -> Vector:
        """Return the state after a step of h, s; quadratures by the trapezoidal rule."""
        equations = system.equations
        ends = [equations.n_q, equations.n_q + equations.n]
        q, u, quadratures = np.split(state, ends)
        implicit = ImplicitStep(equations)
        q_1, u_1 = implicit.step(system.implicit_stage, q, u, system.torque, h)
        if not len(quadratures):
            return np.concatenate([q_1, u_1])
        rates = system.quadratures(q, u, 0) + system.quadratures(q_1, u_1, 2)
        return np.concatenate([q_1, u_1, quadratures + (0.5 * h) * rates])


def _scaled(A: Matrix, factor: Scalar) -> Matrix:
    """Return a matrix times a scalar; zero entries cause no arithmetic."""
    rows = []
    for row in A.tolist():
        rows.append([0.0 if is_zero(x) else factor * x for x in row])
    return np.array(rows)
