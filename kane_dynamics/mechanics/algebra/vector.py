"""
Three-dimensional vectors and tensors over any scalar type.

No function branches on a value, assigns to array entries, or calls a solver, so that all
of them can be traced.
"""

from collections.abc import Sequence
import math

from kane_dynamics._util.typing import Matrix, Scalar, Vector
import numpy as np

QUARTER = 0.5 * math.pi


def is_zero(x: Scalar) -> bool:
    """Return whether a scalar is structurally zero: the number 0, no traced value."""
    return isinstance(x, (int, float)) and x == 0.0


def dot(a: Sequence[Scalar] | Vector, b: Sequence[Scalar] | Vector) -> Scalar:
    """Return a . b without the terms that are zero by structure."""
    total: Scalar = 0.0
    for x, y in zip(a, b):
        if not (is_zero(x) or is_zero(y)):
            total = total + x * y
    return total


def quadratic(A: Matrix, x: Vector) -> Scalar:
    """
    Return x^T A x of a symmetric matrix of numbers.

    The products of entries of x come first: forms of the same x share them.
    """
    total: Scalar = 0.0
    # The upper triangle alone: an entry off the diagonal stands for both.
    for i in range(len(x)):
        for j in range(i, len(x)):
            factor = A[i, j] if i == j else 2.0 * A[i, j]
            if factor != 0.0:
                total = total + factor * (x[i] * x[j])
    return total


def cross(a: Vector, b: Vector) -> Vector:
    """Return the cross product a x b."""
    return np.array([a[1] * b[2] - a[2] * b[1],
                     a[2] * b[0] - a[0] * b[2],
                     a[0] * b[1] - a[1] * b[0]])


def skew(a: Vector) -> Matrix:
    """Return the skew-symmetric matrix [a]x with [a]x b = a x b."""
    return np.array([[0.0, -a[2], a[1]],
                     [a[2], 0.0, -a[0]],
                     [-a[1], a[0], 0.0]])


def axis_rotation(axis: Vector, s: Scalar, c: Scalar) -> Matrix:
    """Return the rotation about a unit axis by an angle with sine s and cosine c."""
    along = np.outer(axis, axis)
    return along + c * (np.eye(3) - along) + s * skew(axis)


def sin_cos(angle: Scalar, offset: float = 0.0) -> tuple[Scalar, Scalar]:
    """Return sine and cosine of angle + offset; multiples of pi/2 cost nothing."""
    quarters = round(offset / QUARTER)
    if abs(offset - quarters * QUARTER) > 1e-14:
        return np.sin(angle + offset), np.cos(angle + offset)

    # Each quarter turns (s, c) to (c, -s).
    s = np.sin(angle)
    c = np.cos(angle)
    return ((s, c), (c, -s), (-s, -c), (-c, s))[quarters % 4]


def rate_tensor(omega: Vector, alpha: Vector) -> Matrix:
    """
    Return the acceleration gradient U = [alpha]x + [omega]x [omega]x.

    A point at r from a body's origin has the acceleration a + U r, a that of the origin.
    """
    x, y, z = omega
    # [omega]x [omega]x = omega omega^T - omega^2 1, of which six products suffice.
    xx = x * x
    yy = y * y
    zz = z * z
    xy = x * y
    xz = x * z
    yz = y * z
    return np.array([[-(yy + zz), xy - alpha[2], xz + alpha[1]],
                     [xy + alpha[2], -(xx + zz), yz - alpha[0]],
                     [xz - alpha[1], yz + alpha[0], -(xx + yy)]])


def inertia_moment(S: Matrix, omega: Vector, U: Matrix) -> Vector:
    """
    Return the inertia moment I alpha + omega x I omega = int r x (U r) dm.

    Computed from the second moment S = int r r^T dm and U = `rate_tensor`, whose entries
    the inertia force needs too. Differences of U's diagonal are differences of squares
    of omega.
    """
    xx, yy, zz = omega * omega
    return np.array([
        S[0, 1] * U[2, 0] - S[0, 2] * U[1, 0] + S[1, 2] * (zz - yy)
        + S[1, 1] * U[2, 1] - S[2, 2] * U[1, 2],
        S[0, 2] * (xx - zz) + S[1, 2] * U[0, 1] + S[2, 2] * U[0, 2]
        - S[0, 0] * U[2, 0] - S[0, 1] * U[2, 1],
        S[0, 0] * U[1, 0] + S[0, 1] * (yy - xx) + S[0, 2] * U[1, 2]
        - S[1, 1] * U[0, 1] - S[1, 2] * U[0, 2]])


def rotated_about_z(S: Matrix, s: Scalar, c: Scalar) -> Matrix:
    """
    Return Q S Q^T for a symmetric S and a rotation Q about z, in 10 multiplications.

    With e = s (Sxx - Syy) + 2 c Sxy, the first two diagonal entries change by -s e and s
    e, and the xy entry becomes c e - Sxy.
    """
    e = s * (S[0, 0] - S[1, 1]) + c * (S[0, 1] + S[0, 1])
    r = s * e
    xz = c * S[0, 2] - s * S[1, 2]
    yz = s * S[0, 2] + c * S[1, 2]
    xy = c * e - S[0, 1]
    return np.array([[S[0, 0] - r, xy, xz],
                     [xy, S[1, 1] + r, yz],
                     [xz, yz, S[2, 2]]])


def symmetric(S: Matrix) -> Matrix:
    """Return the symmetric matrix with the upper triangle of S, of the same entries."""
    xx, xy, xz = S[0]
    yy, yz = S[1, 1:]
    return np.array([[xx, xy, xz],
                     [xy, yy, yz],
                     [xz, yz, S[2, 2]]])
