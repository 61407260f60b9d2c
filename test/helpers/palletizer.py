"""The shipped palletizer: its URDF with three loops, and its configurations in closed form."""

from functools import cache

from kane_dynamics import load_constraints, load_urdf, Robot
from kane_dynamics._util.resources import resource_path
import numpy as np
import yaml

URDF = resource_path('urdf', 'palletizer.urdf')
LOOPS = resource_path('urdf', 'palletizer.constraints.yaml')
CONSTRAINTS = yaml.safe_load(LOOPS.read_text(encoding='utf-8'))
DRIVEN = tuple(CONSTRAINTS['independent'])
SINGULAR_SHOULDER = -np.arctan2(0.2, 0.1)  # the lower arm in line with the triangle's rear pin


@cache
def palletizer(**options):
    """Return the palletizer with its loops."""
    return Robot(load_urdf(URDF), **(load_constraints(CONSTRAINTS) | options))


@cache
def palletizer_tree():
    """Return the palletizer with open loops."""
    return Robot(load_urdf(URDF))


def joint_angles(swivel, shoulder, lever, turn):
    """Return the closed configuration by joint: opposite sides stay parallel."""
    return {'swivel': swivel, 'shoulder': shoulder, 'elbow': lever - shoulder,
            'wrist_pin': -lever, 'turn': turn, 'lever_drive': lever,
            'drive_pin': shoulder - lever, 'triangle_pin': -shoulder, 'rod_1_pin': shoulder,
            'rod_2_pin': lever}


def positions(robot, *driven):
    """Return `joint_angles` as an array in the order of a robot."""
    angles = joint_angles(*driven)
    return np.array([angles[name] for name in robot.joint_names])
