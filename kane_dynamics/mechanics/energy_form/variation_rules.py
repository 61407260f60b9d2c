"""
Variations and time derivatives of vectors and dyadics, seen from frames that turn.

A frame B turns in A with the angular velocity omega; in a variation of the motion it turns by the
possible rotation theta. What stands still in B changes in A by turning alone, so for a vector V
and a dyadic D

    A_var V = B_var V + theta x V,        A_d V = B_d V + omega x V,
    A_var D = B_var D + theta x D - D x theta,   and A_d D with omega likewise,

and, rotations of A and B being what they are at every time of the varied motion,

    A_var omega = A_d theta + theta x omega,     hence B_var omega = A_d theta.

Components of everything are along one and the same triad, whichever frame the change is seen
from. A scalar changes alike in all frames, so each term of an energy may be varied in the frame
in which that is least work. Source: vector variations, Journal of Robotic Systems 5 (1988) 553.
"""

from typing import Any

import numpy as np


def turned(turn: Any, quantity: Any) -> Any:
    """
    Return how turning alone changes a quantity.

    Parameters
    ----------
    turn : (3,) array of scalars
        Possible rotation theta, rad, or angular velocity omega, rad/s.
    quantity : (3,) or (3, 3) array of scalars
        A vector V, which gives theta x V, or a dyadic D, which gives theta x D - D x theta.

    """
    if np.ndim(quantity) == 1:
        return np.cross(turn, quantity)
    return np.cross(turn, quantity.T).T - np.cross(quantity, turn)  # columns, then rows


def absolute(relative_change: Any, turn: Any, quantity: Any) -> Any:
    """
    Return the change of a vector or dyadic in frame A from its change in frame B.

    Parameters
    ----------
    relative_change : (3,) or (3, 3) array of scalars
        Variation, or time derivative, in B.
    turn : (3,) array of scalars
        Possible rotation, or angular velocity, of B in A.
    quantity : (3,) or (3, 3) array of scalars
        What changes.

    """
    return relative_change + turned(turn, quantity)


def relative(absolute_change: Any, turn: Any, quantity: Any) -> Any:
    """
    Return the change of a vector or dyadic in frame B from its change in frame A.

    Parameters
    ----------
    absolute_change : (3,) or (3, 3) array of scalars
        Variation, or time derivative, in A.
    turn : (3,) array of scalars
        Possible rotation, or angular velocity, of B in A.
    quantity : (3,) or (3, 3) array of scalars
        What changes.

    """
    return absolute_change - turned(turn, quantity)


def angular_velocity_variation(rotation_rate: Any, rotation: Any, omega: Any) -> Any:
    """
    Return the variation in A of the angular velocity of B in A: A_d theta + theta x omega.

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
