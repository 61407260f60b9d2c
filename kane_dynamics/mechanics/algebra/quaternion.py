"""
Quaternions (x, y, z, w) of rotations, w being the scalar part, over any scalar type.

The quaternion of the axes b of a body in axes a is (e sin(angle / 2), cos(angle / 2)) for the
rotation about e that takes a to b (Kane, Likins & Levinson, Spacecraft Dynamics, 1983, 1.3 and
1.13; Shuster, J. Astronautical Sciences 41, 1993). All functions accept a quaternion of any
length but zero: it stands for the same rotation as the unit quaternion along it.
"""

from typing import Any

from kane_dynamics._util.typing import Array
import numpy as np

SMALL = 1e-8  # rad: sin(x) / x is 1 to rounding


def rotation_matrix(p: Any) -> Any:
    """Return the rotation matrix of a quaternion, (3, 3); its columns are the rotated axes."""
    x, y, z, w = p
    s = 2.0 / (x * x + y * y + z * z + w * w)
    sx, sy, sz = s * x, s * y, s * z
    xx, yy, zz, xy, xz, yz = sx * x, sy * y, sz * z, sx * y, sx * z, sy * z
    wx, wy, wz = sx * w, sy * w, sz * w
    return np.array([[1.0 - (yy + zz), xy - wz, xz + wy],
                     [xy + wz, 1.0 - (xx + zz), yz - wx],
                     [xz - wy, yz + wx, 1.0 - (xx + yy)]])


def quaternion_rate(p: Any, omega: Any) -> Any:
    """
    Return the rate of a quaternion, (4,), for an angular velocity on the body's axes, rad/s.

    p' = 1/2 E(p) omega = 1/2 p (omega, 0); the length of p stays.
    """
    x, y, z, w = p
    a, b, c = (0.5 * rate for rate in omega)
    return np.array([w * a + y * c - z * b, w * b + z * a - x * c,
                     w * c + x * b - y * a, -(x * a + y * b + z * c)])


def normalized(p: Any) -> Any:
    """Return the unit quaternion along a quaternion."""
    x, y, z, w = p
    return p * (1.0 / np.sqrt(x * x + y * y + z * z + w * w))


def product(p: Array, r: Array) -> Array:
    """Return the quaternion of the rotation p followed by r about the rotated axes; (..., 4)."""
    v, w, a, c = p[..., :3], p[..., 3:], r[..., :3], r[..., 3:]
    return np.concatenate([w * a + c * v + np.cross(v, a),
                           w * c - np.sum(v * a, axis=-1, keepdims=True)], axis=-1)


def exponential(turn: Array) -> Array:
    """Return the unit quaternion of a rotation vector, (..., 3), rad."""
    half = 0.5 * np.linalg.norm(turn, axis=-1, keepdims=True)
    return np.concatenate([0.5 * np.sinc(half / np.pi) * turn, np.cos(half)], axis=-1)


def logarithm(p: Array) -> Array:
    """Return the rotation vector of a quaternion, (..., 3), of at most pi rad."""
    p = np.where(p[..., 3:] < 0.0, -p, p)
    sine = np.linalg.norm(p[..., :3], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, p[..., 3:])
    ratio = np.where(sine > SMALL * p[..., 3:], angle / np.where(sine == 0.0, 1.0, sine),
                     2.0 / np.maximum(p[..., 3:], SMALL))
    result: Array = ratio * p[..., :3]
    return result


def conjugate(p: Array) -> Array:
    """Return the quaternion of the opposite rotation, (..., 4)."""
    result: Array = p * np.array([-1.0, -1.0, -1.0, 1.0])
    return result
