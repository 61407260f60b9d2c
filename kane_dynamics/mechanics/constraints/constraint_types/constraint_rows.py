"""Rows of a constraint, and the geometry of a mechanism that constraints evaluate."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any, Protocol

from kane_dynamics._util.checks import constant
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import ConstraintError
from kane_dynamics.model.model import Frame
import numpy as np


class Geometry(Protocol):
    """Geometry of a mechanism at one configuration and time, as constraints use it."""

    q: Vector
    t: Scalar

    def carrier(self, first: str, second: str) -> Frame:
        """Return the axes of the outermost body that moves both frames, or the world."""

    def axle_carrier(self, frame: str, axis: Vector) -> Frame:
        """Return the axes of the body that carries a wheel's axle; else the wheel's."""

    def in_axes_of(self, frame: str | Frame) -> 'Geometry':
        """
        Return the same geometry with vectors in the axes of a frame's body or the world.

        Rows do not depend on these axes, but their arithmetic does: it is least where
        most directions of a constraint are fixed.
        """

    def pose(self, frame: str | Frame) -> tuple[Matrix, Vector]:
        """Return axes (3, 3, columns) and origin (3,) of a frame, m."""

    def partial_velocities(self, frame: str | Frame, at: Vector | None = None) -> Matrix:
        """
        Return the Jacobian (partial velocities), (6, n_q): linear, then angular.

        They are those of the point of the frame's body at position `at`, (3,), m; by
        default of the frame's origin.
        """

    def motion(self, frame: str, qdot: Vector) -> Matrix:
        """
        Return velocity and acceleration of a frame at constant joint rates, (2, 6).

        Linear, then angular; relative to the axes of `in_axes_of`.
        """

    def coordinate(self, name: str, constraint: str) -> tuple[Vector, Scalar]:
        """Return a coordinate's row, (n_q,), and its value, for the named constraint."""

    def speed_rows(self, names: Sequence[str]) -> tuple[Matrix, Vector]:
        """Return rows of Y, (k, n_q), and of Z, (k,), of these speeds."""

    def other_speeds(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the names of all speeds but these."""


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """
    A constraint at one configuration and time.

    Attributes
    ----------
    J : (m, n_q) array
        J q' = b.
    b : (m,) array
    residual : tuple of m
        Residual of each row, m or rad, if it is of a position constraint; None if it is
        of a velocity constraint (nonholonomic).

    """

    J: Matrix
    b: Vector
    residual: tuple[Scalar, ...]

    @property
    def residual_or_zero(self) -> Vector:
        """Return the residuals, 0 for rows of velocity constraints, which have none."""
        residuals: list[Scalar] = []
        for residual in self.residual:
            residuals.append(0.0 if residual is None else residual)
        return np.array(residuals, dtype=object)


def unit(value: Any, what: str) -> Array:
    """Return a normalised direction, (3,); ConstraintError unless it is nonzero."""
    vector = constant(value, (3,), what, ConstraintError)
    length = math.hypot(*vector)  # does not overflow
    if length < 1e-12:
        raise ConstraintError(f'{what}: {vector.tolist()}; expected a nonzero direction')
    return constant(vector / length, (3,), what)


def finite_number(value: Any, what: str) -> float:
    """Return a finite number; ConstraintError for anything else."""
    return float(constant(value, (), what, ConstraintError))


def positive(value: Any, what: str) -> float:
    """Return a positive number; ConstraintError for anything else."""
    number = finite_number(value, what)
    if number <= 0.0:
        raise ConstraintError(f'{what}: {number}; expected a positive number')
    return number


def triad(direction: Array) -> tuple[Array, Array, Array]:
    """Return a right-handed triad of unit vectors, the third along a direction."""
    # Gram-Schmidt from the coordinate axis that is farthest from the direction.
    start = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = start - (start @ direction) * direction
    first = first / np.sqrt(first @ first)
    second = np.cross(direction, first)
    return first, second, direction


def relative_partials(geometry: Geometry, frame: str, seen_from: str | None) -> Matrix:
    """Return a frame's Jacobian as seen from another frame, (6, n_q), world axes."""
    J = geometry.partial_velocities(frame)
    if seen_from is None:
        return J
    # The point of the other body at the frame's origin.
    _, origin = geometry.pose(frame)
    return J - geometry.partial_velocities(seen_from, origin)
