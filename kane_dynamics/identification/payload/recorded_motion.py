"""The motion of all joints and the generalized forces of a recording of some joints."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Array
from kane_dynamics.control.trajectory_feedforward import LOOP_TOLERANCE
from kane_dynamics.control.trajectory_joints import driving_joints
from kane_dynamics.errors import InputError
from kane_dynamics.identification.payload.payload_rows import actuators
from kane_dynamics.identification.recordings.recording import Recording
from kane_dynamics.loop_tracking.driven_mechanism import mechanism_motion, MechanismMotion
from kane_dynamics.loop_tracking.loop_tracker import velocity_rows
from kane_dynamics.robot.robot import Robot
import numpy as np


def recorded_joints(robot: Robot) -> tuple[str, ...]:
    """
    Return the joints whose motion and torques a recording has: all, or the actuators.

    Raises
    ------
    InputError
        Constraints are not those of positions, or the actuators are not joints.

    """
    rows = velocity_rows(robot)
    if rows:
        raise InputError(f"recording: constraint '{rows[0]}' is one of velocities, and "
                         'the positions of joints do not determine those of the others; '
                         'expected constraints of positions, or PayloadEstimator.update '
                         'with all positions')
    # As many joints as independent speeds: each has its own torque.
    if robot.n == robot.model.n:
        return robot.joint_names
    # The joints with actuators, whose torques the recording has.
    names = actuators(robot)
    unknown = [name for name in names if name not in robot.joint_names]
    if unknown:
        raise InputError(f"recording: the independent speed '{unknown[0]}' is no joint "
                         'rate; expected Robot(actuated=...) with the joints of the '
                         'recording')
    return names


def recorded_motion(robot: Robot, names: Sequence[str], recording: Recording
                    ) -> tuple[Array, Array, Array, Array, Array]:
    """
    Return q (N, n_q), u, udot, tau (N, n) and t (N,) of a robot for a recording of joints.

    Raises
    ------
    InputError, ConstraintError
        As `mechanism_motion`; or, of more actuators than independent speeds, one
        contradicts the loops that the others close.

    """
    motion = recorded_states(robot, names, recording)
    torques = np.zeros((len(recording), robot.model.n))
    torques[:, list(map(robot.joint_names.index, names))] = recording.tau
    return *motion, robot.generalized_force(torques, motion.q,
                                            t=recording.t), recording.t


def recorded_states(robot: Robot, names: Sequence[str],
                    recording: Recording) -> MechanismMotion:
    """
    Return q (N, n_q), u and udot (N, n) of a robot for a recording of joints.

    Raises
    ------
    InputError, ConstraintError
        As `recorded_motion`.

    """
    state = recording.q, recording.u, recording.udot
    if robot.equations.in_joint_rates:
        return MechanismMotion(*state)
    # Of more joints than degrees of freedom, some drive the others.
    driving = list(range(len(names)))
    if len(names) > robot.n:
        driving = _driving(robot, names)
    of_driving = [values[:, driving] for values in state]
    motion = mechanism_motion(robot, [names[k] for k in driving], recording.t,
                              *of_driving)
    # The joints that do not drive must agree with those that do.
    places = list(map(robot.joint_names.index, names))
    apart = np.abs(motion.q[:, places] - recording.q)
    k, j = divmod(int(apart.argmax()), len(names))
    if apart[k, j] > LOOP_TOLERANCE:
        raise InputError(f"recording: '{names[j]}' at {recording.q[k, j]:.4g} rad or m "
                         f'at {recording.t[k]:.4g} s; expected '
                         f'{motion.q[k, places[j]]:.4g}, which '
                         f'follows from the other joints, within {LOOP_TOLERANCE:g}')
    return motion


def _driving(robot: Robot, names: Sequence[str]) -> list[int]:
    """Return the actuators that drive the others, where there are more than speeds."""
    wanted = driving_joints(robot)
    if not set(wanted) <= set(names):
        raise InputError(f'recording: of {", ".join(names)}; expected the joints that '
                         f'drive the others, {", ".join(wanted)}, among the actuators '
                         '(Robot(independent=...))')
    return list(map(names.index, wanted))
