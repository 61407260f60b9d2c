"""
The numbers of `commands` in the form that drives take: effort, MIT, or position with offset.

effort
    torque / scale.
position_offset
    The desired position plus torque / stiffness, for a servo of this stiffness; without a
    command the measured position, so that the servo holds where it is.
mit
    Five rows of all joints: desired position and velocity, stiffness, damping, and torque.
    The drive adds stiffness * (q_d - q) + damping * (u_d - u) to the torque. Without a
    command the torque and the stiffness are zero, and the damping acts on the velocity.

The desired position is that of the motion, or of the first state without one, in mode
inverse_dynamics, whose feedback is the drive's. Other modes compute the whole torque: there
the desired position is the measured one, and stiffness and damping of `mit` are zero.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.parameter_checks import per_joint
import numpy as np

EFFORT, MIT, POSITION = 'effort', 'mit', 'position_offset'
ROWS = {EFFORT: 1, MIT: 5, POSITION: 1}


class Reference(NamedTuple):
    """Measured positions and rates, and desired ones, (n,) each; None: the measured ones."""

    q: Array
    u: Array
    desired: tuple[Array, Array] | None = None


class CommandForm:
    """
    Converts torques to commands, and commands to the torques of the drives.

    Parameters
    ----------
    robot : Robot
    commanded : sequence of int
        Indices of the joints with actuators.
    values : mapping
        Parameters commands.form, commands.stiffness, commands.damping, efforts.scale.

    Raises
    ------
    InputError
        A parameter does not fit the form or the robot.

    """

    def __init__(self, robot: Robot, commanded: Sequence[int],
                 values: Mapping[str, Any]) -> None:
        names = [robot.joint_names[k] for k in commanded]
        self.kind: str = values['commands.form']
        self.count = ROWS[self.kind] * len(names)
        self.scale = effort_scale(values, names)
        self.stiffness = per_joint(values, 'commands.stiffness', names, np.nan)
        self.damping = per_joint(values, 'commands.damping', names, 0.0)
        places = list(commanded)
        if self.kind == EFFORT:
            return
        if not robot.equations.in_joint_rates:
            raise InputError(f"parameter 'commands.form': {self.kind} of an arm with closed "
                             'loops or chosen speeds; expected effort')
        if not (self.stiffness > 0.0).all():
            raise InputError(f"parameter 'commands.stiffness': "
                             f'{values["commands.stiffness"].tolist()}; expected the '
                             f'positive stiffness of the drives for {self.kind}, N m/rad')
        self.lower = np.asarray(robot.limits.lower)[places]
        self.upper = np.asarray(robot.limits.upper)[places]

    @property
    def plain(self) -> bool:
        """Return whether commands are the torques themselves."""
        return self.kind == EFFORT and bool((self.scale == 1.0).all())

    def numbers(self, tau: Array, at: Reference, effort_limit: Array, *,
                acting: bool) -> Array:
        """
        Return the numbers of a command, (count,).

        Parameters
        ----------
        tau : (n,) array
            Torques within their limits, N m or N.
        at : Reference
            Measured and desired state.
        effort_limit : (n,) array
            Of the whole torque of a drive, N m or N.
        acting : bool
            Whether the torque is a command; False for the zeros of a stop.

        """
        if self.kind == EFFORT:
            return np.asarray(tau / self.scale)
        if self.kind == MIT:
            return self._mit(tau, at, effort_limit, acting)
        if not acting:
            return at.q.copy()
        target = at.q if at.desired is None else at.desired[0]
        # The servo's torque, stiffness times the distance, stays within the limit.
        reach = effort_limit / self.stiffness
        aim = np.clip(target + tau / self.stiffness, at.q - reach, at.q + reach)
        return np.clip(aim, self.lower, self.upper)

    def _mit(self, tau: Array, at: Reference, effort_limit: Array, acting: bool) -> Array:
        """Return the rows of MIT mode, one after the other."""
        zero = np.zeros_like(tau)
        gain = 1.0 / np.abs(self.scale)
        if not acting:
            return np.concatenate([at.q, zero, zero, self.damping * gain, zero])
        if at.desired is None:
            return np.concatenate([at.q, zero, zero, zero, tau / self.scale])
        q_d, u_d = at.desired
        feedback = self.stiffness * (q_d - at.q) + self.damping * (u_d - at.u)
        total = np.clip(tau + feedback, -effort_limit, effort_limit)
        return np.concatenate([q_d, u_d, self.stiffness * gain, self.damping * gain,
                               (total - feedback) / self.scale])

    def torque(self, numbers: Array, q: Array, u: Array) -> Array:
        """Return the torques, (n,) N m or N, of drives with a command at a state."""
        if self.kind == EFFORT:
            return np.asarray(numbers * self.scale)
        if self.kind == POSITION:
            return np.asarray(self.stiffness * (numbers - q) - self.damping * u)
        q_d, u_d, stiffness, damping, effort = numbers.reshape(5, -1)
        feedback = stiffness * (q_d - q) + damping * (u_d - u)
        return np.asarray(feedback * np.abs(self.scale) + effort * self.scale)


def effort_scale(values: Mapping[str, Any], names: Sequence[str]) -> Array:
    """Return the torque per reported and commanded effort of joints, (n,)."""
    scale = per_joint(values, 'efforts.scale', names, 1.0)
    if not scale.all():
        joint = names[int(np.flatnonzero(scale == 0.0)[0])]
        raise InputError(f"parameter 'efforts.scale' of joint '{joint}': 0; expected the "
                         'torque per effort, N m or N')
    return scale
