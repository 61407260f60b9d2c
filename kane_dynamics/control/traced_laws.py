"""The laws of the modes of `Controller` as functions over any scalar, to be compiled."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.control.arm_gravity import ArmGravity
from kane_dynamics.control.computed_torque import (corrected_acceleration,
                                                   followed_friction, followed_rates,
                                                   law_of)
from kane_dynamics.control.terms import Mode, Terms
from kane_dynamics.mechanics.algebra.flags import either, finite
from kane_dynamics.mechanics.constraints.conditioning import guarded
from kane_dynamics.robot.feedforward_friction import changes_friction
from kane_dynamics.robot.robot import Robot, TORQUE_TERMS
import numpy as np

CORIOLIS = TORQUE_TERMS.index('coriolis')
FRICTION = TORQUE_TERMS.index('friction')
MODES = (Mode.INVERSE_DYNAMICS, Mode.COMPUTED_TORQUE, Mode.GRAVITY_COMPENSATION)


class Desired(NamedTuple):
    """
    The desired motion of the joints that follow, (n,), and 1 if there is one, else 0.

    With closed loops also the desired configuration, (n_q,), and its speeds, (n,).
    """

    q: Vector
    u: Vector
    udot: Vector
    moving: Scalar
    configuration: Vector | None = None
    speeds: Vector | None = None


class LawInput(NamedTuple):
    """
    Input of a law: state, desired motion, memory, settings.

    Attributes
    ----------
    q, u : (n_q,), (n,) arrays
        Measured state.
    stamp : Scalar
        Its time, ns since the path began.
    desired : Desired
    begins : Scalar
        1 at the first state of the law, whose memory is not valid there; else 0.
    memory, settings : arrays
        Of the law.
    parameters, limits : arrays
        Of the robot.
    external : (n,) array or None
        Torques of the measured wrenches; None for a robot that has none.

    """

    q: Vector
    u: Vector
    stamp: Scalar
    desired: Desired
    begins: Scalar
    memory: Vector
    settings: Vector
    parameters: Vector
    limits: Vector
    external: Vector | None = None


class TracedLaw(NamedTuple):
    """
    The law of a mode as a function over any scalar.

    Attributes
    ----------
    torque : callable
        Returns the torques before the limits, of the commanded joints, and the next
        memory, of a `LawInput`.
    settings, memory : int
        Lengths of its settings and its memory.
    holds : bool
        Whether the pose of the first state without a motion is desired.
    variant : tuple of str
        Distinguishes laws of one mode and robot whose functions differ, as by a frame.
    closes : bool
        Whether a motion needs its configuration of closed loops.

    """

    torque: Callable[[LawInput], tuple[Vector, Vector]]
    settings: int
    memory: int = 0
    holds: bool = False
    variant: tuple[str, ...] = ()
    closes: bool = False

    def beside(self, robot: Robot, arm: ArmGravity | None) -> 'TracedLaw':
        """Return the law without the gravity that the arm adds at the measured positions."""
        if arm is None:
            return self

        def torque(at: LawInput) -> tuple[Vector, Vector]:
            tau, memory = self.torque(at)
            force = arm.force(robot, at.q, at.parameters)
            return tau - robot.equations.joint_torques(force, at.q), memory
        return self._replace(torque=torque)

    def of_joints(self, places: Sequence[int]) -> 'TracedLaw':
        """Return the law with the torques of some of its joints alone."""
        def torque(at: LawInput) -> tuple[Vector, Vector]:
            tau, memory = self.torque(at)
            return tau[list(places)], memory
        return self._replace(torque=torque)


def controller_laws(robot: Robot, terms: Terms) -> dict[Mode, TracedLaw]:
    """Return the laws of `MODES`; their settings are the gains, kp then kd."""
    def law_of(mode: Mode) -> TracedLaw:
        def torque(at: LawInput) -> tuple[Vector, Vector]:
            tau = mode_torque(robot, mode, terms, at.q, at.u, at.desired, at.settings,
                              at.parameters, at.limits)
            # Modes hold against external torques; gravity compensation yields to them.
            if at.external is not None and mode is not Mode.GRAVITY_COMPENSATION:
                tau = tau - at.external
            return tau, at.memory
        return TracedLaw(torque, 2 * robot.n, holds=mode is Mode.COMPUTED_TORQUE)
    return {mode: law_of(mode) for mode in MODES}


def mode_torque(robot: Robot, mode: Mode, terms: Terms, q: Vector, u: Vector,
                desired: Desired, gains: Vector, parameters: Vector,
                limits: Vector) -> Vector:
    """
    Return the torque before the limits, (n,), as `Controller.torque` without wrenches.

    Parameters
    ----------
    robot : Robot
        In joint rates, without friction that depends on loads where terms are left out.
    mode : Mode
        One of `MODES`.
    terms : Terms
        The terms of the command.
    q, u : (n,) arrays of Scalar
        Measured state.
    desired : Desired
        In computed torque without a motion: the pose that is held.
    gains : (2 n,) array of Scalar
        kp, then kd.
    parameters, limits : arrays of Scalar
        Of the robot.

    """
    equations = robot.equations
    # The terms of the model that the caller left out are zero.
    gravity = equations.zeros
    if terms.gravity:
        gravity = equations.gravity_force(q, parameters)
    if mode is Mode.GRAVITY_COMPENSATION:
        return gravity
    if mode is Mode.COMPUTED_TORQUE:
        return _computed_torque(robot, terms, q, u, desired, gains, parameters, limits)
    # Feedforward alone while a motion runs; gravity compensation before and after.
    feedforward = motion_torque(robot, terms, desired.q, desired.u, desired.udot,
                                parameters)
    return either(desired.moving, feedforward, gravity)


def motion_torque(robot: Robot, terms: Terms, q: Vector, u: Vector, udot: Vector,
                  parameters: Vector) -> Vector:
    """Return the command of a motion, (n,), without the terms that are switched off."""
    equations = robot.equations
    tau: Vector
    # As `Terms.inverse_dynamics`, over any scalar.
    if terms.complete:
        tau = equations.inverse_dynamics(q, u, udot, None, parameters)
    else:
        tau = terms.weights @ equations.torque_terms(q, u, udot, parameters)
    if terms.friction and changes_friction(robot):
        tau = tau + equations.feedforward_change(q, u, udot, parameters)
    return tau


def _computed_torque(robot: Robot, terms: Terms, q: Vector, u: Vector, desired: Desired,
                     gains: Vector, parameters: Vector, limits: Vector) -> Vector:
    """Return the torque at the measured state and the corrected acceleration."""
    equations = robot.equations
    if terms.complete:
        law = law_of(robot)
        return law(q, u, desired.q, desired.u, desired.udot, gains, None, 0.0,
                   parameters, limits)
    # With some terms left out: feedback through the inertia, and the stated terms beside
    # it.
    feedforward = desired.udot if terms.inertia else equations.zeros
    kp, kd = np.split(gains, 2)
    corrected = corrected_acceleration(q, u, desired.q, desired.u, feedforward, kp, kd)
    rows = equations.torque_terms(q, u, corrected, parameters)
    force: Any = terms.of_feedback.weights @ rows
    if terms.friction:  # at the desired speed, as in the whole law
        force = force + equations.tree.feedforward_friction(desired.u, desired.udot)
    return force


# -------------------------------------------------------------------------------------
# Closed loops: the joints that follow determine the others.

class Actuation(NamedTuple):
    """
    The joints of an arm with closed loops.

    Attributes
    ----------
    followed, commanded : tuple of int
        Indices of the joints that follow motions, in the gains' order, and of those
        with actuators.
    preload : (n_q,) array or None
        As of `Controller`.

    """

    followed: tuple[int, ...]
    commanded: tuple[int, ...]
    preload: Vector | None = None


def closed_loop_laws(robot: Robot, terms: Terms, joints: Actuation
                     ) -> dict[Mode, TracedLaw]:
    """Return the laws of `MODES` for an arm with closed loops, as `controller_laws`."""
    def law_of(mode: Mode) -> TracedLaw:
        def torque(at: LawInput) -> tuple[Vector, Vector]:
            return followed_torque(robot, mode, terms, joints, at), at.memory
        return TracedLaw(torque, 2 * robot.n, holds=mode is Mode.COMPUTED_TORQUE,
                         closes=mode is Mode.INVERSE_DYNAMICS)
    return {mode: law_of(mode) for mode in MODES}


def followed_torque(robot: Robot, mode: Mode, terms: Terms, joints: Actuation,
                    at: LawInput) -> Vector:
    """Return the torques of the commanded joints, as `Controller.torque`; NaN in faults."""
    equations = robot.equations
    # Gravity compensation yields to external forces; the other modes hold against them.
    external = equations.zeros
    if at.external is not None and mode is not Mode.GRAVITY_COMPENSATION:
        external = at.external
    # At rest gravity alone is compensated.
    holding = equations.zeros
    if terms.gravity:
        holding = equations.gravity_force(at.q, at.parameters)
    if mode is Mode.COMPUTED_TORQUE:
        force = _followed_feedback(robot, terms, joints, at) - external
        return commanded_torques(robot, joints, force, at.q, at.limits)
    still = commanded_torques(robot, joints, holding - external, at.q, at.limits)
    if mode is Mode.GRAVITY_COMPENSATION:
        return still
    force = followed_feedforward(robot, terms, joints, at.desired, at.parameters)
    moving = commanded_torques(robot, joints, force - external, at.desired.configuration,
                               at.limits)
    return either(at.desired.moving, moving, still)


def followed_feedforward(robot: Robot, terms: Terms, joints: Actuation, desired: Desired,
                         parameters: Vector) -> Vector:
    """Return the generalized force, (n,), of a desired motion of closed loops."""
    equations = robot.equations
    q = desired.configuration
    u = desired.speeds
    assert q is not None and u is not None
    # udot of the speeds for the accelerations of the joints that follow.
    udot = followed_rates(equations, joints.followed, q, u, desired.udot)
    force: Vector
    # All terms at once, or the chosen ones.
    if terms.complete:
        force = equations.inverse_dynamics(q, u, udot, None, parameters)
    else:
        rows = _followed_terms(robot, joints, q, u, desired.udot, parameters)
        force = terms.weights @ rows
    if terms.friction and changes_friction(robot):
        force = force + equations.feedforward_change(q, u, udot, parameters)
    return force


def commanded_torques(robot: Robot, joints: Actuation, force: Vector, q: Vector,
                      limits: Vector) -> Vector:
    """Return the torques of the actuators; the first is NaN where they are not determined."""
    equations = robot.equations
    torques = equations.joint_torques(force, q)
    if joints.preload is not None:
        # The part of the preload that has no generalized force.
        loaded = equations.at_rest(q).projected(joints.preload)
        shared = equations.shared_torques(q, loaded, 0.0)
        torques = torques + (joints.preload - shared)
    if equations.watched:
        torques = guarded(torques, equations.margin(q, 0.0, limits))
    is_determined = finite(torques[:1])
    return np.asarray(guarded(torques[list(joints.commanded)], is_determined - 0.5))


def _followed_feedback(robot: Robot, terms: Terms, joints: Actuation, at: LawInput
                       ) -> Vector:
    """Return the generalized force of computed torque, (n,)."""
    equations = robot.equations
    places = list(joints.followed)
    q, u = at.q, at.u
    desired = at.desired
    if terms.complete:
        law = law_of(robot, places)
        return law(q, u, desired.q, desired.u, desired.udot, at.settings, None, 0.0,
                   at.parameters, at.limits)
    # Feedback acts on the joints that follow, and terms are left out of the sum.
    motion = equations.joint_motion(q, u, equations.zeros)
    kp, kd = np.split(at.settings, 2)
    feedforward = desired.udot if terms.inertia else equations.zeros
    corrected = corrected_acceleration(q[places], motion.qdot[places], desired.q,
                                       desired.u, feedforward, kp, kd)
    rows = _followed_terms(robot, joints, q, u, corrected, at.parameters)
    force: Vector = terms.of_feedback.weights @ rows
    if terms.friction:
        # Friction of the desired motion, under the load of all other terms.
        load = equations.zeros
        if equations.carries_loads:
            load = np.delete(rows, FRICTION, axis=0).sum(axis=0)
        friction = followed_friction(equations, places, q, motion, desired.u,
                                     desired.udot, load, 0.0)
        force = force + motion.projected(friction)
    return force


def _followed_terms(robot: Robot, joints: Actuation, q: Vector, u: Vector,
                    accelerations: Vector, parameters: Vector) -> Matrix:
    """Return inverse dynamics by source, (5, n), as `Controller` adds it up."""
    equations = robot.equations
    # The drift is what udot must be for the joints that follow not to accelerate; its
    # inertial torque counts with the Coriolis terms.
    drift = followed_rates(equations, joints.followed, q, u, 0.0 * accelerations)
    udot = followed_rates(equations, joints.followed, q, u, accelerations)
    rows: Matrix = equations.torque_terms(q, u, udot - drift, parameters)
    rows = np.array(rows)
    rows[CORIOLIS] = rows[CORIOLIS] + equations.mass_matrix(q, parameters) @ drift
    return rows
