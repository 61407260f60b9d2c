"""What a robot's kernels read at each call, and what bounds its joints."""

from copy import copy
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.checks import constant
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.model.model import Frame, Inertial, Model
import numpy as np


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Bounds of every coordinate's joint, (n,) arrays; infinite where none is stated."""

    lower: Array
    upper: Array
    velocity: Array
    effort: Array


class Parameters:
    """Gravity and payload: what may change while a robot runs, without another compilation."""

    __slots__ = ('_frame', '_payload', 'block')  # a misspelt name is an error

    def __init__(self, model: Model, payload_frame: Frame | None) -> None:
        """Start with the model's gravity and no payload."""
        self._frame = payload_frame
        self._payload: Inertial | None = None
        self.block = np.zeros(3 if payload_frame is None else 13)
        self.gravity = model.gravity

    def copy(self) -> 'Parameters':
        """Return the same values in a block of their own."""
        other = copy(self)
        other.block = self.block.copy()
        return other

    @property
    def gravity(self) -> Array:
        """Acceleration of free fall, (3,), m/s^2, world axes."""
        return self.block[:3].copy()

    @gravity.setter
    def gravity(self, value: Any) -> None:
        self.block[:3] = constant(value, (3,), 'gravity (m/s^2)', InputError)

    @property
    def payload(self) -> Inertial | None:
        """Return what the robot carries, in the axes of its `payload_frame`."""
        return self._payload

    @payload.setter
    def payload(self, value: Inertial | None) -> None:
        if self._frame is None:
            raise InputError('this robot carries no payload: construct it with payload_frame=')
        if not (value is None or isinstance(value, Inertial)):
            raise InputError(f'payload is a {type(value).__name__}; expected an Inertial or None')
        P = np.zeros((4, 4)) if value is None else value.pseudo_inertia
        self.block[3:] = [P[3, 3], *P[:3, 3], P[0, 0], P[0, 1], P[0, 2], P[1, 1], P[1, 2], P[2, 2]]
        self._payload = value
