"""Checks of a target pose: in a kernel, and with words where it has refused one."""

from __future__ import annotations

from kane_dynamics._util.checks import shape_of
from kane_dynamics._util.typing import Array, Matrix, Scalar
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.poses import checked_pose, ORTHONORMAL
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.vector import cross
from numpy.typing import ArrayLike


def pose_margin(pose: Matrix) -> Scalar:
    """Return a number that is positive for a pose (4, 4), over any scalar."""
    R = pose[:3, :3]
    # R^T R = 1: the squared deviations must be below a tolerance.
    total: Scalar = ORTHONORMAL**2
    for r in range(3):
        for s in range(r, 3):
            deviation = R[r] @ R[s] - float(r == s)
            total = total - deviation * deviation
    # The last row of a homogeneous transformation.
    for entry, expected in zip(pose[3], (0.0, 0.0, 0.0, 1.0)):
        deviation = entry - expected
        total = total - deviation * deviation
    # A reflection is orthonormal, too, but has determinant -1.
    determinant = cross(R[0], R[1]) @ R[2]
    return select(determinant < 0.0, -1.0, total)


def require_pose(numbers: ArrayLike, what: str = 'pose') -> Array:
    """Return one pose, (4, 4); InputError for anything else."""
    shape = shape_of(numbers, what)
    if len(shape) == 3:  # poses
        raise InputError(f'{what}: shape {shape}; expected (4, 4)')
    return checked_pose(numbers, what)
