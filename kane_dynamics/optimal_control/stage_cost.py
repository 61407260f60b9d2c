"""
The cost of one interval of a horizon, over any scalar.

    1/2 sum of weight (value - target)^2 over the n torques of the interval, and the n
    positions and n speeds at its end, plus 1/2 `speed_weight` (|u| - speed limit)^2 of every joint
    beyond its speed limit.
"""

from typing import Any, NamedTuple

from kane_dynamics.mechanics.algebra.dual import select
import numpy as np


class Limits(NamedTuple):
    """Limits of the joints, (n,) each; `speed_weight` is that of an excess of speed."""

    torque: Any
    speed: Any
    speed_weight: Any


def speed_excess(u: Any, limits: Limits) -> tuple[Any, Any]:
    """Return the speed beyond the limit, with its sign, and 1 where there is some, (n,) each."""
    excess = [select(most < x, x - most, select(x < -most, x + most, 0.0))
              for x, most in zip(u, limits.speed)]
    active = [select(most < x, 1.0, select(x < -most, 1.0, 0.0))
              for x, most in zip(u, limits.speed)]
    return np.array(excess), np.array(active)


def stage_cost(x: Any, tau: Any, target: Any, weight: Any, limits: Limits) -> Any:
    """Return the cost; x is the state at the end, (2 n,); target and weight of x, then tau."""
    away = np.concatenate([x, tau]) - target
    excess, _ = speed_excess(x[len(tau):], limits)
    return 0.5 * (weight @ (away * away) + limits.speed_weight @ (excess * excess))


def cost_slopes(x: Any, tau: Any, target: Any, weight: Any, limits: Limits) -> tuple[Any, Any]:
    """Return the gradient of `stage_cost` by x and tau, (3 n,), and the diagonal of its Hessian."""
    n = len(tau)
    excess, active = speed_excess(x[n:], limits)
    none = np.zeros(n)
    beyond = np.concatenate([none, limits.speed_weight * excess, none])
    return (weight * (np.concatenate([x, tau]) - target) + beyond,
            weight + np.concatenate([none, limits.speed_weight * active, none]))
