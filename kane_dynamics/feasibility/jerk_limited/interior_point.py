"""
Fastest profile within limits, by a primal-dual interior-point method.

The duration, the sum of h / sqrt(x), is convex in the coefficients of x. Each limit is a
pair 1 - v > 0, 1 + v > 0 with a logarithmic barrier (Nocedal and Wright, Numerical
Optimization, chapter 19). Curvatures of the limits are left out of the Hessian, which so
is positive definite and has three diagonals beside the main one. All iterates satisfy
the limits.
"""

from collections.abc import Callable

from kane_dynamics._util.optional_imports import extra
from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.jerk_limited.profile_spline import ProfileSpline
from kane_dynamics.feasibility.jerk_limited.third_order_limits import ThirdOrderLimits
import numpy as np

EXCESS = 2e-4  # relative difference of the duration to a local optimum, about
STEPS, HALVINGS = 120, 20
BOUNDARY = 0.95  # of the way to a limit, at most
REDUCTION = 0.15  # of the barrier parameter


def fastest_spline(spline: ProfileSpline, limits: ThirdOrderLimits, c: Array,
                   distance: float, least: float = EXCESS) -> tuple[Array, float]:
    """
    Return coefficients of the fastest profile, and an approximate bound of its excess.

    Parameters
    ----------
    spline : ProfileSpline
        The grid.
    limits : ThirdOrderLimits
        The limits at its points.
    c : (N - 1,) array
        Coefficients of a profile that satisfies the limits.
    distance : float
        Relative difference of its duration to the least one, about, with which the
        barrier begins. The excess that is returned is such a difference, to a local
        optimum.
    least : float
        The excess at which the iteration ends.

    """
    solve = banded_solver()
    weights = spline.weights
    profile = spline.at(c)
    uses = limits.at(profile)
    sides = _sides(uses.values)
    count = sides.size
    duration = float(weights @ profile[0]**-0.5)
    mu = distance * duration / count
    dual = mu / sides

    def merit(x: Array, sides: Array) -> float:
        return float(weights @ x**-0.5) - mu * float(np.log(sides).sum())

    for _ in range(STEPS):
        x = profile[0]
        duration = float(weights @ x**-0.5)
        # Newton's step of the barrier function.
        gradient = np.einsum('imp,mp->ip', uses.slopes, mu / sides[0] - mu / sides[1])
        gradient[0] -= 0.5 * weights * x**-1.5
        blocks = _blocks(uses.slopes, (dual / sides).sum(axis=0))
        blocks[:, 0, 0] += 0.75 * weights * x**-2.5
        slope = spline.gradient(gradient)
        change = solve(spline.hessian(blocks), -slope)
        moved = spline.at(change)
        rate = np.einsum('imp,ip->mp', uses.slopes, moved)
        rates = np.stack([-rate, rate])
        to_limits = float((-rates / sides).max())
        to_zero = float((-moved[0] / x).max())
        length = min(1.0, BOUNDARY / max(to_limits, to_zero, 1e-30))
        # Line search: inside all limits, with a part of the decrease that the slope
        # states.
        decrease = float(slope @ change)
        start = merit(x, sides)
        for _ in range(HALVINGS):
            new = profile + length * moved
            if (new[0] > 0.0).all():
                new_uses = limits.at(new)
                new_sides = _sides(new_uses.values)
                allowed = start + 1e-4 * length * decrease + 1e-12 * abs(start)
                if (new_sides > 0.0).all() and merit(new[0], new_sides) <= allowed:
                    break
            length *= 0.5
        else:
            return c, mu * count / duration
        dual_change = mu / sides - dual - dual / sides * rates
        shorter = min(1.0, BOUNDARY / max(float((-dual_change / dual).max()), 1e-30))
        c = c + length * change
        profile, uses, sides = new, new_uses, new_sides
        dual = np.clip(dual + shorter * dual_change, 1e-6 * mu / sides, 1e6 * mu / sides)
        # Near the minimum for this barrier a smaller one follows, or the end.
        if -decrease < 0.1 * mu * np.sqrt(count) and length > 0.3:
            if mu * count <= least * duration:
                return c, mu * count / duration
            mu = max(REDUCTION * mu, 0.9 * least * duration / count)
    return c, mu * count / duration


def banded_solver() -> Callable[[Array, Array], Array]:
    """
    Return a function of diagonals, (4, m), and right side, (m,), that returns x.

    The diagonals are A[i, i], A[i, i-1], A[i, i-2] and A[i, i-3] of a symmetric positive
    definite matrix; entries before its first column are ignored.
    """
    linalg = extra('scipy.linalg', 'identify', 'time_optimal with jerk limits')

    def solution(diagonals: Array, right: Array) -> Array:
        # SciPy's columns of the lower band begin at the main diagonal.
        columns = np.zeros_like(diagonals)
        for k, diagonal in enumerate(diagonals):
            columns[k, :len(right) - k] = diagonal[k:]
        return np.asarray(linalg.solveh_banded(columns, right, lower=True))
    return solution


def _sides(values: Array) -> Array:
    return np.stack([1.0 - values, 1.0 + values])


def _blocks(slopes: Array, ratio: Array) -> Array:
    """Return the sums of ratio times the products of slopes, (P, 3, 3)."""
    scaled = ratio * slopes
    blocks = np.empty((slopes.shape[2], 3, 3))
    for i in range(3):
        for j in range(i + 1):
            blocks[:, i, j] = np.einsum('mp,mp->p', scaled[i], slopes[j])
            blocks[:, j, i] = blocks[:, i, j]
    return blocks
