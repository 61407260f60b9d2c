"""
Largest profile x(s) of squared path velocities within linear limits, by reachability analysis.

On a grid of a path q(s) the squared path velocity x = s'^2 is linear in s between the vertices, so
the path acceleration s'' = v / (2 h) is constant, with v the increase of x over an interval of
length h. Every limit in an interval is, with x at its start,

    |alpha v + beta x + gamma| <= width.

A pass from the end to the start of the path computes the controllable sets, intervals of x from
which the end can be reached within all limits: the least and the largest x of a linear program in
(x, v). A pass from the start to the end then chooses the largest v that leads into the next set
(Pham and Pham, TOPP-RA, IEEE Trans. Robotics 34 (2018)).

The linear program has two unknowns. What the limits alone allow is computed for all intervals at
once, in SIMD lanes (`interval_limits`). The set at the end of the interval excludes more x, in
closed form for each line that bounds v. So a pass is a short traced program of one interval,
repeated natively.
"""

from functools import cache, partial
from itertools import pairwise
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.feasibility.interval_limits import allowed, extreme, NEWTON_STEPS, steady
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.motion.controller_points import Segments
from kane_dynamics.native.runtime.batch_kernel import batch_kernel
from kane_dynamics.native.runtime.kernel import Kernel
import numpy as np

EMPTY = 1e200  # error of an empty set
ROUNDING = 1e-9  # relative excess of a limit that is rounding
RANGE, GROUPS = 3, 4  # numbers of a set; numbers of a limit, and of what it allows


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


def _groups(row: Any) -> list[Any]:
    """Return the groups of numbers of the lines in an interval."""
    ends = range(RANGE, len(row) + 1, (len(row) - RANGE) // GROUPS)
    return [row[begin:end] for begin, end in pairwise(ends)]


def controllable(following: Any, row: Any) -> Any:
    """
    Return the set of x at the start of an interval, for the set at its end.

    Sets are rows (least x, largest x, error of both). `row` is what the limits allow: no lower
    bound of the x at the end may exceed the largest x there, and no upper one be below the least.
    """
    upper, lower, _, rates = _groups(row)
    lows, highs = [row[0]], [row[1]]
    for lines, end, rising, falling in ((upper, following[0], lows, highs),
                                        (lower, following[1], highs, lows)):
        for at, rate in zip(lines, rates):
            x, up = (end - at) * rate, rate > 0.0
            rising.append(select(up, x, rising[0]))
            falling.append(select(up, falling[0], x))
    low, high = (extreme([(x, 0.0) for x in part], sign)[0] for part, sign in (
        (lows, -1.0), (highs, 1.0)))
    return np.array([low, high, row[2]])


def reached(x: Any, following: Any, row: Any) -> Any:
    """Return the largest x at the end of an interval, in the set there, for x at its start."""
    upper, _, slopes, _ = _groups(row)
    end = extreme([(following[1], 0.0), *(
        (at + slope * x[()], 0.0) for at, slope in zip(upper, slopes))], 1.0)[0]
    return select(end < following[0], following[0], end)


@cache
def _allowed_kernel(m: int, middles: int, steps: int) -> Kernel:
    """Return the kernel of `allowed`, for m limits at vertices and some within an interval."""
    within = [('middles', (GROUPS, middles))] if middles else []
    return batch_kernel('allowed', partial(allowed, steps), [
        ('rows', (GROUPS, m)), ('after', (GROUPS, m)), *within, ('most', ())],
        (RANGE + GROUPS * (2 * m + middles),))


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


def compile_passes(m: int) -> None:
    """Compile the passes for m limits at each vertex, so that no request waits for them."""
    kernel = _allowed_kernel(m, 0, NEWTON_STEPS[0])
    kernel.compile_lanes()
    _steady_kernel(m)
    _pass_kernels(*kernel.shape)


def end_limit(limits: IntervalLimits) -> float:
    """Return the largest x at the end of the path."""
    result = np.empty(1)
    _steady_kernel(limits.rows.shape[2]).scan([limits.rows[-1:], limits.most[-1:]], result)
    return float(result[0])


class Infeasible(Exception):  # noqa: N818 - raised only inside this package
    """No profile satisfies the limits; `vertex` is the last from which the end is unreachable."""

    def __init__(self, vertex: int) -> None:
        super().__init__(vertex)
        self.vertex = vertex


def controllable_sets(limits: IntervalLimits, last: tuple[float, float],
                      known: tuple[Array, Segments] | None = None) -> Array:
    """
    Return the controllable sets of all vertices: least and largest x, and its error.

    The rows, (N + 1, w), continue with the bounds of the x at the next vertex.

    Parameters
    ----------
    limits : Limits
        Limits of the path.
    last : (float, float)
        Least and largest x at the end of the path.
    known : (N + 1, w) array and array of int, optional
        The sets for limits that differ at some vertices only, where they were wider, and these
        vertices. The array is written to.

    Raises
    ------
    Infeasible
        If a set is empty.

    """
    rows, middles, most = limits
    count = len(rows) - 1
    inputs = [rows, rows[1:], *([middles] if middles.size else []), most]

    def passed(sets: Array) -> int:
        """Run the pass, and return the last vertex with an empty set, -1 for none."""
        sets[-1, :RANGE] = *last, 0.0
        kernel, _ = _pass_kernels(sets.shape[1])
        kernel.scan([sets[1:, :RANGE], sets[:-1]], sets[:-1, :RANGE], reverse=True)
        low, high, error = sets[:, :RANGE].T
        slack = ROUNDING * high
        bad = np.flatnonzero(~((error <= slack) & (low <= high + slack)))
        return int(bad[-1]) if bad.size else -1
    if known is not None:
        # A set shrinks with the limits and with the set after it, so that in the intervals
        # without other limits the pass may begin with the set of the pass before.
        sets, changed = known
        kernel = _allowed_kernel(rows.shape[2], middles.shape[2], NEWTON_STEPS[0])
        near = np.zeros(count + 1, dtype=bool)
        near[changed] = True
        near[:-1] |= near[1:].copy()
        intervals = np.flatnonzero(near[:-1])
        allowed_rows = np.empty((len(intervals), *kernel.shape))
        kernel.run(inputs, allowed_rows, len(intervals), dict.fromkeys(
            (argument.name for argument in kernel.arguments), intervals))
        sets[intervals] = allowed_rows
        if passed(sets) < 0:
            return sets
    for steps in NEWTON_STEPS:
        kernel = _allowed_kernel(rows.shape[2], middles.shape[2], steps)
        sets = np.empty((count + 1, *kernel.shape))
        kernel.run(inputs, sets, count)
        vertex = passed(sets)
        if vertex < 0:
            return sets
        error, slack = sets[vertex, 2], ROUNDING * sets[vertex, 1]
        if not slack < error < EMPTY:
            break
    raise Infeasible(vertex)


def fastest_profile(sets: Array, first: float) -> Array:
    """Return the largest profile x, (N + 1,), in controllable sets, from x = `first`."""
    count, width = len(sets) - 1, sets.shape[1]
    x = np.empty(count + 1)
    x[0] = first
    _, kernel = _pass_kernels(width)
    kernel.scan([x[:-1], sets[1:, :RANGE], sets[:-1]], x[1:])
    return x
