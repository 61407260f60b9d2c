"""
Reference formulation of a flexible beam: Kane's sums as volume integrals, by quadrature.

The reference for `recursive`, which uses precomputed integrals. A point of the beam at rho from
the body's origin has the partial velocities and the acceleration

    v^r = v_O^r + omega^r x rho + d rho / d eta_r
    a   = a_O + alpha x rho + omega x (omega x rho) + 2 omega x rho' + rho''

with ' in the axes of the body. The integral of v^r . a is exact for these points. That of the
straight beam, a rigid body, is subtracted here. World axes, any scalar type. Source: Kane, Ryan &
Banerjee, JGCD 10 (1987).

A twisting section is a round disc. Its partial angular velocities are those of the beam plus
psi e, and its -F_r* is w^r . (J alpha + w x J w), minus that of the disc of the straight beam.
"""

from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross, skew
from kane_dynamics.mechanics.definition.kinematics import BodyMotion, Configuration
from kane_dynamics.model.beam import Beam
import numpy as np


class BeamPoints:
    """Points of a bent beam, and of the straight one: positions and partial velocities."""

    def __init__(self, beam: Beam, here: Configuration, q: Any) -> None:
        """Evaluate the points at the body's configuration and the coordinates q, (n,)."""
        self.beam, R = beam, here.R_wb
        eta = q[list(beam.coordinates)]
        unit = np.eye(len(q))[list(beam.coordinates)]
        self.straight = beam.points @ R.T  # (g, 3)
        self.bent = self.straight + sum(beam.displacement(eta)) @ R.T
        self.axis = R @ beam.direction
        self.modal = []  # d rho / d eta of each point, (m, 3)
        self.partials = []  # v^r of each point of the bent and of the straight beam, (n, 3)
        for g in range(len(beam.weights)):
            modal = (beam.shapes[g] @ R.T
                     + np.multiply.outer(-(beam.shortening[g] @ eta), self.axis))
            carried = [here.partial_velocity_origin + here.partial_angular_velocity @ skew(place)
                       for place in (self.bent[g], self.straight[g])]
            self.modal.append(modal)
            self.partials.append((carried[0] + unit.T @ modal, carried[1]))

    def total(self, vectors: Any) -> Any:
        """
        Return the integral of v^r . a over the bent beam minus that over the straight one.

        `vectors(g)` returns a of point g of the two.
        """
        result: Any = 0.0
        for g, dm in enumerate(self.beam.weights):
            (v, v_straight), (a, a_straight) = self.partials[g], vectors(g)
            result = result + dm * (v @ a - v_straight @ a_straight)
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

    def carried(place: Any) -> Any:
        return motion.a + cross(motion.alpha, place) + cross(omega, cross(omega, place))

    def accelerations(g: int) -> tuple[Any, Any]:
        modal = points.modal[g]
        curved = speed @ beam.shortening[g] @ speed
        bending = 2.0 * cross(omega, speed @ modal) + gain @ modal - curved * points.axis
        return carried(points.bent[g]) + bending, carried(points.straight[g])
    return -points.total(accelerations) - Twist(beam, here, len(q)).torques(
        motion, (u, udot))


def mass_matrix(beam: Beam, here: Configuration, q: Any) -> Any:
    """Return the contribution of bending to the mass matrix, (n, n)."""
    points = BeamPoints(beam, here, q)
    return (points.total(lambda g: tuple(v.T for v in points.partials[g]))
            + Twist(beam, here, len(q)).inertia())


def weight(beam: Beam, here: Configuration, q: Any, gravity: Any) -> Any:
    """Return the contribution of bending to the generalized force of gravity, (n,)."""
    return BeamPoints(beam, here, q).total(lambda g: (gravity, gravity))


def modal_force(beam: Beam, q: Any, u: Any, friction: bool) -> Any:
    """Return the generalized force of elasticity and material damping, (n,)."""
    modes = list(beam.coordinates)
    force = beam.stiffness @ q[modes]
    if friction:
        force = force + beam.damping @ u[modes]
    return -(force @ np.eye(len(q))[modes])
