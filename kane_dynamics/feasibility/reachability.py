"""
Largest profile x(s) of squared path velocities within linear limits, by reachability.

On a grid of a path q(s) the squared path velocity x = s'^2 is linear in s between the
vertices, so the path acceleration s'' = v / (2 h) is constant, with v the increase of x
over an interval of length h. Every limit in an interval is, with x at its start,

    |alpha v + beta x + gamma| <= width.

A pass from the end to the start of the path computes the controllable sets: intervals of
x from which the end can be reached within all limits. They are the least and the largest
x of a linear program in (x, v). A pass from the start to the end then chooses the
largest v that leads into the next set (Pham and Pham, TOPP-RA, IEEE Trans. Robotics 34
(2018)).

For fixed x the limits bound v from both sides, by lines over x. What they alone allow is
computed for all intervals at once, in SIMD lanes (`allowed`): the difference of the
least upper and the largest lower line is a concave, piecewise linear function of x,
whose roots are the ends of the allowed x. Newton's method from outside finds them in
finitely many steps, two or three in practice. The set at the end of the interval
excludes more x, in closed form for each line. So a pass is a short traced program of one
interval, repeated natively.
"""

from collections.abc import Sequence
from functools import cache, partial
from itertools import pairwise
from typing import NamedTuple

from kane_dynamics._util.typing import Array, Matrix, Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import magnitude, select
from kane_dynamics.motion.controller_points import Segments
from kane_dynamics.native.runtime.kernel import batch_kernel, Kernel
import numpy as np

# Of one linear program; the second number where the first is too small.
NEWTON_STEPS = (4, 20)
# Ratios of the coefficients of v and x below which a limit is stiff, and v = 0 must
# satisfy it.
STIFF, STIFFEST = 4.0, 0.5
TINY = 1e-300
SMALLEST = 1e-13  # replaces a smaller coefficient of v, relative to those of its row
EMPTY = 1e200  # error of an empty set
ROUNDING = 1e-9  # relative excess of a limit that is rounding
RANGE, GROUPS = 4, 4  # numbers of a set; numbers of a limit, and of what it allows
LOW, HIGH, ERROR, FAILED = range(RANGE)

Line = tuple[Scalar, Scalar]  # value at x = 0, and slope
Lines = Sequence[Line]


class IntervalLimits(NamedTuple):
    """
    Limits of a path with N intervals.

    Attributes
    ----------
    rows : (N + 1, 4, m) array
        alpha, beta, gamma and width of each limit at each vertex.
    middles : (N, 4, p) array
        The same for limits within each interval; p may be 0.
    most : (N + 1,) array
        Largest x at the vertices.

    """

    rows: Array
    middles: Array
    most: Array


class Infeasible(Exception):  # noqa: N818 - raised only inside this package
    """No profile satisfies the limits; the end is unreachable from `vertex`."""

    def __init__(self, vertex: int) -> None:
        super().__init__(vertex)
        self.vertex = vertex


# What the limits allow in one interval, over any scalar, for tracing.

def allowed(steps: int, rows: Matrix, following: Matrix, *middles_and_most: Matrix
            ) -> Vector:
    """
    Return the range of x that the limits in an interval allow, for any set at its end.

    It is the least and the largest x for which some v satisfies the limits, with their
    error, and the bounds of the x at the end, x + v, as lines over x: the upper and the
    lower ones at x = 0, their slopes and reciprocal slopes.

    Parameters
    ----------
    steps : int
        Of Newton's method.
    rows, following : (4, m) arrays
        Limits at the vertices at both ends of the interval.
    *middles_and_most : arrays
        The limits in the middle, (4, p), if there are any, and the largest x, ().

    """
    *middles, most = middles_and_most
    limits = _in_interval(rows, following)
    for block in middles:
        limits += list(block.T)
    upper, lower = _bounds(limits)
    high, error = _root(upper, lower, steady(rows, most[()]), 1.0, steps)
    # The least x is 0, unless a limit excludes slow motion.
    low_steps = 1 if steps == NEWTON_STEPS[0] else steps
    low, low_error = _root(upper, lower, 0.0 * most[()], -1.0, low_steps)

    # x + v = value + slope x: of the upper bounds of v, then of the lower ones.
    upper_values, upper_drifts = zip(*upper)
    lower_values, _ = zip(*lower)
    slopes = []
    for drift in upper_drifts:
        slopes.append(1.0 + drift)
    reciprocals = []
    for slope in slopes:
        reciprocals.append(1.0 / select(magnitude(slope) < TINY, TINY, slope))
    largest_error = select(low_error < error, error, low_error)
    return np.array([low, high, largest_error, 0.0, *upper_values, *lower_values,
                     *slopes, *reciprocals])


