"""
Variations and time derivatives of vectors and dyadics in rotating frames.

A frame B rotates in A with the angular velocity omega; in a variation of the motion it
rotates by the possible rotation theta. A quantity that is constant in B changes in A by
the rotation alone. So for a vector V and a dyadic D

    A_var V = B_var V + theta x V,        A_d V = B_d V + omega x V,
    A_var D = B_var D + theta x D - D x theta,   and A_d D with omega likewise,

and for the angular velocity itself,

    A_var omega = A_d theta + theta x omega,     hence B_var omega = A_d theta.

All components are along one triad, for changes in either frame. The change of a scalar
is equal in all frames, so each term of an energy may be varied in the most convenient
one. Source: vector variations, Journal of Robotic Systems 5 (1988) 553.
"""

from typing import Any

from kane_dynamics.mechanics.algebra.vector import cross
import numpy as np


def rotation_change(turn: Any, quantity: Any) -> Any:
    """
    Return the change of a quantity due to rotation alone.

    Parameters
    ----------
    turn : (3,) array of scalars
        Possible rotation theta, rad, or angular velocity omega, rad/s.
    quantity : (3,) or (3, 3) array of scalars
        A vector V, for theta x V, or a dyadic D, for theta x D - D x theta.

    """
    if np.ndim(quantity) == 1:
        return cross(turn, quantity)
    return cross(turn, quantity) + cross(turn, quantity.T).T  # columns, then rows


def absolute(relative_change: Any, turn: Any, quantity: Any) -> Any:
    """
    Return the change of a vector or dyadic in frame A from its change in frame B.

    Parameters
    ----------
    relative_change : (3,) or (3, 3) array of scalars
        Variation or time derivative in B.
    turn : (3,) array of scalars
        Possible rotation or angular velocity of B in A.
    quantity : (3,) or (3, 3) array of scalars
        The changing quantity.

    """
    return relative_change + rotation_change(turn, quantity)


def relative(absolute_change: Any, turn: Any, quantity: Any) -> Any:
    """
    Return the change of a vector or dyadic in frame B from its change in frame A.

    Arguments as `absolute`, which it inverts.
    """
    return absolute_change - rotation_change(turn, quantity)


def angular_velocity_variation(rotation_rate: Any, rotation: Any, omega: Any) -> Any:
    """
    Return the variation in A of the angular velocity of B in A.

    It is A_d theta + theta x omega.

    Parameters
    ----------
    rotation_rate : (3,) array of scalars
        Time derivative in A of the possible rotation, rad/s.
    rotation : (3,) array of scalars
        Possible rotation of B in A, rad.
    omega : (3,) array of scalars
        Angular velocity of B in A, rad/s.

    """
    return absolute(rotation_rate, rotation, omega)
