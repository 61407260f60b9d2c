"""
Generalized forces by Hamilton's principle with variations of vectors.

With possible displacements p and rotations theta of every body, its momentum m v and
angular momentum H = I . omega, Hamilton's principle for arbitrary variations gives

    F* = sum over bodies of  var( 1/2 omega . I . omega ) - d/dt( H . theta )
                           + var( 1/2 m v . v )           - d/dt( m v . p )

All rates of the variations cancel. Kinetic energy is a scalar, so its variation does not
depend on the frame in which omega, I and v are varied. In the body's own frame I is
constant. Source: vector variations, Journal of Robotic Systems 5 (1988) 553.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.mechanics.elastic_joints import spring_torque as drive_spring
from kane_dynamics.mechanics.energy_form import variation_rules
from kane_dynamics.model.model import WORLD
import numpy as np


@dataclass(frozen=True, eq=False)
class PossibleMotion:
    """
    Possible displacement and rotation of a point and axes, a row per variation.

    In world axes.

    Attributes
    ----------
    displacement, rotation : (k, 3) arrays
        m and rad, per unit of the variation.
    displacement_rate, rotation_rate : (k, 3) arrays
        Their time derivatives along the motion, for constant variations.

    """

    displacement: Array
    rotation: Array
    displacement_rate: Array
    rotation_rate: Array

    def along(self, directions: Array) -> 'PossibleMotion':
        """Return the motion for variations of q, the columns of (n_q, k)."""
        return PossibleMotion(directions.T @ self.displacement,
                              directions.T @ self.rotation,
                              directions.T @ self.displacement_rate,
                              directions.T @ self.rotation_rate)


class VariedMotion(Protocol):
    """A motion of joints, and the possible motions of its bodies (`state`)."""

    q: Any  # coordinates, rates and accelerations, (n_q,) each
    qdot: Any
    qddot: Any
    state: Any  # with `model`, `axes(body)` and `center_of_mass(body)`


class HamiltonByVariations:
    """
    Generalized forces by variations of every body's vectors and dyadics.

    Parameters
    ----------
    turning : sequence of int, optional
        For each body, the index of the body (or WORLD) in whose frame its rotational
        energy is varied. Default: its own.
    translating : sequence of int, optional
        The same for its translational energy. Default: the world.

    """

    def __init__(self, turning: Sequence[int] | None = None,
                 translating: Sequence[int] | None = None) -> None:
        """Store the frames of the variations."""
        self.turning = turning
        self.translating = translating

    def inertia_force(self, motion: VariedMotion, variations: Array) -> Array:
        """Return F*, (k,), for the columns of `variations`, (n_q, k)."""
        state = motion.state
        model = state.model
        if model.flexible:
            raise ModelError('variations of vectors: a model with a beam; expected '
                             'rigid bodies')
        bodies = range(len(model.bodies))
        turning = bodies if self.turning is None else self.turning
        translating = self.translating
        if translating is None:
            translating = [WORLD] * len(bodies)
        coms = [state.center_of_mass(k) for k in bodies]
        possible = [com.along(variations) for com in coms]
        force = np.zeros(variations.shape[1])
        for k, (body, com) in enumerate(zip(model.bodies, coms)):
            # The two energies, varied in the frames that were chosen for them.
            R = state.axes(k)
            inertia = R @ body.inertial.inertia @ R.T
            turns = _frame_rotation(possible, turning[k])
            force = force + turning_force(inertia, motion, com, possible[k], turns)
            turns = _frame_rotation(possible, translating[k])
            force = force + body.inertial.mass * translating_force(
                motion, com, possible[k], turns)

            # With constant variations of the coordinates,
            # the rotor's rate is not varied.
            joint = body.joint
            rotor_acceleration = joint.multiplier * motion.qddot[joint.coordinate]
            rotor_torque = joint.armature * rotor_acceleration * joint.multiplier
            force = force - rotor_torque * variations[joint.coordinate]
        return force

    def conservative_force(self, motion: VariedMotion, variations: Array) -> Array:
        """Return the generalized active force of gravity and springs, (k,)."""
        model = motion.state.model
        force = np.zeros(variations.shape[1])
        for k, body in enumerate(model.bodies):
            # The virtual work of the weight: m g . p, with the virtual displacement p of
            # the center of mass.
            com = motion.state.center_of_mass(k).along(variations)
            joint = body.joint
            position = joint.multiplier * motion.q[joint.coordinate] + joint.offset
            spring_torque = (joint.stiffness * (position - joint.rest)
                             * joint.multiplier)
            force = force + com.displacement @ (body.inertial.mass * model.gravity)
            force = force - spring_torque * variations[joint.coordinate]
        for _, drive, link, motor in model.drives:
            # The virtual work of a spring is minus its torque times its extension.
            extension = motion.q[motor] - motion.q[link]
            possible_extension = variations[motor] - variations[link]
            force = force - drive_spring(drive, extension) * possible_extension
        return force


def _frame_rotation(possible: Sequence[PossibleMotion], frame: int) -> Array:
    """Return the possible rotation of a body, or of the world, which is zero; (k, 3)."""
    if frame == WORLD:
        return np.zeros_like(possible[0].rotation)
    return possible[frame].rotation


def turning_force(inertia: Array, motion: VariedMotion, com: PossibleMotion,
                  possible: PossibleMotion, turns: Array) -> Array:
    """
    Return the rotational term var( 1/2 omega . I . omega ) - d/dt( H . theta ), (k,).

    Parameters
    ----------
    inertia : (3, 3) array
        Central inertia dyadic I, world axes, kg m^2.
    motion : VariedMotion
        Motion of the joints.
    com, possible : PossibleMotion
        Motion of the body for unit variations of the coordinates, and for the k
        variations.
    turns : (k, 3) array
        Possible rotation of the frame in which omega and I are varied.

    """
    omega = com.rotation.T @ motion.qdot
    alpha = com.rotation_rate.T @ motion.qdot + com.rotation.T @ motion.qddot
    momentum = inertia @ omega
    no_change = np.zeros((3, 3))  # the inertia is constant in the body
    inertia_rate = variation_rules.absolute(no_change, omega, inertia)
    momentum_rate = inertia_rate @ omega + inertia @ alpha
    force = []
    for theta, theta_rate, turn in zip(possible.rotation, possible.rotation_rate, turns):
        # var( 1/2 omega . I . omega ) in the chosen frame; I is constant in the body.
        omega_variation = variation_rules.angular_velocity_variation(
            theta_rate, theta, omega)
        omega_variation = variation_rules.relative(omega_variation, turn, omega)
        inertia_variation = variation_rules.rotation_change(theta - turn, inertia)
        energy_variation = (momentum @ omega_variation
                            + 0.5 * omega @ inertia_variation @ omega)
        # d/dt( H . theta )
        momentum_term = momentum_rate @ theta + momentum @ theta_rate
        force.append(energy_variation - momentum_term)
    return np.array(force)


def translating_force(motion: VariedMotion, com: PossibleMotion,
                      possible: PossibleMotion, turns: Array) -> Array:
    """
    Return the translational term var( 1/2 v . v ) - d/dt( v . p ) per unit mass, (k,).

    In the world, the variation of a point's velocity is the rate of its displacement.
    Arguments as in `turning_force`.
    """
    # v = sum of p_s q_s', with the possible displacements p_s of the center of mass; then
    # its rate.
    v = com.displacement.T @ motion.qdot
    a = com.displacement_rate.T @ motion.qdot + com.displacement.T @ motion.qddot
    force = []
    for p, p_rate, turn in zip(possible.displacement, possible.displacement_rate, turns):
        v_variation = variation_rules.relative(p_rate, turn, v)
        force.append(v @ v_variation - (a @ p + v @ p_rate))
    return np.array(force)
