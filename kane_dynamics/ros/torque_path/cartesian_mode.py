"""Mode cartesian_impedance: the controlled frame on a spring to its target."""

from collections.abc import Mapping
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.model.model import WORLD
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.parameters.task_settings import (cartesian_settings,
                                                        controlled_frame, differ,
                                                        target_limits)
from kane_dynamics.ros.torque_path.cartesian_target import CartesianTarget, largest_of
from kane_dynamics.ros.torque_path.live_law import LiveLaw
from kane_dynamics.ros.torque_path.pose_functions import bound, displacement
from kane_dynamics.ros.torque_path.task_description import TaskDescription, TaskSnapshot
from kane_dynamics.task_space.cartesian_impedance import CartesianImpedance
from kane_dynamics.task_space.pose_filter import PoseFilter
import numpy as np

SMOOTHING = 0.03  # s: of the target, so that its acceleration has no steps
NEAR = 0.999  # of a limit of the target, above which it is reported


class CartesianMode(LiveLaw):
    """
    The law of mode cartesian_impedance, with its target.

    The target begins at the pose of the frame at the first state. What messages make of
    it moves within limits of speed and acceleration, so that no message makes a jump of
    torque.

    Parameters
    ----------
    robot : Robot
        The robot of the torque path.
    values : mapping
        The node's parameters; cartesian.*, walls.* and target.* are used.

    Attributes
    ----------
    frame : str
        The controlled frame.
    target : CartesianTarget
        By the messages, before the limits.

    Raises
    ------
    InputError
        A parameter does not fit the robot.

    """

    pose: Array | None = None  # no joint positions are held

    def __init__(self, robot: Robot, values: Mapping[str, Any]) -> None:
        self.frame = controlled_frame(values, robot.model)
        self._robot = robot
        self._axes = values['cartesian.axes']
        self._settings = cartesian_settings(values, robot)
        self.law = CartesianImpedance(robot, self.frame, axes=self._axes,
                                      **self._posed(robot.neutral()))
        self._trial = CartesianImpedance(robot, self.frame, axes=self._axes,
                                         **self._posed(robot.neutral()))
        self.target = CartesianTarget(robot, values['target.timeout'])
        # Steps of the target's acceleration would be steps of torque.
        self._filter = PoseFilter(**target_limits(values), smoothing=SMOOTHING)
        self._measured = np.eye(4)
        self._difference = np.zeros(6)
        self._compare = bound(robot, displacement, self._difference,
                              start=self._measured, goal=self.target.pose)
        self._use_target_limits(values)
        self.restart()

    def _posed(self, q: Array) -> dict[str, Any]:
        """Return the settings of the law, with q, (n_q,), as posture by default."""
        return {'posture': q, **self._settings}

    def _use_target_limits(self, values: Mapping[str, Any]) -> None:
        """Use the parameters of the target."""
        self.target.timeout = values['target.timeout']
        limits = target_limits(values)
        self._filter.tune(**limits)
        self._fastest = limits['linear_speed'], limits['angular_speed']
        self._farthest = values['target.max_distance']
        self._widest = values['target.max_angle']

    def check(self, values: Mapping[str, Any]) -> None:
        """Raise InputError unless parameters fit the arm."""
        # A law of its own checks the settings, which that of the path does not use yet.
        settings = cartesian_settings(values, self._robot)
        if differ(settings, self._settings):
            self._trial.update(**{'posture': self._robot.neutral(), **settings})

    def update(self, values: Mapping[str, Any]) -> bool:
        """Use checked parameters; return whether a setting of the law changes."""
        settings = cartesian_settings(values, self._robot)
        changed = differ(settings, self._settings)
        self._settings = settings
        self._use_target_limits(values)
        if changed:
            self.law.update(**self._posed(self._posture))
        return changed

    def compile(self) -> None:  # noqa: A003
        """Compile the kernels of the law."""
        self.law.compile()

    def restart(self) -> None:
        """Begin at the pose of the frame at the next state."""
        self.target.clear()
        self._time = 0.0

    def torque(self, q: Array, u: Array, motion: Motion | None, moment: float,
               t: float) -> Array:
        """Return joint torques (n_q,) towards the target at stamp t, s."""
        target = self.target
        if not target.known:
            self._begin(q)
        stamp = round(t * NANO)
        target.advance(stamp, self._may_move(q))
        elapsed = t - self._time if self._time else 0.0
        self._time = t
        desired = self._filter.step(target.pose, max(elapsed, 0.0), target.twist)
        self._desired = desired
        return self.law.torque(q, u, *desired, target.wrench(stamp), t)

    def _begin(self, q: Array) -> None:
        """Hold the pose of the frame at q, (n_q,), and the posture if none is stated."""
        pose = self._robot.frame_pose(self.frame, q)
        self.target.begin(pose)
        self._filter.reset(pose)
        self._posture = q.copy()
        self.law.update(**self._posed(self._posture))

    def _may_move(self, q: Array) -> bool:
        """Return whether a target that moves by a twist is near enough to the frame."""
        if not self.target.has_twist:
            return True
        self._measured[:] = self._robot.frame_pose(self.frame, q)
        self._compare()
        distance, angle = largest_of(self._difference)
        return bool(distance <= self._farthest and angle <= self._widest)

    def snapshot(self, stamp: int) -> TaskSnapshot:
        """Return what is kept of the last cycle."""
        age = -1.0
        if self.target.moved_at:
            age = (stamp - self.target.moved_at) / NANO
        desired = self._desired
        return TaskSnapshot(desired.pose, age,
                            (desired.twist, self.target.wrench(stamp)))

    def describe(self, q: Array, u: Array, snapshot: TaskSnapshot) -> TaskDescription:
        """Return the wrench of the law at a state, and what is at its limit."""
        assert snapshot.desired is not None
        twist, wrench = snapshot.detail
        state = self.law.state(q, u, snapshot.desired, twist)
        saturated = []
        for what, scale in zip(('force', 'moment'), state.spring_scale):
            if scale < 1.0:
                saturated.append(f'{what} of the spring')
        if state.effort_scale < 1.0:
            saturated.append('effort of the task')
        if state.speed_scale < 1.0 or state.braking > 0.0:
            saturated.append('speed of the joints')
        if state.regularization > 0.0:
            saturated.append('singular configuration')
        for what, part, limit in (('speed', twist[:3], self._fastest[0]),
                                  ('angular speed', twist[3:], self._fastest[1])):
            if np.sqrt(part @ part) > NEAR * limit:
                saturated.append(f'{what} of the target')
        total = in_world(self._rotation(snapshot.desired), state.wrench)
        if wrench is not None:
            total = total + wrench
        return TaskDescription(total, tuple(saturated))

    def _rotation(self, desired: Array) -> Array:
        """Return the axes of the law as columns, in the world, for a desired pose."""
        if self._axes == 'world':
            return np.eye(3)
        if self._axes == 'frame':
            return desired[:3, :3]
        model = self._robot.model
        reference = model.frame(self._axes)
        if reference.body == WORLD:
            return reference.rotation
        return desired[:3, :3] @ model.frame(self.frame).rotation.T @ reference.rotation


def in_world(rotation: Array, six: Array) -> Array:
    """Return linear and angular components, (6,), of those in axes."""
    return np.concatenate([rotation @ six[:3], rotation @ six[3:]])
