"""Closed loops: two frames of a mechanism that a joint holds together."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from kane_dynamics._util.frozen import freeze
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import (ConstraintRows,
                                                                                  Geometry,
                                                                                  positive, triad,
                                                                                  unit)
from kane_dynamics.model.model import Frame
import numpy as np

FLOOR = 1e-16  # smallest 1 + cos(angle), its rounding; the angle is then a half turn
NUDGE = 1e-15  # rad: keeps the residual of an exact half turn, 0 / 0, far from zero

# For each kind: directions without relative translation of the origins, and directions without
# relative rotation. 'side', 'up' and 'axis' are a right-handed triad of the second frame.
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
Kind = Literal['weld', 'revolute', 'prismatic', 'cylindrical', 'universal', 'spherical', 'planar',
               'inline', 'distance']


@dataclass(frozen=True, eq=False)
class Closure:
    """
    Closed loop: two frames of the mechanism, joined by the joint at which the loop was cut.

    Parameters
    ----------
    first, second : str
        The frames; one of them may be fixed in the world.
    kind : str
        The relative motion that remains free: `weld` none; `revolute` rotation about `axis`;
        `prismatic` translation along it; `cylindrical` both; `universal` rotations about `axis`
        and `second_axis`; `spherical` all rotations; `planar` translation normal to `axis` and
        rotation about it; `inline` translation along `axis` and all rotations (the origin of
        `first` stays on a line of `second`); `distance` everything except a change of the distance
        between the origins.
    axis : (3,) array
        The same direction in the axes of both frames; of a universal closure, in those of `first`.
    second_axis : (3,) array, optional
        Of a universal closure: in the axes of `second`, perpendicular to `axis` wherever the loop
        is closed; by default the direction `side` (see Notes).
    length : float, optional
        Of a distance closure, m; positive.
    name : str

    Notes
    -----
    Every row is in the axes of a body of the loop, so that the same rows are redundant in every
    configuration.

    Position rows are the velocity of the origin of `second` relative to that of `first`. Without
    an axis, they are along x, y and z (labels `x`, `y`, `z`) of the outermost body that moves both
    frames (of the world, if there is none), and relative to that body. Kinds with an axis use the
    right-handed triad `side`, `up`, `axis` fixed in `second` (x, y, z if the axis is z). The rows
    are the exact time derivatives of their residuals.

    Orientation rows are the angular velocity of `second` relative to `first` about side, up and
    axis (labels `turn_1`, `turn_2`, `turn_3`). The residual is 2 tan(angle / 2) times the axis of
    the remaining rotation. It is zero only at the correct orientation and tends to infinity at a
    half turn; its time derivative is the row's velocity where the loop is closed (elsewhere a
    regular matrix times that velocity). Newton's method with these rows converges quadratically,
    and never to frames that are flipped.

    The row of a universal closure, `turn_1`, is about axis x second_axis. Its residual is the
    cosine of the angle between the two, of which it is the exact time derivative.

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
        if self.kind not in ROWS:
            raise ConstraintError(f'{what}: kind: {self.kind!r}; expected one of '
                                  f'{", ".join(ROWS)}')
        freeze(self, 'axis', unit(self.axis, f'{what}: axis'))
        for key, kind in (('second_axis', 'universal'), ('length', 'distance')):
            if getattr(self, key) is not None and self.kind != kind:
                raise ConstraintError(f'{what}: {key}, given with kind {self.kind!r}; expected '
                                      f'it with kind {kind!r} only')
        if self.kind == 'universal':
            given = triad(self.axis)[0] if self.second_axis is None else self.second_axis
            freeze(self, 'second_axis', unit(given, f'{what}: second_axis'))
        if self.kind == 'distance':
            if self.length is None:
                raise ConstraintError(f'{what}: length: missing; expected the distance in m')
            freeze(self, 'length', positive(self.length, f'{what}: length'))

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the names of the rows: those of position, then those of orientation."""
        moves, turns = ROWS[self.kind]
        return tuple(f'{self.name}/{part}' for part in (*moves, *(TURNS[x] for x in turns)))

    def rows(self, here: Geometry) -> ConstraintRows:
        """Return the rows of the constrained relative translations, then rotations."""
        turns = ROWS[self.kind][1]
        here, seen_from = self._within(here)
        (R1, p1), (R2, p2) = here.pose(self.first), here.pose(self.second)
        d = p2 - p1
        # Relative to a body, joints that move both frames alike have zero columns.
        J = ((here.partial_velocities(self.second) - here.partial_velocities(seen_from, p2))
             - (here.partial_velocities(self.first) - here.partial_velocities(seen_from, p1)))
        if self.kind == 'distance':
            far = np.sqrt(d @ d)
            return ConstraintRows(np.array([(d / far) @ J[:3]]), np.zeros(1), (far - self.length,))
        along, about = self._directions(here, seen_from)
        residual = [direction @ d for direction in along]
        if turns == ('between',):
            residual.append((R1 @ self.axis) @ (R2 @ self.second_axis))
        elif turns:
            missing = (_turn(R2.T @ R1) if len(turns) == 3 else
                       _tilt(R2.T @ (R1 @ self.axis), self.axis))
            residual += [self._triad[turn] @ missing for turn in turns]
        return ConstraintRows(
            np.array([*(n @ J[:3] for n in along), *(n @ J[3:] for n in about)]),
            np.zeros(len(residual)), tuple(residual))

    def accelerations(self, here: Geometry, qdot: Any) -> list[Any]:
        """
        Return the time derivatives of the rows times q' at constant joint rates q', m of them.

        A row is the component of a relative velocity along a direction n; its derivative is the
        component of the relative acceleration and, where n turns, n' times the velocity.
        """
        turns = ROWS[self.kind][1]
        here, seen_from = self._within(here)
        (v1, a1), (v2, a2) = here.motion(self.first, qdot), here.motion(self.second, qdot)
        v, a = v2 - v1, a2 - a1
        if self.kind == 'distance':
            d = here.pose(self.second)[1] - here.pose(self.first)[1]
            far = np.sqrt(d @ d)
            n = d / far
            return [n @ a[:3] + (v[:3] @ v[:3] - (n @ v[:3]) * (n @ v[:3])) / far]
        along, about = self._directions(here, seen_from)
        if turns == ('between',):
            a_1, a_2 = (here.pose(self.first)[0] @ self.axis,
                        here.pose(self.second)[0] @ self.second_axis)
            turned = [cross(cross(v2[3:], a_2), a_1) + cross(a_2, cross(v1[3:], a_1))]
        else:
            turned = [cross(v2[3:], n) for n in about]
        return [*(n @ a[:3] for n in along),
                *(n @ a[3:] + rate @ v[3:] for n, rate in zip(about, turned))]

    @property
    def _triad(self) -> dict[str, Any]:
        return dict(zip(('side', 'up', 'axis'), triad(self.axis)))

    def _within(self, here: Geometry) -> tuple[Geometry, str | Frame]:
        """Return the geometry in the axes of the body to which the position rows are relative."""
        seen_from = (here.carrier(self.first, self.second)
                     if ROWS[self.kind][0] in (CARRIED, ('distance',)) else self.second)
        return here.in_axes_of(seen_from), seen_from

    def _directions(self, here: Geometry, seen_from: str | Frame) -> tuple[list[Any], list[Any]]:
        """Return the directions of position rows, at rest in `seen_from`, and of orientation."""
        moves, turns = ROWS[self.kind]
        R1, R2 = here.pose(self.first)[0], here.pose(self.second)[0]
        fixed = dict(zip(CARRIED, here.pose(seen_from)[0].T))
        carried = {name: R2 @ direction for name, direction in self._triad.items()}
        if self.kind == 'universal':
            carried['between'] = cross(R2 @ self.second_axis, R1 @ self.axis)
        return ([(fixed | carried)[move] for move in moves], [carried[turn] for turn in turns])


def _turn(Q: Any) -> Any:
    """Return the residual of a rotation Q^T: 2 tan(angle / 2) times its axis, (3,)."""
    sine = np.array([Q[1, 2] - Q[2, 1], Q[2, 0] - Q[0, 2], Q[0, 1] - Q[1, 0]])
    return (2.0 * sine + NUDGE) / _floored(Q[0, 0] + Q[1, 1] + Q[2, 2] + 1.0)


def _tilt(direction: Any, axis: Any) -> Any:
    """Return the residual of the shortest rotation of a direction onto an axis, (3,)."""
    return (2.0 * cross(direction, axis) + NUDGE) / _floored(direction @ axis + 1.0)


def _floored(x: Any) -> Any:
    """Return 1 + cos(angle), bounded below by its rounding error."""
    return select(x < FLOOR, FLOOR, x)
