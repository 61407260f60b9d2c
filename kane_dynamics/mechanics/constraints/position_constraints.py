"""Constraints on positions: closed loops, coupled joints, prescribed motion."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from kane_dynamics._util.frozen import freeze
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.dual import moving, rates
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.constraints.constraint_rows import (across, ConstraintRows, Geometry,
                                                                 unit)
import numpy as np


@dataclass(frozen=True, eq=False)
class Coupling:
    """
    A joint's coordinate follows others: q_joint = sum of ratios times theirs + offset.

    Parameters
    ----------
    joint : str
        The one that follows.
    ratios : mapping of joint name to float
        Of the coordinates that it follows (a gear: one, its ratio with sign).
    offset : float
        rad or m.
    name : str

    """

    joint: str
    ratios: Mapping[str, float]
    offset: float = 0.0
    name: str = ''

    def __post_init__(self) -> None:
        """Name it."""
        freeze(self, 'name', self.name or f'coupling of {self.joint}')

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the name of the row."""
        return (self.name,)

    def rows(self, here: Geometry) -> ConstraintRows:
        """Return the row."""
        row, gap = here.coordinate(self.joint, self.name)
        for joint, ratio in self.ratios.items():
            of_other, value = here.coordinate(joint, self.name)
            row, gap = row - float(ratio) * of_other, gap - float(ratio) * value
        return ConstraintRows(row[None, :], np.zeros(1), (gap - self.offset,))


@dataclass(frozen=True, eq=False)
class Closure:
    """
    Two frames of the mechanism are joined: the joint at which a closed loop was cut.

    Parameters
    ----------
    first, second : str
        The frames; one of them may be fixed in the world.
    kind : 'weld', 'revolute' or 'spherical'
        A revolute closure leaves free the turn about `axis`, a spherical one every turn.
    axis : (3,) array
        Of a revolute closure; the same direction in the axes of both frames.
    name : str

    """

    first: str
    second: str
    kind: Literal['weld', 'revolute', 'spherical'] = 'weld'
    axis: Any = (0.0, 0.0, 1.0)
    name: str = ''

    def __post_init__(self) -> None:
        """Check and normalise."""
        freeze(self, 'name', self.name or f'closure of {self.first} and {self.second}')
        if self.kind not in ('weld', 'revolute', 'spherical'):
            raise ConstraintError(f"constraint '{self.name}': kind is '{self.kind}'; valid: weld, "
                                  'revolute, spherical')
        freeze(self, 'axis', unit(self.axis, f"constraint '{self.name}': axis"))

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the names of the rows: three of position, up to three of direction."""
        turns = {'weld': 3, 'revolute': 2, 'spherical': 0}[self.kind]
        parts = ('x', 'y', 'z', *('turn_1', 'turn_2', 'turn_3')[:turns])
        return tuple(f'{self.name}/{part}' for part in parts)

    def rows(self, here: Geometry) -> ConstraintRows:
        """
        Return the rows.

        Those of direction keep an axis a of one frame perpendicular to an axis b of the other:
        the rate of a . b is (b x a) . (omega_second - omega_first).
        """
        (R1, p1), (R2, p2) = here.pose(self.first), here.pose(self.second)
        J = here.partial_velocities(self.second) - here.partial_velocities(self.first)
        rows, gap = list(J[:3]), list(p2 - p1)
        side, up = across(self.axis)
        pairs = {'spherical': (), 'revolute': ((side, self.axis), (up, self.axis)),
                 'weld': ((side, self.axis), (up, self.axis), (up, side))}[self.kind]
        for one, other in pairs:
            a, b = R1 @ one, R2 @ other
            rows.append(cross(b, a) @ J[3:])
            gap.append(a @ b)
        return ConstraintRows(np.array(rows), np.zeros(len(rows)), tuple(gap))


@dataclass(frozen=True, eq=False)
class Prescribed:
    """
    A joint moves as a given function of time (a shaker, a platform, a spacecraft's base).

    Parameters
    ----------
    joint : str
    position : callable
        ``position(t)``, rad or m, over any scalar: numpy's sin, cos, tanh, sqrt and arithmetic.
    name : str

    Notes
    -----
    The constraint force of its row is the force or torque that the prescribed motion takes.

    """

    joint: str
    position: Callable[[Any], Any]
    name: str = ''

    def __post_init__(self) -> None:
        """Name it."""
        freeze(self, 'name', self.name or f'prescribed {self.joint}')

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the name of the row."""
        return (self.name,)

    def rows(self, here: Geometry) -> ConstraintRows:
        """Return the row: the joint's rate is the function's."""
        row, value = here.coordinate(self.joint, self.name)
        speed = rates(np.array([self.position(moving(here.t, 1.0))], dtype=object))
        return ConstraintRows(row[None, :], speed, (value - self.position(here.t),))
