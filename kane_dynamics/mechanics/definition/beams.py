"""
Reference formulation of a flexible beam: Kane's sums as volume integrals, by quadrature.

The reference for `recursive`, which uses precomputed integrals. A point of the beam at
rho from the body's origin has the partial velocities and the acceleration

    v^r = v_O^r + omega^r x rho + d rho / d eta_r
    a   = a_O + alpha x rho + omega x (omega x rho) + 2 omega x rho' + rho''

with ' in the axes of the body. The integral of v^r . a is exact for these points. That
of the straight beam, a rigid body, is subtracted here. World axes, any scalar type.
Source: Kane, Ryan & Banerjee, JGCD 10 (1987).

A twisting section is a round disc. Its partial angular velocities are those of the beam
plus psi e, and its -F_r* is w^r . (J alpha + w x J w), minus that of the disc of the
straight beam.
"""

from collections.abc import Callable

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.vector import cross, skew
from kane_dynamics.mechanics.definition.kinematics import BodyMotion, Configuration
from kane_dynamics.model.beam import Beam
import numpy as np


class BeamPoints:
    """Points of a bent and of the straight beam: positions and partial velocities."""

    def __init__(self, beam: Beam, configuration: Configuration, q: Vector) -> None:
        """Evaluate the points in the body's configuration; q are the n coordinates."""
        self.beam = beam
        R = configuration.R_wb
        modes = list(beam.coordinates)
        eta = q[modes]
        unit = np.eye(len(q))[modes]
        self.axis = R @ beam.direction

        # Positions of the points from the body's origin, (g, 3).
        self.straight = beam.points @ R.T
        self.bent = self.straight + sum(beam.displacement(eta)) @ R.T

        # d rho / d eta of each point, (m, 3): its mode shape, and the beam's shortening.
        self.modal = []
        for shape, shortening in zip(beam.shapes, beam.shortening):
            axial = np.multiply.outer(-(shortening @ eta), self.axis)
            self.modal.append(shape @ R.T + axial)

        # v^r of each point of the bent and of the straight beam, (n, 3) each.
        v = configuration.partial_velocity_origin
        omega = configuration.partial_angular_velocity
        self.partials = []
        for bent, straight, modal in zip(self.bent, self.straight, self.modal):
            v_bent = v + omega @ skew(bent) + unit.T @ modal
            v_straight = v + omega @ skew(straight)
            self.partials.append((v_bent, v_straight))

    def total(self, vectors: Callable[[int], tuple[Matrix, Matrix]]) -> Matrix:
        """
        Return the integral of v^r . a over the bent minus that over the straight beam.

        `vectors(g)` returns a of point g of the two.
        """
        # Quadrature: the sum of v^r . a dm over the points. The rigid body already has
        # the part of the straight beam.
        result: Scalar = 0.0
        for g, dm in enumerate(self.beam.weights):
            v, v_straight = self.partials[g]
            a, a_straight = vectors(g)
            result = result + dm * (v @ a - v_straight @ a_straight)
        return result


