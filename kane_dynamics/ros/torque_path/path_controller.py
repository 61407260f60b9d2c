"""The controller of the torque path, as the parameters of the node describe it."""

from collections.abc import Callable, Mapping
import math
from typing import Any

from kane_dynamics.control.computed_torque import joints_that_follow
from kane_dynamics.control.controller import Controller, ModeLaw
from kane_dynamics.control.quasi_static import rigid_and_bending
from kane_dynamics.control.terms import Mode
from kane_dynamics.model.elastic_model import with_rigid_joints
from kane_dynamics.model.model import Model
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.configuration_files import robot_options
from kane_dynamics.ros.common.conversion import Array
from kane_dynamics.ros.parameters.parameter_checks import controller_settings, per_joint
from kane_dynamics.ros.torque_path.closed_loop_reader import commanded_joints
import numpy as np

RISE = 0.05  # s


def path_controller(model: Model, values: Mapping[str, Any],
                    laws_of: Callable[[Robot], Mapping[Mode, ModeLaw]] | None = None
                    ) -> Controller:
    """
    Return the controller of a model, with the model whose links are rigid as its robot.

    Its commands include the quasi-static deflection of flexible links. Elastic joints are
    rigid for it; their limits are those of the motors.

    Parameters
    ----------
    model : Model
        Of the arm, with beams and drives or without.
    values : mapping
        The node's parameters.
    laws_of : callable, optional
        Returns the laws of further modes of the robot.

    Raises
    ------
    KaneError
        A parameter does not fit the model.

    """
    # Elastic joints are controlled as rigid ones, with the limits of their motors.
    rigid = with_rigid_joints(model) if model.drives else model
    robot, bending = rigid_and_bending(rigid, robot_options(values))
    laws: Mapping[Mode, ModeLaw] = {}
    if laws_of is not None:
        laws = laws_of(robot)
    return Controller(robot, bending=bending, laws=laws, **path_settings(values, robot))


def path_settings(values: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """
    Return the settings of the controller.

    The gains are those of the joints that follow.
    """
    settings = controller_settings(values, robot.joint_names)
    follow = list(joints_that_follow(robot))
    gains = {name: settings[name][follow] for name in ('kp', 'kd')}
    # What a joint without a motor would need is not commanded, so that nothing limits it.
    commanded = list(commanded_joints(robot, [robot.joint_names[k] for k in follow]))
    limits = {'effort_limit': settings['effort_limit'],
              'rate_limit': rate_limit(values, robot)}
    for name, stated in limits.items():
        limits[name] = np.full(len(stated), math.inf)
        limits[name][commanded] = stated[commanded]
    return settings | gains | limits


def rate_limit(values: Mapping[str, Any], robot: Robot) -> Array:
    """
    Return the limit of the rate of effort of each joint, (n,) N m/s or N/s.

    It is parameter limits.rate, or else that with which an effort grows from zero to its
    limit within `RISE`; joints without an effort limit have none.
    """
    joints = robot.joint_names
    effort = np.minimum(robot.limits.effort, per_joint(values, 'limits.effort', joints,
                                                       math.inf))
    return per_joint(values, 'limits.rate', joints, effort / RISE)
