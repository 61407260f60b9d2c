"""
A pose that follows a target within limits of speed and acceleration.

Position and orientation each move as follows. With e the distance to the target, w its
velocity and a the largest acceleration, the desired velocity is w plus that at which a
brake at a reaches the target: sqrt(2 a |e|) along e, and in proportion to e where e is
small, with the same slope. It is limited to the largest speed, and its change to a dt.
"""

from kane_dynamics._util.typing import Array, Scalar, Vector
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.robot.robot import Robot
from kane_dynamics.ros.torque_path.pose_functions import (bound, displaced,
                                                          displacement)
import numpy as np

FASTEST_DECAY = 30.0  # 1/s: rate at which a small distance vanishes
LARGEST_SHARE = 0.3  # of a small distance that vanishes in one step
SMOOTHING = 0.05  # s: time constant of the acceleration for feedforward
BRAKE = 0.8  # of the acceleration limit, used to brake: the others correct it
TINY = 1e-30


class TargetFilter:
    """
    Moves a pose towards a target.

    Parameters
    ----------
    robot : Robot
        Compiles the kernel.

    Attributes
    ----------
    pose : (4, 4) array
    twist, acceleration : (6,) arrays
        Of the pose: linear, then angular, world axes; the acceleration is smoothed.
    limits : (4,) array
        See `set_limits`.

    """

    def __init__(self, robot: Robot) -> None:
        # Pose, twist and acceleration in one array, which the kernel reads and writes.
        self._state = np.zeros(28)
        self._next = np.zeros(28)
        self.pose = self._state[:16].reshape(4, 4)
        self.twist = self._state[16:22]
        self.acceleration = self._state[22:]
        self._target = np.eye(4)
        self._target_twist = np.zeros(6)
        self.limits = np.ones(4)
        self._step = np.zeros(())
        self._advance = bound(robot, filtered_pose, self._next, state=self._state,
                              target=self._target, target_twist=self._target_twist,
                              limits=self.limits, dt=self._step)

    def set_limits(self, speed: float, angular_speed: float, acceleration: float,
                   angular_acceleration: float) -> None:
        """Change the limits, m/s, rad/s, m/s^2 and rad/s^2."""
        self.limits[:] = speed, angular_speed, acceleration, angular_acceleration

    def restart(self, pose: Array) -> None:
        """Begin at rest at a pose, (4, 4)."""
        self._state[:] = 0.0
        self.pose[:] = pose

    def advance(self, target: Array, twist: Array, dt: float) -> None:
        """Move the pose towards a target with a twist for a time, s."""
        if dt <= 0.0:
            return
        self._target[:] = target
        self._target_twist[:] = twist
        self._step[()] = dt
        self._advance()
        self._state[:] = self._next


def filtered_pose(state: Vector, target: Vector, target_twist: Vector, limits: Vector,
                  dt: Scalar) -> Vector:
    """Return the state after a time step; traced."""
    pose = state[:16].reshape(4, 4)
    twist = state[16:22]
    error = displacement(pose, target)
    acceleration = []
    for part in range(2):
        places = slice(3 * part, 3 * part + 3)
        acceleration.append(_acceleration(error[places], twist[places],
                                          target_twist[places], limits[part],
                                          limits[2 + part], dt))
    change = np.concatenate(acceleration)
    new_twist = twist + dt * change
    moved = displaced(pose, dt * new_twist)
    # For feedforward: its jumps would be jumps of torque.
    share = select(dt < SMOOTHING, dt / SMOOTHING, 1.0)
    smooth = state[22:] + share * (change - state[22:])
    return np.concatenate([moved.ravel(), new_twist, smooth])


def _acceleration(error: Vector, velocity: Vector, target_velocity: Vector,
                  fastest: Scalar, largest: Scalar, dt: Scalar) -> Vector:
    """Return the acceleration, (3,), of position or orientation."""
    distance = np.sqrt(error @ error + TINY)
    decay = select(FASTEST_DECAY * dt < LARGEST_SHARE, FASTEST_DECAY, LARGEST_SHARE / dt)
    brake = BRAKE * largest
    # Where both laws meet they have the same slope.
    near = brake / (decay * decay)
    root = np.sqrt(2.0 * brake * select(near < distance, distance - 0.5 * near, near))
    approach = select(near < distance, root, decay * distance)
    desired = target_velocity + (approach / distance) * error
    desired = _limited(desired, fastest)
    return _limited((1.0 / dt) * (desired - velocity), largest)


def _limited(vector: Vector, largest: Scalar) -> Vector:
    """Return a vector whose length is at most a limit, with its direction."""
    length = np.sqrt(vector @ vector + TINY)
    return select(largest < length, largest / length, 1.0) * vector
