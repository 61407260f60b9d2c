"""Mode joint_impedance: joints on springs to a desired motion, or to where they are."""

from collections.abc import Mapping
from typing import Any

from kane_dynamics._util.typing import Array, Vector
from kane_dynamics.control.computed_torque import joints_that_follow
from kane_dynamics.control.followed_motion import FollowedMotion
from kane_dynamics.control.traced_laws import LawInput, TracedLaw
from kane_dynamics.mechanics.algebra.flags import either
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.parameters.parameter_checks import terms
from kane_dynamics.ros.parameters.task_settings import (differ, joint_damping,
                                                        joint_stiffness)
from kane_dynamics.ros.torque_path.live_law import NativeLaw
from kane_dynamics.task_space.joint_impedance import joint_impedance_law, JointImpedance
from kane_dynamics.task_space.reference_dynamics import compensation_weights
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
        self._values = values
        # The inertia by which a ratio damps is that where the mode begins.
        self._inertia = np.ones(len(robot.joint_names))
        self._settings = self._checked(values)
        self.law = JointImpedance(robot, **self._settings)
        self.restart()

    def _checked(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the settings of the law, of the joints that follow."""
        stiffness = joint_stiffness(values, self._robot)
        damping = joint_damping(values, self._robot, stiffness, self._inertia)
        return {'stiffness': stiffness[self._places], 'damping': damping[self._places],
                'compensate': terms(values)}

    def check(self, values: Mapping[str, Any]) -> None:
        """Raise InputError unless parameters fit the arm."""
        self._checked(values)

    def update(self, values: Mapping[str, Any]) -> bool:
        """Use checked parameters; return whether a setting of the law changes."""
        self._values = values
        return self._apply(self._checked(values))

    def _apply(self, settings: Mapping[str, Any]) -> bool:
        """Change the settings of the law; return whether one differs."""
        changed = differ(settings, self._settings)
        self._settings = dict(settings)
        self.law.update(**settings)
        return changed

    def compile(self) -> None:  # noqa: A003
        """Compile what the path needs beside the law."""
        self._motion.compile()
        self._robot.compile('mass_matrix')

    def restart(self) -> None:
        """Hold the pose of the next state, unless there is a motion."""
        self._pose: Array | None = None
        self._begins = True

    def torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
               t: float) -> Array:
        """Return joint torques (n_q,) towards the motion, or the pose that is held."""
        if self._begins:
            self._begin(q)
        if motion is not None:
            self._pose = None  # the pose at the end of the motion is held next
            q_d, u_d, udot_d = self._motion.desired(motion, moment)
            return self.law.torque(q, u, q_d, u_d, udot_d, t=t)
        if self._pose is None:
            self._pose = q[self._places].copy()
        return self.law.torque(q, u, self._pose, t=t)

    def _begin(self, q: Array) -> None:
        """Damp by the inertia of each joint at q, (n_q,), with the others at rest."""
        self._begins = False
        # The independent speeds of an arm of the node are rates of joints that follow.
        inertias = np.diag(self._robot.mass_matrix(q))
        for name, inertia in zip(self._robot.speed_names, inertias, strict=True):
            self._inertia[self._robot.joint_names.index(name)] = inertia
        self._apply(self._checked(self._values))

    def joint_spring(self, q: Array) -> JointSpring:
        """Return spring and damper of the joints, for the inertia at q, (n_q,)."""
        robot = self._robot
        values = self._values
        speeds = [robot.joint_names.index(name) for name in robot.speed_names]
        # Joints that follow have the inertia of their speed.
        inertia = np.ones(len(robot.joint_names))
        inertia[speeds] = np.diag(robot.mass_matrix(q))
        stiffness = joint_stiffness(values, robot)
        damping = joint_damping(values, robot, stiffness, inertia)
        by_ratio = not values['joint_impedance.damping'].size
        return JointSpring(np.diag(stiffness[speeds]), np.diag(damping[speeds]), by_ratio)

    @property
    def pose(self) -> Array | None:
        """Return the positions that are held, of the joints that follow."""
        return self._pose

    # On the native torque path.

    def traced(self) -> TracedLaw:
        """
        Return the law for an arm in joint rates.

        Its memory are the inertias of the joints where the mode begins, by which a ratio
        damps.
        """
        equations = self._robot.equations
        law = joint_impedance_law(self.law)
        n = self._robot.n

        def torque(at: LawInput) -> tuple[Vector, Vector]:
            # The damping by ratio scales with the root of the inertia where the mode
            # begins.
            stiffness, stated, per_root, weights = np.split(at.settings, [n, 2 * n, 3 * n])
            inertia = either(at.begins, np.diag(equations.mass_matrix(at.q, at.parameters)),
                             at.memory)
            damping = stated + per_root * np.sqrt(inertia)
            settings = np.concatenate([stiffness, damping, weights])
            desired = at.desired
            tau = law(at.q, at.u, desired.q, desired.u, desired.udot, settings, t=0.0,
                      parameters=at.parameters)
            return tau, inertia
        return TracedLaw(torque, len(self.settings_numbers()), memory=n, holds=True)

    def settings_numbers(self) -> Array:
        """Return stiffness, stated damping, that per root of inertia, and weights."""
        robot = self._robot
        stiffness = joint_stiffness(self._values, robot)
        # Linear in the root of the inertia, so that its values at 0 and 1 tell all.
        stated = joint_damping(self._values, robot, stiffness, np.zeros(robot.n))
        per_root = joint_damping(self._values, robot, stiffness, np.ones(robot.n)) - stated
        weights = compensation_weights(terms(self._values))
        return np.concatenate([stiffness, stated, per_root, weights])
