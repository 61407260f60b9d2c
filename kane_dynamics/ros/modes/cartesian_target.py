"""Messages to the target of the controlled frame, which `cartesian_cycle` follows."""

from collections.abc import Callable
import math
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Matrix, Vector
from kane_dynamics.control_cycle.cycle_results import NEVER
from kane_dynamics.mechanics.algebra.quaternion import rotation_matrix
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.modes.cartesian_cycle import TargetOrders
import numpy as np


class Directed(NamedTuple):
    """
    A twist or a wrench of a message.

    Attributes
    ----------
    numbers : (6,) array
        Linear, then angular.
    turns : bool
        Whether they are in the axes of the target; else in those of the world.
    at : int
        When it arrived, ns.

    """

    numbers: Array
    turns: bool
    at: int


class CartesianTarget:
    """
    The latest pose, twist and wrench of messages.

    Messages and states are processed in the same thread.

    Parameters
    ----------
    timeout : float
        s; without a further message in this time, twist and wrench end.

    Attributes
    ----------
    timeout : float
    moved_at : int
        When the last pose or twist arrived, ns; 0: none.
    twists : int
        Number of the latest twist.
    changes : int
        How often a message changed what is asked.
    changed : callable
        Called after each message.

    """

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        self.changed: Callable[[], Any] = lambda: None
        # Numbers of messages, by which the law sees that one is new.
        self.changes = 0
        self.twists = 0
        self._count = 0
        self._wrenches = 0
        self._goal = np.eye(4)
        self._posed_at = 0
        self.moved_at = 0
        self._twist: Directed | None = None
        self._wrench: Directed | None = None

    def go_to(self, pose: Matrix, now: int) -> None:
        """Reach a pose in the time since the last one."""
        self._count += 1
        self._goal = pose.copy()
        self._posed_at = self.moved_at = now
        self._note_change()

    def move(self, twist: Vector, turns: bool, now: int) -> None:
        """Move with a twist, (6,), in the axes of the target if it turns, else the world's."""
        self.twists += 1
        self._twist = Directed(twist.copy(), turns, now)
        self.moved_at = now
        self._note_change()

    def press(self, wrench: Vector, turns: bool, now: int) -> None:
        """Add a wrench, (6,), in the axes of the target if it turns, else the world's."""
        self._wrenches += 1
        self._wrench = Directed(wrench.copy(), turns, now)
        self._note_change()

    def _note_change(self) -> None:
        self.changes += 1
        self.changed()

    def orders(self, epoch: int, farthest: float, widest: float, limits: Vector
               ) -> TargetOrders:
        """
        Return the orders of the messages, with times since epoch, ns.

        Further parameters are the fields of `TargetOrders` of these names.
        """
        # Numbers, time and axes of a twist or a wrench; without one, never.
        def of(directed: Directed | None) -> tuple[Array, float, float]:
            if directed is None:
                return np.zeros(6), NEVER, 0.0
            return directed.numbers, float(directed.at - epoch), float(directed.turns)
        return TargetOrders(float(self._count), float(self._posed_at - epoch),
                            float(self.twists), float(self._wrenches), self._goal,
                            *of(self._twist), *of(self._wrench), self.timeout * NANO,
                            farthest, widest, limits)


def pose_of_numbers(numbers: Vector, frame: Matrix) -> Matrix:
    """
    Return the pose of a message in the world, (4, 4).

    Parameters
    ----------
    numbers : (7,) array
        Position, m, and quaternion x, y, z, w of any length.
    frame : (4, 4) array
        The pose of the frame in which they are.

    """
    rotation = frame[:3, :3] @ rotation_matrix(numbers[3:])
    position = frame[:3, :3] @ numbers[:3] + frame[:3, 3]
    upper = np.concatenate([rotation, position[:, None]], axis=1)
    return np.concatenate([upper, np.array([[0.0, 0.0, 0.0, 1.0]])])


def largest_of(error: Array) -> tuple[float, float]:
    """Return distance, m, and angle, rad, of a displacement (6,)."""
    # Squares of components above 1e154 would overflow.
    return math.hypot(*error[:3]), math.hypot(*error[3:])
