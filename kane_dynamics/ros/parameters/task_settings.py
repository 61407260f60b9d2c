"""The parameters of impedance and hand guiding as settings of their laws."""

from collections.abc import Mapping
import math
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.parameter_checks import per_joint, terms
import numpy as np

EFFORTS_PER_UNIT = 5.0  # joint stiffness by default: effort limits per rad or m


def controlled_frame(values: Mapping[str, Any], model: Model) -> str:
    """Return the controlled frame: cartesian.frame, else tip, else the last link."""
    tip = values['tip'] and values['prefix'] + values['tip']
    return str(values['cartesian.frame'] or tip or model.bodies[-1].name)


def differ(settings: Mapping[str, Any], others: Mapping[str, Any]) -> bool:
    """Return whether two records of settings differ."""
    if settings.keys() != others.keys():
        return True
    return any(not np.array_equal(value, others[name])
               for name, value in settings.items())


def wall_settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """Return the settings of the walls before the joint limits; None for a default."""
    settings: dict[str, Any] = {}
    for name in ('margin', 'stiffness'):
        stated = values[f'walls.{name}']
        settings[f'limit_{name}'] = None
        if stated.size:
            settings[f'limit_{name}'] = per_joint(values, f'walls.{name}',
                                                  robot.joint_names, 0.0)
    return settings


def joint_stiffness(values: Mapping[str, Any], robot: Robot) -> Array:
    """
    Return parameter joint_impedance.stiffness, (n_q,), N m/rad or N/m.

    Raises
    ------
    InputError
        It has the wrong length, or it is not set and a joint has no effort limit.

    """
    # By default so stiff that the whole effort belongs to a small deflection.
    name = 'joint_impedance.stiffness'
    joints = robot.joint_names
    limits = np.asarray(robot.limits.effort, dtype=np.float64)
    stiffness = per_joint(values, name, joints, EFFORTS_PER_UNIT * limits)
    if not np.isfinite(stiffness).all():
        joint = joints[int(np.flatnonzero(~np.isfinite(stiffness))[0])]
        raise InputError(f"parameter '{name}': empty, and joint '{joint}' has no effort "
                         'limit; expected one number or one per joint, N m/rad or N/m')
    return stiffness


def damping_settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Array | None]:
    """
    Return the settings of damping of `JointImpedance`, (n_q,): the stated one or a ratio.

    The other one is None.
    """
    joints = robot.joint_names
    if values['joint_impedance.damping'].size:
        damping = per_joint(values, 'joint_impedance.damping', joints, 0.0)
        return {'damping': damping, 'damping_ratio': None}
    ratio = per_joint(values, 'joint_impedance.damping_ratio', joints, 0.0)
    return {'damping': None, 'damping_ratio': ratio}


def cartesian_settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """
    Return the settings of the Cartesian impedance that may change live.

    The posture is left out where the parameter is empty.
    """
    if (values['cartesian.stiffness'] < 0.0).any():
        raise InputError("parameter 'cartesian.stiffness': "
                         f'{values["cartesian.stiffness"].tolist()}; expected six '
                         'numbers of at least 0')
    # Parameters in the words of the law.
    joints = robot.joint_names
    settings = {
        'stiffness': values['cartesian.stiffness'],
        'damping_ratio': values['cartesian.damping_ratio'],
        'posture_stiffness': per_joint(values, 'cartesian.posture_stiffness', joints,
                                       0.0),
        'null_damping': values['cartesian.null_damping'],
        'force_limit': values['cartesian.max_force'],
        'moment_limit': values['cartesian.max_moment'],
        'effort_limit': per_joint(values, 'limits.effort', joints, math.inf),
        'compensate': terms(values)}
    if values['cartesian.posture'].size:
        posture = per_joint(values, 'cartesian.posture', joints, 0.0)
        limits = robot.limits
        for joint, value, low, high in zip(joints, posture, limits.lower, limits.upper):
            if not low <= value <= high:
                raise InputError(f"parameter 'cartesian.posture': {value:.4g} for joint "
                                 f"'{joint}'; expected {low:.4g} to {high:.4g}, its "
                                 'position limits')
        settings['posture'] = posture
    return settings | wall_settings(values, robot)


def target_limits(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the limits of the target, as arguments of `PoseFilter`."""
    return {'linear_speed': values['target.max_speed'],
            'angular_speed': values['target.max_angular_speed'],
            'linear_acceleration': values['target.max_acceleration'],
            'angular_acceleration': values['target.max_angular_acceleration']}


def friction_beyond_model(values: Mapping[str, Any], robot: Robot) -> dict[str, Array]:
    """
    Return the numbers of `FrictionError` from observer.friction.*, (n,) each.

    Raise InputError if a list has the wrong length.
    """
    joints = robot.speed_names
    numbers = {}
    for name in ('coulomb', 'damping', 'offset'):
        numbers[name] = per_joint(values, f'observer.friction.{name}', joints, 0.0)
    numbers['friction_speed'] = per_joint(values, 'observer.friction.speed', joints, 0.0)
    return numbers


def guiding_settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """
    Return the settings of hand guiding that may change live.

    The rows of the friction error are those of `friction_beyond_model`. Friction is left
    to an arm that compensates it itself.
    """
    joints = robot.joint_names
    # Friction that the arm does not compensate, guiding does not compensate either.
    friction = values['hand_guiding.friction']
    if not terms(values).friction:
        friction = 0.0
    speed = None
    if values['hand_guiding.max_speed'].size:
        speed = per_joint(values, 'hand_guiding.max_speed', joints, math.inf)
    return {'friction': friction,
            'damping': per_joint(values, 'hand_guiding.damping', joints, 0.0),
            'speed_limit': speed,
            'effort_limit': per_joint(values, 'limits.effort', joints, math.inf),
            'friction_error': np.array(list(friction_beyond_model(values, robot).values())),
            **wall_settings(values, robot)}
