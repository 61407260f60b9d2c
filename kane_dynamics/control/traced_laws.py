"""The laws of the modes of `Controller` as functions over any scalar, to be compiled."""

from collections.abc import Callable
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.control.computed_torque import corrected_acceleration, law_of
from kane_dynamics.control.terms import Mode, Terms
from kane_dynamics.mechanics.algebra.flags import either
from kane_dynamics.robot.feedforward_friction import changes_friction
from kane_dynamics.robot.robot import Robot
import numpy as np

MODES = (Mode.INVERSE_DYNAMICS, Mode.COMPUTED_TORQUE, Mode.GRAVITY_COMPENSATION)


class Desired(NamedTuple):
    """The desired motion (n,), and 1 if there is one, else 0."""

    q: Vector
    u: Vector
    udot: Vector
    moving: Scalar


class LawInput(NamedTuple):
    """
    Input of a law: state, desired motion, memory, settings.

    Attributes
    ----------
    q, u : (n,) arrays
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
        Returns the torque before the limits, (n,), and the next memory, of a `LawInput`.
    settings, memory : int
        Lengths of its settings and its memory.
    holds : bool
        Whether the pose of the first state without a motion is desired.
    variant : tuple of str
        Distinguishes laws of one mode and robot whose functions differ, as by a frame.

    """

    torque: Callable[[LawInput], tuple[Vector, Vector]]
    settings: int
    memory: int = 0
    holds: bool = False
    variant: tuple[str, ...] = ()


def controller_laws(robot: Robot, terms: Terms) -> dict[Mode, TracedLaw]:
    """Return the laws of `MODES`; their settings are the gains, kp then kd."""
    def law_of(mode: Mode) -> TracedLaw:
        def torque(at: LawInput) -> tuple[Vector, Vector]:
            tau = mode_torque(robot, mode, terms, at.q, at.u, at.desired, at.settings,
                              at.parameters, at.limits)
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
    gravity = equations.zeros
    if terms.gravity:
        gravity = equations.gravity_force(q, parameters)
    if mode is Mode.GRAVITY_COMPENSATION:
        return gravity
    if mode is Mode.COMPUTED_TORQUE:
        return _computed_torque(robot, terms, q, u, desired, gains, parameters, limits)
    feedforward = motion_torque(robot, terms, desired.q, desired.u, desired.udot,
                                parameters)
    return either(desired.moving, feedforward, gravity)


def motion_torque(robot: Robot, terms: Terms, q: Vector, u: Vector, udot: Vector,
                  parameters: Vector) -> Vector:
    """Return the command of a motion, (n,), without the terms that are switched off."""
    equations = robot.equations
    tau: Vector
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
    feedforward = desired.udot if terms.inertia else equations.zeros
    kp, kd = np.split(gains, 2)
    corrected = corrected_acceleration(q, u, desired.q, desired.u, feedforward, kp, kd)
    rows = equations.torque_terms(q, u, corrected, parameters)
    force: Any = terms.of_feedback.weights @ rows
    if terms.friction:  # at the desired speed, as in the whole law
        force = force + equations.tree.feedforward_friction(desired.u, desired.udot)
    return force