def _in_interval(rows: Matrix, following: Matrix) -> list[Vector]:
    """
    Return the limits in an interval from those at the vertices at its start and its end.

    It is the mean of the limits at both ends, which is that at the middle. Of a stiff
    limit, which bounds x rather than v, both ends count: a limit at the middle alone
    would let x oscillate around the bound (Pham and Pham 2018).
    """
    limits = []
    for begin, end in zip(rows.T, following.T):
        both = select(_stiff(begin, STIFF), 0.0, 0.5)
        both = both * select(_stiff(end, STIFF), 0.0, 1.0)
        both = select(begin[0] * end[0] > 0.0, both, 0.0)
        # The limit at the end, at x + v, as one of x and v.
        at_end = np.array([end[0] + end[1], *end[1:]])
        change = both * (at_end - begin)
        limits += [begin + change, at_end - change]  # the mean, twice, or both
    return limits


def _stiff(row: Vector, ratio: float) -> Scalar:
    """Return whether the coefficients of v and x have less than a ratio."""
    return magnitude(row[0]) < ratio * (magnitude(row[1]) + TINY)


def steady(rows: Matrix, most: Scalar) -> Scalar:
    """
    Return the largest x at which the stiff limits of a vertex hold for v = 0.

    A larger x would need a v that changes x by much of its size, back and forth between
    vertices.
    """
    for row in rows.T:
        _, beta, gamma, width = row
        # The limit that a larger x uses up: the upper one, or that on the other side.
        room = width - select(beta < 0.0, -gamma, gamma)
        bound = select(_stiff(row, STIFFEST), room, 0.0)
        x = room / magnitude(select(bound > 0.0, beta, 1.0))
        most = select(bound > 0.0, select(x < most, x, most), most)
    return most


def _bounds(limits: Sequence[Vector]) -> tuple[Lines, Lines]:
    """Return the upper and lower bounds of v as lines over x, with equal slopes."""
    upper, lower = [], []
    for alpha, beta, gamma, width in limits:

        # |alpha v + beta x + gamma| <= width as two lines for v, over any scalar; tiny
        # alphas become almost vertical bounds instead of divisions by zero.
        size = magnitude(alpha)
        tiny = SMALLEST * magnitude(beta) + 1e-100
        reciprocal = 1.0 / select(size < tiny, tiny, size)
        signed = select(alpha < 0.0, -reciprocal, reciprocal)
        room = width * reciprocal
        middle = -signed * gamma
        drift = -signed * beta
        upper.append((middle + room, drift))
        lower.append((middle - room, drift))
    return upper, lower


def _root(upper: Lines, lower: Lines, x: Scalar, sign: float, steps: int
          ) -> tuple[Scalar, Scalar]:
    """
    Return the end of the set, from an x above (sign 1) or below it (sign -1).

    The second part is its error, that of the last step of Newton's method, infinite if
    the set is empty.
    """
    # Newton's method on a concave function, so that each step stays on one side of the
    # end.
    error = 0.0
    for _ in range(steps + 1):
        highest, high_slope = extreme(_lines_at(upper, x), 1.0)
        lowest, low_slope = extreme(_lines_at(lower, x), -1.0)
        room = highest - lowest
        slope = high_slope - low_slope
        # Without a slope toward the set there is none: the step is then far beyond all
        # x.
        towards = select(sign * slope < 0.0, slope, -sign * 1e-300)
        error = select(room < 0.0, room / towards, 0.0)
        x = x - error
    return x, magnitude(error)


