"""Constraints on velocities: points, and speeds that depend on others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from kane_dynamics._util.frozen import freeze
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.user_functions import evaluated, evaluated_scalar
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import (
    ConstraintRows, finite, Geometry, relative_partials, unit)
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
        Frame in which the direction is fixed (a knife edge: the frame itself); world by default.
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
        freeze(self, 'direction', unit(self.direction, f"constraint '{self.name}': direction"))
        if not callable(self.value):
            freeze(self, 'value', finite(self.value, f"constraint '{self.name}': value"))

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the name of the row."""
        return (self.name,)

    def rows(self, here: Geometry) -> ConstraintRows:
        """Return the row: the component of the partial velocities."""
        d = self.direction
        if self.axes is not None:
            here = here.in_axes_of(self.axes)
            d = here.pose(self.axes)[0] @ d
        J = relative_partials(here, self.frame, self.relative_to)
        b = self.functions(here).get('value(t)', self.value)
        row = d @ (J[3:] if self.angular else J[:3])
        return ConstraintRows(np.array([row]), np.array([b]), (None,))

    def functions(self, here: Geometry) -> dict[str, Any]:
        """Return what must be continuous in time, by name: the value, if it is a function."""
        if not callable(self.value):
            return {}
        return {'value(t)': evaluated_scalar(self.value, f"constraint '{self.name}': value(t)",
                                             here.t)}


def knife_edge(frame: str, direction: Any, name: str = '') -> PointVelocity:
    """Return the constraint of zero velocity of a frame's origin along one of its directions."""
    return PointVelocity(frame, direction, axes=frame, name=name or f'knife edge {frame}')


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
        if isinstance(self.dependent, str):
            raise ConstraintError(f"constraint '{self.name}': dependent: {self.dependent!r}; "
                                  'expected a list of speeds')
        freeze(self, 'dependent', tuple(self.dependent))
        freeze(self, 'labels', tuple(f'{self.name}/{speed}' for speed in self.dependent))

    def rows(self, here: Geometry) -> ConstraintRows:
        """Return Y_D - A Y_I and B - Z_D + A Z_I; ConstraintError for a wrong shape."""
        Y_D, Z_D = here.speed_rows(self.dependent)
        Y_I, Z_I = here.speed_rows(here.other_speeds(self.dependent))
        A, B = self.functions(here).values()
        return ConstraintRows(Y_D - A @ Y_I, B - Z_D + A @ Z_I, (None,) * len(self.dependent))

    def functions(self, here: Geometry) -> dict[str, Any]:
        """Return what must be continuous in time, by name: A and B."""
        m = len(self.dependent)
        what = f"constraint '{self.name}'"
        A = np.asarray(evaluated(self.A, f'{what}: A(q, t)', here.q, here.t))
        B = np.zeros(m) if self.B is None else np.asarray(
            evaluated(self.B, f'{what}: B(q, t)', here.q, here.t))
        others = len(here.other_speeds(self.dependent))
        for name, value, shape in (('A', A, (m, others)), ('B', B, (m,))):
            if value.shape != shape:
                raise ConstraintError(f"constraint '{self.name}': {name}(q, t) returns shape "
                                      f'{value.shape}; expected {shape}')
        return {'A(q, t)': A, 'B(q, t)': B}
