"""Placements: poses of frames on bodies, as they are stated and as they are combined."""

from __future__ import annotations

from dataclasses import dataclass, field
import math

from kane_dynamics._util.checks import constant, warn_of_turns
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
import numpy as np
from numpy.typing import ArrayLike

EYE = np.eye(3)
EYE.flags.writeable = False
ORIGIN = (0.0, 0.0, 0.0)
SNAP = 1e-14
UNIT_LENGTH = 1e-3  # largest deviation of a quaternion's length from 1, as of rounded files


def snapped(values: ArrayLike) -> Array:
    """
    Return an array with entries within `SNAP` of 0, 1 or -1 rounded to them.

    Tracing then folds rotations by multiples of pi/2. The tolerance is far below the error of a
    decimal angle (3.14159265359 differs from pi by 2e-13), so stated angles do not change.
    """
    array = np.array(values, dtype=np.float64)
    whole = np.rint(array)
    exact = (np.abs(array - whole) < SNAP) & (np.abs(whole) <= 1.0)
    array[exact] = whole[exact] + 0.0  # + 0.0 turns -0.0 into 0.0
    return array


def rotation_about(axis: Array, angle: float) -> Array:
    """Return the rotation about a unit axis, (3, 3), by an angle, rad (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine = math.sin(angle)
    cosine = math.cos(angle)
    return cosine * EYE + sine * cross + (1.0 - cosine) * np.outer(axis, axis)


@dataclass
class Placement:
    """The pose of a frame in the axes of body `body` (or WORLD)."""

    body: int
    rotation: Array = field(default_factory=lambda: EYE)
    translation: Array = field(default_factory=lambda: np.zeros(3))

    def frame(self, rotation: Array, translation: Array) -> Placement:
        """Return the placement of a frame at (rotation, translation) in this one's axes."""
        if self.rotation is EYE and not self.translation.any():
            return Placement(self.body, rotation, translation)
        offset = self.rotation @ translation
        moved = self.translation + offset
        # What cancels leaves an exact zero, which the tracer folds.
        size = np.abs(self.translation).max() + np.abs(offset).max()
        moved[np.abs(moved) < 1e-15 * size] = 0.0
        R = self.rotation
        if not np.array_equal(rotation, EYE):
            R = self.rotation @ rotation
        return Placement(self.body, snapped(R), moved)


def stated_pose(at: ArrayLike, rpy: ArrayLike, what: str,
                quaternion: ArrayLike | None = None) -> tuple[Array, Array]:
    """
    Return the rotation and translation of a pose as a user states it.

    Parameters
    ----------
    at : (3,) array
        m.
    rpy : (3,) array
        Roll, pitch, yaw about fixed axes, as in URDF, rad.
    what : str
        Whose pose it is, for messages.
    quaternion : (4,) array, optional
        x, y, z, w, instead of `rpy`.

    Warns
    -----
    ModelWarning
        An angle is beyond a full turn, as degrees are.

    Raises
    ------
    ModelError
        If a number is not finite, both orientations are given, or the quaternion is no unit one.

    """
    if quaternion is not None:
        if np.any(rpy):
            raise ModelError(f'{what}: rpy and quaternion; expected one of them')
        return _rotation_of(quaternion, what), constant(at, (3,), f'{what}: at')
    R: Array = np.eye(3)
    angles = constant(rpy, (3,), f'{what}: rpy')
    warn_of_turns(angles, f'{what}: rpy', stacklevel=4)
    # About fixed axes, so that a later rotation multiplies from the left.
    for axis, angle in zip(np.eye(3), angles):
        R = rotation_about(axis, float(angle)) @ R
    return snapped(R), constant(at, (3,), f'{what}: at')


def _rotation_of(quaternion: ArrayLike, what: str) -> Array:
    """Return the rotation matrix of a quaternion x, y, z, w, (3, 3)."""
    parts = constant(quaternion, (4,), f'{what}: quaternion')
    length = float(np.linalg.norm(parts))
    if abs(length - 1.0) > UNIT_LENGTH:
        raise ModelError(f'{what}: quaternion of length {length:g}; expected a unit quaternion '
                         'x, y, z, w')
    sine = float(np.linalg.norm(parts[:3]))
    if sine == 0.0:
        return np.eye(3)
    angle = 2.0 * math.atan2(sine, float(parts[3]))
    return snapped(rotation_about(parts[:3] / sine, angle))
