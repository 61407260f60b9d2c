"""Constraints on velocities: points, and speeds that depend on others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from kane_dynamics._util.frozen import freeze
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.user_functions import evaluated, evaluated_scalar
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import (
    ConstraintRows, finite_number, Geometry, relative_partials, unit)
import numpy as np


@dataclass(frozen=True, eq=False)
class PointVelocity:
    """
    A velocity component of a point of the mechanism is zero or prescribed.

    Parameters
    ----------
    frame : str
        The point is the origin of this frame.
    direction : (3,) array
        Direction of the component; normalised.
    axes : str, optional
        Frame in which the direction is fixed (a knife edge: the frame itself); world by
        default.
    relative_to : str, optional
        Frame relative to which the velocity is measured; world by default.
    value : float or callable
        The component, m/s; a callable takes t.
    angular : bool
        Constrain the angular velocity instead, rad/s.
    name : str

    """

    frame: str
    direction: Any
    axes: str | None = None
    relative_to: str | None = None
    value: float | Callable[[Any], Any] = 0.0
    angular: bool = False
    name: str = ''

    def __post_init__(self) -> None:
        """Normalise the direction, and check the value."""
        kind = 'angular velocity' if self.angular else 'velocity'
        freeze(self, 'name', self.name or f'{kind} of {self.frame}')
        what = f"constraint '{self.name}'"
        freeze(self, 'direction', unit(self.direction, f'{what}: direction'))
        if not callable(self.value):
            freeze(self, 'value', finite_number(self.value, f'{what}: value'))

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the name of the row."""
        return (self.name,)

    def rows(self, geometry: Geometry) -> ConstraintRows:
        """Return the row: the component of the partial velocities."""
        direction = self.direction
        # A direction in the axes of a frame turns with it;
        # J and it are then in one set of axes.
        if self.axes is not None:
            geometry = geometry.in_axes_of(self.axes)
            R, _ = geometry.pose(self.axes)
            direction = R @ direction
        J = relative_partials(geometry, self.frame, self.relative_to)
        b = self.functions(geometry).get('value(t)', self.value)

        # J holds v^r, then omega^r: the row is d . v^r or d . omega^r.
        if self.angular:
            row = direction @ J[3:]
        else:
            row = direction @ J[:3]
        return ConstraintRows(np.array([row]), np.array([b]), (None,))

    def functions(self, geometry: Geometry) -> dict[str, Any]:
        """Return the functions that must be continuous: the value, if it is one."""
        if not callable(self.value):
            return {}
        what = f"constraint '{self.name}': value(t)"
        return {'value(t)': evaluated_scalar(self.value, what, geometry.t)}


def knife_edge(frame: str, direction: Any, name: str = '') -> PointVelocity:
    """Return zero velocity of a frame's origin along a direction fixed in the frame."""
    name = name or f'knife edge {frame}'
    return PointVelocity(frame, direction, axes=frame, name=name)


@dataclass(frozen=True, eq=False)
class DependentSpeeds:
    """
    General linear constraint on the speeds: u_D = A(q, t) u_I + B(q, t).

    Parameters
    ----------
    dependent : sequence of str
        Names of the speeds u_D; u_I are all others, in the order of the speeds.
    A : callable
        ``A(q, t)`` returns (m, n - m).
    B : callable, optional
        ``B(q, t)`` returns (m,); zero by default.
    name : str

    """

    dependent: Sequence[str]
    A: Callable[[Any, Any], Any]
    B: Callable[[Any, Any], Any] | None = None
    name: str = 'dependent speeds'
    labels: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Name the rows."""
        if isinstance(self.dependent, str) or not isinstance(self.dependent, Sequence):
            raise ConstraintError(
                f"constraint '{self.name}': dependent: {self.dependent!r}; expected a "
                'list of speeds')
        freeze(self, 'dependent', tuple(self.dependent))
        labels = tuple(f'{self.name}/{speed}' for speed in self.dependent)
        freeze(self, 'labels', labels)

    def rows(self, geometry: Geometry) -> ConstraintRows:
        """Return Y_D - A Y_I and B - Z_D + A Z_I; ConstraintError for a wrong shape."""
        # u_D = A u_I + B with u = Y q' + Z of both kinds of speeds.
        Y_D, Z_D = geometry.speed_rows(self.dependent)
        Y_I, Z_I = geometry.speed_rows(geometry.other_speeds(self.dependent))
        A, B = self.functions(geometry).values()
        no_residuals = (None,) * len(self.dependent)
        return ConstraintRows(Y_D - A @ Y_I, B - Z_D + A @ Z_I, no_residuals)

    def functions(self, geometry: Geometry) -> dict[str, Any]:
        """Return the functions that must be continuous in time, by name: A and B."""
        m = len(self.dependent)
        what = f"constraint '{self.name}'"
        q = geometry.q
        t = geometry.t
        # Both functions are the user's, and are checked at each call.
        A = np.asarray(evaluated(self.A, f'{what}: A(q, t)', q, t))
        if self.B is None:
            B = np.zeros(m)
        else:
            B = np.asarray(evaluated(self.B, f'{what}: B(q, t)', q, t))

        # u_D = A u_I + B: a row for each dependent speed, a column for each other speed.
        independent_speeds = geometry.other_speeds(self.dependent)
        shapes = {'A': (m, len(independent_speeds)), 'B': (m,)}
        for name, value in (('A', A), ('B', B)):
            if value.shape != shapes[name]:
                raise ConstraintError(
                    f'{what}: {name}(q, t) returns shape {value.shape}; expected '
                    f'{shapes[name]}')
        return {'A(q, t)': A, 'B(q, t)': B}
