"""The center of mass of a tree and its Jacobian, over any scalar."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.errors import ModelError
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.recursive.inverse_dynamics import (first_moment,
                                                                inverse_dynamics)
from kane_dynamics.mechanics.recursive.link import Link
import numpy as np


def center_of_mass(links: Sequence[Link], q: Vector) -> Vector:
    """Return the center of mass of links, (3,), m; ModelError if they are massless."""
    mass, moment = first_moment(links, q)
    return moment * _reciprocal(mass)


def center_of_mass_jacobian(links: Sequence[Link], q: Vector) -> Matrix:
    """Return the velocity of the center of mass per unit of each speed, (3, n)."""
    mass, _ = first_moment(links, np.zeros(len(q)))
    at_rest = np.zeros(len(q)).astype(object)
    # At rest under gravity -e_k, the generalized force is the mass times row k.
    rows = []
    for axis in np.eye(3):
        rows.append(inverse_dynamics(links, q, at_rest, at_rest, -axis))
    return np.stack(rows) * _reciprocal(mass)


def _reciprocal(mass: Scalar) -> Scalar:
    """Return 1 / mass; raise ModelError if the mass is zero."""
    if is_zero(mass):
        raise ModelError('moving bodies: no mass; expected at least one body with mass')
    return 1.0 / mass
