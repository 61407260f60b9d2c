"""
Squared path velocity x(s) = s'^2 as a cubic spline, and the motion with it.

With x the derivatives of the path parameter are s'' = x' / 2 and s''' = sqrt(x) x'' / 2,
where primes of x are derivatives with respect to s. The spline has continuous x'', so
the jerk of the motion changes linearly within one interval of the grid and does not jump
by itself.
"""

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.jerk_limited.smooth_path import SmoothSection
from kane_dynamics.motion.controller_points import ControllerPoints, Segments
import numpy as np

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


class ProfileSpline:
    """
    Cubic B-splines on N intervals, flat at both ends: x' = x'' = 0 there.

    At rest, where q(s) - q(end) begins with the third power of s, the jerk does not
    depend on x' and x''. Other splines could change much within the first interval,
    where no limit counts. A profile has N - 1 coefficients. Its values in an interval
    depend on four.

    Attributes
    ----------
    s : (N + 1,) array
        The vertices.
    place : (P,) array
        s of the points, increasing, except that some follow the others once more.
    rows : (P, 3, 4) array
        Factors of the four coefficients in x, x' and x'' at each point.
    columns : (P, 4) array of int
        The numbers of these coefficients.
    weights : (P,) array
        Of 1 / sqrt(x) in the duration, by the trapezoidal rule.

    """

    def __init__(self, s: Array, place: Array, count: int) -> None:
        """Compute the factors; the first `count` places increase from 0 to 1."""
        n = len(s) - 1
        rows = _vertex_rows(s)
        # The interval of each place, its length, and the distance from its start.
        k = np.clip(np.searchsorted(s, place, side='right') - 1, 0, n - 1)
        h = np.diff(s)[k][:, None]
        z = (place - s[k])[:, None]
        value, slope, bend = np.pad(rows[k], ((0, 0), (0, 0), (0, 1))).transpose(1, 0, 2)
        rise = np.pad(rows[k + 1, 2], ((0, 0), (1, 0))) - bend  # of x'' in the interval
        inner = np.stack([
            value + z * (slope + z * (0.5 * bend + z / (6.0 * h) * rise)),
            slope + z * (bend + 0.5 * z / h * rise),
            bend + z / h * rise], axis=1)
        # The two coefficients before the first one are equal to it, and so at the end.
        self.columns = np.clip(k - 2, 0, n - 5)[:, None] + np.arange(4)
        local = np.clip(k[:, None] + np.arange(-2, 2), 0, n - 2) - self.columns[:, :1]
        self.rows = np.zeros((len(place), 3, 4))
        for column in range(4):
            self.rows[np.arange(len(place)), :, local[:, column]] += inner[:, :, column]
        self.s, self.place, self.count, self.size = s, place, n - 1, count
        self.weights = np.zeros(len(place))
        self.weights[:count - 1] += 0.5 * np.diff(place[:count])
        self.weights[1:count] += 0.5 * np.diff(place[:count])

    def at(self, coefficients: Array) -> Array:
        """Return x, x' and x'' at the points, (3, P)."""
        local = coefficients[self.columns]
        return np.ascontiguousarray(np.einsum('kij,kj->ik', self.rows, local))

    def gradient(self, slopes: Array) -> Array:
        """Return the gradient in the coefficients, (N - 1,), of slopes in x, x', x'', (3, P)."""
        return self._summed(self.columns, np.einsum('kij,ik->kj', self.rows, slopes))

    def hessian(self, blocks: Array) -> Array:
        """Return the diagonals, (4, N - 1), of the Hessian from blocks, (P, 3, 3)."""
        local = self.rows.transpose(0, 2, 1) @ (blocks @ self.rows)
        diagonals = []
        for below in range(4):
            entries = [local[:, a, a - below] for a in range(below, 4)]
            values = np.stack(entries, axis=1)
            diagonals.append(self._summed(self.columns[:, below:], values))
        return np.array(diagonals)

    def _summed(self, places: Segments, values: Array) -> Array:
        sums = np.bincount(places.ravel(), values.ravel(), minlength=self.count)
        return np.asarray(sums, dtype=np.float64)


def _vertex_rows(s: Array) -> Array:
    """Return the factors of coefficients in x, x', x'' at vertices, (N + 1, 3, 3)."""
    h = np.pad(np.diff(s), (2, 2), mode='edge')
    a, b, c, d = (h[k:k + len(s)] for k in range(4))
    down = 6.0 / ((a + b + c) * (b + c))
    up = 6.0 / ((b + c + d) * (b + c))
    left = c / ((a + b + c) * (b + c))
    right = b / ((b + c + d) * (b + c))
    return np.array([[c * left, 1.0 - c * left - b * right, b * right],
                     [-3.0 * left, 3.0 * (left - right), 3.0 * right],
                     [down, -down - up, up]]).transpose(2, 0, 1)


def motion_points(path: SmoothSection, spline: ProfileSpline, coefficients: Array
                  ) -> ControllerPoints:
    """Return the points of the motion at the points of the path."""
    # x = (ds/dt)^2 is a cubic between the points; durations are integrals of 1 /
    # sqrt(x) by Gauss.
    x, slope, bend = spline.at(coefficients)[:, :spline.size]
    h = np.diff(spline.place[:spline.size])
    z = 0.5 * h * (1.0 + NODES[:, None])
    curved = 0.5 * bend[:-1] + z / (6.0 * h) * np.diff(bend)
    inside = x[:-1] + z * (slope[:-1] + z * curved)
    durations = 0.5 * h * (WEIGHTS @ (1.0 / np.sqrt(inside)))
    # q' = q_s sqrt(x), q'' = q_ss x + q_s x_s / 2.
    q, first, second = (rows[:spline.size] for rows in path.section[:3])
    u = first * np.sqrt(x)[:, None]
    udot = second * x[:, None] + 0.5 * first * slope[:, None]
    t = np.concatenate([[0.0], np.cumsum(durations)])
    return ControllerPoints(t, q, u, udot)