def _lines_at(lines: Lines, x: Scalar) -> Lines:
    """Return the values of lines at x, with their slopes."""
    return [(value + slope * x, slope) for value, slope in lines]


def extreme(lines: Lines, sign: float) -> Line:
    """Return the least (sign 1) or the largest (sign -1) value with its slope."""
    if len(lines) == 1:
        return lines[0]
    half = len(lines) // 2
    x, x_slope = extreme(lines[:half], sign)
    y, y_slope = extreme(lines[half:], sign)
    first = x < y if sign > 0.0 else y < x
    return select(first, x, y), select(first, x_slope, y_slope)


def _extreme_value(values: Sequence[Scalar], sign: float) -> Scalar:
    return extreme([(value, 0.0) for value in values], sign)[0]


# The passes, one interval of each.

def controllable(following: Vector, row: Vector) -> Vector:
    """
    Return the set of x at the start of an interval, for the set at its end.

    Sets are rows (least x, largest x, error of both, and 1 if this set or one after it
    is empty, else 0). `row` is what the limits allow: no lower bound of the x at the end
    may exceed the largest x there, and no upper one be below the least.
    """
    # A line of the limits, with an end of the next set, bounds x from one side: from
    # above or below by the sign of its rate.
    upper, lower, _, rates = _groups(row)
    lows, highs = [row[LOW]], [row[HIGH]]
    for lines, end, rising, falling in ((upper, following[LOW], lows, highs),
                                        (lower, following[HIGH], highs, lows)):
        for value, rate in zip(lines, rates):
            x = (end - value) * rate
            up = rate > 0.0
            rising.append(select(up, x, rising[0]))
            falling.append(select(up, falling[0], x))
    # The narrowest bounds; the set is empty if they cross beyond rounding.
    low, high = _extreme_value(lows, -1.0), _extreme_value(highs, 1.0)
    error = row[ERROR]
    # Both are at least 0 in a set that is not empty, and no numbers where one is none.
    slack = ROUNDING * high
    room = high + slack - low
    precise = slack - error
    failed = select(room > -TINY, following[FAILED], 1.0)
    failed = select(precise > -TINY, failed, 1.0)
    return np.array([low, high, error, failed])


def reached(x: Scalar, following: Vector, row: Vector) -> Scalar:
    """
    Return the largest reachable x at the end of an interval.

    `x` is its value at the start, `following` the set of allowed x at the end, and `row`
    the limits in the interval.
    """
    upper, _, slopes, _ = _groups(row)
    ends = [value + slope * x[()] for value, slope in zip(upper, slopes)]
    end = _extreme_value([following[HIGH], *ends], 1.0)
    return select(end < following[LOW], following[LOW], end)


