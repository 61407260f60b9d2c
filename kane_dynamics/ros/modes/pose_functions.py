"""Displacements between poses, over any scalar: logarithm and exponential of rotations."""

from collections.abc import Callable
from typing import Any

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.quaternion import rotation_matrix
from kane_dynamics.robot.robot import Robot
from kane_dynamics.task_space.orientation_error import half_turn_quaternion
import numpy as np

TINY = 1e-30  # rad^2, below which a rotation vector has no direction


def bound_call(robot: Robot, function: Callable[..., Any], result: Array,
               **arrays: Array) -> Callable[[], Any]:
    """
    Return a native call without arguments of a function over any scalar.

    It reads the arrays, the function's arguments in their order, and writes the result.
    """
    shapes = {name: array.shape for name, array in arrays.items()}
    kernel = robot.compiled(function, name=function.__name__.strip('_'),
                            shape=result.shape, **shapes)
    return kernel.bind(list(arrays.values()), result, str(function.__doc__))


def displacement(start: Matrix, goal: Matrix) -> Vector:
    """
    Return the displacement of a pose to another, (6,): m, then the rotation vector.

    In world axes, as `pose_error`. The angle is at most half a turn; of exactly half a
    turn the axis has one of its two directions.
    """
    turn = rotation_vector(goal[:3, :3] @ start[:3, :3].T)
    return np.concatenate([goal[:3, 3] - start[:3, 3], turn])


def displaced(start: Matrix, step: Vector, share: Scalar = 1.0) -> Matrix:
    """Return the pose (4, 4) after a share of a displacement (6,)."""
    rotation = rotation_of(share * step[3:]) @ start[:3, :3]
    position = start[:3, 3] + share * step[:3]
    upper = np.concatenate([rotation, position[:, None]], axis=1)
    return np.concatenate([upper, np.array([[0.0, 0.0, 0.0, 1.0]])])


def rotation_of(turn: Vector) -> Matrix:
    """Return the rotation matrix of a rotation vector, (3,), rad."""
    half = 0.5 * np.sqrt(turn @ turn + TINY)
    axis_part = 0.5 * (np.sin(half) / half) * turn
    return rotation_matrix(np.array([*axis_part, np.cos(half)]))


def rotation_vector(R: Matrix) -> Vector:
    """Return the rotation vector of a rotation matrix, (3,), rad."""
    axis_part, cosine = half_turn_quaternion(R)
    sine = np.sqrt(axis_part @ axis_part + TINY)
    return (2.0 * _arctangent(sine, cosine) / sine) * axis_part


def _arctangent(sine: Scalar, cosine: Scalar) -> Scalar:
    """Return the angle in [0, pi / 2] of a sine and a cosine that are not negative."""
    is_steep = cosine < sine
    small = select(is_steep, cosine, sine) / select(is_steep, sine, cosine)
    angle = np.arctan(small)
    return select(is_steep, 0.5 * np.pi - angle, angle)
