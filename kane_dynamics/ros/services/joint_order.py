"""The joint order of a request, and loop closure of its positions."""

from collections.abc import Sequence
from dataclasses import dataclass

from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import difference
from kane_dynamics.mechanics.constraints.loop_closure import NEARLY_CLOSED
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, Index, order
import numpy as np

# Rad, or lengths of the mechanism: by the closure of nearly closed loops
MOST_MOVED = 0.1


@dataclass(frozen=True)
class JointOrder:
    """
    The joint order of a request.

    Attributes
    ----------
    joint_names, speed_names : list of str
        All joints, and the independent joints, in the order of the request. Positions
        are of all joints, other vectors of the independent ones. Without constraints the
        lists are equal.
    joints, speeds : (n_q,) and (n,) arrays of int, or None
        Index of each of the robot's joints in the request; None if the orders are equal.

    """

    joint_names: list[str]
    speed_names: list[str]
    joints: Index | None
    speeds: Index | None

    @classmethod
    def of(cls, robot: Robot, names: Sequence[str]) -> 'JointOrder':
        """
        Return the order that the names of a request give.

        Without names it is the robot's order.
        """
        index = order(names, robot.joint_names, 'joint_names')
        every = list(names) or list(robot.joint_names)
        free = [name for name in every if name in robot.speed_names]
        return cls(every, free, index, order(free, robot.speed_names, 'joint_names'))


def close_loops(robot: Robot, q: Array) -> Array:
    """
    Return the configuration near q that satisfies the constraints.

    Without constraints it is q itself.

    The independent joints keep their values. InputError if the constraint residual at q
    is larger than `NEARLY_CLOSED`, rad or lengths of its loop, or if the loops close
    further than `MOST_MOVED` away, rad or lengths of the mechanism.
    """
    residual = np.abs(robot.constraint_residual(q))
    if not residual.any():
        return q
    # A request is rounded, so that its loops may be open by a little; farther ones are
    # another configuration.
    in_units = residual / robot.mechanism.closure_units
    if not in_units.max() <= NEARLY_CLOSED:
        worst = int(in_units.argmax())
        raise InputError(f'position: residual {residual[worst]:.3g} m or rad of '
                         'constraint '
                         f"'{robot.constraint_names[worst]}'; expected at most "
                         f'{NEARLY_CLOSED * robot.mechanism.closure_units[worst]:.3g}')
    # The independent coordinates stay as requested, the others follow.
    closed = robot.closed_configuration(q, fixed=robot.speed_names, start=q)
    moved = np.abs(difference(robot.model, q, closed))
    units = robot.mechanism.units
    if not (moved / units).max() <= MOST_MOVED:
        k = int((moved / units).argmax())
        raise InputError(f"position: closing the loops moves '{robot.joint_names[k]}' by "
                         f'{moved[k]:.3g} rad or m; expected at most {MOST_MOVED:g} rad, '
                         'or lengths of the mechanism')
    return closed
