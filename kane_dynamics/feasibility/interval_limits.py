"""
Path velocities that linear limits allow in one interval of a path, over any scalar, for tracing.

The limits are those of `reachability`. For fixed x they bound v from both sides, by lines over x.
The difference of the least upper and the largest lower line is a concave, piecewise linear
function of x, whose roots are the ends of the allowed x. Newton's method from outside finds them
in finitely many steps, two or three in practice.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.dual import select
import numpy as np

NEWTON_STEPS = (4, 20)  # of one linear program; the second number where the first is too small
# Ratios of the coefficients of v and x below which a limit is stiff, and v = 0 must satisfy it.
STIFF, STIFFEST = 4.0, 0.5
TINY = 1e-300
SMALLEST = 1e-13  # replaces a coefficient of v that is smaller, relative to those of its row

Line = tuple[Any, Any]  # value at x = 0, and slope


def _absolute(x: Any) -> Any:
    return select(x < 0.0, -x, x)


def _in_interval(rows: Any, after: Any) -> list[list[Any]]:
    """
    Return the limits in an interval from those at the vertices at its start and its end.

    It is the mean of the limits at both ends, which is that at the middle. Of a stiff limit, which
    bounds x rather than v, both ends count: a limit at the middle alone would let x oscillate
    around the bound (Pham and Pham 2018).
    """
    out = []
    for begin, end in zip(rows.T, after.T):
        both = select(_ratio(begin) < STIFF, 0.0, 0.5) * select(_ratio(end) < STIFF, 0.0, 1.0)
        both = select(begin[0] * end[0] > 0.0, both, 0.0)
        end = np.array([end[0] + end[1], *end[1:]])
        change = both * (end - begin)
        out += [list(begin + change), list(end - change)]  # the mean, twice, or both
    return out


def _ratio(row: Any) -> Any:
    """Return the ratio of the coefficients of v and x."""
    return _absolute(row[0]) / (_absolute(row[1]) + TINY)


def steady(rows: Any, most: Any) -> Any:
    """
    Return the largest x at which the stiff limits of a vertex hold for v = 0.

    A larger x would need a v that changes x by much of its size, back and forth between vertices.
    """
    for row in rows.T:
        _, beta, gamma, width = row
        stiff = select(_ratio(row) < STIFFEST, 1.0, 0.0)
        for sign in (1.0, -1.0):
            rate, room = sign * beta, width - sign * gamma
            bound = stiff * select(rate > 0.0, 1.0, 0.0) * select(room > 0.0, 1.0, 0.0)
            x = room / select(bound > 0.0, rate, 1.0)
            most = select(bound > 0.0, select(x < most, x, most), most)
    return most


def _bounds(limits: Sequence[Any]) -> tuple[list[Line], list[Line]]:
    """Return the upper and lower bounds of v as lines over x, with equal slopes."""
    upper, lower = [], []
    for alpha, beta, gamma, width in limits:
        size, tiny = _absolute(alpha), SMALLEST * _absolute(beta) + 1e-100
        reciprocal = 1.0 / select(size < tiny, tiny, size)
        signed = select(alpha < 0.0, -reciprocal, reciprocal)
        room, middle, drift = width * reciprocal, -signed * gamma, -signed * beta
        upper.append((middle + room, drift))
        lower.append((middle - room, drift))
    return upper, lower


def extreme(lines: Sequence[tuple[Any, Any]], sign: float) -> tuple[Any, Any]:
    """Return the least (sign 1) or the largest (sign -1) value with its slope."""
    if len(lines) == 1:
        return lines[0]
    half = len(lines) // 2
    (x, x_slope), (y, y_slope) = (extreme(part, sign) for part in (lines[:half], lines[half:]))
    first = x < y if sign > 0.0 else y < x
    return select(first, x, y), select(first, x_slope, y_slope)


def _room(lines: tuple[list[Line], list[Line]], x: Any) -> tuple[Any, Any]:
    """Return the difference of the bounds of v at x, and its slope."""
    ends = [extreme([(at + slope * x, slope) for at, slope in part], sign)
            for part, sign in zip(lines, (1.0, -1.0))]
    return ends[0][0] - ends[1][0], ends[0][1] - ends[1][1]


def _root(lines: tuple[list[Line], list[Line]], x: Any, sign: float,
          steps: int) -> tuple[Any, Any]:
    """
    Return the end of the set, from x above (sign 1) or below it (sign -1), and its error.

    The error is that of the last step of Newton's method, infinite if the set is empty.
    """
    error = 0.0
    for _ in range(steps + 1):
        room, slope = _room(lines, x)
        towards = select(sign * slope < 0.0, slope, -sign * 1e-300)
        error = select(room < 0.0, room / towards, 0.0)
        x = x - error
    return x, _absolute(error)


def allowed(steps: int, rows: Any, after: Any, *rest: Any) -> Any:
    """
    Return what the limits in an interval allow, whatever the set at its end is.

    It is the least and the largest x for which some v satisfies the limits, with their error, and
    the bounds of the x at the end, x + v, as lines over x: the upper and the lower ones at x = 0,
    their slopes and reciprocal slopes. `rest` is the limits in the middle, if there are any, and
    the largest x at the start.
    """
    *middles, most = rest
    lines = _bounds([*_in_interval(rows, after), *(
        limit for each in middles for limit in each.T)])
    high, error = _root(lines, steady(rows, most[()]), 1.0, steps)
    # The least x is 0, unless a limit excludes slow motion.
    low, low_error = _root(lines, 0.0 * most[()], -1.0, 1 if steps == NEWTON_STEPS[0] else steps)
    (upper, drifts), (lower, _) = (zip(*part) for part in lines)
    slopes = [1.0 + drift for drift in drifts]
    return np.array([low, high, select(low_error < error, error, low_error), *upper, *lower,
                     *slopes, *map(_reciprocal, slopes)])


def _reciprocal(x: Any) -> Any:
    return 1.0 / select(_absolute(x) < TINY, TINY, x)
