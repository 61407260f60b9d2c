"""
Generalized forces by Hamilton's principle with variations of vectors.

With possible displacements p and rotations theta of every body, its momentum m v and angular
momentum H = I . omega, Hamilton's principle for arbitrary variations gives

    F* = sum over bodies of  var( 1/2 omega . I . omega ) - d/dt( H . theta )
                           + var( 1/2 m v . v )           - d/dt( m v . p )

All rates of the variations cancel. Kinetic energy is a scalar, so its variation does not depend on
the frame in which omega, I and v are varied. In the body's own frame I is constant.
Source: vector variations, Journal of Robotic Systems 5 (1988) 553.
"""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.mechanics.energy_form.admissible_motion import AdmissibleMotion
from kane_dynamics.mechanics.energy_form.finite_kinematics import PossibleMotion
from kane_dynamics.mechanics.energy_form.variation_rules import (absolute,
                                                                 angular_velocity_variation,
                                                                 relative, rotation_change)
from kane_dynamics.model.model import WORLD
import numpy as np


class HamiltonByVariations:
    """
    Generalized forces by variations of every body's vectors and dyadics.

    Parameters
    ----------
    turning : sequence of int, optional
        For each body, the index of the body (or WORLD) in whose frame its rotational energy is
        varied. Default: its own.
    translating : sequence of int, optional
        The same for its translational energy. Default: the world.

    """

    def __init__(self, turning: Sequence[int] | None = None,
                 translating: Sequence[int] | None = None) -> None:
        """Store the frames of the variations."""
        self.turning = turning
        self.translating = translating

    def inertia_force(self, motion: AdmissibleMotion, variations: Array) -> Array:
        """Return F*, (k,), for the columns of `variations`, (n_q, k)."""
        model, state = motion.state.model, motion.state
        if model.flexible:
            raise ModelError('variations of vectors: a model with a beam; expected rigid bodies')
        coms = [state.center_of_mass(k) for k in range(len(model.bodies))]
        possible = [com.along(variations) for com in coms]
        force = np.zeros(variations.shape[1])
        for k, (body, com) in enumerate(zip(model.bodies, coms)):
            R, joint = state.axes(k), body.joint
            frames = (k if self.turning is None else self.turning[k],
                      WORLD if self.translating is None else self.translating[k])
            turns = [np.zeros_like(possible[k].rotation) if frame == WORLD
                     else possible[frame].rotation for frame in frames]
            force = (force + turning_force(R @ body.inertial.inertia @ R.T, motion, com,
                                           possible[k], turns[0])
                     + body.inertial.mass * translating_force(motion, com, possible[k],
                                                              turns[1]))
            # With constant variations of the coordinates, the rotor's rate is not varied.
            rotor_momentum_rate = joint.armature * joint.multiplier * motion.qddot[
                joint.coordinate]
            force = force - rotor_momentum_rate * joint.multiplier * variations[joint.coordinate]
        return force

    def conservative_force(self, motion: AdmissibleMotion, variations: Array) -> Array:
        """Return the generalized active force of gravity and springs, (k,)."""
        model = motion.state.model
        force = np.zeros(variations.shape[1])
        for k, body in enumerate(model.bodies):
            com = motion.state.center_of_mass(k).along(variations)
            joint = body.joint
            stretch = joint.multiplier * motion.q[joint.coordinate] + joint.offset - joint.rest
            force = (force + com.displacement @ (body.inertial.mass * model.gravity)
                     - joint.stiffness * stretch * joint.multiplier
                     * variations[joint.coordinate])
        return force


def turning_force(inertia: Array, motion: AdmissibleMotion, com: PossibleMotion,
                  possible: PossibleMotion, turns: Array) -> Array:
    """
    Return the rotational term var( 1/2 omega . I . omega ) - d/dt( H . theta ), (k,).

    Parameters
    ----------
    inertia : (3, 3) array
        Central inertia dyadic I, world axes, kg m^2.
    motion : AdmissibleMotion
        Motion of the joints.
    com, possible : PossibleMotion
        Motion of the body for unit variations of the coordinates, and for the k variations.
    turns : (k, 3) array
        Possible rotation of the frame in which omega and I are varied.

    """
    omega = com.rotation.T @ motion.qdot
    alpha = com.rotation_rate.T @ motion.qdot + com.rotation.T @ motion.qddot
    momentum = inertia @ omega
    momentum_rate = absolute(np.zeros((3, 3)), omega, inertia) @ omega + inertia @ alpha
    force = []
    for theta, theta_rate, turn in zip(possible.rotation, possible.rotation_rate, turns):
        omega_variation = relative(angular_velocity_variation(theta_rate, theta, omega), turn,
                                   omega)
        inertia_variation = rotation_change(theta - turn, inertia)  # I is constant in the body
        energy_variation = momentum @ omega_variation + 0.5 * omega @ inertia_variation @ omega
        force.append(energy_variation - (momentum_rate @ theta + momentum @ theta_rate))
    return np.array(force)


def translating_force(motion: AdmissibleMotion, com: PossibleMotion, possible: PossibleMotion,
                      turns: Array) -> Array:
    """
    Return the translational term var( 1/2 v . v ) - d/dt( v . p ) per unit mass, (k,).

    In the world, the variation of a point's velocity is the rate of its displacement. Arguments
    as in `turning_force`.
    """
    v = com.displacement.T @ motion.qdot
    a = com.displacement_rate.T @ motion.qdot + com.displacement.T @ motion.qddot
    force = []
    for p, p_rate, turn in zip(possible.displacement, possible.displacement_rate, turns):
        force.append(v @ relative(p_rate, turn, v) - (a @ p + v @ p_rate))
    return np.array(force)
