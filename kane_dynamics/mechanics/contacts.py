"""
Contacts of named points with simple surfaces, over any scalar.

A point, or a sphere around it, of one link meets a plane, a sphere or a cylinder that is
fixed in the world or in another link. With the distance d between them, the normal n
from the surface to the point, and the velocity v of the point of the first link that
touches, relative to the surface,

    d' = n . v,    slip = (t_1 . v, t_2 . v)

with tangents t_1, t_2. These three velocities are rows J v of the joint rates; their
rates at v' = 0 follow by dual numbers.
"""

from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.jet import moving, rates, values
from kane_dynamics.mechanics.algebra.vector import cross, dot
from kane_dynamics.mechanics.ball_joints import coordinate_rates
from kane_dynamics.mechanics.equations import Equations
from kane_dynamics.model.model import Frame
import numpy as np

POLE = 0.81  # square of the height of a normal near the pole of a sphere, for its tangents


class ContactPair(NamedTuple):
    """
    Pair that may touch: a sphere around the origin of a frame, and a surface.

    Attributes
    ----------
    name : str
    point : Frame
        At the center of the sphere.
    radius : float
        Of the sphere, m; 0 for a point.
    shape : str
        'plane', 'sphere' or 'cylinder'.
    surface : Frame
        Its z axis is the normal of a plane or the axis of a cylinder, its origin in the
        plane, at the center of the sphere, or on the axis.
    surface_radius : float
        m.

    """

    name: str
    point: Frame
    radius: float
    shape: str
    surface: Frame
    surface_radius: float


class ContactRows(NamedTuple):
    """
    Rows of c contacts, three of each: normal, then both tangents.

    Attributes
    ----------
    J : (3 c, n_j) array
    velocities, drift : (3 c,) arrays
        J v, and J' v: their rates at v' = 0.
    distances : (c,) array
        m.
    bases : (c, 3, 3) array
        Normal and tangents as rows, in world axes.
    points : (c, 3) array
        Where the contacts touch, m, in the world.

    """

    J: Matrix
    velocities: Vector
    drift: Vector
    distances: Vector
    bases: Matrix
    points: Matrix


def contact_rows(equations: Equations, pairs: tuple[ContactPair, ...], q: Vector,
                 v: Vector) -> ContactRows:
    """Return the rows of contacts at a configuration and joint rates, (n_j,)."""
    tree = equations.tree
    q_moving = moving(q, coordinate_rates(equations.model, q, v))
    J, velocities, drift, distances, bases, points = [], [], [], [], [], []
    for pair in pairs:
        # Distance and velocities along the motion: their rates are the drift.
        pose, surface = (tree.frame_pose(frame, q_moving)
                         for frame in (pair.point, pair.surface))
        distance, basis, arm, point = gap(pair, pose, surface)
        twist, of_surface = (tree.frame_velocity(frame, q_moving, v)
                             for frame in (pair.point, pair.surface))
        lever = point - surface[:3, 3]
        velocity = (twist[:3] + cross(twist[3:], arm)
                    - of_surface[:3] - cross(of_surface[3:], lever))
        rows = np.array([dot(axis, velocity) for axis in basis])
        velocities += list(values(rows))
        drift += list(rates(rows))
        distances.append(values(np.array([distance]))[0])

        # The same velocities for a unit of each joint rate.
        basis, arm, lever = values(basis), values(arm), values(lever)
        of_point, of_other = (tree.partial_velocities(frame, q)
                              for frame in (pair.point, pair.surface))
        columns = []
        for a, b in zip(of_point.T, of_other.T):
            column = a[:3] + cross(a[3:], arm) - b[:3] - cross(b[3:], lever)
            columns.append([dot(axis, column) for axis in basis])
        J.append(np.array(columns).T)
        bases.append(basis)
        points.append(values(point))
    return ContactRows(np.concatenate(J), np.array(velocities), np.array(drift),
                       np.array(distances), np.array(bases), np.array(points))


def gap(pair: ContactPair, pose: Matrix, surface: Matrix
        ) -> tuple[Scalar, Matrix, Vector, Vector]:
    """Return distance, basis (3, 3), arm from the center to the contact, and its place."""
    center = pose[:3, 3]
    x_axis, z_axis = surface[:3, 0], surface[:3, 2]
    away = center - surface[:3, 3]
    if pair.shape == 'plane':
        normal, first = z_axis, x_axis
        distance = dot(normal, away) - pair.radius
    else:
        if pair.shape == 'cylinder':
            away = away - dot(z_axis, away) * z_axis
        length = np.sqrt(dot(away, away))
        normal = (1.0 / length) * away
        distance = length - pair.surface_radius - pair.radius
        first = z_axis
        if pair.shape == 'sphere':
            # A direction across the axis that is farther from the normal.
            height = dot(normal, z_axis)
            near_pole = height * height > POLE
            axis = np.array([select(near_pole, x, z) for x, z in zip(x_axis, z_axis)])
            across = cross(axis, normal)
            first = (1.0 / np.sqrt(dot(across, across))) * across
    basis = np.array([normal, first, cross(normal, first)])
    arm = -pair.radius * normal
    return distance, basis, arm, center + arm
