"""Closed loops: two frames of a mechanism that a joint holds together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import (
    ConstraintRows, Geometry, positive, triad, unit)
from kane_dynamics.model.model import Frame
import numpy as np

FLOOR = 1e-16  # smallest 1 + cos(angle), its rounding; the angle is then a half turn
NUDGE = 1e-15  # rad: keeps the residual of an exact half turn, 0 / 0, far from zero

# Of each kind: directions without relative translation of the origins, then directions
# without relative rotation. 'side', 'up', 'axis' are a triad of the second frame.
CARRIED = ('x', 'y', 'z')
ACROSS = ('side', 'up')
ROWS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    'weld': (CARRIED, ('side', 'up', 'axis')),
    'revolute': (CARRIED, ACROSS),
    'prismatic': (ACROSS, ('side', 'up', 'axis')),
    'cylindrical': (ACROSS, ACROSS),
    'universal': (CARRIED, ('between',)),
    'spherical': (CARRIED, ()),
    'planar': (('axis',), ACROSS),
    'inline': (ACROSS, ()),
    'distance': (('distance',), ()),
}
TURNS = {'side': 'turn_1', 'up': 'turn_2', 'axis': 'turn_3', 'between': 'turn_1'}
Kind = Literal['weld', 'revolute', 'prismatic', 'cylindrical', 'universal', 'spherical',
               'planar', 'inline', 'distance']


@dataclass(frozen=True, eq=False)
class Closure:
    """
    Closed loop: two frames, joined by the joint at which the loop was cut.

    Parameters
    ----------
    first, second : str
        The frames; one of them may be fixed in the world.
    kind : str
        The relative motion that remains free: `weld` none; `revolute` rotation about
        `axis`; `prismatic` translation along it; `cylindrical` both; `universal`
        rotations about `axis` and `second_axis`; `spherical` all rotations; `planar`
        translation normal to `axis` and rotation about it; `inline` translation along
        `axis` and all rotations (the origin of `first` stays on a line of `second`);
        `distance` everything except a change of the distance between the origins.
    axis : (3,) array
        The same direction in the axes of both frames; of a universal closure, in those
        of `first`.
    second_axis : (3,) array, optional
        Of a universal closure: in the axes of `second`, perpendicular to `axis` wherever
        the loop is closed; by default the direction `side` (see Notes).
    length : float, optional
        Of a distance closure, m; positive.
    name : str

    Notes
    -----
    Every row is in the axes of a body of the loop, so that the same rows are redundant
    in every configuration.

    Position rows are the velocity of the origin of `second` relative to that of `first`.
    Without an axis, they are along x, y and z (labels `x`, `y`, `z`) of the outermost
    body that moves both frames (of the world, if there is none), and relative to that
    body. Kinds with an axis use the right-handed triad `side`, `up`, `axis` fixed in
    `second` (x, y, z if the axis is z). The rows are the exact time derivatives of their
    residuals.

    Orientation rows are the angular velocity of `second` relative to `first` about side,
    up and axis (labels `turn_1`, `turn_2`, `turn_3`). The residual is 2 tan(angle / 2)
    times the axis of the remaining rotation. It is zero only at the correct orientation
    and tends to infinity at a half turn; its time derivative is the row's velocity where
    the loop is closed (elsewhere a regular matrix times that velocity). Newton's method
    with these rows converges quadratically, and never to frames that are flipped.

    The row of a universal closure, `turn_1`, is about axis x second_axis. Its residual
    is the cosine of the angle between the two, of which it is the exact time derivative.

    """

    first: str
    second: str
    kind: Kind = 'weld'
    axis: Any = (0.0, 0.0, 1.0)
    name: str = ''
    second_axis: Any = None
    length: float | None = None

    def __post_init__(self) -> None:
        """Check the arguments and normalise the axes."""
        freeze(self, 'name', self.name or f'closure of {self.first} and {self.second}')
        what = f"constraint '{self.name}'"
        for key in ('first', 'second'):
            if not isinstance(getattr(self, key), str):
                raise ConstraintError(f'{what}: {key}: {getattr(self, key)!r}; expected '
                                      'the name of a frame')
        if not isinstance(self.kind, str) or self.kind not in ROWS:
            raise ConstraintError(f'{what}: kind: {self.kind!r}; expected one of '
                                  f'{", ".join(ROWS)}')
        freeze(self, 'axis', unit(self.axis, f'{what}: axis'))

        # Arguments that belong to one kind only.
        for key, kind in (('second_axis', 'universal'), ('length', 'distance')):
            if getattr(self, key) is not None and self.kind != kind:
                raise ConstraintError(f'{what}: {key}, given with kind {self.kind!r}; '
                                      f'expected it with kind {kind!r} only')

        # Axes of a universal joint:
        # any normal of the first axis if the second is not stated.
        if self.kind == 'universal':
            second_axis = self.second_axis
            if second_axis is None:
                second_axis, _, _ = triad(self.axis)
            freeze(self, 'second_axis', unit(second_axis, f'{what}: second_axis'))
        if self.kind == 'distance':
            if self.length is None:
                raise ConstraintError(f'{what}: length: missing; expected the distance '
                                      'in m')
            freeze(self, 'length', positive(self.length, f'{what}: length'))

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the names of the rows: position, then orientation."""
        moves, turns = ROWS[self.kind]
        parts = [*moves, *(TURNS[turn] for turn in turns)]
        return tuple(f'{self.name}/{part}' for part in parts)

    def rows(self, geometry: Geometry) -> ConstraintRows:
        """Return the rows of the constrained relative translations, then rotations."""
        turns = ROWS[self.kind][1]
        geometry, observer = self._in_observer_axes(geometry)
        R1, p1 = geometry.pose(self.first)
        R2, p2 = geometry.pose(self.second)
        d = p2 - p1

        # The partial velocities of `second` minus those of `first`, each relative to the
        # observer: joints that move both frames alike have zero columns.
        J2 = (geometry.partial_velocities(self.second)
              - geometry.partial_velocities(observer, p2))
        J1 = (geometry.partial_velocities(self.first)
              - geometry.partial_velocities(observer, p1))
        J = J2 - J1
        if self.kind == 'distance':
            distance = np.sqrt(d @ d)
            row = (d / distance) @ J[:3]
            return ConstraintRows(np.array([row]), np.zeros(1),
                                  (distance - self.length,))

        # Residuals of position are components of d; those of orientation are components
        # of the rotation that is missing.
        along, about = self._directions(geometry, observer)
        residual = [n @ d for n in along]
        if turns == ('between',):
            residual.append((R1 @ self.axis) @ (R2 @ self.second_axis))
        elif turns:
            if len(turns) == 3:
                missing_rotation = _turn(R2.T @ R1)
            else:
                missing_rotation = _tilt(R2.T @ (R1 @ self.axis), self.axis)
            residual += [self._triad[turn] @ missing_rotation for turn in turns]

        # One row for each direction n: n . v^r or, of rotations, n . omega^r.
        rows = [n @ J[:3] for n in along]
        rows += [n @ J[3:] for n in about]
        return ConstraintRows(np.array(rows), np.zeros(len(residual)), tuple(residual))

    def accelerations(self, geometry: Geometry, qdot: Vector) -> list[Scalar]:
        """
        Return the time derivatives of the rows times q' at constant joint rates, (m,).

        A row is the component of a relative velocity along a direction n; its derivative
        is the component of the relative acceleration and, where n turns, n' times the
        velocity.
        """
        turns = ROWS[self.kind][1]
        geometry, observer = self._in_observer_axes(geometry)
        v1, a1 = geometry.motion(self.first, qdot)
        v2, a2 = geometry.motion(self.second, qdot)
        v = v2 - v1
        a = a2 - a1
        if self.kind == 'distance':
            # d'' = n . a + (v . v - (n . v)^2) / d, with n = d / |d|
            _, p2 = geometry.pose(self.second)
            _, p1 = geometry.pose(self.first)
            d = p2 - p1
            distance = np.sqrt(d @ d)
            n = d / distance
            along_line = n @ a[:3]
            return [along_line + (v[:3] @ v[:3] - (n @ v[:3]) * (n @ v[:3])) / distance]

        # The directions `about` turn with `second`; 'between' is the cross product of an
        # axis of each frame.
        along, about = self._directions(geometry, observer)
        if turns == ('between',):
            axis_1 = geometry.pose(self.first)[0] @ self.axis
            axis_2 = geometry.pose(self.second)[0] @ self.second_axis
            axis_2_rate = cross(v2[3:], axis_2)
            between_rate = cross(axis_2_rate, axis_1)
            about_rates = [between_rate + cross(axis_2, cross(v1[3:], axis_1))]
        else:
            about_rates = [cross(v2[3:], n) for n in about]

        result = [n @ a[:3] for n in along]
        for n, n_rate in zip(about, about_rates):
            result.append(n @ a[3:] + n_rate @ v[3:])
        return result

    @property
    def _triad(self) -> dict[str, Vector]:
        """Return the directions of rows in the axes of `second`, by name."""
        side, up, axis = triad(self.axis)
        return {'side': side, 'up': up, 'axis': axis}

    def _in_observer_axes(self, geometry: Geometry) -> tuple[Geometry, str | Frame]:
        """Return the geometry in the axes in which positions are compared, and whose they are."""
        observer: str | Frame = self.second
        if ROWS[self.kind][0] in (CARRIED, ('distance',)):
            observer = geometry.carrier(self.first, self.second)
        return geometry.in_axes_of(observer), observer

    def _directions(self, geometry: Geometry,
                    observer: str | Frame) -> tuple[list[Vector], list[Vector]]:
        """Return the directions of translations (in the observer) and rotations."""
        moves, turns = ROWS[self.kind]
        R1, _ = geometry.pose(self.first)
        R2, _ = geometry.pose(self.second)
        # The components of the separation are along axes of the observer, rotations
        # about axes of the second frame.
        R_observer, _ = geometry.pose(observer)
        directions = dict(zip(CARRIED, R_observer.T))
        for name, direction in self._triad.items():
            directions[name] = R2 @ direction
        # The cross of a universal joint turns about the normal of its two axes.
        if self.kind == 'universal':
            directions['between'] = cross(R2 @ self.second_axis, R1 @ self.axis)
        along = [directions[move] for move in moves]
        about = [directions[turn] for turn in turns]
        return along, about


def _turn(Q: Matrix) -> Vector:
    """Return the residual of a rotation Q^T: 2 tan(angle / 2) times its axis, (3,)."""
    # Q - Q^T gives 2 sin(angle), the trace 1 + 2 cos(angle):
    # tan(angle / 2) = sin(angle) / (1 + cos(angle)).
    sine = np.array([Q[1, 2] - Q[2, 1], Q[2, 0] - Q[0, 2], Q[0, 1] - Q[1, 0]])
    return (2.0 * sine + NUDGE) / _floored(Q[0, 0] + Q[1, 1] + Q[2, 2] + 1.0)


def _tilt(direction: Vector, axis: Vector) -> Vector:
    """Return the residual of the shortest rotation of a direction onto an axis, (3,)."""
    return (2.0 * cross(direction, axis) + NUDGE) / _floored(direction @ axis + 1.0)


def _floored(x: Scalar) -> Scalar:
    """Return 1 + cos(angle), bounded below by its rounding error."""
    return select(x < FLOOR, FLOOR, x)