def _groups(row: Vector) -> list[Vector]:
    """Return the parts of a row of `allowed`: values and slopes of the bounding lines."""
    ends = range(RANGE, len(row) + 1, (len(row) - RANGE) // GROUPS)
    return [row[begin:end] for begin, end in pairwise(ends)]


@cache
def _allowed_kernel(m: int, middles: int, steps: int) -> Kernel:
    """Return the kernel of `allowed`, for m limits at vertices and some in between."""
    within = [('middles', (GROUPS, middles))] if middles else []
    inputs = [('rows', (GROUPS, m)), ('following', (GROUPS, m)), *within, ('most', ())]
    width = RANGE + GROUPS * (2 * m + middles)
    return batch_kernel('allowed', partial(allowed, steps), inputs, (width,))


@cache
def _steady_kernel(m: int) -> Kernel:
    return batch_kernel('steady', lambda rows, most: steady(rows, most[()]), [
        ('rows', (GROUPS, m)), ('most', ())], ())


@cache
def _pass_kernels(width: int) -> tuple[Kernel, Kernel]:
    """Return the kernels of both passes, for rows of `allowed` of some width."""
    following, row = ('following', (RANGE,)), ('row', (width,))
    return (batch_kernel('controllable', controllable, [following, row], (RANGE,)),
            batch_kernel('reached', reached, [('x', ()), following, row], ()))


def end_limit(limits: IntervalLimits) -> float:
    """Return the largest x at the end of the path."""
    result = np.empty(1)
    kernel = _steady_kernel(limits.rows.shape[2])
    kernel.scan([limits.rows[-1:], limits.most[-1:]], result)
    return float(result[0])


def controllable_sets(limits: IntervalLimits, last: tuple[float, float],
                      known: tuple[Array, Segments] | None = None) -> Array:
    """
    Return the controllable sets of all vertices, rows as in `controllable`.

    The rows, (N + 1, w), continue with the bounds of the x at the next vertex.

    Parameters
    ----------
    limits : IntervalLimits
        Limits of the path.
    last : (float, float)
        Least and largest x at the end of the path.
    known : (N + 1, w) array and array of int, optional
        The sets for limits that differ at some vertices only, where they were wider, and
        these vertices. The array is written to.

    Raises
    ------
    Infeasible
        If a set is empty.

    """
    # From the sets of an earlier call, only vertices whose limits changed are computed
    # again, before the pass.
    if known is not None:
        sets, vertices = known
        _update_allowed(sets, limits, vertices)
        if _pass_to_start(sets, last) < 0:
            return sets
    for steps in NEWTON_STEPS:
        kernel = _allowed_kernel(limits.rows.shape[2], limits.middles.shape[2], steps)
        sets = np.empty((len(limits.rows), *kernel.shape))
        kernel.run(_allowed_inputs(limits), sets, len(sets) - 1)
        vertex = _pass_to_start(sets, last)
        if vertex < 0:
            return sets
        # An error between rounding and that of an empty set asks for more steps.
        if not ROUNDING * sets[vertex, HIGH] < sets[vertex, ERROR] < EMPTY:
            break
    raise Infeasible(vertex)


def _update_allowed(sets: Array, limits: IntervalLimits, vertices: Segments) -> None:
    """
    Write what the limits allow in the intervals beside some vertices.

    A set shrinks with the limits and with the set after it. So in the other intervals
    the next pass may begin with the sets of the pass before.
    """
    # A vertex belongs to the intervals on both sides.
    beside = np.zeros(len(sets), dtype=bool)
    beside[vertices] = True
    intervals = (beside[1:] | beside[:-1]).nonzero()[0]
    kernel = _allowed_kernel(limits.rows.shape[2], limits.middles.shape[2],
                             NEWTON_STEPS[0])
    names = [argument.name for argument in kernel.arguments]
    rows = np.empty((len(intervals), *kernel.shape))
    kernel.run(_allowed_inputs(limits), rows, len(rows), dict.fromkeys(names, intervals))
    sets[intervals] = rows


def _allowed_inputs(limits: IntervalLimits) -> list[Array]:
    rows, middles, most = limits
    within = [middles] if middles.size else []
    return [rows, rows[1:], *within, most]


def _pass_to_start(sets: Array, last: tuple[float, float]) -> int:
    """Compute all sets; return the last vertex whose set is empty, -1 for none."""
    sets[-1, :RANGE] = *last, 0.0, 0.0
    backward, _ = _pass_kernels(sets.shape[1])
    backward.scan([sets[1:, :RANGE], sets[:-1]], sets[:-1, :RANGE], reverse=True)
    if not sets[0, FAILED]:
        return -1
    return int(sets[:, FAILED].nonzero()[0][-1])


def largest_profile(sets: Array, first: float) -> Array:
    """Return the largest profile x, (N + 1,), in controllable sets, from x = `first`."""
    x = np.empty(len(sets))
    x[0] = first
    _, forward = _pass_kernels(sets.shape[1])
    forward.scan([x[:-1], sets[1:, :RANGE], sets[:-1]], x[1:])
    return x
