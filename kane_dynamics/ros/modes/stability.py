"""The stability of the feedback of a mode at the rate of the joint states."""

from collections.abc import Mapping
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.control.controller import Controller
from kane_dynamics.control.terms import Mode
from kane_dynamics.ros.modes.live_law import LiveLaw
from kane_dynamics.task_space.sampled_spring import JointSpring, steady_share, swing
import numpy as np


class Feedback(NamedTuple):
    """
    A spring with its damper, and what a user changes to weaken it.

    Attributes
    ----------
    spring : JointSpring
    other : JointSpring or None
        The springs that act as well, and keep their stiffness.
    inertia : (n, n) array
        kg m^2 or kg.
    joints : sequence of n str
    gain : str
        What to change.
    largest : tuple of (str, (n,) array)
        Parameters with their values, whose largest stable ones the message names.

    """

    spring: JointSpring
    other: JointSpring | None
    inertia: Array
    joints: tuple[str, ...]
    gain: str
    largest: tuple[tuple[str, Array], ...] = ()


def instability(controller: Controller, laws: Mapping[Mode, LiveLaw], mode: Mode,
                q: Array, period: float, gains: tuple[Array, Array] | None = None) -> str:
    """
    Return the reason for which the feedback of a mode is unstable; empty if it is stable.

    A torque is held for a period, and comes one period late.

    Parameters
    ----------
    controller : Controller
        Of the torque path.
    laws : mapping of Mode to LiveLaw
        Its laws.
    mode : Mode
        The mode that is examined.
    q : (n_q,) array
        Configuration, rad or m.
    period : float
        Time between two joint states, s.
    gains : pair of (n,) arrays, optional
        kp and kd of computed torque. Default: those of the controller.

    """
    for feedback in _feedbacks(controller, laws, mode, q, gains):
        motion = swing(feedback.inertia, feedback.spring.beside(feedback.other), period)
        if not motion.swings_up:
            continue
        share = steady_share(feedback.inertia, feedback.spring, period, feedback.other)
        j = motion.joint
        values = ', '.join(f'{name} {share * gain[j]:.3g}'
                           for name, gain in feedback.largest)
        return (f"{mode}: joint '{feedback.joints[j]}' swings up: with joint states each "
                f'{period * 1e3:.3g} ms its amplitude grows by {motion.growth:.2g} in '
                f'each; expected at most {100.0 * share:.2g}% of the {feedback.gain}'
                + f' ({values})' * bool(values) + ', states more often, or the inertia of '
                'the rotors as `armature` in the supplement')
    law = laws.get(mode)
    if law is not None and period > law.longest_period:
        return (f'{mode}: joint states each {period * 1e3:.3g} ms, with which brakes of '
                f'fast joints swing up; expected states at least each '
                f'{law.longest_period * 1e3:.3g} ms')
    return ''


def _feedbacks(controller: Controller, laws: Mapping[Mode, LiveLaw], mode: Mode,
               q: Array, gains: tuple[Array, Array] | None) -> list[Feedback]:
    """Return the springs of a mode about a configuration, with the target there."""
    robot = controller.robot
    if mode is Mode.COMPUTED_TORQUE:
        # Through the inertia of the model the gains act on the acceleration of each joint.
        kp, kd = gains or (controller.kp, controller.kd)
        spring = JointSpring(np.diag(kp), np.diag(kd), False)
        return [Feedback(spring, None, np.eye(len(kp)), tuple(controller.followed),
                         'gains', (('gains.kp', kp), ('gains.kd', kd)))]
    law = laws.get(mode)
    if law is None:
        return []
    inertia = robot.mass_matrix(q)
    names = tuple(robot.speed_names)
    feedbacks = []
    # Each spring beside those before it, which are stable without it.
    before: JointSpring | None = None
    for gain, spring in law.springs(q).items():
        if spring.stiffness.any() or spring.damping.any():
            feedbacks.append(Feedback(spring, before, inertia, names, gain))
            before = spring.beside(before)
    return feedbacks
