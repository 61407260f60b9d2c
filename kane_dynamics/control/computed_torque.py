"""Computed torque on a desired motion, for simulations."""

from dataclasses import dataclass
from typing import Any
import warnings

from kane_dynamics._util.attribute_hints import fixed
from kane_dynamics._util.checks import per_joint
from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion
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

    Parameters
    ----------
    robot : Robot
        The simulated robot. The former order (motion, kp, kd) still works, with a
        DeprecationWarning.
    motion : Motion
        Motion of the robot's joints, in their order.
    kp : float or (n,) array_like
        1/s^2, finite, not negative; default: 100.
    kd : float or (n,) array_like
        1/s, finite, not negative; default: 20.

    Raises
    ------
    InputError
        Names the argument, or the gain, the joint and the value.

    """

    robot: Robot | None
    motion: Motion
    kp: Array
    kd: Array

    def __init__(self, robot: Robot | Motion, motion: Motion | ArrayLike | None = None,
                 kp: ArrayLike | None = None, kd: ArrayLike | None = None) -> None:
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
        else:
            raise InputError(f'robot: a {type(robot).__name__}; expected a Robot: the order is '
                             '(robot, motion, kp, kd)')
        if not isinstance(motion, Motion):
            raise InputError(f'motion: a {type(motion).__name__}; expected a Motion: the order is '
                             '(robot, motion, kp, kd)')
        if simulated is not None and motion.joint_names != simulated.joint_names:
            raise InputError(f'motion: of the joints {list(motion.joint_names)}; expected '
                             f'{list(simulated.joint_names)}')
        if simulated is not None:
            warn_of_degrees(simulated, motion.positions, 'motion')
        freeze(self, 'robot', simulated)
        freeze(self, 'motion', motion)
        for name, gain, default in (('kp', kp, KP), ('kd', kd, KD)):
            freeze(self, name, per_joint(default if gain is None else gain, name,
                                         motion.joint_names))
