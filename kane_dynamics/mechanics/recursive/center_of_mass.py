"""The center of mass of a tree, its Jacobian, and the momentum about it, any scalar."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import ModelError
from kane_dynamics.mechanics.algebra.vector import cross, is_zero
from kane_dynamics.mechanics.recursive.frame_kinematics import link_poses
from kane_dynamics.mechanics.recursive.inverse_dynamics import (first_moment,
                                                                inverse_dynamics)
from kane_dynamics.mechanics.recursive.link import Link
from kane_dynamics.model.model import WORLD
import numpy as np


def center_of_mass(links: Sequence[Link], q: Vector) -> Vector:
    """Return the center of mass of links, (3,), m; ModelError if they are massless."""
    mass, moment = first_moment(links, q)
    return moment * _reciprocal(mass)


def center_of_mass_jacobian(links: Sequence[Link], q: Vector) -> Matrix:
    """Return the velocity of the center of mass per unit of each speed, (3, n)."""
    mass, _ = first_moment(links, np.zeros(len(q)))
    return _linear_momentum_matrix(links, q) * _reciprocal(mass)


def _linear_momentum_matrix(links: Sequence[Link], q: Vector) -> Matrix:
    """Return the linear momentum per unit of each speed, (3, n)."""
    at_rest = np.zeros(len(q)).astype(object)
    # At rest under gravity -e_k, the generalized force is the mass times row k.
    rows = []
    for axis in np.eye(3):
        rows.append(inverse_dynamics(links, q, at_rest, at_rest, -axis))
    return np.stack(rows)


def centroidal_momentum_matrix(links: Sequence[Link], q: Vector) -> Matrix:
    """
    Return linear, and angular momentum about the center of mass, per unit speed, (6, n).

    By the symmetry of the mass matrix of the tree on a free base, row k is the force of
    the joints, at rest, while the base accelerates by e_k or turns about the center of
    mass by e_k.
    """
    center = center_of_mass(links, q)
    at_rest = np.zeros(len(q)).astype(object)
    rows = []
    for axis in np.eye(3):
        # The world's origin accelerates by -axis x center.
        rows.append(inverse_dynamics(links, q, at_rest, at_rest, cross(axis, center), axis))
    return np.concatenate([_linear_momentum_matrix(links, q), np.stack(rows)])


def resultant(links: Sequence[Link], q: Vector, reactions: Sequence[Vector]) -> Vector:
    """Return the wrench of the base's reactions about the center of mass, (6,)."""
    center = center_of_mass(links, q)
    force: Vector = np.zeros(3)
    moment: Vector = np.zeros(3)
    for link, (_, origin), reaction in zip(links, link_poses(links, q), reactions):
        if link.parent == WORLD:
            force = force + reaction[:3]
            moment = moment + reaction[3:] + cross(origin - center, reaction[:3])
    return np.concatenate([force, moment])


def _reciprocal(mass: Scalar) -> Scalar:
    """Return 1 / mass; raise ModelError if the mass is zero."""
    if is_zero(mass):
        raise ModelError('moving bodies: no mass; expected at least one body with mass')
    return 1.0 / mass
