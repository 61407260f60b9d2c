"""The joint order of a request, and loop closure of its positions."""

from collections.abc import Sequence
from dataclasses import dataclass

from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, Index, order
import numpy as np

MAX_RESIDUAL = 0.01  # m or rad: tolerance for encoder errors and assembly tolerances


@dataclass(frozen=True)
class JointOrder:
    """
    The joint order of a request.

    Attributes
    ----------
    joint_names, speed_names : list of str
        All joints, and the independent joints, in the order of the request. Positions are of all
        joints, other vectors of the independent ones. Without constraints the lists are equal.
    joints, speeds : (n_q,) and (n,) arrays of int, or None
        Index of each of the robot's joints in the request; None if the orders are equal.

    """

    joint_names: list[str]
    speed_names: list[str]
    joints: Index | None
    speeds: Index | None

    @classmethod
    def of(cls, robot: Robot, names: Sequence[str]) -> 'JointOrder':
        """Return the order that the names of a request give; without names, the robot's order."""
        index = order(names, robot.joint_names, 'joint_names')
        every = list(names) or list(robot.joint_names)
        free = [name for name in every if name in robot.speed_names]
        return cls(every, free, index, order(free, robot.speed_names, 'joint_names'))


def close_loops(robot: Robot, q: Array) -> Array:
    """
    Return the configuration near q that satisfies the constraints; q without constraints.

    Raise InputError if the constraint residual at q is larger than `MAX_RESIDUAL`.
    """
    if not robot.constraint_names:
        return q
    residual = np.nan_to_num(np.abs(robot.constraint_gap(q)))
    if residual.max() > MAX_RESIDUAL:
        name = robot.constraint_names[int(residual.argmax())]
        raise InputError(f'position: residual {residual.max():.3g} m or rad of constraint '
                         f"'{name}'; expected at most {MAX_RESIDUAL:g}")
    return robot.closed_posture(q, fixed=robot.speed_names)
