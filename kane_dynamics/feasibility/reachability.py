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

The linear program has two unknowns. For fixed x the limits bound v from both sides, by lines over
x. What the limits alone allow is computed for all intervals at once, in SIMD lanes: the difference
of the least upper and the largest lower line is a concave, piecewise linear function of x, whose
roots are the ends of the allowed x. Newton's method from outside finds them in finitely many
steps, two or three in practice. The set at the end of the interval excludes more x, in closed form
for each line. So a pass is a short traced program of one interval, repeated natively.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import pairwise
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.batch_loop import run_batch, Strided
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loop_support import repeat
from kane_dynamics.native.tracing.program import Program, Shape, trace_program
import numpy as np

Input = tuple[str, Shape]
NEWTON_STEPS = (6, 20)  # of one linear program; the second number where the first is too small
# Ratios of the coefficients of v and x below which a limit is stiff, and v = 0 must satisfy it.
STIFF, STIFFEST = 4.0, 0.5
TINY = 1e-300
SMALLEST = 1e-13  # replaces a coefficient of v that is smaller, relative to those of its row
EMPTY = 1e200  # error of an empty set
ROUNDING = 1e-9  # relative excess of a limit that is rounding
RANGE, GROUPS = 3, 4  # numbers of a set; numbers of a limit, and of what it allows

Line = tuple[Any, Any]  # value at x = 0, and slope


class Limits(NamedTuple):
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


def _steady(rows: Any, most: Any) -> Any:
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


def _extreme(lines: Sequence[tuple[Any, Any]], sign: float) -> tuple[Any, Any]:
    """Return the least (sign 1) or the largest (sign -1) value with its slope."""
    if len(lines) == 1:
        return lines[0]
    half = len(lines) // 2
    (x, x_slope), (y, y_slope) = (_extreme(part, sign) for part in (lines[:half], lines[half:]))
    first = x < y if sign > 0.0 else y < x
    return select(first, x, y), select(first, x_slope, y_slope)


