"""Placements: poses of frames on bodies, as they are stated and as they are combined."""

from __future__ import annotations

from dataclasses import dataclass, field
import math

from kane_dynamics._util.checks import constant
from kane_dynamics._util.orientation import stated_rotation
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
import numpy as np
from numpy.typing import ArrayLike

EYE = np.eye(3)
EYE.flags.writeable = False
ORIGIN = (0.0, 0.0, 0.0)
SNAP = 1e-14
FARTHEST = 1e12  # m: squares of longer lengths would not tell a mechanism from rounding


def point(value: ArrayLike, what: str) -> Array:
    """Return a point, (3,) m; raise ModelError unless it is finite and not too far."""
    place = constant(value, (3,), what)
    if (np.abs(place) > FARTHEST).any():
        raise ModelError(f'{what}: {place.tolist()} m; expected at most {FARTHEST:g} m')
    return place


def snapped(values: ArrayLike) -> Array:
    """
    Return an array with entries within `SNAP` of 0, 1 or -1 rounded to them.

    Tracing then folds rotations by multiples of pi/2. The tolerance is far below the
    error of a decimal angle (3.14159265359 differs from pi by 2e-13), so stated angles
    do not change.
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
        """Return the placement of a frame at (rotation, translation) in these axes."""
        # The placement is the body itself: keep the frame's numbers to the last bit.
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
        If a number is not finite, both orientations are given, or the quaternion is no
        unit one.

    """
    translation = point(at, f'{what}: at')
    angles: Array | None = constant(rpy, (3,), f'{what}: rpy')
    parts: Array | None = None
    if quaternion is not None:
        # Angles of zero state nothing: then a quaternion may be given.
        parts = constant(quaternion, (4,), f'{what}: quaternion')
    if not np.any(rpy):
        angles = None
    R = stated_rotation(angles, parts, f'{what}: ', ModelError, stacklevel=4)
    return snapped(R), translation
