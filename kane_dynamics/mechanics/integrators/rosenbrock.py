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

Joints with bristles have deflections z beside q and u. With a = `bristle_decay`, b =
`bristle_slope`, the stiffness s and the damping s_d of the bristles, each stage solves

    (1 + g a) z' = v - a z + g b v',    F = ... + s z + s_d z'

for z', which adds b (s_d + g s) / (1 + g a) to the damping of the joint.
"""

from collections.abc import Callable
import math
from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.ball_joints import coordinate_rates, joint_positions
from kane_dynamics.mechanics.constraints.mechanism import congruent
from kane_dynamics.mechanics.elastic_joints import (damping_slope, drive_matrix,
                                                    spring_slope)
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.mechanics.friction import (bristle_decay, bristle_rate, bristle_slope,
                                              friction_over_rate, has_bristles,
                                              viscous_over_rate)
from kane_dynamics.mechanics.integrators.held_joints import (
    held_solution, linear_system, Solution, Solver)
from kane_dynamics.mechanics.integrators.interface import StageRates, System
import numpy as np

GAMMA = 1.0 - math.sqrt(0.5)  # the smaller of the two values for L-stability
Stage = Callable[[Vector, Vector, Vector, StageRates, Scalar, int, Vector], StageRates]


class BristleStage(NamedTuple):
    """
    The linearized bristles of n_b joints in one stage.

    Attributes
    ----------
    damping, force : (n_j,) arrays
        What they add to the damping of the joints and to the forces on them.
    rates, slopes : (n_b,) arrays
        The rates of the deflections are rates + slopes times the change of the rates of
        the joints.

    """

    damping: Vector
    force: Vector
    rates: Vector
    slopes: Vector


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

        # Joints whose rates are implicit.
        # Those of a loop remain compatible: all, or none.
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
                   viscous: bool = False, presliding: bool = False) -> Vector:
        """
        Return the friction of the joints divided by speed, (n_j,), N m s or N s/m.

        For Coulomb friction that is mu / sqrt(v^2 + u_s^2), within 8 % of mu tanh(v /
        u_s) / v. The slope of the law is not suitable: it vanishes in sliding, and large
        steps then oscillate about zero speed. `loads`, (n_j,), are those of the drives;
        `viscous` leaves out what depends on the direction of sliding, `presliding` does
        so for joints with bristles.
        """
        total: list[Scalar] = [0.0] * self.n
        if not self._tree.friction:
            return np.array(total)
        for body in self.equations.model.bodies:
            joint = body.joint
            r = joint.coordinate
            load = 0.0 if loads is None else loads[r]
            rate = joint.multiplier * v[r]
            # Bristles carry Coulomb friction by themselves, so that only viscous
            # friction is left.
            if viscous or (presliding and has_bristles(joint)):
                ratio = viscous_over_rate(joint, rate)
            else:
                ratio = friction_over_rate(joint, rate, load)
            total[r] = total[r] + joint.multiplier**2 * ratio
        return np.array(total)

    def _bristled(self, v: Vector, loads: Vector | None, deflections: Vector,
                  first: StageRates, first_qddot: Vector, g: Scalar) -> BristleStage:
        """Return the linearized bristles at joint rates v, (n_j,), with these deflections."""
        damping: list[Scalar] = [0.0] * self.n
        force: list[Scalar] = [0.0] * self.n
        rates, slopes = [], []
        for joint, z, first_rate in zip(self._tree.bristles, deflections,
                                        first.deflections):
            r, m = joint.coordinate, joint.multiplier
            # The law of the bristle at the trial rate, by its exact slopes.
            load = 0.0 if loads is None else loads[r]
            rate = m * v[r]
            decay = bristle_decay(joint, rate, load)
            slope = bristle_slope(joint, rate, z, load)
            z_rate = bristle_rate(joint, rate, z, load)
            # The implicit stage solves z' for its own change:
            # the factor 1 / (1 + g decay).
            stiffness, s_d = joint.presliding_stiffness, joint.presliding_damping
            implicit = 1.0 / (1.0 + g * decay)
            damping[r] = damping[r] + m * m * slope * (s_d + g * stiffness) * implicit

            # Where the deflection returns by itself, its force does too.
            by_z = stiffness - s_d * decay
            returning = g * by_z * (2.0 * first_rate - z_rate) * implicit
            force[r] = force[r] + m * returning
            # z' of the stage is linear in the rates: its value at v, and its slope.
            change = g * slope * m
            rates.append((z_rate + 2.0 * g * decay * first_rate
                          - 2.0 * change * first_qddot[r]) * implicit)
            slopes.append(change * implicit)
        return BristleStage(np.array(damping), np.array(force), np.array(rates),
                            np.array(slopes))

    def stage(self, q: Vector, u: Vector, tau: Vector, first: StageRates, g: Scalar,
              wrench: Matrix | None, parameters: Vector, t: Scalar = 0.0,
              factors: Vector | float = 1.0,
              deflections: Vector | None = None) -> StageRates:
        """
        Return the rates of one stage of a step.

        Parameters
        ----------
        q, u, tau : arrays
            State and torque of the stage.
        first : StageRates
            Results of the first stage; zeros in the first. The sum of both stages is as
            in the reference, since this returns its second stage plus twice the first.
        g : scalar
            gamma times the step, s.
        wrench, parameters, t
            As in `equations.forward_dynamics`.
        factors : scalar or (n_j,) array
            Factors on the model's friction in the linearization.
        deflections : (n_b,) array, optional
            Of bristles; None for the law without presliding.

        """
        rates, _ = self.held_stage(None, q, u, tau, first, g, wrench, parameters,
                                   t, factors, deflections=deflections)
        return rates

    def held_stage(self, held: Solver | None, q: Vector, u: Vector, tau: Vector,
                   first: StageRates,
                   g: Scalar, wrench: Matrix | None, parameters: Vector, t: Scalar = 0.0,
                   factors: Vector | float = 1.0, directions: Vector | None = None,
                   deflections: Vector | None = None) -> tuple[StageRates, Solution]:
        """
        Return the results of `stage` while joints are held, with what holds them.

        With `directions` of sliding, (n_j,), Coulomb friction is constant in the stage.
        """
        system = linear_system(self.equations, q, u, tau, wrench, parameters, t,
                               directions, deflections)
        T = system.T
        if T is None:
            T = np.eye(self.n)
        v = system.v
        first_v, first_udot, _ = first
        K = self._stiffness(q)

        # Each stage evaluates its own friction over speed;
        # otherwise stopping joints reverse.
        loads = None
        if self.equations.carries_loads and directions is None:
            torques = self.equations.drive_torques(q, tau, t)
            unloaded = self._tree.drive_loads(v, torques, None, None, deflections)
            loads = self._tree.transmitted(v, unloaded)
        D = factors * self.resistance(v, loads, viscous=directions is not None,
                                      presliding=deflections is not None)
        first_qddot = T @ first_udot
        bristles: BristleStage | None = None
        if deflections is not None:
            bristles = self._bristled(v, loads, deflections, first, first_qddot, g)
            D = D + bristles.damping

        # Forces of dampers and springs that the first stage's results change.
        resisted = D * first_qddot + self._C @ first_qddot + K @ first_v
        force = (2.0 * g) * resisted - g * (K @ (v - (2.0 * g) * first_qddot))
        if bristles is not None:
            force = force + bristles.force

        # (M + T^T (g D + g^2 K) T) w = net + T^T force.
        A = np.diag(g * D) + _scaled(self._C, g) + _scaled(K, g * g)
        solution = held_solution(system, system.M + congruent(A, T),
                                 system.net + T.T @ force, held)

        # Only rates of joints with springs are implicit.
        qddot = T @ solution.w
        change = qddot - 2.0 * first_qddot
        deflection_rates: Vector = ()
        if bristles is not None:
            of_bristles = [joint.coordinate for joint in self._tree.bristles]
            deflection_rates = bristles.rates + bristles.slopes * qddot[of_bristles]
        rates = StageRates(v + g * (self._sprung * change), solution.w, deflection_rates)
        return rates, solution

    def step(self, stage: Stage, q: Vector, u: Vector,
             torque: Callable[[Vector, Vector, int], Vector],
             h: Scalar, deflections: Vector) -> tuple[Vector, Vector, Vector]:
        """
        Return q, u and the deflections after one step.

        Parameters
        ----------
        stage : callable
            ``stage(q, u, tau, first, g, moment, deflections)``: `ImplicitStep.stage`
            with the robot's wrenches, parameters and time; `moment` is 0 at the beginning
            of the step and 2 at its end.
        q, u : (n_q,), (n,) arrays
            The state.
        torque : callable
            ``torque(q, u, moment)``, (n,).
        h : scalar
            Step size, s.
        deflections : (n_b,) array
            Of bristles; may be empty.

        """
        model = self.equations.model
        g = GAMMA * h

        # First stage, at the step's beginning.
        z = deflections
        zeros = StageRates(np.zeros(self.n), np.zeros(self.equations.n), np.zeros(len(z)))
        first = stage(q, u, torque(q, u, 0), zeros, g, 0, z)
        k_q = coordinate_rates(model, q, first.joints)

        # Second stage, at the end of an Euler step with the first; then their mean.
        q_1 = q + h * k_q
        u_1 = u + h * first.udot
        z_1 = z + h * np.array(first.deflections)
        second = stage(q_1, u_1, torque(q_1, u_1, 2), first, g, 2, z_1)
        w_q = coordinate_rates(model, q_1, second.joints)
        z_rates = np.array(first.deflections) + np.array(second.deflections)
        return (q + (0.5 * h) * (k_q + w_q),
                u + (0.5 * h) * (first.udot + second.udot),
                z + (0.5 * h) * z_rates)


class Rosenbrock:
    """The linearly implicit method, behind the interface of all integrators."""

    name = 'implicit'
    damps = True

    def step(self, system: System, state: Vector, h: Scalar) -> Vector:
        """Return the state after a step of h, s; quadratures by the trapezoidal rule."""
        equations = system.equations
        # The state is q, u, the time where it counts, bristles, then quadratures.
        timed = len(equations.time_inputs('t'))
        ends = np.cumsum([equations.n_q, equations.n, timed, system.bristles])
        q, u, time, z, others = np.split(state, ends)
        implicit = ImplicitStep(equations)
        q_1, u_1, z_1 = implicit.step(system.implicit_stage, q, u, system.torque, h, z)
        integrated = np.concatenate([time, others])
        quadratures = _integrated(system, (q, u), (q_1, u_1), integrated, h)
        return np.concatenate([q_1, u_1, quadratures[:timed], z_1, quadratures[timed:]])


def _integrated(system: System, before: tuple[Vector, Vector], after: tuple[Vector, Vector],
                values: Vector, h: Scalar) -> Vector:
    """Return the quadratures after a step, by the trapezoidal rule."""
    if not len(values):
        return values
    rates = system.quadratures(*before, 0) + system.quadratures(*after, 2)
    return values + (0.5 * h) * rates


def _scaled(A: Matrix, factor: Scalar) -> Matrix:
    """Return a matrix times a scalar; zero entries cause no arithmetic."""
    rows = []
    for row in A.tolist():
        scaled = []
        for x in row:
            scaled.append(x if is_zero(x) else factor * x)
        rows.append(scaled)
    return np.array(rows)
