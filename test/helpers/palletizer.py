"""The shipped palletizer: its URDF, three loops, configurations in closed form."""

from functools import cache

from kane_dynamics import load_constraints, load_urdf, Robot, stiffened
from kane_dynamics._util.resources import resource_path
import numpy as np
import yaml

URDF = resource_path('urdf', 'palletizer.urdf')
LOOPS = resource_path('urdf', 'palletizer.constraints.yaml')
CONSTRAINTS = yaml.safe_load(LOOPS.read_text(encoding='utf-8'))
DRIVEN = tuple(CONSTRAINTS['independent'])
# The lower arm in line with the triangle's rear pin.
SINGULAR_SHOULDER = -np.arctan2(0.2, 0.1)
# Its arms as beams that bend in the plane of the loops; densities by the mass of the
# links, the stiffness made up.
BEAMS = {'beams': {
    'lower_arm': {'length': 0.945, 'density': 116.4, 'stiffness': 4.0e5, 'modes': [1, 0],
                  'direction': [0, 0, 1], 'up': [1, 0, 0], 'damping': 2.0e-3},
    'upper_arm': {'length': 1.025, 'density': 83.0, 'stiffness': 4.0e5, 'modes': [1, 0],
                  'up': [0, 0, 1], 'damping': 2.0e-3}}}


@cache
def palletizer(**options):
    """Return the palletizer with its loops."""
    return Robot(load_urdf(URDF), **(load_constraints(CONSTRAINTS) | options))


@cache
def palletizer_tree():
    """Return the palletizer with open loops."""
    return Robot(load_urdf(URDF))


@cache
def bending_palletizer():
    """Return the palletizer with beams, and its rigid model, with their loops."""
    model = load_urdf(URDF, supplement=BEAMS)
    options = load_constraints(CONSTRAINTS)
    modes = [model.coordinate_names[k] for k in model.modal_coordinates]
    flexible = Robot(model,
                     **options | {'independent': (*DRIVEN, *modes), 'actuated': None})
    return flexible, Robot(stiffened(model), **options)


def joint_angles(swivel, shoulder, lever, turn):
    """Return the closed configuration by joint: opposite sides stay parallel."""
    return {'swivel': swivel, 'shoulder': shoulder, 'elbow': lever - shoulder,
            'wrist_pin': -lever, 'turn': turn, 'lever_drive': lever,
            'drive_pin': shoulder - lever, 'triangle_pin': -shoulder,
            'rod_1_pin': shoulder, 'rod_2_pin': lever}


def positions(robot, *driven):
    """Return `joint_angles` as an array in the order of a robot."""
    angles = joint_angles(*driven)
    return np.array([angles[name] for name in robot.joint_names])
