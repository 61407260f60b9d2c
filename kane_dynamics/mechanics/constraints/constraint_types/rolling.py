"""Rolling without slipping: a wheel or a ball on a plane, a cylinder or a sphere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import ConstraintError
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.vector import cross
from kane_dynamics.mechanics.constraints.constraint_types.constraint_rows import (
    ConstraintRows, finite_number, Geometry, positive, triad, unit)
from kane_dynamics.model.model import Frame, WORLD
import numpy as np

SURFACES = ('plane', 'cylinder', 'sphere')
ITERATIONS = 6  # of Newton's method for the point of a rim nearest to a cylinder


class RollingContact(NamedTuple):
    """
    The contact of a wheel or ball with its surface; axes of the geometry.

    Attributes
    ----------
    R_surface : (3, 3) array
        Axes (columns) of the surface's frame.
    axle : (3,) array or None
        The wheel's axle; None for a ball.
    r, normal : (3,) arrays
        Center to contact point, m; normal of the surface there.
    residual : scalar
        Distance between the bodies, m.
    v : (3, n_q) array
        Partial velocities of the contact point of the wheel relative to the surface's.

    """

    R_surface: Matrix
    axle: Vector | None
    r: Vector
    normal: Vector
    residual: Scalar
    v: Matrix


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
    Rows hold the velocity of the wheel's (or ball's) point of contact relative to the
    surface's: `tangent_1`, `tangent_2`, `normal`. For a wheel, tangent_1 is its
    direction of travel at a positive angular velocity about the axle (axle x normal) and
    tangent_2 is normal x tangent_1: the same rows are redundant for every heading. For a
    ball on a plane they are two directions fixed in the surface's frame; on a cylinder
    tangent_1 is along the cylinder; on a sphere they are those on a plane, rotated by
    the shortest rotation from the parameter `normal` to the normal of the contact
    (undefined where the two are opposite). The residual of `normal` is the distance
    between the bodies, m; the tangents have none.

    The contact point of a rim on a cylinder is found by Newton's method. On the outer
    side it is exact to rounding if the angle between axle and cylinder axis is at most
    60 degrees; on the inner side the axle must be nearly parallel to that axis, since a
    tilted rim touches at two points. If the method fails, the residual of `normal` is
    not zero.

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
        # Lengths and directions, whatever the surface is.
        freeze(self, 'radius', positive(self.radius, f'{what}: radius'))
        freeze(self, 'normal', unit(self.normal, f'{what}: normal'))
        freeze(self, 'height', finite_number(self.height, f'{what}: height'))
        freeze(self, 'surface_axis', unit(self.surface_axis, f'{what}: surface_axis'))
        if self.axis is not None:
            freeze(self, 'axis', unit(self.axis, f'{what}: axis'))
        if self.surface not in SURFACES:
            raise ConstraintError(f'{what}: surface: {self.surface!r}; expected one of '
                                  f'{", ".join(SURFACES)}')

        # Arguments that only one kind of surface has.
        curved = self.surface != 'plane'
        if curved != (self.surface_radius is not None):
            raise ConstraintError(
                f'{what}: surface_radius: {self.surface_radius}, of a {self.surface}; '
                'expected it for a cylinder or sphere only')
        if self.inside and not curved:
            raise ConstraintError(f'{what}: inside: true, of a plane; expected it for a '
                                  'cylinder or sphere only')
        if self.height and curved:
            raise ConstraintError(f'{what}: height: {self.height}, of a {self.surface}; '
                                  'expected it for a plane only')

        # The wheel inside a cylinder or sphere is smaller than it.
        if self.surface_radius is not None:
            surface_radius = positive(self.surface_radius, f'{what}: surface_radius')
            freeze(self, 'surface_radius', surface_radius)
            if self.inside and surface_radius <= self.radius:
                raise ConstraintError(
                    f'{what}: radius: {self.radius}; expected less than surface_radius, '
                    f'{surface_radius}, to roll inside')

    @property
    def labels(self) -> tuple[str, ...]:
        """Return the names of the rows: two tangents of the surface, and its normal."""
        parts = ('tangent_1', 'tangent_2', 'normal')
        return tuple(f'{self.name}/{part}' for part in parts)

    @property
    def _surface(self) -> str | Frame:
        """Return the frame of the surface."""
        return Frame('', WORLD) if self.surface_frame is None else self.surface_frame

    def rows(self, geometry: Geometry) -> ConstraintRows:
        """Return the rows of zero velocity of the contact relative to the surface."""
        if self.axis is None:
            carrier = self._surface
        else:
            carrier = geometry.axle_carrier(self.frame, self.axis)
        contact = self._contact(geometry.in_axes_of(carrier))
        R_surface = contact.R_surface
        normal = contact.normal

        # tangent_1, a unit vector: see the class's notes.
        if contact.axle is not None:
            tangent = cross(contact.r, contact.axle) * (1.0 / self.radius)
        elif self.surface == 'plane':
            tangent = R_surface @ triad(self.normal)[0]
        elif self.surface == 'cylinder':
            tangent = R_surface @ self.surface_axis
        else:
            # By the shortest rotation from `normal` to the normal of the contact.
            start = R_surface @ self.normal
            e = R_surface @ triad(self.normal)[0]
            tangent = e - (start + normal) * ((e @ normal) / (1.0 + start @ normal))

        directions = (tangent, cross(normal, tangent), normal)
        J = np.array([direction @ contact.v for direction in directions])
        return ConstraintRows(J, np.zeros(3), (None, None, contact.residual))

    @property
    def has_surface_rows(self) -> bool:
        """Return whether `surface_rows` differ from `rows`: of a wheel on a plane."""
        return self.axis is not None and self.surface == 'plane'

    def surface_rows(self, geometry: Geometry) -> tuple[ConstraintRows, Matrix]:
        """
        Return rows J_0 with tangents fixed in the plane, and B, (3, 3), with J = B J_0.

        B is a rotation, so that both rows are equivalent where all three are kept; those
        fixed in the plane take less arithmetic.
        """
        contact = self._contact(geometry.in_axes_of(self._surface))
        first, second = (contact.R_surface @ e for e in triad(self.normal)[:2])

        # The direction of travel has the components x, y along the fixed tangents.
        travel = cross(contact.r, contact.axle) * (1.0 / self.radius)
        x = travel @ first
        y = travel @ second

        directions = (first, second, contact.normal)
        J = np.array([direction @ contact.v for direction in directions])
        # The third row keeps the distance, and is the only one with a residual.
        rows = ConstraintRows(J, np.zeros(3), (None, None, contact.residual))
        return rows, np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])

    def _contact(self, geometry: Geometry) -> RollingContact:
        """Return the contact of the wheel or ball with its surface."""
        R, center = geometry.pose(self.frame)
        R_surface, origin = geometry.pose(self._surface)
        axle = None if self.axis is None else R @ self.axis
        c = center - origin
        # r leads from the center to the point of contact,
        # along the normal of the surface.
        if self.surface == 'plane':
            r, normal, residual = self._contact_on_plane(c, R_surface, axle)
        else:
            r, normal, residual = self._contact_on_curve(c, R_surface, axle)

        # The contact points of both bodies are at the same place.
        point = center + r
        # Rolling without slip: the velocity of one point relative to the other is zero.
        v = geometry.partial_velocities(self.frame, point)[:3]
        if self.surface_frame is not None:
            v = v - geometry.partial_velocities(self.surface_frame, point)[:3]
        return RollingContact(R_surface, axle, r, normal, residual, v)

    def _contact_on_plane(self, c: Vector, R_surface: Matrix,
                          axle: Vector | None) -> tuple[Vector, Vector, Scalar]:
        """Return the same as `_contact_on_curve` for a plane."""
        normal = R_surface @ self.normal
        if axle is None:
            r = -self.radius * normal
        else:
            # The lowest point of the rim: against the normal, across the axle.
            r = _unit(normal - (normal @ axle) * axle, -self.radius)
        return r, normal, normal @ (c + r) - self.height

    def _contact_on_curve(self, c: Vector, R_surface: Matrix,
                          axle: Vector | None) -> tuple[Vector, Vector, Scalar]:
        """
        Return center to contact point, the surface's normal there, and the distance, m.

        `c`, (3,), is the center from the origin of the surface's frame.
        """
        outward = -1.0 if self.inside else 1.0
        line = R_surface @ self.surface_axis

        def off(x: Vector) -> Vector:
            """Return a vector without its component along the cylinder's axis."""
            return x if self.surface == 'sphere' else x - (x @ line) * line

        # A ball touches where the normal through its center meets the surface.
        normal = outward * _unit(off(c))
        if axle is None:
            distance = outward * (_length(off(c)) - self.surface_radius)
            residual = distance - self.radius
            return -self.radius * normal, normal, residual

        # The spoke, a unit vector from the center of the wheel, leads to the contact. On
        # a sphere it is in the plane of the normal and the axle.
        spoke = -1.0 * _unit(normal - (normal @ axle) * axle)
        error: Scalar = 0.0
        if self.surface == 'cylinder':
            # Newton's method for the angle of the spoke at which the squared distance of
            # the rim from the axis is stationary: p . p' = 0, with p' = slope, and the
            # derivative slope . slope + p . p''.
            for k in range(ITERATIONS + 1):
                turned = cross(axle, spoke)
                p = off(c + self.radius * spoke)
                slope = self.radius * off(turned)
                bend = slope @ slope - self.radius * (p @ off(spoke))
                turn = (p @ slope) / bend
                if k < ITERATIONS:
                    spoke = _unit(spoke - turn * turned)

            # No contact point, so no zero residual: the last step is not small, or the
            # stationary point is the one on the far side, where this is positive.
            wrong_side = -outward * bend
            error = (self.radius * turn * turn
                     + select(wrong_side > 0.0, wrong_side, 0.0) / self.radius)

        r = self.radius * spoke
        normal = outward * _unit(off(c + r))
        distance = outward * (_length(off(c + r)) - self.surface_radius)
        return r, normal, distance + error


def _length(x: Vector) -> Scalar:
    """Return the norm of a vector, over any scalar."""
    return np.sqrt(x @ x)


def _unit(x: Vector, length: float = 1.0) -> Vector:
    """Return a vector scaled to a length, over any scalar."""
    return x * (length / np.sqrt(x @ x))
