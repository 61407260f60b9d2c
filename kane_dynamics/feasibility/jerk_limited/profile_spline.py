"""
Squared path velocity x(s) = s'^2 as a cubic spline, and the motion with it.

With x the derivatives of the path parameter are s'' = x' / 2 and s''' = sqrt(x) x'' / 2, where
primes of x are derivatives with respect to s. The spline has continuous x'', so the jerk of the
motion changes linearly within one interval of the grid and nowhere jumps by itself.
"""

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.path_geometry import Section
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


class ProfileSpline:
    """
    Uniform cubic B-splines on [0, 1] with N intervals, flat at both ends: x' = x'' = 0 there.

    At rest, where q(s) - q(end) begins with the third power of s, the jerk does not depend on x'
    and x''. Other splines could change much within the first interval, where no limit counts.
    A profile has N - 1 coefficients. At a vertex its value and derivatives depend on three.

    Attributes
    ----------
    step : float
        Length of an interval.
    rows : (N + 1, 3, 3) array
        Factors of the three coefficients in x, x' and x'' at each vertex.
    first : (N + 1,) array of int
        The first of the three coefficients at each vertex.

    """

    def __init__(self, intervals: int) -> None:
        """Compute the factors."""
        h = 1.0 / intervals
        scale = np.array([1.0 / 6.0, 0.5 / h, 1.0 / h**2])[:, None]
        inner = scale * [[1.0, 4.0, 1.0], [-1.0, 0.0, 1.0], [1.0, -2.0, 1.0]]
        # The two coefficients before the first one are equal to it.
        near, end = scale * [[5.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]], np.zeros((3, 3))
        end[0, 0] = 1.0
        self.step = h
        self.rows = np.repeat(inner[None], intervals + 1, axis=0)
        self.rows[0], self.rows[1] = end, near
        # Seen from the end, x' has the other sign.
        self.rows[-1], self.rows[-2] = (rows[:, ::-1] * [[1.0], [-1.0], [1.0]]
                                        for rows in (end, near))
        self.first = np.clip(np.arange(-2, intervals - 1), 0, intervals - 4)
        self.count = intervals - 1

    def at(self, coefficients: Array) -> Array:
        """Return x, x' and x'' at the vertices, (N + 1, 3)."""
        near = coefficients[self.first[:, None] + np.arange(3)]
        return np.asarray(np.einsum('kij,kj->ki', self.rows, near))

    def gradient(self, slopes: Array) -> Array:
        """Return the gradient, (N - 1,), from that with respect to x, x', x'', (N + 1, 3)."""
        parts = np.einsum('kij,ki->kj', self.rows, slopes)
        return self._summed(self.first[:, None] + np.arange(3), parts)

    def hessian(self, blocks: Array) -> Array:
        """Return the diagonals, (3, N - 1), of the Hessian from blocks, (N + 1, 3, 3)."""
        local = np.einsum('kia,kij,kjb->kab', self.rows, blocks, self.rows, optimize=True)
        out = []
        for below in range(3):
            places = self.first[:, None] + np.arange(below, 3)
            out.append(self._summed(places, np.stack(
                [local[:, a, a - below] for a in range(below, 3)], axis=1)))
        return np.array(out)

    def _summed(self, places: Segments, values: Array) -> Array:
        return np.asarray(np.bincount(places.ravel(), values.ravel(), minlength=self.count),
                          dtype=np.float64)


def motion_points(section: Section, profile: Array, h: float) -> ControllerPoints:
    """Return the points of the motion with x, x' and x'' at the vertices, (N + 1, 3)."""
    x, slope, bend = profile.T
    z = 0.5 * h * (1.0 + NODES[:, None])
    inside = (x[:-1] + z * (slope[:-1] + z * (
        0.5 * bend[:-1] + z / (6.0 * h) * np.diff(bend))))
    durations = 0.5 * h * WEIGHTS @ (1.0 / np.sqrt(inside))
    q, first, second = (rows[::2] for rows in section[:3])
    udot = second * x[:, None] + 0.5 * first * slope[:, None]
    u = first * np.sqrt(x)[:, None]
    u[[0, -1]] = udot[[0, -1]] = 0.0
    return ControllerPoints(np.concatenate([[0.0], np.cumsum(durations)]), q, u, udot)
