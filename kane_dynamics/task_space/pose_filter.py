"""
Target filter: a pose that follows a goal within limits of speed and acceleration.

From sample to sample the velocity v turns towards the one that reaches the goal at a
distance d without overshoot: along d, of the speed s with s h + s^2 / (2 a) = |d| for
the sample time h, plus the goal's own velocity. It changes by at most a h, and its
length stays below the limit. Position and orientation do so separately, the orientation
by its rotation vector.

The acceleration then changes in steps. With a smoothing time T the target is that pose
behind a low-pass filter of first order: p_s + T p_s' = p. Its velocity and acceleration
are those of p behind the same filter, so that all three belong together, the limits hold
as before, and the acceleration is continuous. The target is T later for it. Orientations
go a part of the rotation vector between the two; where its axis changes, the limit of the
angular acceleration holds to the order of (T w)^2 for an angular speed w.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any, NamedTuple

from kane_dynamics._util.checks import finite_row, number
from kane_dynamics._util.fixed_attributes import guarded_class
from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.vector import skew
from kane_dynamics.mechanics.constraints.conditioning import guarded as nan_unless
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel
from kane_dynamics.robot.methods.frame_methods import DIRECTIONS
from kane_dynamics.task_space.orientation_error import half_turn_quaternion
from kane_dynamics.task_space.pose_checks import pose_margin, require_pose
import numpy as np
from numpy.typing import ArrayLike

TINY = 1e-24  # squared distance, m^2 or rad^2, that counts as none
STILL = np.zeros(6)


class TargetState(NamedTuple):
    """
    Pose, velocity and acceleration of a filtered target, in the world.

    Attributes
    ----------
    pose : (4, 4) array
        m.
    twist, acceleration : (6,) arrays
        Linear at the origin, then angular. The acceleration is that of the last sample
        interval; without smoothing it changes in steps.

    """

    pose: Array
    twist: Array
    acceleration: Array


@guarded_class
class PoseFilter:
    """
    Target pose that follows a goal within limits of speed and acceleration.

    A law of control that is given its pose and twist sees no jump where the goal jumps.

    Parameters
    ----------
    linear_speed, angular_speed : float
        m/s and rad/s, positive and finite.
    linear_acceleration, angular_acceleration : float
        m/s^2 and rad/s^2, positive and finite.
    smoothing : float, optional
        Time constant, s, of a low-pass filter that makes the acceleration continuous; the
        target is late by it. Default: 0, none.

    Raises
    ------
    InputError
        A number is invalid; names it.

    """

    def __init__(self, *, linear_speed: float, angular_speed: float,
                 linear_acceleration: float, angular_acceleration: float,
                 smoothing: float = 0.0) -> None:
        """Check the limits; the filter starts with `reset`."""
        self._limits = np.zeros(4)
        self._smoothing = np.zeros(1)
        self._smoothing[0] = number(smoothing, 'smoothing',
                                    'a finite time in s, not negative',
                                    lambda x: 0.0 <= x < math.inf)
        # Pose, twist and acceleration in a row; with smoothing, then those behind it.
        self._state: Array | None = None
        self.tune(linear_speed=linear_speed, angular_speed=angular_speed,
                  linear_acceleration=linear_acceleration,
                  angular_acceleration=angular_acceleration)
        self._elapsed = np.zeros(1)
        self._next = self._entry()

    def _entry(self) -> Callable[..., Array]:
        """Return the entry point of the compiled step."""
        return self._kernel.entry('', self._explained)

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes of a copy or a pickle: all but the compiled code."""
        return {name: value for name, value in vars(self).items()
                if name not in ('_next', '_kernel')}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy, with arrays of its own, and its compiled code."""
        for name, value in state.items():
            setattr(self, name, value.copy() if isinstance(value, np.ndarray) else value)
        self._next = self._entry()

    def tune(self, **limits: float) -> None:
        """Change limits, by their names; the target goes on from where it is."""
        changed = self._limits.copy()
        for name, value in limits.items():
            if name not in LIMITS:
                raise InputError(f'tune: {name}; expected some of {", ".join(LIMITS)}')
            changed[LIMITS.index(name)] = number(value, name, 'a positive, finite number',
                                                 lambda x: 0.0 < x < math.inf)
        self._limits = changed

    def reset(self, pose: ArrayLike, twist: ArrayLike | None = None) -> None:
        """Start from a pose, such as the measured one, at rest or with a twist."""
        start = require_pose(pose)
        velocity = STILL
        if twist is not None:
            velocity = finite_row(twist, 'twist', DIRECTIONS, part='direction')
        self._state = np.concatenate([start.ravel(), velocity, STILL])
        if self._smoothing[0] > 0.0:
            # The pose before the low-pass filter is ahead by its time constant.
            displacement = self._smoothing[0] * velocity
            position = start[:3, 3] + displacement[:3]
            rotation = _turned(start[:3, :3], displacement[3:])
            ahead = _pose_row(rotation, position)
            self._state = np.concatenate([ahead, velocity, STILL, self._state])

    @property
    def state(self) -> TargetState | None:
        """Return the target at the last sample; None before `reset`."""
        return None if self._state is None else _target(self._state)

    def step(self, goal: ArrayLike, elapsed: float,
             twist: ArrayLike | None = None) -> TargetState:
        """
        Return the target after a sample interval.

        Parameters
        ----------
        goal : (4, 4) array_like
            The pose to reach, m.
        elapsed : float
            Time since the last sample, s, not negative; at 0 the target stays.
        twist : (6,) array_like, optional
            Velocity of the goal, in the world. Default: at rest.

        Raises
        ------
        InputError
            The goal is no pose, a number is not finite, or there was no `reset`. The
            target then stays where it is.

        """
        if self._state is None:
            raise InputError('step: called before reset; expected reset(pose) with the '
                             'measured pose first')
        if type(elapsed) is not float or not 0.0 <= elapsed < math.inf:
            elapsed = number(elapsed, 'elapsed', 'a finite time in s, not negative',
                             lambda x: 0.0 <= x < math.inf)
        # No time has passed: the same target.
        if elapsed == 0.0:
            return _target(self._state)
        self._elapsed[0] = elapsed
        velocity = STILL if twist is None else twist
        self._state = self._next(self._state, goal, velocity, self._limits,
                                 self._elapsed, self._smoothing)
        return _target(self._state)

    def _explained(self, state: Array, goal: ArrayLike, twist: Any, limits: Array,
                   elapsed: Array, smoothing: Array) -> Array:
        """Return the next state, or raise the InputError that explains why not."""
        pose = require_pose(goal, 'goal')
        velocity = finite_row(twist, 'twist', DIRECTIONS, part='direction')
        result: Array = self._kernel(state, pose, velocity, limits, elapsed, smoothing)
        return result

    @lazy_property
    def _kernel(self) -> Kernel:
        """Return the compiled step."""
        name, step, size = 'target_filter', _step, ROW
        if self._smoothing[0] > 0.0:
            name, step, size = 'smooth_target_filter', smooth_step, 2 * ROW
        inputs = [('state', (size,)), ('goal', (4, 4)), ('twist', (6,)),
                  ('limits', (4,)), ('elapsed', (1,)), ('smoothing', (1,))]
        return batch_kernel(name, step, inputs, (size,))


ROW = 28  # numbers of a pose, a twist and an acceleration
LIMITS = ('linear_speed', 'angular_speed', 'linear_acceleration', 'angular_acceleration')


def _target(state: Array) -> TargetState:
    """Return the parts of a state."""
    # A copy, so that a caller who changes the target does not move the filter.
    copied = state[-ROW:].copy()
    return TargetState(copied[:16].reshape(4, 4), copied[16:22], copied[22:28])


def smooth_step(state: Vector, target: Matrix, twist: Vector, limits: Vector,
                elapsed: Vector, smoothing: Vector) -> Vector:
    """
    Return the state after a sample interval, then the one behind the low-pass filter.

    Parameters
    ----------
    state : (56,) array
        Pose, twist and acceleration before the low-pass filter, and those behind it.
    target : (4, 4) array
        The pose to reach.
    twist : (6,) array
        Its velocity.
    limits : (4,) array
        In the order of `LIMITS`.
    elapsed, smoothing : (1,) arrays
        s, positive.

    """
    h = elapsed[0]
    followed = _step(state[:ROW], target, twist, limits, elapsed, smoothing)
    late = state[ROW:]
    late_pose = late[:16].reshape(4, 4)
    goal = followed[:16].reshape(4, 4)
    # The filter in its implicit form, stable for every interval: T (p_s - before) / h
    # = p - p_s, and likewise for the velocities, as their equation is its derivative.
    v = (h * followed[16:19] + smoothing[0] * late[16:19]) / (h + smoothing[0])
    position = goal[:3, 3] - smoothing[0] * v
    # Orientations: a part of the rotation vector from the late one to the other.
    turn = _rotation_vector(goal[:3, :3] @ late_pose[:3, :3].T)
    w = turn / (h + smoothing[0])
    rotation = _turned(late_pose[:3, :3], h * w)
    velocity = np.concatenate([v, w])
    acceleration = (velocity - late[16:22]) * (1.0 / h)
    return np.concatenate([followed, _pose_row(rotation, position), velocity,
                           acceleration])


def _step(state: Vector, target: Matrix, twist: Vector, limits: Vector,
          elapsed: Vector, smoothing: Vector) -> Vector:
    """Return the state after a sample interval, over any scalar; see the module."""
    h = elapsed[0]
    pose = state[:16].reshape(4, 4)
    R = pose[:3, :3]
    # The errors of position and rotation, each approached within its limits of speed and
    # acceleration.
    displacement = target[:3, 3] - pose[:3, 3]
    turn = _rotation_vector(target[:3, :3] @ R.T)
    v = _approaching(displacement, state[16:19], twist[:3], limits[0], limits[2], h)
    w = _approaching(turn, state[19:22], twist[3:], limits[1], limits[3], h)

    # The target moves with its new velocity.
    position = pose[:3, 3] + h * v
    rotation = _turned(R, h * w)
    moved = _pose_row(rotation, position)
    velocity = np.concatenate([v, w])
    result = np.concatenate([moved, velocity, (velocity - state[16:22]) * (1.0 / h)])
    return nan_unless(result, pose_margin(target))


def _pose_row(rotation: Matrix, position: Vector) -> Vector:
    """Return a pose as a row, (16,)."""
    last = np.array([0.0, 0.0, 0.0, 1.0])
    upper = np.concatenate([rotation, position[:, None]], axis=1)
    return np.concatenate([upper, last[None]]).reshape(16)


def _approaching(distance: Vector, v: Vector, goal_velocity: Vector, fastest: Scalar,
                 strongest: Scalar, h: Scalar) -> Vector:
    """Return the velocity after a sample, (3,), towards a goal at a distance."""
    square = distance @ distance
    is_there = square < TINY
    length = np.sqrt(select(is_there, 1.0, square))
    speed = strongest * (np.sqrt(h * h + 2.0 * length / strongest) - h)
    wanted = goal_velocity + select(is_there, 0.0, speed / length) * distance
    wanted = _shortened(wanted, fastest)
    return v + _shortened(wanted - v, strongest * h)


def _shortened(x: Vector, longest: Scalar) -> Vector:
    """Return a vector, scaled down to a length if it is longer."""
    square = x @ x
    is_longer = longest * longest < square
    return select(is_longer, longest / np.sqrt(select(is_longer, square, 1.0)), 1.0) * x


def _rotation_vector(R: Matrix) -> Vector:
    """Return the rotation vector, of at most half a turn, over any scalar."""
    unit, cosine = half_turn_quaternion(R)
    square = unit @ unit
    is_small = square < TINY
    sine = np.sqrt(select(is_small, 1.0, square))
    # 2 atan(s / (1 + c)) is half of the angle for every cosine c >= 0 of half the angle.
    angle = 4.0 * np.arctan(sine / (1.0 + cosine))
    return select(is_small, 2.0, angle / sine) * unit


def _turned(R: Matrix, w: Vector) -> Matrix:
    """Return R rotated by a rotation vector w in the world, orthonormal to rounding."""
    square = w @ w
    is_small = square < TINY
    angle = np.sqrt(select(is_small, 1.0, square))
    W = skew(w)
    first = select(is_small, 1.0, np.sin(angle) / angle)
    half = np.sin(0.5 * angle) / angle
    second = select(is_small, 0.5, 2.0 * half * half)
    turned = R + (first * W + second * (W @ W)) @ R
    # One step of Newton's method keeps the columns orthonormal.
    return 0.5 * turned @ (3.0 * np.eye(3) - turned.T @ turned)
