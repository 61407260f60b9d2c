"""
Fastest profile within limits, by a primal-dual interior-point method.

The duration, the sum of h / sqrt(x), is convex in the coefficients of x. Each limit is a pair
1 - v > 0, 1 + v > 0 with a logarithmic barrier (Nocedal and Wright, Numerical Optimization,
chapter 19). Curvatures of the limits are left out of the Hessian, which so is positive definite
and has two diagonals beside the main one. All iterates satisfy the limits.
"""

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.banded_solution import banded_solution
from kane_dynamics.feasibility.jerk_limited.profile_spline import ProfileSpline
from kane_dynamics.feasibility.jerk_limited.third_order_limits import ThirdOrderLimits
import numpy as np

# Relative difference between the duration and that of a local optimum, about, and at most.
EXCESS, LARGEST = 2e-4, 2e-3
STEPS, HALVINGS = 400, 40
BOUNDARY = 0.95  # of the way to a limit, at most
REDUCTION = 0.2  # of the barrier parameter


def fastest_spline(spline: ProfileSpline, limits: ThirdOrderLimits, c: Array
                   ) -> tuple[Array, float]:
    """
    Return the coefficients of the fastest profile, from those of a slow one, and its excess.

    The excess is a bound of the relative difference to the duration of a local optimum, about.
    """
    h = spline.step
    profile = spline.at(c)
    weights = np.full(len(profile), h)
    weights[[0, -1]] *= 0.5
    uses = limits.at(profile)
    count = 2 * uses.values.size
    duration = float(weights @ profile[:, 0]**-0.5)
    mu = duration / count
    sides = _sides(uses.values)
    dual = mu / sides

    def merit(x: Array, sides: Array) -> float:
        return float(weights @ x**-0.5 - mu * np.log(sides).sum())

    for _ in range(STEPS):
        x = profile[:, 0]
        duration = float(weights @ x**-0.5)
        gradient = np.zeros_like(profile)
        gradient[:, 0] = -0.5 * weights * x**-1.5
        gradient += np.einsum('ikm,km->ki', uses.slopes, mu / sides[0] - mu / sides[1])
        ratio = (dual / sides).sum(axis=0)
        blocks = np.einsum('ikm,km,jkm->kij', uses.slopes, ratio, uses.slopes, optimize=True)
        blocks[:, 0, 0] += 0.75 * weights * x**-2.5
        slope = spline.gradient(gradient)
        change = banded_solution(spline.hessian(blocks), -slope[:, None])[:, 0]
        moved = spline.at(change)
        rate = np.einsum('ikm,ki->km', uses.slopes, moved)
        rates = np.stack([-rate, rate])
        longest = min(1.0, BOUNDARY / max(float((-rates / sides).max()),
                                          float((-moved[:, 0] / x).max()), 1e-30))
        decrease, before, length = float(slope @ change), merit(x, sides), longest
        for _ in range(HALVINGS):
            new = spline.at(c + length * change)
            if (new[:, 0] > 0.0).all():
                left = _sides(limits.at(new).values)
                if (left > 0.0).all() and merit(new[:, 0], left) <= (
                        before + 1e-4 * length * decrease + 1e-12 * abs(before)):
                    break
            length *= 0.5
        else:
            return c, mu * count / duration
        dual_change = mu / sides - dual - dual / sides * rates
        shorter = min(1.0, BOUNDARY / max(float((-dual_change / dual).max()), 1e-30))
        dual += shorter * dual_change
        c = c + length * change
        profile = spline.at(c)
        uses = limits.at(profile)
        sides = _sides(uses.values)
        dual = np.clip(dual, 1e-6 * mu / sides, 1e6 * mu / sides)
        if -decrease < 0.1 * mu * np.sqrt(count) and length > 0.3:
            if mu * count <= EXCESS * duration:
                return c, mu * count / duration
            mu = max(REDUCTION * mu, 0.9 * EXCESS * duration / count)
    return c, mu * count / duration


def _sides(values: Array) -> Array:
    return np.stack([1.0 - values, 1.0 + values])
