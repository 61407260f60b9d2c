"""Intervals of a number on which quadratic polynomials are positive, and those between."""

import math

from kane_dynamics._util.typing import Array
import numpy as np


def positive_intervals(A: Array, B: Array, C: Array) -> Array:
    """
    Return the open intervals on which A s^2 + B s + C > 0, (k, 2, n, 2) for (k, n) arrays.

    There are at most two; the end of a missing one is not greater than its beginning.
    """
    inf = math.inf
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        # The two roots without cancellation; NaN where there is none.
        half = -0.5 * (B + np.copysign(np.sqrt(B * B - 4.0 * A * C), B))
        roots = half / A, C / half
    first, second = np.fmin(*roots), np.fmax(*roots)
    none, flat = np.isnan(half) | np.isinf(C), A == 0.0
    everywhere = np.where(C > 0.0, -inf, inf)
    cases = [flat & (B > 0.0), flat & (B < 0.0), flat | none, A < 0.0]
    left = np.select(cases, [roots[1], -inf, everywhere, first], -inf)
    right = np.select(cases, [inf, roots[1], inf, second], first)
    beyond = np.where(flat | none | (A < 0.0), inf, second)
    return np.stack([np.stack([left, right], axis=-1),
                     np.stack([beyond, np.full_like(beyond, inf)], axis=-1)], axis=1)


def highest_free(intervals: Array, low: float, high: float) -> float | None:
    """Return the highest number in [low, high] outside all open intervals (m, 2), or None."""
    start, end = intervals[(intervals[:, 0] < np.minimum(high, intervals[:, 1]))
                           & (intervals[:, 1] > low)].T
    order = np.argsort(-end)
    start, end = np.minimum.accumulate(start[order]), end[order]
    if not len(end) or end[0] <= high:
        return high
    gaps = np.flatnonzero(end[1:] <= start[:-1])
    found = float(start[gaps[0] if len(gaps) else -1])
    return found if found >= low else None
