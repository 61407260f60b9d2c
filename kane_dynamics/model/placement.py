"""Placements: poses of frames on bodies."""

from dataclasses import dataclass, field
import math
from typing import Any

from kane_dynamics._util.typing import Array
import numpy as np

EYE = np.eye(3)
EYE.flags.writeable = False
SNAP = 1e-14


def snapped(values: Any) -> Array:
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
    return math.cos(angle) * EYE + math.sin(angle) * cross + (
        1.0 - math.cos(angle)) * np.outer(axis, axis)


@dataclass
class Placement:
    """The pose of a frame in the axes of body `body` (or WORLD)."""

    body: int
    rotation: Array = field(default_factory=lambda: EYE)
    translation: Array = field(default_factory=lambda: np.zeros(3))

    def frame(self, rotation: Array, translation: Array) -> 'Placement':
        """Return the placement of a frame at (rotation, translation) in this one's axes."""
        if self.rotation is EYE and not self.translation.any():
            return Placement(self.body, rotation, translation)
        offset = self.rotation @ translation
        moved = self.translation + offset
        size = np.abs(self.translation).max() + np.abs(offset).max()
        moved[np.abs(moved) < 1e-15 * size] = 0.0  # cancellation leaves exact zeros
        R = self.rotation if np.array_equal(rotation, EYE) else self.rotation @ rotation
        return Placement(self.body, snapped(R), moved)
