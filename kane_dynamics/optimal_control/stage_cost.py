"""
The cost of one interval of a horizon, over any scalar.

    1/2 sum of weight (value - target)^2 over the n torques of the interval, and the n
    positions and n speeds at its end, plus 1/2 `speed_weight` excess^2 of every joint.

The excess of a speed beyond a limit by v (negative within it) is the smooth
(v + sqrt(v^2 + w^2)) / 2, with the width w `WIDTH` times the limit; a kink there costs many
iterations.
"""

from typing import Any, NamedTuple

from kane_dynamics.mechanics.algebra.dual import select
import numpy as np

WIDTH = 0.05
NONE = 1e9  # rad/s or m/s: a limit beyond is none


class Limits(NamedTuple):
    """Limits of the joints, (n,) each; `speed_weight` is that of an excess of speed."""

    torque: Any
    speed: Any
    speed_weight: Any


def speed_excess(u: Any, limits: Limits) -> tuple[Any, Any]:
    """Return the excess beyond the upper and below the lower limit, and its slope, (2, n) each."""
    excess, slope = [], []
    for side in (1.0, -1.0):
        for x, most in zip(u, limits.speed):
            v, width = side * x - most, WIDTH * most
            root = np.sqrt(v * v + width * width)
            given = most < NONE
            excess.append(select(given, side * 0.5 * (v + root), 0.0))
            slope.append(select(given, 0.5 * (1.0 + v / root), 0.0))
    return np.reshape(excess, (2, -1)), np.reshape(slope, (2, -1))


def stage_cost(x: Any, tau: Any, target: Any, weight: Any, limits: Limits) -> Any:
    """Return the cost; x is the state at the end, (2 n,); target and weight of x, then tau."""
    away = np.concatenate([x, tau]) - target
    above, below = speed_excess(x[len(tau):], limits)[0]
    return 0.5 * (weight @ (away * away)
                  + limits.speed_weight @ (above * above + below * below))


def cost_slopes(x: Any, tau: Any, target: Any, weight: Any, limits: Limits) -> tuple[Any, Any]:
    """
    Return the gradient of `stage_cost` by x and tau, (3 n,), and the diagonal of its Hessian.

    The Hessian is that of Gauss and Newton, never negative.
    """
    n = len(tau)
    excess, slope = speed_excess(x[n:], limits)
    none = np.zeros(n)
    by_u = limits.speed_weight * (excess * slope).sum(axis=0)
    bend = limits.speed_weight * (slope * slope).sum(axis=0)
    return (weight * (np.concatenate([x, tau]) - target) + np.concatenate([none, by_u, none]),
            weight + np.concatenate([none, bend, none]))
