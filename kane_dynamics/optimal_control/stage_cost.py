"""
The cost of one interval of a horizon, over any scalar.

    1/2 sum of weight (value - target)^2 over the m torques of the interval, and the n joints'
    positions and rates at its end, plus 1/2 `speed_weight` excess^2 of every joint.

The excess of a speed beyond a limit by v (negative within it) is the smooth
(v + sqrt(v^2 + w^2)) / 2, with the width w `WIDTH` times the limit; a kink there costs many
iterations.
"""

from typing import Any, NamedTuple

from kane_dynamics.mechanics.algebra.dual import select
import numpy as np

WIDTH = 0.05
LEAST = 1e-9  # rad/s or m/s, of the width: that of a limit of 0
NONE = 1e9  # rad/s or m/s: a limit beyond is none


class Limits(NamedTuple):
    """Bounds of torques, (m,), limits of joint rates and weights of their excess, (n,)."""

    lowest_torque: Any
    highest_torque: Any
    speed: Any
    speed_weight: Any


def speed_excess(u: Any, limits: Limits) -> tuple[Any, Any]:
    """Return the excess beyond the upper and below the lower limit, and its slope, (2, n) each."""
    excess, slope = [], []
    for side in (1.0, -1.0):
        for x, most in zip(u, limits.speed):
            v, width = side * x - most, WIDTH * most
            root = np.sqrt(v * v + width * width + LEAST**2)
            given = most < NONE
            excess.append(select(given, side * 0.5 * (v + root), 0.0))
            slope.append(select(given, 0.5 * (1.0 + v / root), 0.0))
    return np.reshape(excess, (2, -1)), np.reshape(slope, (2, -1))


def stage_cost(away: Any, rates: Any, weight: Any, limits: Limits) -> Any:
    """
    Return the cost.

    Parameters
    ----------
    away : (2 n + m,) array
        Positions and rates of the joints at the end, and torques, minus their targets.
    rates : (n,) array
        Of the joints at the end.
    weight : (2 n + m,) array
        Of `away`.
    limits : Limits
        Limits of torques and speeds.

    """
    above, below = speed_excess(rates, limits)[0]
    return 0.5 * (weight @ (away * away)
                  + limits.speed_weight @ (above * above + below * below))


def cost_slopes(away: Any, rates: Any, weight: Any, limits: Limits) -> tuple[Any, Any]:
    """
    Return the gradient of `stage_cost`, (2 n + m,), and the diagonal of its Hessian.

    They are by the positions and rates of the joints, and the torques. The Hessian is that of
    Gauss and Newton, never negative.
    """
    n = len(rates)
    excess, slope = speed_excess(rates, limits)
    by_u = limits.speed_weight * (excess * slope).sum(axis=0)
    bend = limits.speed_weight * (slope * slope).sum(axis=0)
    before, behind = np.zeros(n), np.zeros(len(away) - 2 * n)
    return (weight * away + np.concatenate([before, by_u, behind]),
            weight + np.concatenate([before, bend, behind]))
