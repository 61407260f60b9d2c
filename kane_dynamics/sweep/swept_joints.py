"""The joints of a sweep's robot: those that follow, their start, and closed configurations."""

import hashlib

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array
from kane_dynamics.control.computed_torque import followed_joints, motion_columns
from kane_dynamics.errors import ConstraintError, InputError
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion
from kane_dynamics.mechanics.ball_joints import angle_places, neutral, on_unit_quaternions
from kane_dynamics.mechanics.constraints.loop_closure import NEARLY_CLOSED
from kane_dynamics.motion.motion import Motion
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.robot.robot import Robot
import numpy as np


class SweptJoints:
    """
    Which joints have values in the trials of a robot, and which of them follow.

    Parameters
    ----------
    robot : Robot
    motion : Motion or None
        The desired motion; None for rest.

    """

    def __init__(self, robot: Robot, motion: Motion | None) -> None:
        """Store the robot."""
        self._robot, self._moves = robot, motion is not None
        self.constrained = not robot.equations.in_joint_rates

    @lazy_property
    def followed(self) -> tuple[int, ...]:
        """Return the indices in q of the joints that follow by computed torque."""
        robot = self._robot
        if robot.model.balls:
            raise InputError('controller: computed_torque with ball joints, whose '
                             'positions are rotations; expected gravity_compensation or '
                             'none')
        return followed_joints(robot)

    @property
    def followed_names(self) -> tuple[str, ...]:
        """Return the names of the joints that follow."""
        return tuple(self._robot.coordinate_names[k] for k in self.followed)

    @property
    def tracked(self) -> tuple[int, ...]:
        """Return the indices in q of the joints with a tracking error; all if none moves."""
        return self.followed if self._moves else tuple(angle_places(self._robot.model))

    @property
    def tracked_names(self) -> tuple[str, ...]:
        """Return the names of the joints with a tracking error."""
        return tuple(self._robot.coordinate_names[k] for k in self.tracked)

    def check_motion(self, motion: Motion | None) -> None:
        """Raise InputError unless a motion is of the joints that follow."""
        if motion is None:
            return
        if not self.constrained and motion.joint_names != self._robot.joint_names:
            raise InputError(f'motion: joints {list(motion.joint_names)}; '
                             f'expected {list(self._robot.joint_names)}')
        self.columns(motion)

    def columns(self, motion: Motion) -> list[int]:
        """Return the indices, in a motion, of the joints that follow it."""
        return motion_columns(self._robot, self.followed, motion.joint_names)

    def start(self, motion: Motion | None, t0: float) -> tuple[list[float], list[float]]:
        """Return the usual initial q, (n_q,), and u, (n,)."""
        robot = self._robot
        if motion is not None:
            # The joints that follow begin on the motion, and the loops give the others.
            desired = [x[None, self.columns(motion)] for x in motion.sample(t0)]
            driven = mechanism_motion(robot, self.followed_names, np.array([t0]), *desired)
            return driven.q[0].tolist(), driven.u[0].tolist()
        # A closed loop begins at the robot's configuration, or at the neutral one.
        configuration = robot.configuration
        if configuration is None:
            configuration = neutral(robot.model)
        return np.asarray(configuration).tolist(), [0.0] * robot.n

    def closed(self, q0: Array, t0: float) -> tuple[Array, list[str | None]]:
        """
        Return closed configurations near q0, (N, n_q), and the reasons where none exists.

        Rows without one are NaN. The joints whose rates are independent speeds keep
        their values; the assembly mode is that of q0, if its loops are nearly closed,
        else that of the robot.
        """
        robot = self._robot
        closed = np.array([on_unit_quaternions(robot.model, q) for q in q0])
        errors: list[str | None] = [None] * len(closed)
        # Those without any residual are closed; equal ones are closed once.
        residual = robot.constraint_residual(closed, t=t0)
        is_open = np.flatnonzero(residual.any(axis=1))
        distinct, numbers = np.unique(closed[is_open], axis=0, return_inverse=True)
        numbers = numbers.ravel()
        for k, guess in enumerate(distinct):
            rows = is_open[numbers == k]
            try:
                closed[rows] = self._closed_near(guess, t0)
            except ConstraintError as error:
                # A trial that cannot begin is a row with its reason, and the others go
                # on.
                closed[rows] = np.nan
                for i in rows.tolist():
                    errors[i] = f'q0: {error}'
        return closed, errors

    def _closed_near(self, guess: Array, t0: float) -> Array:
        """Return a closed configuration near a guess, (n_q,), as `closed`."""
        robot = self._robot
        fixed = [name for name in robot.speed_names if name in robot.coordinate_names]
        residual = robot.constraint_residual(guess, t=t0) / robot.mechanism.closure_units
        nearly_closed = np.abs(residual).max(initial=0.0) <= NEARLY_CLOSED
        start = guess if fixed and nearly_closed else None
        return robot.closed_configuration(guess, t=t0, fixed=fixed, start=start)


def robot_digest(robot: Robot) -> str:
    """Return a hash of the equations of a robot, its gravity and its limits."""
    key = robot.kernels.key
    if key is None:  # functions of the user: what they compute
        key = module_text(robot.kernels.program('forward_dynamics'), 'robot')
    limits = robot.limits
    numbers = [robot.parameters.gravity, limits.lower, limits.upper, limits.velocity,
               limits.effort]
    text = key + repr([np.asarray(x).tolist() for x in numbers])
    return hashlib.sha256(text.encode()).hexdigest()
