"""The torque breakdown, by source and by body, as a message."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.analysis.power_balance import power_balance
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array, doubles, Index
from kane_dynamics_interfaces.msg import TorqueExplanation
import numpy as np


def explanation_message(robot: Robot, state: Sequence[Array], wrench: Array | None,
                        names: Sequence[str],
                        index: Index | None = None) -> TorqueExplanation:
    """
    Return the torque breakdown of a motion.

    Parameters
    ----------
    robot : Robot
        A robot of the calling thread.
    state : three (n,) arrays
        q, u, udot in the robot's order.
    wrench : (k, 6) array or None
        As in `Robot.inverse_dynamics`.
    names : sequence of str
        Joint names in the order of the response.
    index : (n,) array of int, optional
        Index of each of the robot's joints in `names`; default: the same order.

    """
    # Columns in the order of the request, if it names joints.
    def table(rows: Array) -> Any:
        if index is None:
            return doubles(rows)
        ordered = np.empty_like(rows)
        ordered[:, index] = rows
        return doubles(ordered)
    q, u, udot = state
    why = robot.explain(q, u, udot, wrench=wrench)
    power = power_balance(robot, q, u, udot, wrench=wrench)
    return TorqueExplanation(
        joint_names=list(names), sources=list(why.sources),
        by_source=table(why.by_source),
        bodies=list(why.bodies), by_body=table(why.by_body), joint_power=power.joints,
        external_power=power.external, friction_power=power.friction,
        energy_rate=power.energy_rate, power_residual=power.residual)
