"""
Orientation error of a spring: the rotation vector, and the gradient of its energy.

With n the axis and theta the angle of a rotation, its vector is phi = theta n, and a
spring K has the energy V = 1/2 phi . K phi. The moment is minus the gradient of V along
the angular velocity. It is -K phi only for equal stiffnesses: for others -K phi is no
gradient of any energy, and a closed motion would gain or lose energy.

At half a turn phi changes its sign, and the direction of the moment would jump. Beyond
`FADE` the angle in phi is therefore replaced by a smooth g(theta) whose slope falls to
zero at half a turn. V and the moment are then smooth everywhere. About the error's axis
the moment is zero at half a turn, an unstable equilibrium; up to `FADE` phi is the
logarithm. A term that is odd in phi, such as d . C phi of a spring that couples it with a
displacement d, would still jump: it has the factor `coupling`, which falls from one at
`FADE` to zero at half a turn. Source of the logarithm's derivative: F. Bullo, R. Murray,
"Proportional derivative (PD) control on the Euclidean group", ECC 1995.
"""

import math
from typing import NamedTuple

from kane_dynamics._util.typing import Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.vector import cross
import numpy as np

FADE = math.radians(160.0)  # rad; up to here the error is the logarithm
COSINE_OF_FADE = math.cos(0.5 * FADE)  # of half the angle, where the fading begins
SMALL = 0.02  # tangent of half the angle: series below
TINY = 1e-300  # least divisor of a length that may be zero


class OrientationError(NamedTuple):
    """
    Rotation vector of an orientation error, and what the gradient of its energy needs.

    Attributes
    ----------
    vector : (3,) array
        phi, rad: g(theta) n.
    unit : (3,) array
        sin(theta / 2) n.
    along, across, twist : scalars
        The rate of phi for an angular velocity w is ``across w - twist unit x w + along
        unit (unit . w)``.
    coupling : scalar
        The factor of terms that are odd in phi.
    coupling_slope : scalar
        The gradient of `coupling` is ``coupling_slope unit``.

    """

    vector: Vector
    unit: Vector
    along: Scalar
    across: Scalar
    twist: Scalar
    coupling: Scalar
    coupling_slope: Scalar

    def moment(self, u: Vector) -> Vector:
        """Return the transposed rate of phi times u, (3,): the gradient for u = K phi."""
        n = self.unit
        return (self.across * u + self.twist * cross(n, u)
                + self.along * (n @ u) * n)

    def rate(self, w: Vector) -> Vector:
        """Return the rate of phi, (3,), for an angular velocity w, rad/s."""
        n = self.unit
        return (self.across * w - self.twist * cross(n, w)
                + self.along * (n @ w) * n)


def half_turn_quaternion(R: Matrix) -> tuple[Vector, Scalar]:
    """
    Return sin(theta / 2) n and cos(theta / 2) >= 0 of a rotation, over any scalar.

    4 p p^T of the quaternion p is linear in R; its row with the largest diagonal entry
    is p times that entry (Shepperd's method), so that no digits are lost at any angle.
    """
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    rows: list[Vector] = [np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0],
                                    R[1, 0] - R[0, 1], 1.0 + trace])]
    for i in range(3):
        products = [R[i, k] + R[k, i] for k in range(3)]
        products[i] = 1.0 + 2.0 * R[i, i] - trace
        rows.append(np.array([*products, rows[0][i]]))

    # The row with the largest diagonal entry, chosen entry by entry.
    largest = rows[0]
    size = rows[0][3]
    for i in range(3):
        row = rows[1 + i]
        is_larger = size < row[i]
        size = select(is_larger, row[i], size)
        largest = np.array([select(is_larger, x, y) for x, y in zip(row, largest)])
    p = largest * (1.0 / np.sqrt(largest @ largest))

    # Of the two quaternions of a rotation, the one of at most half a turn.
    sign = select(p[3] < 0.0, -1.0, 1.0)
    return sign * p[:3], sign * p[3]


def pose_difference(pose: Matrix, target: Matrix, axes: Matrix
                    ) -> tuple[Vector, OrientationError]:
    """Return displacement, m, and orientation error of a pose from a target, in axes."""
    displacement = axes.T @ (pose[:3, 3] - target[:3, 3])
    turn = axes.T @ pose[:3, :3] @ target[:3, :3].T @ axes
    return displacement, orientation_error(turn)


def orientation_error(R: Matrix) -> OrientationError:
    """Return the orientation error of a rotation (3, 3), over any scalar."""
    unit, cosine = half_turn_quaternion(R)
    sine_2 = unit @ unit

    # h is the cosine, and a polynomial even in it near half a turn: g is 2 atan(s / h).
    x = cosine * (1.0 / COSINE_OF_FADE)
    x_2 = x * x
    near_half_turn = cosine < COSINE_OF_FADE
    faded = COSINE_OF_FADE * (0.375 + x_2 * (0.75 - 0.125 * x_2))
    h = select(near_half_turn, faded, cosine)
    slope = select(near_half_turn, x * (1.5 - 0.5 * x_2), 1.0)  # dh / dcosine

    # atan(z) / z and (1 - atan(z) / z) / s^2 with z = s / h, by series near zero.
    z_2 = sine_2 / (h * h)
    is_small = z_2 < SMALL * SMALL
    sine = np.sqrt(select(is_small, 1.0, sine_2))
    z = sine / h
    bracket = 1.0 / 3.0 - z_2 * (0.2 - z_2 * (1.0 / 7.0 - z_2 * (1.0 / 9.0)))
    ratio = select(is_small, 1.0 - z_2 * bracket, np.arctan(z) / z)

    # g' = (h cos + s^2 slope) / (s^2 + h^2); the rate of phi across n is g / 2 cot.
    scale = 2.0 * ratio / h  # g / s
    g_rate = (h * cosine + sine_2 * slope) / (sine_2 + h * h)
    across = 0.5 * scale * cosine
    far = (g_rate - across) / select(is_small, 1.0, sine_2)
    along = select(is_small, bracket / (h * h), far)

    # Terms odd in phi vanish with the cosine, as the slope does; cos' = -unit . w / 2.
    bend = select(near_half_turn, 1.5 * (1.0 - x_2), 0.0)
    coupling_slope = (-0.5 / COSINE_OF_FADE) * bend
    return OrientationError(scale * unit, unit, along, across, 0.5 * scale, slope,
                            coupling_slope)
