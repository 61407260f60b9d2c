"""Inertials of uniform primitive shapes; combine them with ``+``."""

from __future__ import annotations

from kane_dynamics._util.checks import constant
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.model.inertial import Inertial
from kane_dynamics.model.placement import FARTHEST, ORIGIN, point
import numpy as np
from numpy.typing import ArrayLike


def _size(value: ArrayLike, shape: tuple[int, ...], what: str) -> Array:
    """Return lengths, m; raise ModelError if one is negative or not finite."""
    lengths = constant(value, shape, what)
    if (lengths < 0.0).any() or (lengths > FARTHEST).any():
        raise ModelError(f'{what}: {lengths.tolist()} m; expected nonnegative lengths of '
                         f'at most {FARTHEST:g}')
    return lengths


def point_mass(mass: float, at: ArrayLike = ORIGIN) -> Inertial:
    """Return the inertial of a particle of `mass`, kg, at a point, m."""
    return Inertial(mass, point(at, 'place of a point mass'))


def rod(mass: float, start: ArrayLike, end: ArrayLike) -> Inertial:
    """
    Return the inertial of a thin rod: m/12 (l^2 1 - l l^T), with l from end to end.

    Parameters
    ----------
    mass : float
        kg.
    start, end : (3,) arrays
        m.

    Raises
    ------
    ModelError
        If the ends are one point.

    """
    a = point(start, 'start of a rod')
    b = point(end, 'end of a rod')
    length = b - a
    if not length.any():
        raise ModelError(f'rod: both ends at {a.tolist()} m; expected two points, or '
                         'point_mass(mass, at)')
    m = float(constant(mass, (), 'mass'))
    # m/12 (l^2 1 - l l^T), about the center.
    inertia = m / 12.0 * (length @ length * np.eye(3) - np.outer(length, length))
    return Inertial(mass, 0.5 * (a + b), inertia)


def disc(mass: float, radius: float, axis: ArrayLike = (0.0, 0.0, 1.0), *,
         at: ArrayLike = ORIGIN, thickness: float = 0.0) -> Inertial:
    """
    Return the inertial of a disc or a cylinder: m r^2/2 about its axis.

    Parameters
    ----------
    mass : float
        kg.
    radius, thickness : float
        m; the thickness is measured along the axis.
    axis : (3,) array
        Direction, of any length.
    at : (3,) array
        Center, m.

    Raises
    ------
    ModelError
        If the axis is zero or a length is negative.

    """
    n = constant(axis, (3,), 'axis of a disc')
    if not n.any():
        raise ModelError(f'axis of a disc: {n.tolist()}; expected a nonzero vector')
    n = n / np.abs(n).max()  # its square would overflow or vanish otherwise
    along = np.outer(n, n) / (n @ n)
    m = float(constant(mass, (), 'mass'))
    r = float(_size(radius, (), 'radius of a disc'))
    h = float(_size(thickness, (), 'thickness of a disc'))
    # Across the axis, m (r^2 / 4 + h^2 / 12).
    across = m * (r * r / 4.0 + h * h / 12.0)
    inertia = 0.5 * m * r * r * along + across * (np.eye(3) - along)
    return Inertial(mass, point(at, 'center of a disc'), inertia)


def ball(mass: float, radius: float, at: ArrayLike = ORIGIN) -> Inertial:
    """Return the inertial of a solid ball: 2/5 m r^2 about every diameter; kg and m."""
    size = float(_size(radius, (), 'radius of a ball'))
    m = float(constant(mass, (), 'mass'))
    inertia = 0.4 * m * size**2 * np.eye(3)
    return Inertial(mass, point(at, 'center of a ball'), inertia)


def box(mass: float, size: ArrayLike, at: ArrayLike = ORIGIN) -> Inertial:
    """Return the inertial of a box with edges (3,), m: m/12 (b^2 + c^2) about a."""
    squares: Array = _size(size, (3,), 'size of a box')**2
    m = float(constant(mass, (), 'mass'))
    inertia = m / 12.0 * np.diag(squares.sum() - squares)
    return Inertial(mass, point(at, 'center of a box'), inertia)
