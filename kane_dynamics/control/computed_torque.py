"""Computed torque on a desired motion, for simulations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
import warnings

from kane_dynamics._util.attribute_hints import fixed
from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array
from kane_dynamics.control.constrained_law import (followed_joints, motion_columns,
                                                   require_closed, require_rigid)
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.motion.motion import Motion, State
from kane_dynamics.robot.methods.configuration_methods import warn_of_degrees
from kane_dynamics.robot.robot import Robot
from numpy.typing import ArrayLike

KP, KD = 100.0, 20.0  # default gains, 1/s^2 and 1/s: critically damped


@fixed
@dataclass(frozen=True, eq=False, init=False)
class ComputedTorque:
    """
    Computed torque on a desired motion, as a torque source of `simulate`.

    ``tau = ID(q, u, udot_d + kd (u_d - u) + kp (q_d - q))``, with the dynamics of `robot`.

    With chosen speeds or constraints, as many joints as there are independent speeds follow the
    motion, with the errors ``e'' + kd e' + kp e = 0``; see `control.constrained_law`.

    Parameters
    ----------
    robot : Robot
        The simulated robot. The former order (motion, kp, kd) still works, with a
        DeprecationWarning.
    motion : Motion
        Motion of the robot's joints, in their order; or of the followed ones, in theirs.
    kp : float or (n,) array_like
        1/s^2, finite, not negative; default: 100.
    kd : float or (n,) array_like
        1/s, finite, not negative; default: 20.
    followed : sequence of str, optional
        The n joints that follow the motion, in the order of the gains. Default: those of the
        motion if it has n; else those whose rates are the independent speeds, or the n with
        actuators. Robots without chosen speeds or constraints: all.

    Raises
    ------
    InputError
        Names the argument, or the gain, the joint and the value; or the point of a motion of all
        joints that violates a constraint. The robot has beams.

    """

    robot: Robot | None
    motion: Motion
    kp: Array
    kd: Array
    followed: tuple[int, ...]
    columns: list[int]

    def __init__(self, robot: Robot | Motion, motion: Motion | ArrayLike | None = None,
                 kp: ArrayLike | None = None, kd: ArrayLike | None = None, *,
                 followed: Sequence[str] | None = None) -> None:
        """Check the gains; one number applies to all joints."""
        simulated: Robot | None = None
        if isinstance(robot, Motion):
            warnings.warn('ComputedTorque(motion, kp, kd) is deprecated; expected '
                          'ComputedTorque(robot, motion, kp, kd)', DeprecationWarning,
                          stacklevel=2)
            former: Any = (motion, kd if kp is None else kp)
            kp, kd = (kp, kd) if motion is None else former
            motion = robot
        elif isinstance(robot, Robot):
            simulated = robot
            require_angles(robot.model, 'ComputedTorque')
        else:
            raise InputError(f'robot: a {type(robot).__name__}; expected a Robot: the order is '
                             '(robot, motion, kp, kd)')
        if not isinstance(motion, Motion):
            raise InputError(f'motion: a {type(motion).__name__}; expected a Motion: the order is '
                             '(robot, motion, kp, kd)')
        places = columns = list(range(motion.n))
        if simulated is not None:
            places, columns = _followed(simulated, motion, followed)
        freeze(self, 'robot', simulated)
        freeze(self, 'motion', motion)
        freeze(self, 'followed', tuple(places))
        freeze(self, 'columns', columns)
        names = [motion.joint_names[k] for k in columns]
        for name, gain, default in (('kp', kp, KP), ('kd', kd, KD)):
            freeze(self, name, per_joint(default if gain is None else gain, name, names))

    def desired(self, t: Array) -> State:
        """Return q, u, udot of the followed joints at times (K,), s, (K, n) arrays."""
        q, u, udot = self.motion.sample(t)
        if len(self.columns) == self.motion.n:
            return q, u, udot
        return q[:, self.columns], u[:, self.columns], udot[:, self.columns]


def _followed(robot: Robot, motion: Motion, followed: Sequence[str] | None
              ) -> tuple[list[int], list[int]]:
    """Return the indices of the followed joints, and their columns of the motion."""
    require_rigid(robot)
    constrained = not robot.equations.in_joint_rates
    if not constrained and motion.joint_names != robot.joint_names:
        raise InputError(f'motion: of the joints {list(motion.joint_names)}; expected '
                         f'{list(robot.joint_names)}')
    if not constrained and followed is not None:
        raise InputError(f'followed: {list(followed)}; expected None, because all joints of this '
                         'robot follow the motion')
    if constrained and followed is None and motion.n == robot.n:
        followed = motion.joint_names
    places = followed_joints(robot, followed) if constrained else tuple(range(motion.n))
    columns = motion_columns(robot, places, motion.joint_names)
    if motion.n == robot.n_q:
        warn_of_degrees(robot, motion.positions, 'motion', stacklevel=5)
        require_closed(robot, motion.positions, motion.times)
    return list(places), columns
