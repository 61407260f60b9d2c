"""
Reference formulation of a flexible beam: Kane's sums as volume integrals, by quadrature.

The reference for `recursive`, which uses precomputed integrals. The position rho of a point from
the body's origin is expanded in powers of the modal coordinates and speeds, rho = rho_0 + rho_1 +
rho_2, and with it its partial velocities and acceleration:

    v_i^r = (v_O^r + omega^r x rho)_i + d rho_i / d eta_r,    a_j likewise,

The sum of v_i^r . a_j over i + j <= 2 corresponds to the kinetic energy to second order. The term
i = j = 0 is that of the straight beam, a rigid body, and is omitted here. World axes, any scalar
type. Source: Kane, Ryan & Banerjee, JGCD 10 (1987).

A twisting section is a round disc. Its partial angular velocities are those of the beam plus
psi e, and its -F_r* is w^r . (J alpha + w x J w), minus that of the disc of the straight beam.
"""

from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross, skew
from kane_dynamics.mechanics.definition.kinematics import BodyMotion, Configuration
from kane_dynamics.model.beam import Beam
import numpy as np


class BeamPoints:
    """Points of a beam: positions and partial velocities in powers of the modal coordinates."""

    def __init__(self, beam: Beam, here: Configuration, q: Any) -> None:
        """Evaluate the points at the body's configuration and the coordinates q, (n,)."""
        self.beam, R = beam, here.R_wb
        eta = q[list(beam.coordinates)]
        unit = np.eye(len(q))[list(beam.coordinates)]
        bent, shorter = beam.displacement(eta)
        self.places = [points @ R.T for points in (beam.points, bent, shorter)]  # (g, 3) each
        across = [shapes @ R.T for shapes in beam.shapes]
        along = [np.multiply.outer(-(H @ eta), R @ beam.direction) for H in beam.shortening]
        self.modal = [across, along]  # d rho_1 / d eta, d rho_2 / d eta: (m, 3) per point
        self.partials = []  # v_0, v_1, v_2 of each point, (n, 3)
        for g in range(len(beam.weights)):
            v = [here.partial_angular_velocity @ skew(places[g])  # each row crossed with it
                 for places in self.places]
            self.partials.append([v[0] + here.partial_velocity_origin,
                                  v[1] + unit.T @ across[g], v[2] + unit.T @ along[g]])

    def total(self, vectors: Any) -> Any:
        """Return the integral of v_i^r . a_j; `vectors(g)` returns a_0, a_1, a_2 of point g."""
        result: Any = 0.0
        for g, dm in enumerate(self.beam.weights):
            v, a = self.partials[g], vectors(g)
            result = result + dm * (v[0] @ a[1] + v[1] @ a[0]
                                    + v[0] @ a[2] + v[1] @ a[1] + v[2] @ a[0])
        return result


class Twist:
    """Sections of a beam as discs that rotate about its axis (torsion)."""

    def __init__(self, beam: Beam, here: Configuration, n: int) -> None:
        """Evaluate the sections at the body's configuration; n is the number of coordinates."""
        self.e = here.R_wb @ beam.direction
        self.carried = here.partial_angular_velocity
        self.shapes = beam.twists @ np.eye(n)[list(beam.coordinates)]  # (g, n)
        self.discs = [(spin, psi) for spin, psi in zip(beam.spins, self.shapes) if psi.any()]

    def _moment(self, spin: float, w: Any) -> Any:
        """Return the angular momentum J w of a disc."""
        return 0.5 * spin * (w + (w @ self.e) * self.e)

    def torques(self, motion: BodyMotion, rates: tuple[Any, Any]) -> Any:
        """Return the contribution of torsion to -F_r*, (n,); `rates` are u and udot."""
        result: Any = np.zeros(len(self.carried))
        for spin, psi in self.discs:
            turn, gain = (psi @ x for x in rates)
            w = motion.omega + turn * self.e
            alpha = motion.alpha + gain * self.e + cross(motion.omega, turn * self.e)
            straight = self._moment(spin, motion.alpha) + cross(
                motion.omega, self._moment(spin, motion.omega))
            torque = self._moment(spin, alpha) + cross(w, self._moment(spin, w))
            partials = self.carried + np.multiply.outer(psi, self.e)
            result = result + partials @ torque - self.carried @ straight
        return result

    def inertia(self) -> Any:
        """Return the contribution of torsion to the mass matrix, (n, n)."""
        result: Any = np.zeros((len(self.carried), len(self.carried)))
        for spin, psi in self.discs:
            for partials, sign in ((self.carried + np.multiply.outer(psi, self.e), 1.0),
                                   (self.carried, -1.0)):
                turned = np.array([self._moment(sign * spin, w) for w in partials])
                result = result + partials @ turned.T
        return result


def inertia_force(beam: Beam, here: Configuration, motion: BodyMotion, q: Any, u: Any,
                  udot: Any) -> Any:
    """Return the contribution of bending to F_r*, (n,), N m or N."""
    points = BeamPoints(beam, here, q)
    speed, gain = (x[list(beam.coordinates)] for x in (u, udot))
    omega = motion.omega

    def accelerations(g: int) -> list[Any]:
        a = [cross(motion.alpha, places[g]) + cross(omega, cross(omega, places[g]))
             for places in points.places]
        a[0] = a[0] + motion.a
        for power in (1, 2):
            shapes = points.modal[power - 1][g]
            a[power] = a[power] + 2.0 * cross(omega, speed @ shapes) + gain @ shapes
        a[2] = a[2] - (speed @ beam.shortening[g] @ speed) * (here.R_wb @ beam.direction)
        return a
    return -points.total(accelerations) - Twist(beam, here, len(q)).torques(
        motion, (u, udot))


def mass_matrix(beam: Beam, here: Configuration, q: Any) -> Any:
    """Return the contribution of bending to the mass matrix, (n, n)."""
    points = BeamPoints(beam, here, q)
    return (points.total(lambda g: [v.T for v in points.partials[g]])
            + Twist(beam, here, len(q)).inertia())


def weight(beam: Beam, here: Configuration, q: Any, gravity: Any) -> Any:
    """Return the contribution of bending to the generalized force of gravity, (n,)."""
    none = np.zeros(3)
    return BeamPoints(beam, here, q).total(lambda g: [gravity, none, none])


def modal_force(beam: Beam, q: Any, u: Any, friction: bool) -> Any:
    """Return the generalized force of elasticity and material damping, (n,)."""
    modes = list(beam.coordinates)
    force = beam.stiffness @ q[modes]
    if friction:
        force = force + beam.damping @ u[modes]
    return -(force @ np.eye(len(q))[modes])
