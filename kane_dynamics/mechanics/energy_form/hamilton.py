"""
The energy road by variations of vectors: Hamilton's principle, each term in a frame of choice.

With possible displacements p and rotations theta of every body, and its momentum m v and angular
momentum H = I . omega, Hamilton's principle for variations that are otherwise arbitrary says

    F* = sum over bodies of  var( 1/2 omega . I . omega ) - d/dt( H . theta )
                           + var( 1/2 m v . v )           - d/dt( m v . p )

in which all rates of the variations cancel. A kinetic energy is a scalar, so in whichever frame
omega and I, or v, are varied, its variation is the same; in the body's own, I stands still.
Source: vector variations, Journal of Robotic Systems 5 (1988) 553.
"""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.mechanics.energy_form.admissible_motion import Admissible
from kane_dynamics.mechanics.energy_form.finite_kinematics import PossibleMotion
from kane_dynamics.mechanics.energy_form.variation_rules import (absolute,
                                                                 angular_velocity_variation,
                                                                 relative, turned)
from kane_dynamics.model.model import WORLD
import numpy as np


class HamiltonByVariations:
    """
    Variations of every body's vectors and dyadics.

    Parameters
    ----------
    turning : sequence of int, optional
        For each body, the number of the body (or WORLD) in whose frame its energy of rotation is
        varied; its own by default.
    translating : sequence of int, optional
        The same for its energy of translation; the world by default.

    """

    def __init__(self, turning: Sequence[int] | None = None,
                 translating: Sequence[int] | None = None) -> None:
        """Keep the frames."""
        self.turning = turning
        self.translating = translating

    def inertia_force(self, motion: Admissible, variations: Array) -> Array:
        """Return F*, (k,), for the columns of `variations`, (n_q, k)."""
        model, posture = motion.posture.model, motion.posture
        if model.flexible:
            raise ModelError('the variations of vectors here are of rigid bodies; a beam bends')
        centres = [posture.mass_centre(k) for k in range(len(model.bodies))]
        possible = [centre.along(variations) for centre in centres]
        force = np.zeros(variations.shape[1])
        for k, (body, centre) in enumerate(zip(model.bodies, centres)):
            R, joint = posture.axes(k), body.joint
            frames = (k if self.turning is None else self.turning[k],
                      WORLD if self.translating is None else self.translating[k])
            turns = [np.zeros_like(possible[k].rotation) if frame == WORLD
                     else possible[frame].rotation for frame in frames]
            force = (force + turning_force(R @ body.inertial.inertia @ R.T, motion, centre,
                                           possible[k], turns[0])
                     + body.inertial.mass * translating_force(motion, centre, possible[k],
                                                              turns[1]))
            # The rotor's rate is not varied while variations of the coordinates are steady.
            rotor_momentum_rate = joint.armature * joint.multiplier * motion.qddot[
                joint.coordinate]
            force = force - rotor_momentum_rate * joint.multiplier * variations[joint.coordinate]
        return force

    def conservative_force(self, motion: Admissible, variations: Array) -> Array:
        """Return the generalized active force, (k,): weights and springs under variation."""
        model = motion.posture.model
        force = np.zeros(variations.shape[1])
        for k, body in enumerate(model.bodies):
            centre = motion.posture.mass_centre(k).along(variations)
            joint = body.joint
            stretch = joint.multiplier * motion.q[joint.coordinate] + joint.offset - joint.rest
            force = (force + centre.displacement @ (body.inertial.mass * model.gravity)
                     - joint.stiffness * stretch * joint.multiplier
                     * variations[joint.coordinate])
        return force


def turning_force(inertia: Array, motion: Admissible, centre: PossibleMotion,
                  possible: PossibleMotion, turns: Array) -> Array:
    """
    Return var( 1/2 omega . I . omega ) - d/dt( H . theta ) of a body, (k,).

    Parameters
    ----------
    inertia : (3, 3) array
        Central inertia dyadic I, world axes, kg m^2.
    motion : Admissible
        Of the joints.
    centre, possible : PossibleMotion
        Of the body, for unit variations of the coordinates, and for the k variations.
    turns : (k, 3) array
        Possible rotation of the frame in which omega and I are varied.

    """
    omega = centre.rotation.T @ motion.qdot
    alpha = centre.rotation_rate.T @ motion.qdot + centre.rotation.T @ motion.qddot
    momentum = inertia @ omega
    momentum_rate = absolute(np.zeros((3, 3)), omega, inertia) @ omega + inertia @ alpha
    force = []
    for theta, theta_rate, turn in zip(possible.rotation, possible.rotation_rate, turns):
        omega_variation = relative(angular_velocity_variation(theta_rate, theta, omega), turn,
                                   omega)
        inertia_variation = turned(theta - turn, inertia)  # it stands still in the body
        energy_variation = momentum @ omega_variation + 0.5 * omega @ inertia_variation @ omega
        force.append(energy_variation - (momentum_rate @ theta + momentum @ theta_rate))
    return np.array(force)


def translating_force(motion: Admissible, centre: PossibleMotion, possible: PossibleMotion,
                      turns: Array) -> Array:
    """
    Return var( 1/2 v . v ) - d/dt( v . p ) of a mass centre, (k,); arguments as above.

    In the world, the variation of a point's velocity is the rate of its displacement.
    """
    v = centre.displacement.T @ motion.qdot
    a = centre.displacement_rate.T @ motion.qdot + centre.displacement.T @ motion.qddot
    force = []
    for p, p_rate, turn in zip(possible.displacement, possible.displacement_rate, turns):
        force.append(v @ relative(p_rate, turn, v) - (a @ p + v @ p_rate))
    return np.array(force)
