"""Momenta of a link and their rates about the origin of other axes, over any scalar."""

from typing import Any, NamedTuple

from kane_dynamics._util.typing import Matrix, Vector
from kane_dynamics.mechanics.algebra.vector import cross, symmetric
import numpy as np


class LinkMomenta(NamedTuple):
    """
    Moments of the mass of a link, its linear momentum, and the rates of its momenta.

    Attributes
    ----------
    h : (3,) array
        int r dm, about the origin of the axes.
    S : (3, 3) array
        int r r^T dm.
    P : (3,) array
        Linear momentum.
    force, moment : (3,) arrays
        Rates of linear and angular momentum.

    """

    h: Vector
    S: Matrix
    P: Vector
    force: Vector
    moment: Vector


def link_momenta(R: Matrix, p: Vector, mass: Any, first: Vector, second: Matrix,
                 motion: tuple[Vector, Vector, Vector, Vector]) -> LinkMomenta:
    """
    Return the momenta of a link.

    Parameters
    ----------
    R, p : (3, 3), (3,) arrays
        Rotation from the link's axes, and its origin.
    mass, first, second : scalar, (3,), (3, 3) arrays
        Moments of its mass in its own axes, about its origin.
    motion : tuple
        Velocity, angular velocity, acceleration and angular acceleration of the point of
        the link that is at the origin of the axes, (3,) each.

    """
    v, omega, a, alpha = motion

    # From the link's axes and origin to the others.
    h_of_link = R @ first
    h = h_of_link + mass * p
    S = symmetric(R @ second @ R.T)
    S = S + symmetric(np.outer(p, h_of_link) + np.outer(h, p))

    # Momenta, and their rates; I omega = trace(S) omega - S omega.
    P = mass * v + cross(omega, h)
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    L = cross(h, v) + trace * omega - S @ omega
    force = mass * a + cross(alpha, h) + cross(omega, P)
    moment = cross(h, a) + trace * alpha - S @ alpha + cross(v, P) + cross(omega, L)
    return LinkMomenta(h, S, P, force, moment)
