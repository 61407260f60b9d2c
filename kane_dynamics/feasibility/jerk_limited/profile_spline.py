"""
Squared path velocity x(s) = s'^2 as a cubic spline, and the motion with it.

With x the derivatives of the path parameter are s'' = x' / 2 and s''' = sqrt(x) x'' / 2, where
primes of x are derivatives with respect to s. The spline has continuous x'', so the jerk of the
motion changes linearly within one interval of the grid and does not jump by itself.
"""

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.jerk_limited.smooth_path import SmoothSection
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


class ProfileSpline:
    """
    Cubic B-splines on N intervals, flat at both ends: x' = x'' = 0 there.

    At rest, where q(s) - q(end) begins with the third power of s, the jerk does not depend on x'
    and x''. Other splines could change much within the first interval, where no limit counts.
    A profile has N - 1 coefficients. At a vertex its value and derivatives depend on three.

    Attributes
    ----------
    s : (N + 1,) array
        The vertices.
    rows : (P, 3, 3) array
        Factors of the three coefficients in x, x' and x'' at each point, which is a vertex.
    first : (P,) array of int
        The first of the three coefficients at each point.
    weights : (P,) array
        Of 1 / sqrt(x) in the duration, by the trapezoidal rule.

    """

    def __init__(self, s: Array, vertex: Segments) -> None:
        """Compute the factors."""
        count = len(s) - 1
        h = np.pad(np.diff(s), (2, 2), mode='edge')
        a, b, c, d = (h[k:k + count + 1] for k in range(4))
        left, right = c / ((a + b + c) * (b + c)), b / ((b + c + d) * (b + c))
        down, up = 6.0 / ((a + b + c) * (b + c)), 6.0 / ((b + c + d) * (b + c))
        inner = np.array([[c * left, 1.0 - c * left - b * right, b * right],
                          [-3.0 * left, 3.0 * (left - right), 3.0 * right],
                          [down, -down - up, up]]).transpose(2, 0, 1)
        # The two coefficients before the first one are equal to it, and so at the end.
        columns = np.clip(np.arange(-2, count - 1)[:, None] + np.arange(3), 0, count - 2)
        first = np.clip(np.arange(-2, count - 1), 0, count - 4)
        rows = np.zeros_like(inner)
        places = np.arange(count + 1)
        for k in range(3):
            rows[places, :, columns[:, k] - first] += inner[:, :, k]
        self.s, self.count, self.size = s, count - 1, count + 1
        self.rows, self.first = rows[vertex], first[vertex]
        self.weights = np.zeros(len(vertex))
        self.weights[:count] += 0.5 * np.diff(s)
        self.weights[1:count + 1] += 0.5 * np.diff(s)

    def at(self, coefficients: Array) -> Array:
        """Return x, x' and x'' at the points, (3, P)."""
        near = coefficients[self.first[:, None] + np.arange(3)]
        return np.ascontiguousarray(np.einsum('kij,kj->ik', self.rows, near))

    def gradient(self, slopes: Array) -> Array:
        """Return the gradient, (N - 1,), from that with respect to x, x', x'', (3, P)."""
        parts = np.einsum('kij,ik->kj', self.rows, slopes)
        return self._summed(self.first[:, None] + np.arange(3), parts)

    def hessian(self, blocks: Array) -> Array:
        """Return the diagonals, (3, N - 1), of the Hessian from blocks, (P, 3, 3)."""
        local = self.rows.transpose(0, 2, 1) @ (blocks @ self.rows)
        return np.array([self._summed(
            self.first[:, None] + np.arange(below, 3),
            np.stack([local[:, a, a - below] for a in range(below, 3)], axis=1))
            for below in range(3)])

    def resampled(self, coefficients: Array, s: Array) -> Array:
        """Return about the coefficients of the same profile on other vertices, (N' - 1,)."""
        x, slope, bend = self.at(coefficients)[:, :self.size]
        k = np.clip(np.searchsorted(self.s, s[1:-1], side='right') - 1, 0, self.size - 2)
        h, z = np.diff(self.s)[k], s[1:-1] - self.s[k]
        return np.asarray(x[k] + z * (slope[k] + z * (
            0.5 * bend[k] + z / (6.0 * h) * np.diff(bend)[k])))

    def _summed(self, places: Segments, values: Array) -> Array:
        return np.asarray(np.bincount(places.ravel(), values.ravel(), minlength=self.count),
                          dtype=np.float64)


def motion_points(path: SmoothSection, spline: ProfileSpline, coefficients: Array
                  ) -> ControllerPoints:
    """Return the points of the motion at the vertices."""
    x, slope, bend = spline.at(coefficients)[:, :spline.size]
    h = np.diff(path.s)
    z = 0.5 * h * (1.0 + NODES[:, None])
    inside = (x[:-1] + z * (slope[:-1] + z * (
        0.5 * bend[:-1] + z / (6.0 * h) * np.diff(bend))))
    durations = 0.5 * h * (WEIGHTS @ (1.0 / np.sqrt(inside)))
    q, first, second = (rows[:spline.size] for rows in path.section[:3])
    u = first * np.sqrt(x)[:, None]
    udot = second * x[:, None] + 0.5 * first * slope[:, None]
    return ControllerPoints(np.concatenate([[0.0], np.cumsum(durations)]), q, u, udot)
