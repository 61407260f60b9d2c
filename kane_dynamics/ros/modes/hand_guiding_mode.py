"""Mode hand_guiding: an operator leads the arm by hand."""

from collections.abc import Mapping
from typing import Any

from kane_dynamics._util.typing import Array, Vector
from kane_dynamics.control.friction_error import FrictionError
from kane_dynamics.control.traced_laws import LawInput, TracedLaw
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.modes.live_law import NativeLaw, WALL
from kane_dynamics.ros.modes.task_description import TaskDescription, TaskSnapshot
from kane_dynamics.ros.parameters.parameter_checks import terms
from kane_dynamics.ros.parameters.task_settings import (controlled_frame, differ,
                                                        guiding_settings)
from kane_dynamics.task_space.hand_guiding import (hand_guiding_law, HandGuiding,
                                                   wall_slopes)
from kane_dynamics.task_space.joint_speed_limits import LONGEST_PERIOD
from kane_dynamics.task_space.law_kernel import settings_of
from kane_dynamics.task_space.sampled_spring import JointSpring, spring_of_joints
import numpy as np


class HandGuidingMode(NativeLaw):
    """
    The law of mode hand_guiding, without the terms that the arm adds itself.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path.
    values : mapping
        The node's parameters; hand_guiding.*, walls.*, observer.friction.* and
        arm_compensates are used.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    pose: Array | None = None  # no positions are held
    longest_period = LONGEST_PERIOD

    def __init__(self, robot: Robot, values: Mapping[str, Any]) -> None:
        self._robot = robot
        self._settings = guiding_settings(values, robot)
        frame = controlled_frame(values, robot.model)
        settings = self._of_law(self._settings)
        self.law = HandGuiding(robot, frame=frame, **settings)
        # A law of its own checks settings that the path does not use yet.
        self._trial = HandGuiding(robot, frame=frame, **settings)
        self._frame = frame
        self._adds_gravity = terms(values).gravity

    def _of_law(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """Return settings as those of the law, with the friction beyond the model."""
        coulomb, damping, offset, speed = settings['friction_error']
        error = FrictionError(self._robot.speed_names, coulomb=coulomb, damping=damping,
                              offset=offset, friction_speed=speed)
        return {**settings, 'friction_error': error}

    def check(self, values: Mapping[str, Any]) -> None:
        """Raise InputError unless parameters fit the arm."""
        settings = guiding_settings(values, self._robot)
        if differ(settings, self._settings):
            self._trial.update(**self._of_law(settings))

    def update(self, values: Mapping[str, Any]) -> bool:
        """Use checked parameters; return whether a setting of the law changes."""
        settings = guiding_settings(values, self._robot)
        changed = differ(settings, self._settings)
        self._settings = settings
        if changed:
            self.law.update(**self._of_law(settings))
        return changed

    def compile(self) -> None:  # noqa: A003
        """Compile what the path needs beside the law."""
        self._robot.compile('gravity_force', 'joint_torques')

    def torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
               t: float) -> Array:
        """Return joint torques (n_q,) at a state."""
        tau = self.law.torque(q, u, t)
        # The law holds the whole weight; an arm that does so itself gets the rest.
        if self._adds_gravity:
            return tau
        gravity = self._robot.gravity_force(q)
        if not self._robot.equations.in_joint_rates:
            gravity = self._robot.joint_torques(gravity, q)
        return tau - gravity

    def describe(self, q: Array, u: Array, snapshot: TaskSnapshot) -> TaskDescription:
        """Return which limits of speed the operator exceeds, and which walls act."""
        robot = self._robot
        rates = robot.joint_rates(q, u)
        saturated = []
        # The law's default: half of the limits of the joints.
        limits = self._settings['speed_limit']
        if limits is None:
            limits = 0.5 * np.asarray(robot.limits.velocity)
        for k in np.flatnonzero(np.abs(rates) > limits):
            saturated.append(f'speed of {robot.joint_names[k]}')
        if self.law.energy(q) > 0.0:
            saturated.append('wall')
        return TaskDescription(saturated=tuple(saturated))

    def springs(self, q: Array) -> dict[str, JointSpring]:
        """Return the damper of the joints, and the walls that act at q, (n_q,)."""
        damping = self._settings['damping']
        robot = self._robot
        return {'damping': spring_of_joints(robot, q, np.zeros_like(damping), damping),
                WALL: spring_of_joints(robot, q, *wall_slopes(self.law, q))}

    # On the native torque path.

    def traced(self) -> TracedLaw:
        """Return the law for an arm in joint rates; it has no memory."""
        equations = self._robot.equations
        law = hand_guiding_law(self.law)

        def torque(at: LawInput) -> tuple[Vector, Vector]:
            tau = law(at.q, at.u, at.settings, t=0.0, parameters=at.parameters)
            if not self._adds_gravity:
                tau = tau - equations.gravity_force(at.q, at.parameters)
            return tau, at.memory
        return TracedLaw(torque, len(self.settings_numbers()), variant=(self._frame,))

    def settings_numbers(self) -> Array:
        """Return the settings of the law."""
        return settings_of(self.law)