class Twist:
    """Sections of a beam as discs that rotate about its axis (torsion)."""

    def __init__(self, beam: Beam, configuration: Configuration, n: int) -> None:
        """Evaluate the sections in the body's configuration; n coordinates."""
        self.e = configuration.R_wb @ beam.direction
        self.omega_partials = configuration.partial_angular_velocity
        shapes = beam.twists @ np.eye(n)[list(beam.coordinates)]  # (g, n)
        self.discs = []
        for spin_inertia, psi in zip(beam.spins, shapes):
            if psi.any():
                self.discs.append((spin_inertia, psi))

    def _moment(self, spin_inertia: float, omega: Vector) -> Vector:
        """Return the angular momentum J omega of a disc."""
        # A round disc has half of its polar moment about each diameter:
        # J = spin / 2 (1 + e e^T).
        return 0.5 * spin_inertia * (omega + (omega @ self.e) * self.e)

    def _disc_torque(self, spin_inertia: float, omega: Vector, alpha: Vector) -> Vector:
        """Return J alpha + omega x J omega of a disc."""
        gyroscopic = cross(omega, self._moment(spin_inertia, omega))
        return self._moment(spin_inertia, alpha) + gyroscopic

    def torques(self, motion: BodyMotion, u: Vector, udot: Vector) -> Vector:
        """Return the contribution of torsion to -F_r*, (n,)."""
        result: Vector = np.zeros(len(self.omega_partials))
        for spin_inertia, psi in self.discs:
            # The section turns relative to the body,
            # about an axis that the body carries along.
            twist_rate = (psi @ u) * self.e
            twist_acceleration = (psi @ udot) * self.e
            omega = motion.omega + twist_rate
            alpha = motion.alpha + twist_acceleration + cross(motion.omega, twist_rate)

            partials = self.omega_partials + np.multiply.outer(psi, self.e)
            twisted = self._disc_torque(spin_inertia, omega, alpha)
            straight = self._disc_torque(spin_inertia, motion.omega, motion.alpha)
            result = result + partials @ twisted - self.omega_partials @ straight
        return result

    def inertia(self) -> Matrix:
        """Return the contribution of torsion to the mass matrix, (n, n)."""
        n = len(self.omega_partials)
        result: Matrix = np.zeros((n, n))
        for spin_inertia, psi in self.discs:
            # The disc of the twisted section in place of the straight beam's.
            twisted = self.omega_partials + np.multiply.outer(psi, self.e)
            result = result + self._disc_inertia(spin_inertia, twisted)
            result = result + self._disc_inertia(-spin_inertia, self.omega_partials)
        return result

    def _disc_inertia(self, spin_inertia: float, partials: Matrix) -> Matrix:
        """Return w^r . J w^s of a disc, (n, n), from its partial angular velocities."""
        moments = np.array([self._moment(spin_inertia, omega) for omega in partials])
        return partials @ moments.T


def inertia_force(beam: Beam, configuration: Configuration, motion: BodyMotion,
                  q: Vector, u: Vector, udot: Vector) -> Vector:
    """Return the contribution of bending and torsion to F_r*, (n,), N m or N."""
    points = BeamPoints(beam, configuration, q)
    modes = list(beam.coordinates)
    eta_rate = u[modes]
    eta_acceleration = udot[modes]
    omega = motion.omega

    def rigid_acceleration(place: Vector) -> Vector:
        """Return a_O + alpha x rho + omega x (omega x rho)."""
        centripetal = cross(omega, cross(omega, place))
        return motion.a + cross(motion.alpha, place) + centripetal

    def accelerations(g: int) -> tuple[Vector, Vector]:
        """Return the acceleration of point g of the bent and of the straight beam."""
        modal = points.modal[g]
        # rho'' has the rate of d rho / d eta, since the shortening is of second order.
        shortening = eta_rate @ beam.shortening[g] @ eta_rate
        relative = eta_acceleration @ modal - shortening * points.axis
        coriolis = 2.0 * cross(omega, eta_rate @ modal)
        bent = rigid_acceleration(points.bent[g]) + coriolis + relative
        return bent, rigid_acceleration(points.straight[g])

    # The twist of the sections is a motion about the beam's axis, not of its points.
    torsion = Twist(beam, configuration, len(q))
    return -points.total(accelerations) - torsion.torques(motion, u, udot)


def mass_matrix(beam: Beam, configuration: Configuration, q: Vector) -> Matrix:
    """Return the contribution of bending and torsion to the mass matrix, (n, n)."""
    points = BeamPoints(beam, configuration, q)

    def partial_velocities(g: int) -> tuple[Matrix, Matrix]:
        # M has v^r . v^s in place of v^r . a.
        bent, straight = points.partials[g]
        return bent.T, straight.T

    torsion = Twist(beam, configuration, len(q))
    return points.total(partial_velocities) + torsion.inertia()


def weight(beam: Beam, configuration: Configuration, q: Vector,
           gravity: Vector) -> Vector:
    """Return the contribution of bending to the generalized force of gravity, (n,)."""
    # Weight per unit of mass is the same vector at all points of both beams.
    return BeamPoints(beam, configuration, q).total(lambda g: (gravity, gravity))


def modal_force(beam: Beam, q: Vector, u: Vector, friction: bool) -> Vector:
    """Return the generalized force of elasticity and material damping, (n,)."""
    modes = list(beam.coordinates)
    force = beam.stiffness @ q[modes]
    if friction:
        force = force + beam.damping @ u[modes]
    return -(force @ np.eye(len(q))[modes])
