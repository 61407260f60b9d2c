"""Mode joint_impedance: joints on springs to a desired motion, or to where they are."""

from collections.abc import Mapping
from typing import Any

from kane_dynamics._util.typing import Array, Vector
from kane_dynamics.control.computed_torque import joints_that_follow
from kane_dynamics.control.followed_motion import FollowedMotion
from kane_dynamics.control.traced_laws import LawInput, TracedLaw
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.modes.live_law import NativeLaw
from kane_dynamics.ros.parameters.parameter_checks import terms
from kane_dynamics.ros.parameters.task_settings import (damping_settings, differ,
                                                        joint_stiffness)
from kane_dynamics.task_space.joint_impedance import (compile_dampers,
                                                      joint_impedance_law,
                                                      JointImpedance)
from kane_dynamics.task_space.law_kernel import lanes_of_single_states, settings_of
from kane_dynamics.task_space.modal_damping import damping_by_ratio
from kane_dynamics.task_space.sampled_spring import JointSpring
import numpy as np


class JointImpedanceMode(NativeLaw):
    """
    The law of mode joint_impedance; without a motion it holds the first pose.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path.
    values : mapping
        The node's parameters; joint_impedance.* and arm_compensates are used.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    def __init__(self, robot: Robot, values: Mapping[str, Any]) -> None:
        self._robot = robot
        self._places = list(joints_that_follow(robot))
        self._motion = FollowedMotion(robot, None)
        self._settings = self._checked(values)
        self.law = JointImpedance(robot, **self._settings)
        self.restart()

    def _checked(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the settings of the law, of the joints that follow."""
        settings: dict[str, Any] = {
            'stiffness': joint_stiffness(values, self._robot)[self._places],
            'compensate': terms(values)}
        for name, of_joints in damping_settings(values, self._robot).items():
            settings[name] = None if of_joints is None else of_joints[self._places]
        return settings

    def check(self, values: Mapping[str, Any]) -> None:
        """Raise InputError unless parameters fit the arm."""
        self._checked(values)

    def update(self, values: Mapping[str, Any]) -> bool:
        """Use checked parameters; return whether a setting of the law changes."""
        settings = self._checked(values)
        changed = differ(settings, self._settings)
        self._settings = settings
        self.law.update(**settings)
        return changed

    def compile(self) -> None:  # noqa: A003
        """Compile what the path needs beside the law."""
        compile_dampers(self.law)
        self._motion.compile()
        self._robot.compile('mass_matrix')

    def restart(self) -> None:
        """Hold the pose of the next state, unless there is a motion."""
        self._pose: Array | None = None

    def torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
               t: float) -> Array:
        """Return joint torques (n_q,) towards the motion, or the pose that is held."""
        if motion is not None:
            self._pose = None  # the pose at the end of the motion is held next
            q_d, u_d, udot_d = self._motion.desired(motion, moment)
            return self.law.torque(q, u, q_d, u_d, udot_d, t=t)
        if self._pose is None:
            self._pose = q[self._places].copy()
        return self.law.torque(q, u, self._pose, t=t)

    def springs(self, q: Array) -> dict[str, JointSpring]:
        """Return spring and damper of the joints, for the inertia at q, (n_q,)."""
        robot = self._robot
        # The independent speeds of an arm of the node are rates of joints that follow.
        order = [self._places.index(robot.joint_names.index(name))
                 for name in robot.speed_names]
        settings = self._settings  # the main thread may replace them meanwhile
        stiffness = settings['stiffness'][order]
        stated = settings['damping']
        if stated is not None:
            return {'stiffness': JointSpring(np.diag(stiffness), np.diag(stated[order]),
                                             False)}
        ratio = settings['damping_ratio'][order]
        damping = damping_by_ratio(robot.mass_matrix(q), stiffness, ratio)
        return {'stiffness': JointSpring(np.diag(stiffness), damping, True)}

    @property
    def pose(self) -> Array | None:
        """Return the positions that are held, of the joints that follow."""
        return self._pose

    # On the native torque path.

    def traced(self) -> TracedLaw:
        """Return the law for an arm in joint rates."""
        law = joint_impedance_law(self.law, lanes_of_single_states)

        def torque(at: LawInput) -> tuple[Vector, Vector]:
            desired = at.desired
            tau = law(at.q, at.u, desired.q, desired.u, desired.udot, at.settings, t=0.0,
                      parameters=at.parameters)
            return tau, at.memory
        return TracedLaw(torque, len(self.settings_numbers()), holds=True)

    def settings_numbers(self) -> Array:
        """Return the settings of the law."""
        return settings_of(self.law)
