"""The gravity that an arm compensates itself, for the base and the payload it was told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import hashlib
from typing import Any

from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.robot.robot import Robot
import numpy as np


@dataclass(frozen=True)
class ArmGravity:
    """
    The gravity and the payload that an arm believes in.

    An arm that compensates gravity adds the torque that holds it under `gravity` with
    `payload`. A command is the torque of the model, less this one at the measured
    positions.

    Attributes
    ----------
    gravity : tuple of three float, optional
        In the axes of the base, m/s^2. Default: that of the robot, whenever it changes.
    payload : tuple of ten float
        Its `Inertial.parameters` in the axes of the robot's payload frame; zeros: none.

    """

    gravity: tuple[float, ...] | None = None
    payload: tuple[float, ...] = (0.0,) * 10

    @classmethod
    def of(cls, gravity: Array | None, payload: Inertial | None) -> ArmGravity:
        """Return the statement of a gravity, (3,) or None, and a payload."""
        ten = np.zeros(10) if payload is None else payload.parameters
        three = None if gravity is None else tuple(np.asarray(gravity, float).tolist())
        return cls(three, tuple(ten.tolist()))

    @property
    def label(self) -> str:
        """Return a name that distinguishes kernels with these constants."""
        return hashlib.sha256(repr((self.gravity, self.payload)).encode()).hexdigest()[:16]

    def force(self, robot: Robot, q: Vector, parameters: Vector, t: Scalar = 0.0) -> Vector:
        """Return the generalized force that the arm adds, (n,), over any scalar."""
        return robot.equations.gravity_force(q, self._block(robot, parameters), t)

    def force_at(self, robot: Robot, q: Array, **time: Any) -> Array:
        """Return the generalized force that the arm adds, (..., n), N m or N."""
        own = robot.copy()
        own.parameters.block[:] = self._block(robot, robot.parameters.block)
        return np.asarray(own.gravity_force(q, **time))

    def entry(self, robot: Robot) -> Callable[..., Array]:
        """Return a function of q and t with the result of `force_at` for one state."""
        def force(q: Vector, parameters: Vector, t: Scalar) -> Vector:
            return self.force(robot, q, parameters, t)
        kernel = robot.compiled(force, name=f'arm_gravity_{self.label}', q=(robot.n_q,),
                                shape=(robot.n,))
        return kernel.entry('', kernel)

    def _block(self, robot: Robot, parameters: Vector) -> Vector:
        """Return the parameters of a robot with this gravity and payload."""
        count = robot.parameters.physical
        gravity = parameters[:3] if self.gravity is None else self.gravity
        own = np.array([*gravity, *self.payload][:count])
        return np.concatenate([own, parameters[count:]])
