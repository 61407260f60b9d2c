"""Limits that an active arm survives when they are set: torque, speed, time, weight."""

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
FEWEST_PERIODS = 2.0  # of the states, in state_timeout
LARGEST_TILT = 5.0  # m/s^2, by which one request changes the gravity


def check_live_limits(path: TorquePath, robot: Robot, present: Mapping[str, Any],
                      values: Mapping[str, Any], changed: Collection[str]) -> None:
    """
    Raise InputError unless an arm in operation survives new limits.

    Each limit is at least a hundredth of that without the parameter. The effort holds the
    arm where it is; effort and speed do not fall while a motion is followed. A limit that
    does not become smaller is accepted. States do not time out between two of them, and
    the gravity of the model does not jump.

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

    timeout = values['state_timeout']
    needed = min(FEWEST_PERIODS * path.period, present['state_timeout'])
    if 'state_timeout' in changed and timeout < needed:
        raise InputError(f"parameter 'state_timeout': {timeout:.4g} s of an active arm; "
                         f'expected at least {needed:.4g} s, two periods of its states')
    tilt = float(np.linalg.norm(values['gravity'] - present['gravity']))
    if tilt > LARGEST_TILT:
        raise InputError(f"parameter 'gravity': changed by {tilt:.4g} m/s^2 on an active "
                         f'arm; expected at most {LARGEST_TILT:g} m/s^2 in one request')

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
    of_command = terms(values)
    if 'limits.effort' in changed and of_command.gravity:
        force = robot.gravity_force(q)
        if of_command.arm is not None:
            force = force - of_command.arm.force_at(robot, q)
        holding = np.abs(robot.joint_torques(force, q))
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
