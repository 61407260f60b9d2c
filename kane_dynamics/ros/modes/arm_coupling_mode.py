"""Mode arm_coupling: one side of two arms that feel each other."""

from collections.abc import Mapping
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import joints_that_follow
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.modes.live_law import LiveLaw
from kane_dynamics.ros.modes.task_description import TaskDescription, TaskSnapshot
from kane_dynamics.ros.parameters.task_settings import coupling_settings
from kane_dynamics.task_space.arm_coupling import ArmCoupling, PartnerState
from kane_dynamics.task_space.sampled_spring import JointSpring
import numpy as np


class ArmCouplingMode(LiveLaw):
    """
    The law of mode arm_coupling, which engages once when parameter coupling.engaged rises.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path.
    values : mapping
        The node's parameters; coupling.* and arm_compensates are used.

    Attributes
    ----------
    joints : tuple of str
        The joints that are coupled.
    law : ArmCoupling
    partner : PartnerState or None
        The last state of the partner, its time on the clock of the node; None before
        the first one.

    Raises
    ------
    InputError
        A parameter does not fit the robot, or coupling.partner is empty.

    """

    pose: Array | None = None  # the law itself holds a position

    def __init__(self, robot: Robot, values: Mapping[str, Any]) -> None:
        if not values['coupling.partner']:
            raise InputError("parameter 'coupling.partner': empty; expected the topic "
                             '~/coupling_state of the node of the other arm')
        places = joints_that_follow(robot)
        self.joints = tuple(robot.coordinate_names[k] for k in places)
        self._settings = coupling_settings(values, robot, self.joints)
        self.law = ArmCoupling(robot, followed=self.joints, **self._settings)
        self._robot = robot
        self.partner: PartnerState | None = None
        self._wanted = values['coupling.engaged']
        self._waits = self._wanted  # for the first state of the partner

    def check(self, values: Mapping[str, Any]) -> None:
        """Raise InputError unless parameters fit the arm."""
        coupling_settings(values, self._robot, self.joints)

    def update(self, values: Mapping[str, Any]) -> bool:
        """Use checked parameters; the law engages without a jump, so that none blends."""
        wanted = values['coupling.engaged']
        if wanted != self._wanted:
            self._wanted = wanted
            self._waits = wanted
            if not wanted:
                self.law.disengage('parameter coupling.engaged is false')
        return False

    def compile(self) -> None:  # noqa: A003
        """Do nothing: the law is compiled."""

    def restart(self) -> None:
        """Begin alone at the next state; an interrupted coupling needs a new request."""
        self.law.restart()

    def torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
               t: float) -> Array:
        """Return joint torques (n_q,) at a state with stamp t, s."""
        law = self.law
        partner = self.partner
        if self._waits and partner is not None and law.is_usable(t, partner):
            self._waits = False
            law.engage(q, partner)
        return law.torque(t, q, u, partner)

    def snapshot(self, stamp: int) -> TaskSnapshot:
        """Return the record of the last cycle, with the action of the law."""
        law = self.law
        acting = []
        if law.saturated:
            acting.append('force of the coupling')
        if not law.engaged:
            acting.append(f'alone: {self.reason}')
        return TaskSnapshot(detail=tuple(acting))

    @property
    def reason(self) -> str:
        """Return why the arm is alone."""
        if not self._wanted:
            return 'parameter coupling.engaged is false'
        if self._waits:
            return 'no state of the partner yet'
        return self.law.lost

    def describe(self, q: Array, u: Array, snapshot: TaskSnapshot) -> TaskDescription:
        """Return whether the force is at its limit, and why the arm is alone."""
        return TaskDescription(saturated=snapshot.detail)

    def springs(self, q: Array) -> dict[str, JointSpring]:
        """
        Return spring and damper of the coupling, of the independent speeds.

        Of coupled arms they are those of the motion against each other: with equal arms
        and springs, K (q_p - q) acts on both, so that q - q_p has twice the spring.
        """
        # The independent speeds of an arm of the node are rates of coupled joints.
        order = list(map(self.joints.index, self._robot.speed_names))
        sides = 2.0 if self.law.engaged else 1.0
        stiffness = sides * self._settings['stiffness'][order]
        damping = sides * self._settings['damping'][order]
        return {'stiffness': JointSpring(np.diag(stiffness), np.diag(damping), False)}
