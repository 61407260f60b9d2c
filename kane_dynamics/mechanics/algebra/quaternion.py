"""
Quaternions (x, y, z, w) of rotations, w being the scalar part, over any scalar type.

The quaternion of the axes b of a body in axes a is (e sin(angle / 2), cos(angle / 2))
for the rotation about e that takes a to b (Kane, Likins & Levinson, Spacecraft Dynamics,
1983, sections 1.3 and 1.13; Shuster, J. Astronautical Sciences 41, 1993). All functions
accept a quaternion of any length but zero: it stands for the same rotation as the unit
quaternion along it.
"""

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
import numpy as np

SMALL = 1e-8  # rad: sin(x) / x is 1 to rounding


def rotation_matrix(p: Vector) -> Matrix:
    """Return the rotation matrix of a quaternion; its columns are the rotated axes."""
    x, y, z, w = p

    # Twice the products of the unit quaternion's components.
    s = 2.0 / _squared_length(p)
    sx = s * x
    sy = s * y
    sz = s * z
    xx = sx * x
    yy = sy * y
    zz = sz * z
    xy = sx * y
    xz = sx * z
    yz = sy * z
    wx = sx * w
    wy = sy * w
    wz = sz * w
    # R = 1 + 2 w [v] + 2 [v]^2 with v = (x, y, z), for a unit quaternion.
    return np.array([[1.0 - (yy + zz), xy - wz, xz + wy],
                     [xy + wz, 1.0 - (xx + zz), yz - wx],
                     [xz - wy, yz + wx, 1.0 - (xx + yy)]])


def quaternion_rate(p: Vector, omega: Vector) -> Vector:
    """
    Return the rate of a quaternion, (4,), for an angular velocity on its axes, rad/s.

    p' = 1/2 E(p) omega = 1/2 p (omega, 0); the length of p stays.
    """
    x, y, z, w = p
    # p' = 1/2 p omega, with omega as a quaternion without scalar part.
    a, b, c = (0.5 * rate for rate in omega)
    return np.array([w * a + y * c - z * b,
                     w * b + z * a - x * c,
                     w * c + x * b - y * a,
                     -(x * a + y * b + z * c)])


def normalized(p: Vector) -> Vector:
    """Return the unit quaternion along a quaternion."""
    return p * (1.0 / np.sqrt(_squared_length(p)))


def _squared_length(p: Vector) -> Scalar:
    x, y, z, w = p
    return x * x + y * y + z * z + w * w


def quaternion_product(p: Array, r: Array) -> Array:
    """Return the quaternion of p followed by r about the rotated axes; (..., 4)."""
    v, w = np.split(p, [3], axis=-1)
    a, c = np.split(r, [3], axis=-1)
    vector = w * a + c * v + np.cross(v, a)
    scalar = w * c - np.sum(v * a, axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def exponential(turn: Array) -> Array:
    """Return the unit quaternion of a rotation vector, (..., 3), rad."""
    half = 0.5 * np.linalg.norm(turn, axis=-1, keepdims=True)
    return np.concatenate([0.5 * np.sinc(half / np.pi) * turn, np.cos(half)], axis=-1)


def logarithm(p: Array) -> Array:
    """Return the rotation vector of a quaternion, (..., 3), of at most pi rad."""
    # Of the two quaternions of the rotation, the one whose angle is at most pi.
    p = np.where(p[..., 3:] < 0.0, -p, p)
    vector, cosine = np.split(p, [3], axis=-1)
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, cosine)

    # angle / sine, and its limit for small angles.
    ratio = angle / np.where(sine == 0.0, 1.0, sine)
    limit = 2.0 / np.maximum(cosine, SMALL)
    result: Array = np.where(sine > SMALL * cosine, ratio, limit) * vector
    return result


def conjugate(p: Array) -> Array:
    """Return the quaternion of the opposite rotation, (..., 4)."""
    result: Array = p * np.array([-1.0, -1.0, -1.0, 1.0])
    return result
