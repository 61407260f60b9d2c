"""Fill in trajectories for joint_trajectory_controller."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics.control.terms import Terms
from kane_dynamics.control.trajectory_feedforward import (fill_trajectory,
                                                          FilledTrajectory)
from kane_dynamics.errors import InputError
from kane_dynamics.motion.motion import Motion
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import (Array, message_of_points,
                                                 nanoseconds, point_columns)
from kane_dynamics.ros.parameters.parameter_checks import per_joint, terms
from kane_dynamics.ros.services.motion_check import refuse_impossible
from kane_dynamics.ros.services.served_robot import ServedRobot
from trajectory_msgs.msg import JointTrajectory


@dataclass(frozen=True)
class FillSettings:
    """
    Settings of filled trajectories.

    They are the parameters feedforward.*, arm_compensates and limits.effort.

    Attributes
    ----------
    compensate : Terms
    effort_limit : (n,) array
        N m or N, in addition to that of the robot.
    tolerance : (n,) array or None
        Largest error of the interpolated effort, N m or N; None if not set.
    clip : bool
        Clamp efforts instead of rejecting a trajectory.

    """

    compensate: Terms
    effort_limit: Array
    tolerance: Array | None
    clip: bool

    @classmethod
    def from_values(cls, values: Mapping[str, Any],
                    joints: Sequence[str]) -> 'FillSettings':
        """
        Return the settings of the parameters.

        Raise InputError if one does not fit.
        """
        tolerance = None
        if values['feedforward.tolerance'].size:
            tolerance = per_joint(values, 'feedforward.tolerance', joints, 0.0)
        return cls(compensate=terms(values), tolerance=tolerance,
                   effort_limit=per_joint(values, 'limits.effort', joints, math.inf),
                   clip=values['feedforward.clip'])


def filled_message(served: ServedRobot, message: JointTrajectory) -> JointTrajectory:
    """
    Return a JointTrajectory with all fields filled in.

    Raise InputError if invalid.

    An empty trajectory, which ends the motion of the controller, is returned unchanged.
    """
    if not message.points:
        return message
    # A trajectory that starts on receipt begins where the arm is, which is checked
    # then.
    names = message.joint_names
    columns = point_columns(message, names, served.values['trajectory.max_points'])
    on_receipt = not nanoseconds(message.header.stamp)
    _refuse_impossible(served, names, columns, executed=on_receipt)
    filled = _filled(served, names, columns)
    answer = message_of_points(filled.joint_names, filled.times, {
        'positions': filled.positions, 'velocities': filled.velocities,
        'accelerations': filled.accelerations, 'effort': filled.efforts})
    answer.header = message.header
    return answer


def _refuse_impossible(served: ServedRobot, names: Sequence[str], points: Sequence[Any],
                       executed: bool) -> None:
    """
    Raise InputError unless the arm can move like that.

    `fill_trajectory` refuses other faults.

    Where the motion sets out is judged only if it is executed on receipt.
    """
    joints = served.robot.joint_names
    if not set(names) <= set(joints):
        return
    # From the measured positions, if there are any: at the speeds that are stated.
    measured = served.measured()
    place: Array | None = None
    start = None
    if measured is not None:
        place = measured[list(map(joints.index, names))]
        start = place, None, None
    motion = Motion.from_points(*points, joint_names=names, start=start)
    if not executed or place is None:
        refuse_impossible(served, motion)
        return
    # A motion that is executed on receipt begins at the speed of the arm, too.
    rates: Array | None = None
    speeds = served.measured_speeds()
    if measured is not None and speeds is not None:
        rates = served.robot.joint_rates(measured, speeds)
        rates = rates[list(map(joints.index, names))]
    refuse_impossible(served, motion, place, speeds=rates)


def _filled(served: ServedRobot, names: Sequence[str], points: Sequence[Any]
            ) -> FilledTrajectory:
    """
    Return a filled trajectory.

    Parameters
    ----------
    served : ServedRobot
        The robot, its loads, and the parameters.
    names : sequence of m str
        The joints of the columns.
    points : (K,) and three (K, m) arrays
        Times, positions, velocities and accelerations; the last two may be None.

    """
    joints = served.robot.joint_names
    settings = FillSettings.from_values(served.values, joints)
    index = [joints.index(name) for name in names if name in joints]
    all_known = len(index) == len(names)  # `fill_trajectory` refuses unknown joints
    tolerance = None
    if settings.tolerance is not None and all_known:
        tolerance = settings.tolerance[index]
    # A first point later than 0 s: the motion sets out from where the arm is.
    first_time = points[0][0]
    sets_out = first_time > 0.0
    measured = served.measured()
    if sets_out and measured is None:
        raise InputError(f'point 0: time_from_start {first_time:g} s without a measured '
                         'position; expected 0 s, or an active node that receives joint '
                         'states')
    resting = _resting(served.robot, names, measured)
    start = None
    if sets_out and measured is not None and all_known:
        start = (measured[index], None, None)
    return fill_trajectory(
        served.robot, *points, joint_names=names, rest=resting, start=start,
        tolerance=tolerance, compensate=settings.compensate,
        effort_limit=settings.effort_limit, clip=settings.clip,
        max_points=served.values['trajectory.max_points'], bending=served.bending,
        loop_tolerance=served.values['closure.tolerance'],
        max_figure=served.values['closure.max_conditioning'])


def _resting(robot: Robot, names: Sequence[str], measured: Array | None) -> Array | None:
    """
    Return where the joints are that a trajectory of joints `names` lacks, (n_q,).

    The result is None if that is not known, and not needed. InputError if joints are
    missing whose positions are not known.
    """
    missing = [name for name in robot.joint_names if name not in names]
    # Loops may close from the configuration of the constraints file.
    if measured is None and missing and robot.configuration is None:
        raise InputError(f'positions of {", ".join(missing)}: not known; expected a '
                         'trajectory of all joints, a `configuration` in the constraints '
                         'file, or an active node that receives joint states')
    return measured