def _room(lines: tuple[list[Line], list[Line]], x: Any) -> tuple[Any, Any]:
    """Return the difference of the bounds of v at x, and its slope."""
    ends = [_extreme([(at + slope * x, slope) for at, slope in part], sign)
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
    their slopes and reciprocal slopes. `rest` is the limits in the middle, if there are any, the
    largest x at the start, and nothing, which all lanes share.
    """
    *middles, most, _ = rest
    lines = _bounds([*_in_interval(rows, after), *(
        limit for each in middles for limit in each.T)])
    high, error = _root(lines, _steady(rows, most[()]), 1.0, steps)
    # The least x is 0, unless a limit excludes slow motion.
    low, low_error = _root(lines, 0.0 * most[()], -1.0, 1 if steps == NEWTON_STEPS[0] else steps)
    (upper, slopes), (lower, _) = (zip(*part) for part in lines)
    slopes = [1.0 + slope for slope in slopes]
    return np.array([low, high, select(low_error < error, error, low_error), *upper, *lower,
                     *slopes, *map(_reciprocal, slopes)])


def _reciprocal(x: Any) -> Any:
    return 1.0 / select(_absolute(x) < TINY, TINY, x)


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
    low, high = (_extreme([(x, 0.0) for x in part], sign)[0] for part, sign in (
        (lows, -1.0), (highs, 1.0)))
    return np.array([low, high, row[2]])


def reached(x: Any, following: Any, row: Any) -> Any:
    """Return the largest x at the end of an interval, in the set there, for x at its start."""
    upper, _, slopes, _ = _groups(row)
    end = _extreme([(following[1], 0.0), *(
        (at + slope * x[()], 0.0) for at, slope in zip(upper, slopes))], 1.0)[0]
    return select(end < following[0], following[0], end)


def _kernel(name: str, function: Callable[..., Any], inputs: Sequence[Input], shape: Shape,
            steps: int = 0) -> Kernel:
    """Return a kernel of one interval."""
    def program() -> Program:
        return trace_program(name, function, inputs)
    return Kernel(name, program, f'{name} {inputs} {steps}', [
        Argument(*each) for each in inputs[:-1]], np.zeros(inputs[-1][1]), shape)


@cache
def _allowed_kernel(m: int, middles: int, steps: int) -> Kernel:
    """Return the kernel of `allowed`, for m limits at vertices and some within an interval."""
    within = [('middles', (GROUPS, middles))] if middles else []
    return _kernel('allowed', partial(allowed, steps), [
        ('rows', (GROUPS, m)), ('after', (GROUPS, m)), *within, ('most', ()),
        ('shared', (0,))],
        (RANGE + GROUPS * (2 * m + middles),), steps)


@cache
def _steady_kernel(m: int) -> Kernel:
    return _kernel('steady', lambda rows, most: _steady(rows, most[()]), [
        ('rows', (GROUPS, m)), ('most', ())], ())


@cache
def _pass_kernels(width: int) -> tuple[Kernel, Kernel]:
    """Return the kernels of both passes, for rows of `allowed` of some width."""
    inputs: list[Input] = [('following', (RANGE,)), ('row', (width,))]
    return (_kernel('controllable', controllable, inputs, (RANGE,)),
            _kernel('reached', reached, [('x', ()), *inputs], ()))


def compile_passes(m: int) -> None:
    """Compile the passes for m limits at each vertex, so that no request waits for them."""
    kernel = _allowed_kernel(m, 0, NEWTON_STEPS[0])
    kernel.compile_lanes()
    _steady_kernel(m)
    _pass_kernels(*kernel.shape)


def end_limit(limits: Limits) -> float:
    """Return the largest x at the end of the path."""
    result = np.empty(1)
    repeat(_steady_kernel(limits.rows.shape[2]).address, [
        limits.rows[-1:].ctypes.data, limits.most[-1:].ctypes.data, result.ctypes.data], [0] * 3, 1)
    return float(result[0])


class Infeasible(Exception):  # noqa: N818 - raised only inside this package
    """No profile satisfies the limits; `vertex` is the last from which the end is unreachable."""

    def __init__(self, vertex: int) -> None:
        super().__init__(vertex)
        self.vertex = vertex


def controllable_sets(limits: Limits, last: tuple[float, float]) -> Array:
    """
    Return the controllable sets of all vertices: least and largest x, and its error.

    The rows, (N + 1, w), continue with the bounds of the x at the next vertex.

    Parameters
    ----------
    limits : Limits
        Limits of the path.
    last : (float, float)
        Least and largest x at the end of the path.

    Raises
    ------
    Infeasible
        If a set is empty.

    """
    rows, middles, most = limits
    count = len(rows) - 1
    for steps in NEWTON_STEPS:
        kernel = _allowed_kernel(rows.shape[2], middles.shape[2], steps)
        sets = np.empty((count + 1, *kernel.shape))
        place = [Strided(each.ctypes.data, each.strides[0]) for each in (
            rows, rows[1:], *([middles] if middles.size else []), most, sets)]
        run_batch(kernel.lane_address, [*place[:-1], place[-1], place[-1]], count)
        sets[-1, :RANGE] = *last, 0.0
        stride = sets.strides[0]
        before = sets.ctypes.data + (count - 1) * stride
        repeat(_pass_kernels(*kernel.shape)[0].address, [before + stride, before, before],
               [-stride] * 3, count)
        low, high, error = sets[:, :RANGE].T.copy()
        slack = ROUNDING * high
        bad = np.flatnonzero(~((error <= slack) & (low <= high + slack)))
        if not bad.size:
            return sets
        if not slack[bad[-1]] < error[bad[-1]] < EMPTY:
            break
    raise Infeasible(int(bad[-1]))


def fastest_profile(sets: Array, first: float) -> Array:
    """Return the largest profile x, (N + 1,), in controllable sets, from x = `first`."""
    count, width = len(sets) - 1, sets.shape[1]
    x = np.empty(count + 1)
    x[0] = first
    at, begin, stride = x.ctypes.data, sets.ctypes.data, sets.strides[0]
    repeat(_pass_kernels(width)[1].address, [at, begin + stride, begin, at + 8], [8, stride, stride, 8],
           count)
    return x
