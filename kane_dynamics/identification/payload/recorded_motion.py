"""The motion of all joints and the generalized forces of a recording of some joints."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.identification.payload.payload_rows import actuators
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.kinematics.mechanism_motion import mechanism_motion, velocity_rows
from kane_dynamics.mechanics.constraints.constrained_equations import ConstrainedEquations
from kane_dynamics.robot.robot import Robot
import numpy as np


def recorded_joints(robot: Robot) -> tuple[str, ...]:
    """
    Return the joints whose motion and torques a recording has: all, or with constraints actuators.

    Raises
    ------
    InputError
        Constraints are not those of positions, or the actuators are not joints, as many as
        independent speeds.

    """
    if not robot.constraint_names:
        return robot.joint_names
    rows = velocity_rows(robot)
    if rows:
        raise InputError(f"recording: constraint '{rows[0]}' is one of velocities, and the "
                         'positions of joints do not determine those of the others; expected '
                         'constraints of positions, or PayloadEstimator.update with all positions')
    names = actuators(robot)
    unknown = [name for name in names if name not in robot.joint_names]
    if unknown:
        raise InputError(f"recording: the independent speed '{unknown[0]}' is no joint rate; "
                         'expected Robot(actuated=...) with the joints of the recording')
    return names


def recorded_motion(robot: Robot, names: Sequence[str], recording: Recording
                    ) -> tuple[Array, Array, Array, Array, Array]:
    """
    Return q (N, n_q), u, udot, tau (N, n) and t (N,) of a robot for a recording of joints.

    Raises
    ------
    InputError, ConstraintError
        As `mechanism_motion`.

    """
    state = recording.q, recording.u, recording.udot
    if not isinstance(robot.equations, ConstrainedEquations):
        return *state, recording.tau, recording.t
    motion = mechanism_motion(robot, names, recording.t, *state)
    torques = np.zeros((len(recording), robot.model.n))
    torques[:, [robot.joint_names.index(name) for name in names]] = recording.tau
    return *motion, robot.generalized_force(torques, motion.q, t=recording.t), recording.t
