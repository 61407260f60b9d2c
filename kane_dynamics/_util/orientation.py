"""Orientations as users state them: by roll, pitch and yaw, or by a quaternion."""

from __future__ import annotations

from kane_dynamics._util.checks import warn_of_turns
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import KaneError
import numpy as np

# Largest deviation of a quaternion's length from 1, as of rounded files.
UNIT_LENGTH = 1e-3


def stated_rotation(rpy: Array | None, quaternion: Array | None, prefix: str,
                    error: type[KaneError], stacklevel: int) -> Array:
    """
    Return the rotation matrices of orientations, (..., 3, 3).

    Parameters
    ----------
    rpy : (..., 3) array or None
        Roll, pitch and yaw about the fixed x, y and z axes, rad, as in URDF; finite.
    quaternion : (..., 4) array or None
        x, y, z, w, as in ROS; finite. It is normalized.
    prefix : str
        Of messages.
    error : type of KaneError
        That is raised.
    stacklevel : int
        Of the warning: 1 names the caller of this function.

    Warns
    -----
    ModelWarning
        An angle is beyond a full turn, as degrees are.

    Raises
    ------
    error
        Both are given, or the length of a quaternion is far from 1.

    """
    if rpy is not None and quaternion is not None:
        raise error(f'{prefix}rpy: given with quaternion; expected one of them')
    if quaternion is not None:
        return _quaternion_rotation(quaternion, prefix, error)
    if rpy is None:
        return np.eye(3)
    warn_of_turns(rpy, f'{prefix}rpy', stacklevel=stacklevel + 1)
    # About fixed axes: first x, then y, then z.
    x, y, z = (_turn_about(k, rpy[..., k]) for k in range(3))
    return np.asarray(z @ y @ x)


def _turn_about(axis: int, angle: Array) -> Array:
    """Return rotations about x, y or z, with exact zeros and ones, (..., 3, 3)."""
    # In the plane of the two other axes.
    second = (axis + 1) % 3
    third = (axis + 2) % 3
    cosine = np.cos(angle)
    sine = np.sin(angle)
    R = np.zeros((*np.shape(angle), 3, 3))
    R[..., axis, axis] = 1.0
    R[..., second, second] = cosine
    R[..., third, third] = cosine
    R[..., third, second] = sine
    R[..., second, third] = -sine
    return R


def _quaternion_rotation(quaternion: Array, prefix: str,
                         error: type[KaneError]) -> Array:
    """Return the rotation matrices of quaternions x, y, z, w."""
    length = np.linalg.norm(quaternion, axis=-1)
    deviation = np.abs(length - 1.0)
    if (deviation > UNIT_LENGTH).any():
        worst = float(length.ravel()[np.argmax(deviation)])
        raise error(f'{prefix}quaternion: length {worst:.6g}; expected 1, in the order '
                    'x, y, z, w')
    # R = 1 + 2 w [v]x + 2 [v]x [v]x.
    v = quaternion[..., :3] / length[..., None]
    w = (quaternion[..., 3] / length)[..., None, None]
    V = skew(v)
    return np.asarray(np.eye(3) + 2.0 * w * V + 2.0 * (V @ V))


def skew(w: Array) -> Array:
    """Return the skew-symmetric matrices [w]x, (..., 3, 3), of vectors (..., 3)."""
    W = np.zeros((*w.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        W[..., k, j] = w[..., i]
        W[..., j, k] = -w[..., i]
    return W
