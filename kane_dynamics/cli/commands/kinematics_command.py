"""The commands `jacobian` and `inverse-kinematics`."""

from argparse import Namespace

from kane_dynamics.cli.commands.inspect_command import print_table
from kane_dynamics.cli.shared import load, positions, print_json, without_rounding
from kane_dynamics.kinematics import (inverse_kinematics, pose_from, rotation_quaternion,
                                      rotation_rpy)
from kane_dynamics.robot.methods.frame_methods import DIRECTIONS
import numpy as np


def jacobian(options: Namespace) -> None:
    """Print pose and Jacobian of a frame."""
    _, robot = load(options)
    robot.model.frame(options.frame)  # an unknown frame is an error before any message
    q = positions(options, 'q', robot)
    pose = robot.frame_pose(options.frame, q)
    J = robot.jacobian(options.frame, q, axes=options.axes)
    place, turn = pose[:3, 3], pose[:3, :3]
    sizes = np.linalg.svd(J, compute_uv=False)
    if options.json:
        print_json({'coordinate_names': robot.coordinate_names, 'q': q, 'pose': pose,
                    'rpy': rotation_rpy(turn), 'quaternion': rotation_quaternion(turn),
                    'speed_names': robot.speed_names, 'jacobian': J, 'singular_values': sizes})
        return
    words = [f'{value + 0.0:.6g}' for value in (*without_rounding(place), *rotation_rpy(turn))]
    print(f'{options.frame}: at {", ".join(words[:3])} m, roll, pitch, yaw '
          f'{", ".join(words[3:])} rad')
    print_table([f'{options.axes} axes', *DIRECTIONS],
                [[name, *column] for name, column in zip(robot.speed_names,
                                                         without_rounding(J).T, strict=True)])
    print(f'singular values: {", ".join(f"{size:.4g}" for size in sizes)}')


def inverse(options: Namespace) -> int:
    """Print joint positions at which a frame has a pose; return 1 if there are none."""
    _, robot = load(options)
    robot.model.frame(options.frame)
    pose = pose_from(options.position, rpy=options.rpy, quaternion=options.quaternion)
    oriented = options.rpy is not None or options.quaternion is not None
    start = positions(options, 'q0', robot)
    result = inverse_kinematics(robot, options.frame, pose if oriented else pose[:3, 3], start)
    distance = float(np.linalg.norm(result.error[:3]))
    angle = float(np.linalg.norm(result.error[3:]))
    if options.json:
        print_json({'coordinate_names': robot.coordinate_names, 'q': result.q,
                    'converged': result.converged, 'distance': distance, 'angle': angle,
                    'iterations': result.iterations})
        return int(not result.converged)
    print_table(['coordinate', 'q'], zip(robot.coordinate_names, result.q, strict=True))
    if not result.converged:
        print(f'not reached: {distance:.4g} m and {angle:.4g} rad remain, at the closest '
              'configuration within the limits that was found')
    return int(not result.converged)
