"""Limits that an active arm survives when they are set: it needs torque and speed."""

from collections.abc import Collection, Mapping
import math
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.parameter_checks import per_joint, terms
from kane_dynamics.ros.torque_path.path_controller import rate_limit
from kane_dynamics.ros.torque_path.state_check import speed_limits
from kane_dynamics.ros.torque_path.torque_path import TorquePath
import numpy as np

LIMITS = ('limits.effort', 'limits.velocity', 'limits.rate')
# Of the limit without the parameter: with less, an arm can neither stop nor be observed.
SMALLEST_SHARE = 0.01


def check_live_limits(path: TorquePath, robot: Robot, present: Mapping[str, Any],
                      values: Mapping[str, Any], changed: Collection[str]) -> None:
    """
    Raise InputError unless an arm in operation survives new limits.

    Each limit is at least a hundredth of that without the parameter. The effort holds the
    arm where it is; effort and speed do not fall while a motion is followed. A limit that
    does not become smaller is accepted.

    Parameters
    ----------
    path : TorquePath
        Inactive paths need no check.
    robot : Robot
        With the loads of the path.
    present, values : mapping
        The node's parameters before and after the request.
    changed : collection of str
        Names of the parameters in the request.

    """
    if not path.running:
        return

    def require(name: str, least: Array, what: str) -> None:
        before, after = _limit(name, robot, present), _limit(name, robot, values)
        _require(robot, name, after, np.minimum(before, least), what)

    moving = any(motion is not None for motion in path.active_motion.scheduled)
    for name in LIMITS:
        if name not in changed:
            continue
        default = _limit(name, robot, {**values, name: np.zeros(0)})
        least = np.where(np.isfinite(default), SMALLEST_SHARE * default, 0.0)
        require(name, least, 'a hundredth of the limit without it')
        if moving and name != 'limits.rate':
            require(name, default, 'no smaller limit while a motion is followed')
    q = path.measured()
    u = path.measured_speeds()
    if q is None or u is None:
        return
    if 'limits.velocity' in changed and len(u) == len(robot.joint_names):
        require('limits.velocity', np.abs(u), 'the present speed')
    if 'limits.effort' in changed and terms(values).gravity:
        holding = np.abs(robot.joint_torques(robot.gravity_force(q), q))
        require('limits.effort', holding, 'the torque that holds the arm')


def _limit(name: str, robot: Robot, values: Mapping[str, Any]) -> Array:
    """Return one of the limits for each joint, (n_q,)."""
    if name == 'limits.velocity':
        return speed_limits(robot, values)
    if name == 'limits.rate':
        return rate_limit(values, robot)
    stated = per_joint(values, 'limits.effort', robot.joint_names, math.inf)
    return np.minimum(robot.limits.effort, stated)


def _require(robot: Robot, name: str, limit: Array, least: Array, what: str) -> None:
    """Raise InputError for the first joint whose limit is below the least one."""
    for joint, value, bound in zip(robot.joint_names, limit, least):
        if value < bound:
            raise InputError(f"parameter '{name}': {value:.4g} for joint '{joint}' of an "
                             f'active arm; expected at least {bound:.4g}, {what}')
