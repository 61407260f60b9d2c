"""
A four-axis palletizer with three parallelograms, as URDF and constraints.

Motors on the carousel drive the lower arm (`shoulder`) and, by a lever and a rod, the upper
arm; two more parallelograms keep the wrist level. The dimensions are of the usual size, of no
particular machine. At zero the lower arm is vertical and the upper arm horizontal.
"""

from functools import cache

from kane_dynamics import load_constraints, load_urdf, Robot
import numpy as np

PIVOT, ARM, FORE, LEVER = (0.25, 0.0, 0.75), 1.0, 1.1, 0.35  # m
PLATE, WRIST = (-0.15, 0.0, 0.2), (0.1, 0.0, 0.2)  # pins of the triangle and of the wrist, m
ACROSS, UPRIGHT = '0 1 0', '0 0 1'
# Link: its parent, joint and origin of the joint, axis, end of the rod, mass, limits, effort.
LINKS = (
    ('carousel', 'base', 'swivel', (0, 0, 0), UPRIGHT, PIVOT, 250.0, (-3.0, 3.0), 4000),
    ('lower_arm', 'carousel', 'shoulder', PIVOT, ACROSS, (0, 0, ARM), 120.0, (-0.5, 1.2), 6000),
    ('upper_arm', 'lower_arm', 'elbow', (0, 0, ARM), ACROSS, (FORE, 0, 0), 60.0, (-1.4, 1.4), 0),
    ('wrist', 'upper_arm', 'wrist_pin', (FORE, 0, 0), ACROSS, WRIST, 15.0, (-1.6, 1.6), 0),
    ('flange', 'wrist', 'turn', (0.1, 0, -0.15), UPRIGHT, (0.05, 0, -0.1), 8.0, (-6.0, 6.0), 500),
    ('lever', 'carousel', 'lever_drive', PIVOT, ACROSS, (-LEVER, 0, 0), 25.0, (-0.9, 0.9), 6000),
    ('drive_rod', 'lever', 'drive_pin', (-LEVER, 0, 0), ACROSS, (0, 0, ARM), 12.0, (-2.0, 2.0), 0),
    ('triangle', 'lower_arm', 'triangle_pin', (0, 0, ARM), ACROSS, PLATE, 6.0, (-1.6, 1.6), 0),
    ('rod_1', 'carousel', 'rod_1_pin', tuple(np.add(PIVOT, PLATE)), ACROSS, (0, 0, ARM), 8.0,
     (-1.6, 1.6), 0),
    ('rod_2', 'triangle', 'rod_2_pin', WRIST, ACROSS, (FORE, 0, 0), 8.0, (-1.6, 1.6), 0))
FRAMES = (('upper_arm_rear', 'upper_arm', (-LEVER, 0, 0)), ('drive_end', 'drive_rod', (0, 0, ARM)),
          ('triangle_rear', 'triangle', PLATE), ('rod_1_end', 'rod_1', (0, 0, ARM)),
          ('wrist_top', 'wrist', WRIST), ('rod_2_end', 'rod_2', (FORE, 0, 0)),
          ('tool', 'flange', (0, 0, -0.2)))
DRIVEN = ('swivel', 'shoulder', 'lever_drive', 'turn')
JOINTS = tuple(link[2] for link in LINKS)
SINGULAR_SHOULDER = -np.arctan2(0.15, 0.2)  # lower arm and plate in line
CONSTRAINTS = {
    'constraints': {
        'drive': {'closure': {'first': 'drive_end', 'second': 'upper_arm_rear', 'kind': 'inline',
                              'axis': [0, 1, 0]}},
        'level_1': {'closure': {'first': 'rod_1_end', 'second': 'triangle_rear',
                                'kind': 'inline', 'axis': [0, 1, 0]}},
        'level_2': {'closure': {'first': 'rod_2_end', 'second': 'wrist_top', 'kind': 'inline',
                                'axis': [0, 1, 0]}}},
    'independent': list(DRIVEN), 'actuated': list(DRIVEN),
    'configuration': dict.fromkeys(JOINTS, 0.0)}


def _vector(x):
    return ' '.join(f'{float(each):.12g}' for each in x)


@cache
def palletizer_urdf():
    """Return the URDF of the tree."""
    words = ['<robot name="palletizer"><link name="base"/>']
    for name, parent, joint, at, axis, end, mass, limits, effort in LINKS:
        length = float(np.linalg.norm(end))
        around = mass * length**2 / 12.0
        thin = 0.02 * around + 0.01
        sizes = [thin if abs(x) > 0.9 * length else around + 0.01 for x in end]
        words.append(
            f'<link name="{name}"><inertial><origin xyz="{_vector(np.multiply(0.5, end))}"/>'
            f'<mass value="{mass}"/><inertia ixx="{sizes[0]:.9g}" iyy="{sizes[1]:.9g}" '
            f'izz="{sizes[2]:.9g}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{joint}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{name}"/><origin xyz="{_vector(at)}"/><axis xyz="{axis}"/>'
            f'<limit lower="{limits[0]}" upper="{limits[1]}" velocity="3" '
            f'effort="{effort or 10000}"/>'
            f'<dynamics damping="{5.0 if effort else 0.5}"/></joint>')
    for name, parent, at in FRAMES:
        words.append(f'<link name="{name}"/><joint name="{name}_joint" type="fixed">'
                     f'<parent link="{parent}"/><child link="{name}"/>'
                     f'<origin xyz="{_vector(at)}"/></joint>')
    return ''.join(words) + '</robot>'


@cache
def palletizer(**options):
    """Return the palletizer with its loops."""
    return Robot(load_urdf(palletizer_urdf()), **(load_constraints(CONSTRAINTS) | options))


@cache
def palletizer_tree():
    """Return the palletizer with open loops."""
    return Robot(load_urdf(palletizer_urdf()))


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
