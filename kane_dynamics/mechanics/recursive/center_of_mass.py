"""The center of mass of a tree and its Jacobian, over any scalar."""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.errors import ModelError
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.mechanics.recursive.inverse_dynamics import first_moment, inverse_dynamics
from kane_dynamics.mechanics.recursive.link import Link
import numpy as np


def center_of_mass(links: Sequence[Link], q: Any) -> Any:
    """Return the center of mass of links, (3,), m, world axes; ModelError without any mass."""
    mass, moment = first_moment(links, q)
    return moment * _reciprocal(mass)


def center_of_mass_jacobian(links: Sequence[Link], q: Any) -> Any:
    """
    Return the velocity of the center of mass per unit of each speed, (3, n).

    At rest under gravity -e_k, the generalized force is m times row k.
    """
    mass, _ = first_moment(links, np.zeros(len(q)))
    rest = np.zeros(len(q)).astype(object)
    rows = [inverse_dynamics(links, q, rest, rest, -unit) for unit in np.eye(3)]
    return np.stack(rows) * _reciprocal(mass)


def _reciprocal(mass: Any) -> Any:
    if is_zero(mass):
        raise ModelError('moving bodies: no mass; expected at least one body with mass')
    return 1.0 / mass
