"""
Links that the drives of a recording move: all joints of a tree, or the actuators of closed loops.

The rates of the driven joints are the independent speeds. The torque of each gear is then
the generalized force of its joint, T^T f of all joint forces f, where T are the rates of all
joints at unit rates of the driven ones: without more actuators than degrees of freedom the
links determine it.
"""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Matrix
from kane_dynamics.errors import InputError
from kane_dynamics.identification.payload.recorded_motion import recorded_joints
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
from kane_dynamics.model.model import FRICTION, Joint, Model
from kane_dynamics.robot.robot import Robot
import numpy as np

# Fields of a joint without rotor and friction.
LOSSLESS: dict[str, Any] = {'armature': 0.0}
LOSSLESS.update((field.name, field.default) for field in fields(Joint) if field.name in FRICTION)


class DrivenMotion(NamedTuple):
    """Torques of the driven joints (N, n), and mass matrices of their rates (N, n, n)."""

    torque: Array
    mass_matrix: Matrix


class DrivenLinks:
    """
    The links alone: without rotors, and without friction of the driven joints.

    Parameters
    ----------
    given : Model or Robot
        With rigid joints. A robot has constraints on positions.

    Attributes
    ----------
    model : Model
        As given.
    joint_names : tuple of n str
        The driven joints, in the order of the recording.

    Raises
    ------
    InputError
        The constraints are not those of positions, or the actuators are not joints.

    """

    def __init__(self, given: Model | Robot) -> None:
        self._given = given
        if isinstance(given, Robot):
            self.model = given.model
            self.joint_names = recorded_joints(given)
        else:
            self.model = given
            self.joint_names = given.joint_names

    @lazy_property
    def robot(self) -> Robot:
        """
        Return the robot whose speeds are the rates of the driven joints.

        Raises
        ------
        InputError
            There are more drives than degrees of freedom, or constraints move in time.

        """
        names = self.model.joint_names
        driven = set(map(names.index, self.joint_names))
        bodies = []
        for body in self.model.bodies:
            joint = body.joint
            if joint.coordinate in driven:
                body = replace(body, joint=replace(joint, **LOSSLESS))
            bodies.append(body)
        links = replace(self.model, bodies=tuple(bodies))
        given = self._given
        if not isinstance(given, Robot):
            return Robot(links, friction=False)
        robot = self._in_driven_rates(links, given)
        robot.parameters.gravity = given.parameters.gravity
        if given.parameters.payload is not None:
            robot.parameters.payload = given.parameters.payload
        return robot

    def _in_driven_rates(self, links: Model, given: Robot) -> Robot:
        """Return the robot whose speeds are the rates of the driven joints."""
        count = len(self.joint_names)
        if count > given.n:
            raise InputError(f'recording: {count} drives of a mechanism with {given.n} '
                             'degrees of freedom; expected torques of the gears and '
                             'positions of the links, because motion determines the sum of '
                             'what the drives transmit, not the share of each')
        # Wrench frames and chosen speeds have no part in identification.
        robot = Robot(links, **{**given.options, 'speeds': None, 'actuated': None,
                                'independent': self.joint_names, 'wrench_frames': ()})
        robot.equations.require_timeless(
            'model', 'because the times of a recording have another origin')
        return robot

    def motion(self, t: Array, q: Array, u: Array, udot: Array,
               samples: Sequence[int] | Array) -> DrivenMotion:
        """
        Return the torques of a motion of the driven joints, and mass matrices at some rows.

        Raises
        ------
        LoopError
            The loops do not close, or the driven joints do not determine the motion.

        """
        robot = self.robot
        q, u, udot = mechanism_motion(robot, self.joint_names, t, q, u, udot)
        return DrivenMotion(robot.inverse_dynamics(q, u, udot), robot.mass_matrix(q[samples]))

    def closed(self, q: Array) -> Array:
        """Return configurations, (N, n_q), with the driven joints at q, (N, n), in order."""
        rest = np.zeros_like(q)
        t = np.arange(len(q), dtype=np.float64)
        return mechanism_motion(self.robot, self.joint_names, t, q, rest, rest).q
