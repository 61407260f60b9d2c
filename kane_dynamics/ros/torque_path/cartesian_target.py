"""
The target of the controlled frame between two messages.

A pose of `~/target_pose` is reached along a straight line and about one axis, at constant
speed, in the time between the last two poses: poses at 5 Hz then give a motion without
stops, one period late. While `~/target_twist` is in time, the target moves with it from
the last pose on, without delay. A target that no message moves any more is held.
"""

from collections.abc import Callable

from kane_dynamics._util.typing import Array, Matrix, Vector
from kane_dynamics.mechanics.algebra.quaternion import rotation_matrix
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.common.conversion import NANO
from kane_dynamics.ros.torque_path.pose_functions import (bound, displaced,
                                                          displacement)
import numpy as np

LONGEST_PERIOD = 0.3  # s between two poses that belong together: of 5 Hz, with delays


class CartesianTarget:
    """
    The pose and the twist that the controlled frame is to have, and the wrench.

    Messages and states are processed in the same thread.

    Parameters
    ----------
    robot : Robot
        Compiles the kernels.
    timeout : float
        s; without a further message in this time, twist and wrench end.

    Attributes
    ----------
    pose : (4, 4) array
        At the time of the last `advance`, in the world.
    twist : (6,) array
        Its velocity, linear then angular, world axes.
    known : bool
        Whether there is a pose.
    moved_at : int
        When the last pose or twist arrived, ns; 0: none since `clear`.

    """

    def __init__(self, robot: Robot, timeout: float) -> None:
        self.timeout = timeout
        self.pose = np.eye(4)
        self.twist = np.zeros(6)
        self._start = np.eye(4)  # where the present movement began
        self._goal = np.eye(4)
        self._step = np.zeros(6)  # its displacement
        self._share = np.zeros(())
        self._displace = bound(robot, displaced, self.pose, start=self._start,
                               step=self._step, share=self._share)
        self._compare = bound(robot, displacement, self._step, start=self._start,
                              goal=self._goal)
        self.clear()

    def clear(self) -> None:
        """Forget the target, as the law restarts."""
        self.known = False
        self.moved_at = 0
        self._posed_at = 0  # when the last pose arrived, ns
        self._advanced_at = 0
        self._duration = 0.0  # of the movement to the last pose, s
        self._wrench: Callable[[], Array] | None = None
        self._wrench_at = 0
        self._twist: Callable[[], Array] | None = None
        self._twist_at = 0
        self.twist[:] = 0.0

    def begin(self, pose: Array) -> None:
        """Hold a pose, that of the frame when the law begins."""
        self.pose[:] = pose
        self.known = True
        self._duration = 0.0

    def go_to(self, pose: Array, now: int) -> None:
        """Reach a pose in the time since the last one."""
        self.advance(now, True)
        since = (now - self._posed_at) / NANO
        self._posed_at = self.moved_at = now
        self._start[:] = self.pose
        self._goal[:] = pose
        self._compare()
        # A single pose is reached as fast as the limits of the target allow.
        self._duration = since if 0.0 < since <= LONGEST_PERIOD else 0.0
        self._began = now
        if self._duration == 0.0 or self._moves_by_twist(now):
            self.pose[:] = pose
            self._duration = 0.0

    def move(self, twist: Callable[[], Array], now: int) -> None:
        """Move with a twist, whose function gives it in world axes at the present pose."""
        self._twist = twist
        self._twist_at = self.moved_at = now

    def press(self, wrench: Callable[[], Array], now: int) -> None:
        """Add a wrench, whose function gives it in world axes at the present pose."""
        self._wrench = wrench
        self._wrench_at = now

    @property
    def has_twist(self) -> bool:
        """Return whether a twist was received that has not ended yet."""
        return self._twist is not None

    def _moves_by_twist(self, now: int) -> bool:
        """Return whether the last twist is in time."""
        if self._twist is None:
            return False
        if (now - self._twist_at) / NANO > self.timeout:
            self._twist = None
            return False
        return True

    def advance(self, now: int, may_move: bool) -> None:
        """
        Set `pose` and `twist` to their values at a time, ns.

        Parameters
        ----------
        now : int
            Stamp of the state, ns.
        may_move : bool
            False holds a target that moves with a twist, such as one that is far ahead
            of the arm.

        """
        elapsed = max(now - self._advanced_at, 0) / NANO if self._advanced_at else 0.0
        self._advanced_at = now
        self.twist[:] = 0.0
        if self._duration > 0.0:
            share = (now - self._began) / NANO / self._duration
            if share < 1.0:
                self._share[()] = max(share, 0.0)
                self.twist[:] = self._step
                self.twist /= self._duration
            else:
                self._share[()] = 1.0
                self._duration = 0.0
            self._displace()
        elif self._moves_by_twist(now) and may_move:
            assert self._twist is not None
            self.twist[:] = self._twist()
            self._start[:] = self.pose
            np.multiply(self.twist, elapsed, out=self._step)
            self._share[()] = 1.0
            self._displace()

    def wrench(self, now: int) -> Array | None:
        """Return the wrench at the frame, (6,) in world axes; None without one in time."""
        if self._wrench is None:
            return None
        if (now - self._wrench_at) / NANO > self.timeout:
            self._wrench = None
            return None
        return self._wrench()


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
    return float(np.sqrt(error[:3] @ error[:3])), float(np.sqrt(error[3:] @ error[3:]))
