"""The parameters of impedance, hand guiding and coupled arms as settings of their laws."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

from kane_dynamics.errors import InputError
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.parameter_checks import per_joint, terms
import numpy as np

EFFORTS_PER_UNIT = 5.0  # joint stiffness by default: effort limits per rad or m
COUPLED = 2.0  # likewise of joints that are coupled with another arm, whose spring adds
SWIFTEST = 50.0  # rad/s: most of sqrt(stiffness / inertia) of them, as states come late
RATIO = 0.7  # damping ratio of coupled joints by default


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
    planes = values['hand_guiding.planes']
    if len(planes) % 4:
        raise InputError(f"parameter 'hand_guiding.planes': {len(planes)} numbers; "
                         'expected four for each plane')
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
            'speed_limit': speed, 'frame_speed': values['hand_guiding.max_frame_speed'],
            'planes': planes.reshape(-1, 4),
            'plane_stiffness': values['hand_guiding.plane_stiffness'],
            'effort_limit': per_joint(values, 'limits.effort', joints, math.inf),
            'friction_error': np.array(list(friction_beyond_model(values, robot).values())),
            **wall_settings(values, robot)}


def coupling_settings(values: Mapping[str, Any], robot: Robot,
                      joints: Sequence[str]) -> dict[str, Any]:
    """
    Return the settings of `ArmCoupling`: parameters coupling.*.

    Parameters
    ----------
    values : mapping
        The node's parameters.
    robot : Robot
        The robot of the torque path.
    joints : sequence of str
        The joints that are coupled.

    Raises
    ------
    InputError
        A list has the wrong length, or the stiffness is not set and a joint has no
        effort limit.

    """
    places = list(map(robot.joint_names.index, joints))
    # The inertia of each joint with the others free. The independent speeds of an arm of
    # the node are rates of the joints that are coupled.
    mobilities = np.diag(np.linalg.inv(robot.mass_matrix(robot.neutral())))
    inertias = dict(zip(robot.speed_names, 1.0 / mobilities))
    inertia = np.array([inertias[name] for name in joints])
    effort = np.asarray(robot.limits.effort, np.float64)[places]
    # No faster than what states of the partner, some periods late, keep steady.
    default = np.minimum(COUPLED * effort, SWIFTEST**2 * inertia)
    default[~np.isfinite(effort)] = np.inf
    stiffness = per_joint(values, 'coupling.stiffness', joints, default)
    if not np.isfinite(stiffness).all():
        joint = joints[int(np.flatnonzero(~np.isfinite(stiffness))[0])]
        raise InputError(f"parameter 'coupling.stiffness': empty, and joint '{joint}' has "
                         'no effort limit; expected one number or one per joint, N m/rad '
                         'or N/m')
    speeds = np.asarray(robot.limits.velocity, np.float64)[places]
    damping = 2.0 * RATIO * np.sqrt(stiffness * inertia)
    settings = {
        'stiffness': stiffness,
        'damping': per_joint(values, 'coupling.damping', joints, damping),
        'scale': per_joint(values, 'coupling.scale', joints, 1.0),
        'force_limit': per_joint(values, 'coupling.max_force', joints, math.inf),
        'speed_limit': per_joint(values, 'coupling.max_speed', joints, speeds),
        'compensate': terms(values)}
    for name in ('reflection', 'alone', 'timeout', 'ramp', 'align_speed'):
        settings[name] = values[f'coupling.{name}']
    return settings
