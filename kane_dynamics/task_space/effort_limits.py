"""Saturation of torques at the effort limits: of a task, and joint by joint."""

from __future__ import annotations

from typing import Any

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import magnitude, select, smallest
from kane_dynamics.mechanics.algebra.lane_products import by_entries
from kane_dynamics.mechanics.algebra.lanes import Lanes

TINY = 1e-300


def within_limits(compensation: Vector, task: Vector, limits: Vector, lanes: Any = Lanes
                  ) -> tuple[Vector, Scalar]:
    """
    Return compensation + s task with the largest s up to 1 within limits, and s.

    All torques of the task have the same factor, so that its wrench keeps its direction.
    Where the compensation alone exceeds a limit in the direction of the task, s is 0;
    the result then exceeds it, too. Joints without a torque of the task do not limit s.

    Parameters
    ----------
    compensation, task : (n,) arrays of scalars
        Torques of the joints, N m or N.
    limits : (n,) array of scalars
        N m or N.
    lanes : class or object
        The functions of `Lanes`.

    """
    shares = by_entries(_share_within, lanes, compensation, task, limits)
    scale = smallest([1.0, *shares])
    return plus_scaled(compensation, scale, task, lanes), scale


def _share_within(held: Scalar, torque: Scalar, limit: Scalar) -> Scalar:
    """Return the largest factor of a torque, perhaps above 1, within a limit."""
    sign = select(torque < 0.0, -1.0, 1.0)
    size = sign * torque
    # The reciprocal does not wait for what is held.
    is_idle = size < TINY
    reciprocal = 1.0 / select(is_idle, 1.0, size)
    room = select(is_idle, 1.0, limit - sign * held)
    return select(room < 0.0, 0.0, room) * reciprocal


def plus_scaled(a: Vector, scale: Scalar, b: Vector, lanes: Any) -> Vector:
    """Return a + scale b, (n,)."""
    return by_entries(lambda x, y: x + scale * y, lanes, a, b)


def clamped(held: Vector, added: Vector, limits: Vector, lanes: Any = Lanes) -> Vector:
    """
    Return held + added, (n,), where each added torque ends at the limit of its joint.

    A held torque beyond its limit stays.
    """
    return by_entries(_clamped, lanes, held, added, limits)


def _clamped(torque: Scalar, change: Scalar, limit: Scalar) -> Scalar:
    """Return the entry of `clamped` for one joint."""
    size = magnitude(torque)
    bound = select(size < limit, limit, size)
    total = torque + change
    total = select(total < -bound, -bound, total)
    return select(bound < total, bound, total)
