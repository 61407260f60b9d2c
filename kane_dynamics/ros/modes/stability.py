"""The stability of the feedback of a mode at the rate of the joint states."""

from collections.abc import Mapping
from typing import NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.control.controller import Controller
from kane_dynamics.control.terms import Mode
from kane_dynamics.ros.modes.live_law import LiveLaw, SprungArm
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
    arm : SprungArm
    gain : str
        What to change.
    largest : tuple of (str, (n,) array)
        Parameters with their values, whose largest stable ones the message names.

    """

    spring: JointSpring
    other: JointSpring | None
    arm: SprungArm
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
        inertia, names, own = feedback.arm
        motion = swing(inertia, feedback.spring.beside(feedback.other), period, own)
        if not motion.swings_up:
            continue
        share = steady_share(inertia, feedback.spring, period, feedback.other, own)
        j = motion.joint
        values = ', '.join(f'{name} {share * gain[j]:.3g}'
                           for name, gain in feedback.largest)
        missing = 'the inertia of the rotors as `armature`' if own is None else (
            'the `damping` of the drives')
        return (f"{mode}: joint '{names[j]}' swings up: with joint states each "
                f'{period * 1e3:.3g} ms its amplitude grows by {motion.growth:.2g} in '
                f'each; expected at most {100.0 * share:.2g}% of the {feedback.gain}'
                + f' ({values})' * bool(values) + ', states more often, or '
                f'{missing} in the supplement')
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
        arm = SprungArm(np.eye(len(kp)), tuple(controller.followed))
        return [Feedback(spring, None, arm, 'gains', (('gains.kp', kp), ('gains.kd', kd)))]
    law = laws.get(mode)
    if law is None:
        return []
    feedbacks = []
    # Each spring beside those before it, which are stable without it.
    before: JointSpring | None = None
    springs = law.springs(q)
    arm = law.sprung_arm(robot, q)
    for gain, spring in springs.items():
        if spring.stiffness.any() or spring.damping.any():
            feedbacks.append(Feedback(spring, before, arm, gain))
            before = spring.beside(before)
    return feedbacks
