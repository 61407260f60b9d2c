"""Rolling without slipping: a wheel or a ball on a plane, a cylinder or a sphere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from kane_dynamics._util.frozen import freeze
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import (ConstraintRows,
                                                                                  finite,
                                                                                  Geometry,
                                                                                  positive, triad,
                                                                                  unit)
from kane_dynamics.model.model import Frame, WORLD
import numpy as np

SURFACES = ('plane', 'cylinder', 'sphere')
ITERATIONS = 6  # of Newton's method for the point of a rim nearest to a cylinder


@dataclass(frozen=True, eq=False)
class Rolling:
    """
    A wheel (a thin disc) or a ball rolls on a surface without slipping.

    Parameters
    ----------
    frame : str
        Its origin is the center of the wheel or ball.
    radius : float
        m, positive.
    axis : (3,) array, optional
        The wheel's axle in the frame's axes; None for a ball.
    normal : (3,) array
        Of the plane, in the axes of the surface's frame.
    height : float
        Distance of the plane from the origin of the surface's frame along the normal, m.
    name : str
    surface_frame : str, optional
        Frame that carries the surface; world by default. Both bodies may move.
    surface : 'plane', 'cylinder' or 'sphere'
        A cylinder or sphere is centered on the origin of the surface's frame.
    surface_radius : float, optional
        Of a cylinder or sphere, m.
    surface_axis : (3,) array
        Of a cylinder, in the axes of the surface's frame.
    inside : bool
        Roll on the inner side of the cylinder or sphere.

    Notes
    -----
    Rows hold the velocity of the wheel's (or ball's) point of contact relative to the surface's:
    `tangent_1`, `tangent_2`, `normal`. For a wheel, tangent_1 is its direction of travel at a
    positive angular velocity about the axle (axle x normal) and tangent_2 is normal x tangent_1:
    the same rows are redundant for every heading. For a ball on a plane they are two directions
    fixed in the surface's frame; on a cylinder tangent_1 is along the cylinder; on a sphere they
    are those on a plane, rotated by the shortest rotation from the parameter `normal` to the
    normal of the contact (undefined where the two are opposite). The residual of `normal` is the
    distance between the bodies, m; the tangents have none.

    The contact point of a rim on a cylinder is found by Newton's method. On the outer side it is
    exact to rounding if the angle between axle and cylinder axis is at most 60 degrees; on the
    inner side the axle must be nearly parallel to that axis, since a tilted rim touches at two
    points. If the method fails, the residual of `normal` is not zero.

    """

    frame: str
    radius: float
    axis: Any = None
    normal: Any = (0.0, 0.0, 1.0)
    height: float = 0.0
    name: str = ''
    surface_frame: str | None = None
    surface: Literal['plane', 'cylinder', 'sphere'] = 'plane'
    surface_radius: float | None = None
    surface_axis: Any = (0.0, 0.0, 1.0)
    inside: bool = False

    def __post_init__(self) -> None:
        """Check the arguments and normalise the directions."""
        freeze(self, 'name', self.name or f'rolling of {self.frame}')
        what = f"constraint '{self.name}'"
        freeze(self, 'radius', positive(self.radius, f'{what}: radius'))
        freeze(self, 'normal', unit(self.normal, f'{what}: normal'))
        freeze(self, 'height', finite(self.height, f'{what}: height'))
        freeze(self, 'surface_axis', unit(self.surface_axis, f'{what}: surface_axis'))
        if self.axis is not None:
            freeze(self, 'axis', unit(self.axis, f'{what}: axis'))
        if self.surface not in SURFACES:
            raise ConstraintError(f'{what}: surface: {self.surface!r}; expected one of '
                                  f'{", ".join(SURFACES)}')
        curved = self.surface != 'plane'
        if curved != (self.surface_radius is not None):
            raise ConstraintError(f'{what}: surface_radius: {self.surface_radius}, of a '
                                  f'{self.surface}; expected it for a cylinder or sphere only')
        if self.inside and not curved:
            raise ConstraintError(f'{what}: inside: true, of a plane; expected it for a cylinder '
                                  'or sphere only')
        if self.height and curved:
            raise ConstraintError(f'{what}: height: {self.height}, of a {self.surface}; expected '
                                  'it for a plane only')
        if self.surface_radius is not None:
            freeze(self, 'surface_radius', positive(self.surface_radius,
                                                    f'{what}: surface_radius'))
            if self.inside and self.surface_radius <= self.radius:
                raise ConstraintError(f'{what}: radius: {self.radius}; expected less than '
                                      f'surface_radius, {self.surface_radius}, to roll inside')

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the names of the rows: two tangents of the surface, and its normal."""
        return tuple(f'{self.name}/{part}' for part in ('tangent_1', 'tangent_2', 'normal'))

    @property
    def _surface(self) -> str | Frame:
        return Frame('', WORLD) if self.surface_frame is None else self.surface_frame

    def rows(self, here: Geometry) -> ConstraintRows:
        """Return the rows of zero velocity of the contact point relative to the surface."""
        here = here.in_axes_of(self._surface if self.axis is None else
                               here.axle_carrier(self.frame, self.axis))
        Rs, axle, r, normal, residual, v = self._at_contact(here)
        if axle is not None:
            along = cross(r, axle) * (1.0 / self.radius)  # a unit vector
        elif self.surface == 'plane':
            along = Rs @ triad(self.normal)[0]
        elif self.surface == 'cylinder':
            along = Rs @ self.surface_axis
        else:  # by the shortest rotation from `normal` to the normal of the contact
            start, e = (Rs @ x for x in (self.normal, triad(self.normal)[0]))
            along = e - (start + normal) * ((e @ normal) / (1.0 + start @ normal))
        directions = (along, cross(normal, along), normal)
        return ConstraintRows(np.array([d @ v for d in directions]), np.zeros(3),
                              (None, None, residual))

    @property
    def has_surface_rows(self) -> bool:
        """Return whether `surface_rows` differ from `rows`: of a wheel on a plane."""
        return self.axis is not None and self.surface == 'plane'

    def surface_rows(self, here: Geometry) -> tuple[ConstraintRows, Any]:
        """
        Return rows J_0 with tangents fixed in the plane, and B, (3, 3), with J = B J_0.

        B is a rotation, so that both rows are equivalent where all three are kept; those fixed in
        the plane take less arithmetic.
        """
        Rs, axle, r, normal, residual, v = self._at_contact(here.in_axes_of(self._surface))
        first, second = (Rs @ e for e in triad(self.normal)[:2])
        along = cross(r, axle) * (1.0 / self.radius)
        x, y = along @ first, along @ second
        return (ConstraintRows(np.array([d @ v for d in (first, second, normal)]), np.zeros(3),
                               (None, None, residual)),
                np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]]))

    def _at_contact(self, here: Geometry) -> tuple[Any, ...]:
        """
        Return the geometry of the contact.

        These are the axes of the surface's frame, the axle, center to contact point, the normal,
        the residual, and the partial velocities of the wheel relative to the surface there.
        """
        R, center = here.pose(self.frame)
        Rs, origin = here.pose(self._surface)
        axle = None if self.axis is None else R @ self.axis
        r, normal, residual = self._contact(center - origin, Rs, axle)
        at = center + r
        v = here.partial_velocities(self.frame, at)[:3]
        if self.surface_frame is not None:
            v = v - here.partial_velocities(self.surface_frame, at)[:3]
        return Rs, axle, r, normal, residual, v

    def _contact(self, c: Any, Rs: Any, axle: Any) -> tuple[Any, Any, Any]:
        """
        Return center to contact point, (3,), surface normal there, (3,), and the distance, m.

        `c` is the center from the origin of the surface's frame; world axes.
        """
        if self.surface == 'plane':
            normal = Rs @ self.normal
            r = (-self.radius * normal if axle is None else
                 _unit(normal - (normal @ axle) * axle, -self.radius))
            return r, normal, normal @ (c + r) - self.height
        outward = -1.0 if self.inside else 1.0
        line = Rs @ self.surface_axis

        def off(x: Any) -> Any:
            """Return a vector without its component along the cylinder's axis."""
            return x if self.surface == 'sphere' else x - (x @ line) * line
        normal = outward * _unit(off(c))
        if axle is None:
            residual = outward * (_length(off(c)) - self.surface_radius) - self.radius
            return -self.radius * normal, normal, residual
        spoke = -1.0 * _unit(normal - (normal @ axle) * axle)
        astray: Any = 0.0
        if self.surface == 'cylinder':
            for k in range(ITERATIONS + 1):  # stationary distance of the rim from the axis
                turned = cross(axle, spoke)
                p, slope = off(c + self.radius * spoke), self.radius * off(turned)
                bend = slope @ slope - self.radius * (p @ off(spoke))
                turn = (p @ slope) / bend
                if k < ITERATIONS:
                    spoke = _unit(spoke - turn * turned)
            wrong = -outward * bend  # positive at the stationary point on the far side
            astray = self.radius * turn * turn + select(wrong > 0.0, wrong, 0.0) / self.radius
        r = self.radius * spoke
        normal = outward * _unit(off(c + r))
        residual = outward * (_length(off(c + r)) - self.surface_radius)
        return r, normal, residual + astray


def _length(x: Any) -> Any:
    return np.sqrt(x @ x)


def _unit(x: Any, length: float = 1.0) -> Any:
    """Return a vector scaled to a length, over any scalar."""
    return x * (length / np.sqrt(x @ x))
