"""The tolerances of a goal, by the rules of joint_trajectory_controller."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.ros.common.conversion import (Array, JointNamesError, NANO,
                                                 nanoseconds)
from kane_dynamics.ros.parameters.parameter_checks import per_joint
import numpy as np

DEFAULT, NONE = 0.0, -1.0  # special values of a tolerance
QUANTITIES = ('position', 'velocity', 'acceleration')


@dataclass(frozen=True, eq=False)
class StateTolerance:
    """
    Largest errors of the joints that follow a motion.

    Each is an (n,) array, infinite for none: rad or m, and s.
    """

    position: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True, eq=False)
class GoalTolerances:
    """
    The tolerances of a goal.

    Attributes
    ----------
    path, goal : StateTolerance
        During the motion, and after its end.
    time : float
        s after the end of the motion in which the goal must be reached; infinite for
        any.

    """

    path: StateTolerance
    goal: StateTolerance
    time: float


def goal_tolerances(message: Any, joints: Sequence[str],
                    every_joint: Sequence[str],
                    values: Mapping[str, Any]) -> GoalTolerances:
    """
    Return the tolerances of a goal; those that it does not state are the parameters'.

    Parameters
    ----------
    message : FollowJointTrajectory.Goal
        The goal.
    joints : sequence of n str
        The joints that follow motions.
    every_joint : sequence of str
        The robot's joints, in the order of the parameters.
    values : mapping
        The node's parameters; trajectory.* are used.

    Raises
    ------
    JointNamesError
        A tolerance is of a joint that does not follow motions.
    InputError
        A tolerance is negative, other than -1, or not a number, or a joint has two.

    """
    places = list(map(list(every_joint).index, joints))
    none = np.full(len(joints), math.inf)

    # Tolerances of the parameters are in the robot's order of joints.
    def parameter(name: str) -> Array:
        return per_joint(values, name, every_joint, math.inf)[places]

    path = StateTolerance(parameter('trajectory.path_tolerance'), none, none)
    goal = StateTolerance(parameter('trajectory.goal_tolerance'),
                          np.full(len(joints), values['trajectory.stopped_speed']), none)
    seconds = nanoseconds(message.goal_time_tolerance) / NANO
    return GoalTolerances(
        _stated(message.path_tolerance, 'path_tolerance', joints, path),
        _stated(message.goal_tolerance, 'goal_tolerance', joints, goal),
        _resolved(seconds, values['trajectory.goal_time'], 'goal_time_tolerance'))


def _stated(entries: Sequence[Any], field: str, joints: Sequence[str],
            defaults: StateTolerance) -> StateTolerance:
    """Return the tolerances of the entries of a goal, and defaults for other joints."""
    columns = [getattr(defaults, quantity).copy() for quantity in QUANTITIES]
    named: set[str] = set()
    # An entry replaces the defaults of one joint.
    for entry in entries:
        name = entry.name
        if name not in joints:
            raise JointNamesError(f"{field}: '{name}'; expected joints of "
                                  f'{", ".join(joints)}')
        if name in named:
            raise InputError(f"{field}: '{name}' twice; expected each joint once")
        named.add(name)
        # Newer releases of control_msgs have this field.
        effort = getattr(entry, 'effort', DEFAULT)
        if effort not in (DEFAULT, NONE):
            raise InputError(f"{field} of '{name}': effort {effort:g}; expected 0 or -1, "
                             'because efforts are not compared')
        j = list(joints).index(name)
        for quantity, column in zip(QUANTITIES, columns):
            column[j] = _resolved(getattr(entry, quantity), float(column[j]),
                                  f"{field} of '{name}': {quantity}")
    return StateTolerance(*columns)


def _resolved(value: float, default: float, what: str) -> float:
    """Return a tolerance of the goal, its default for 0, or infinity for -1."""
    if value == DEFAULT:
        return default
    if value == NONE:
        return math.inf
    if value > 0.0:
        return value
    raise InputError(f'{what} {value:g}; expected a positive number, 0 for the default, '
                     'or -1 for none')
