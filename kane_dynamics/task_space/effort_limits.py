"""Saturation of torques at the effort limits: of a task, and joint by joint."""

from __future__ import annotations

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.mechanics.algebra.dual import magnitude, select, smallest
import numpy as np

TINY = 1e-300


def within_limits(compensation: Vector, task: Vector, limits: Vector
                  ) -> tuple[Vector, Scalar]:
    """
    Return compensation + s task with the largest s up to 1 within limits, and s.

    All torques of the task have the same factor, so that its wrench keeps its direction.
    Where the compensation alone exceeds a limit in the direction of the task, s is 0;
    the result then exceeds it, too.

    Parameters
    ----------
    compensation, task : (n,) arrays of scalars
        Torques of the joints, N m or N.
    limits : (n,) array of scalars
        N m or N.

    """
    shares: list[Scalar] = [1.0]
    for held, torque, limit in zip(compensation, task, limits):
        is_negative = torque < 0.0
        size = select(is_negative, -torque, torque)
        room = limit - select(is_negative, -held, held)
        room = select(room < 0.0, 0.0, room)
        shares.append(room / select(size < TINY, TINY, size))
    scale = smallest(shares)
    return compensation + scale * np.asarray(task), scale


def clamped(held: Vector, added: Vector, limits: Vector) -> Vector:
    """
    Return held + added, (n,), where each added torque ends at the limit of its joint.

    A held torque beyond its limit stays.
    """
    result = []
    for torque, change, limit in zip(held, added, limits):
        size = magnitude(torque)
        bound = select(size < limit, limit, size)
        total = torque + change
        total = select(total < -bound, -bound, total)
        result.append(select(bound < total, bound, total))
    return np.array(result)
