"""The commands `jacobian` and `inverse-kinematics`."""

from argparse import Namespace

from kane_dynamics.cli.printing import print_json, print_table, without_rounding
from kane_dynamics.cli.robot_options import load_robot, positions
from kane_dynamics.kinematics import (inverse_kinematics, pose_from, rotation_quaternion,
                                      rotation_rpy)
from kane_dynamics.robot.methods.frame_methods import DIRECTIONS
import numpy as np


def jacobian(options: Namespace) -> None:
    """Print pose and Jacobian of a frame."""
    _, robot = load_robot(options)
    robot.model.frame(options.frame)  # an unknown frame is an error before any message
    q = positions(options, 'q', robot)
    pose = robot.frame_pose(options.frame, q)
    J = robot.jacobian(options.frame, q, axes=options.axes)
    position = pose[:3, 3]
    rotation = pose[:3, :3]
    rpy = rotation_rpy(rotation)
    singular_values = np.asarray(np.linalg.svd(J, compute_uv=False), dtype=np.float64)
    if options.json:
        print_json({'coordinate_names': robot.coordinate_names, 'q': q, 'pose': pose,
                    'rpy': rpy, 'quaternion': rotation_quaternion(rotation),
                    'speed_names': robot.speed_names, 'jacobian': J,
                    'singular_values': singular_values})
        return
    # Pose, Jacobian by columns, and how near a singular configuration is.
    print(f'{options.frame}: at {_listed(without_rounding(position))} m, roll, pitch, '
          f'yaw {_listed(without_rounding(rpy, 1.0))} rad')
    columns = without_rounding(J).T
    print_table([f'{options.axes} axes', *DIRECTIONS],
                [[name, *column] for name, column in zip(robot.speed_names, columns,
                                                         strict=True)])
    shown = ', '.join(f'{value:.4g}' for value in without_rounding(singular_values))
    print(f'singular values: {shown}')


def inverse(options: Namespace) -> int:
    """Print joint positions at which a frame has a pose; return 1 if there are none."""
    _, robot = load_robot(options)
    robot.model.frame(options.frame)
    target = pose_from(options.position, rpy=options.rpy, quaternion=options.quaternion)
    if options.rpy is None and options.quaternion is None:
        target = target[:3, 3]  # any orientation will do
    start = positions(options, 'q0', robot)
    # The nearest configuration found, also where it does not reach the pose.
    result = inverse_kinematics(robot, options.frame, target, start)
    distance = float(np.linalg.norm(result.error[:3]))
    angle = float(np.linalg.norm(result.error[3:]))
    if options.json:
        print_json({'coordinate_names': robot.coordinate_names, 'q': result.q,
                    'converged': result.converged, 'distance': distance, 'angle': angle,
                    'iterations': result.iterations})
    else:
        print_table(['coordinate', 'q'], zip(robot.coordinate_names, result.q,
                                             strict=True))
        if not result.converged:
            print(f'not reached: {distance:.4g} m and {angle:.4g} rad remain, at the '
                  'closest configuration within the limits that was found')
    return 0 if result.converged else 1


def _listed(numbers: np.ndarray) -> str:
    """Return numbers as text."""
    return ', '.join(f'{number + 0.0:.6g}' for number in numbers)
