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
the desired position is the measured one, and stiffness and damping of `mit` are zero. In a
fault, without a valid state, the damping of `mit` acts on the distance from the speed of the
stop.

The torque of a drive at the measured state, feedback included, stays within the limits of
the effort and of the rate.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.parameter_checks import per_joint
import numpy as np

EFFORT, MIT, POSITION = 'effort', 'mit', 'position_offset'
INTERFACES = {EFFORT: ('effort',), POSITION: ('position',),
              MIT: ('position', 'velocity', 'stiffness', 'damping', 'effort')}


class Reference(NamedTuple):
    """
    State and limits of a command.

    Attributes
    ----------
    q, u : (n,) arrays
        Measured positions and rates.
    effort_limit : (n,) array
        Of the whole torque of a drive, N m or N.
    lowest, highest : (n,) arrays
        Torques that the rate limit allows, N m or N.
    desired : pair of (n,) arrays, optional
        Desired positions and rates. Default: the measured ones.
    stop_speed : (n,) array, optional
        Desired rates of a stop without valid states.

    """

    q: Array
    u: Array
    effort_limit: Array
    lowest: Array
    highest: Array
    desired: tuple[Array, Array] | None = None
    stop_speed: Array | None = None


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
        self.interfaces = INTERFACES[self.kind]
        self.count = len(self.interfaces) * len(names)
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

    def numbers(self, tau: Array, at: Reference, *, acting: bool) -> tuple[Array, Array]:
        """
        Return the numbers of a command, (count,), and the torque of the drives, (n,).

        Parameters
        ----------
        tau : (n,) array
            Torques within their limits, N m or N.
        at : Reference
            Measured and desired state, and limits.
        acting : bool
            Whether the torque is a command; False for the zeros of a stop.

        """
        zero = np.zeros_like(tau)
        q_d, u_d = at.desired or (at.q, zero)
        feedback = zero
        if at.desired is not None:
            feedback = self.stiffness * (q_d - at.q)
            if self.kind == MIT:  # the damping of a servo is its own
                feedback = feedback + self.damping * (u_d - at.u)
        total = np.clip(tau + feedback, -at.effort_limit, at.effort_limit)
        total = np.clip(total, at.lowest, at.highest) if acting else zero
        if self.kind == POSITION:
            if not acting:
                return at.q.copy(), zero
            aim = np.clip(at.q + total / self.stiffness, self.lower, self.upper)
            return aim, self.stiffness * (aim - at.q)
        # The rows of MIT mode: position, velocity, stiffness, damping and torque.
        gain = 1.0 / np.abs(self.scale)
        stiffness = damping = zero
        if acting and at.desired is not None:
            stiffness, damping = self.stiffness * gain, self.damping * gain
        elif not acting:
            damping = self.damping * gain
        elif at.stop_speed is not None:
            u_d, damping = at.stop_speed, self.damping * gain
        rows = [q_d, u_d, stiffness, damping, (total - feedback) / self.scale]
        return np.concatenate(rows), total

    def without_state(self) -> Array | None:
        """
        Return the numbers of a stop while the position is unknown; None for no command.

        A position servo then keeps its last goal, and holds.
        """
        if self.kind == POSITION:
            return None
        rows = np.zeros((len(self.interfaces), len(self.scale)))
        if self.kind == MIT:
            rows[3] = self.damping / np.abs(self.scale)
        return rows.ravel()

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
