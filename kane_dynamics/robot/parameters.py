"""What a robot's kernels read at each call, and what bounds its joints."""

from copy import copy
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.checks import constant
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints.conditioning import EXCESS
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

    __slots__ = ('_frame', '_payload', '_tolerance', 'block', 'physical')  # others are errors

    def __init__(self, model: Model, payload_frame: Frame | None, watched: int = 0) -> None:
        """Start with the model's gravity and no payload; `watched` numbers are limits."""
        self._frame = payload_frame
        self._payload: Inertial | None = None
        self._tolerance: tuple[float, float] | None = None
        self.physical = 3 if payload_frame is None else 13  # entries before the limits
        self.block = np.zeros(self.physical + watched)
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
    def closure_tolerance(self) -> tuple[float, float] | None:
        """
        Largest residual of conditions on positions that calls accept, (m, rad); None: any.

        Set it to a number for both, to a pair, or to None. Residuals count together, as the root
        of the sum of their squares.
        """
        return self._tolerance

    @closure_tolerance.setter
    def closure_tolerance(self, value: Any) -> None:
        if value is None:
            self._tolerance = None
        else:
            try:
                pair = np.broadcast_to(np.asarray(value, dtype=np.float64), 2)
            except (TypeError, ValueError):
                pair = np.full(2, np.nan)
            if not (np.isfinite(pair).all() and (pair > 0.0).all()):
                raise InputError(f'closure_tolerance is {value!r}; expected a positive number, m '
                                 'and rad, a pair of them, or None')
            self._tolerance = float(pair[0]), float(pair[1])
        if len(self.block) > self.physical:  # rows left out follow from others where loops close
            self.block[self.physical + 1:] = (0.0 if self._tolerance is None else np.array(
                [*self._tolerance, EXCESS])**-2.0)

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
        self.block[3:13] = [P[3, 3], *P[:3, 3], P[0, 0], P[0, 1], P[0, 2], P[1, 1], P[1, 2],
                            P[2, 2]]
        self._payload = value
