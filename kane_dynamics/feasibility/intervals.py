"""Intervals on which quadratic polynomials are positive, and numbers outside them."""

import math

from kane_dynamics._util.typing import Array
import numpy as np


def positive_intervals(A: Array, B: Array, C: Array) -> Array:
    """
    Return the open intervals on which A s^2 + B s + C > 0, (k, 2, n, 2).

    A, B and C are (k, n). There are at most two intervals; the end of a missing one is
    not greater than its beginning.
    """
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        # The two roots without cancellation; NaN where there is none.
        half = -0.5 * (B + np.copysign(np.sqrt(B * B - 4.0 * A * C), B))
        roots = half / A, C / half
    first = np.fmin(*roots)
    second = np.fmax(*roots)
    no_root = np.isnan(half) | np.isinf(C)
    linear = A == 0.0
    inf = math.inf
    everywhere = np.where(C > 0.0, -inf, inf)  # or nowhere, where there is no root

    # The one interval of a line or of a parabola that opens downward, or the left one of
    # a parabola that opens upward. The first case that holds is taken.
    cases = [linear & (B > 0.0), linear & (B < 0.0), linear | no_root, A < 0.0]
    begin = np.select(cases, [roots[1], -inf, everywhere, first], -inf)
    end = np.select(cases, [inf, roots[1], inf, second], first)

    # The right one of a parabola that opens upward.
    single = linear | no_root | (A < 0.0)
    begin_right = np.where(single, inf, second)
    end_right = np.full_like(begin_right, inf)
    return np.stack([np.stack([begin, end], axis=-1),
                     np.stack([begin_right, end_right], axis=-1)], axis=1)


def highest_free(intervals: Array, low: float, high: float) -> float | None:
    """
    Return the highest number in [low, high] outside all open intervals, or None.

    The intervals are (m, 2).
    """
    # Those that are not empty and reach into [low, high], by falling ends.
    starts, ends = intervals.T
    relevant = (starts < np.minimum(high, ends)) & (ends > low)
    order = np.argsort(-ends[relevant])
    ends = ends[relevant][order]
    starts = np.minimum.accumulate(starts[relevant][order])
    if not len(ends) or ends[0] <= high:
        return high

    # Below the start of all intervals above the first free space between them.
    gaps = np.flatnonzero(ends[1:] <= starts[:-1])
    place = gaps[0] if len(gaps) else -1
    highest = float(starts[place])
    return highest if highest >= low else None
