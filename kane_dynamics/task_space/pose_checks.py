"""Checks of a target pose: in a kernel, and with words where it has refused one."""

from __future__ import annotations

from kane_dynamics._util.typing import Array, Matrix, Scalar
from kane_dynamics.errors import InputError
from kane_dynamics.kinematics.poses import checked_pose, ORTHONORMAL
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.vector import cross
import numpy as np
from numpy.typing import ArrayLike


def pose_margin(pose: Matrix) -> Scalar:
    """Return a number that is positive for a pose (4, 4), over any scalar."""
    R = pose[:3, :3]
    total: Scalar = ORTHONORMAL**2
    for r in range(3):
        for s in range(r, 3):
            deviation = R[r] @ R[s] - float(r == s)
            total = total - deviation * deviation
    for entry, expected in zip(pose[3], (0.0, 0.0, 0.0, 1.0)):
        deviation = entry - expected
        total = total - deviation * deviation
    determinant = cross(R[0], R[1]) @ R[2]
    return select(determinant < 0.0, -1.0, total)


def flat_pose(pose: ArrayLike, what: str = 'pose') -> Array:
    """Return a pose as 16 numbers; InputError for another shape."""
    if type(pose) is np.ndarray and pose.shape == (4, 4):  # of a control loop
        return pose.ravel()
    try:
        array = np.asarray(pose, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f'{what}: {pose!r}; expected numbers of shape (4, 4)') from None
    if array.shape != (4, 4):
        raise InputError(f'{what}: shape {array.shape}; expected (4, 4)')
    return array.ravel()


def require_pose(numbers: Array) -> None:
    """Raise InputError unless 16 numbers are a pose."""
    checked_pose(numbers.reshape(4, 4), 'pose')
