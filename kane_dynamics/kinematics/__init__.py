"""Poses, their errors, and inverse kinematics."""

from kane_dynamics.kinematics.damped_least_squares import (inverse_kinematics,
                                                           InverseKinematics)
from kane_dynamics.kinematics.poses import (pose_error, pose_exp, pose_from, pose_log,
                                            rotation_exp, rotation_log,
                                            rotation_quaternion, rotation_rpy)

__all__ = ['InverseKinematics', 'inverse_kinematics', 'pose_error', 'pose_exp',
           'pose_from', 'pose_log', 'rotation_exp', 'rotation_log',
           'rotation_quaternion', 'rotation_rpy']
