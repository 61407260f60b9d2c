"""
Largest profile x(s) of squared path velocities within linear limits, by reachability analysis.

On a grid of a path q(s) the squared path velocity x = s'^2 is linear in s between the vertices, so
the path acceleration s'' = v / (2 h) is constant, with v the increase of x over an interval of
length h. Every limit in an interval is, with x at its start,

    |alpha v + beta x + gamma| <= width + slope x.

A pass from the end to the start of the path computes the controllable sets, intervals of x from
which the end can be reached within all limits: the least and the largest x of a linear program in
(x, v). A pass from the start to the end then chooses the largest v that leads into the next set
(Pham and Pham, TOPP-RA, IEEE Trans. Robotics 34 (2018)). Each pass is a traced program of one
interval, repeated natively.

The linear program has two unknowns. For fixed x the limits bound v from both sides, and the
difference of the least upper and the largest lower bound is a concave, piecewise linear function
of x, whose roots are the ends of the set. Newton's method from outside finds them in finitely many
steps, two or three in practice.
"""

from collections.abc import Sequence
from functools import cache, partial
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.native.runtime.argument import Argument
from kane_dynamics.native.runtime.kernel import Kernel
from kane_dynamics.native.runtime.loop_support import repeat
from kane_dynamics.native.tracing.program import Program, trace_program
import numpy as np

NEWTON_STEPS = (4, 20)  # of one linear program; the second number where the first is too small
# Ratios of the coefficients of v and x below which a limit is stiff, and v = 0 must satisfy it.
STIFF, STIFFEST = 4.0, 0.5
TINY = 1e-300
SMALLEST = 1e-13  # replaces a coefficient of v that is smaller, relative to those of its row
EMPTY = 1e200  # error of an empty set
ROUNDING = 1e-9  # relative excess of a limit that is rounding

Line = tuple[Any, Any]  # value at x = 0, and slope


class Limits(NamedTuple):
    """
    Limits of a path with N intervals.

    Attributes
    ----------
    rows : (N + 1, 5, m) array
        alpha, beta, gamma, width and slope of each limit at each vertex.
    middles : (N, 5, p) array
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
    return _absolute(row[0]) / (_absolute(row[1]) + _absolute(row[4]) + TINY)


def _steady(rows: Any, most: Any) -> Any:
    """
    Return the largest x at which the stiff limits of a vertex hold for v = 0.

    A larger x would need a v that changes x by much of its size, back and forth between vertices.
    """
    for row in rows.T:
        _, beta, gamma, width, slope = row
        stiff = select(_ratio(row) < STIFFEST, 1.0, 0.0)
        for sign in (1.0, -1.0):
            rate, room = sign * beta - slope, width - sign * gamma
            bound = stiff * select(rate > 0.0, 1.0, 0.0) * select(room > 0.0, 1.0, 0.0)
            x = room / select(bound > 0.0, rate, 1.0)
            most = select(bound > 0.0, select(x < most, x, most), most)
    return most


def _bounds(following: Any, limits: Sequence[Any]) -> tuple[list[Line], list[Line]]:
    """Return the upper and lower bounds of v as lines over x."""
    upper, lower = [(following[1], -1.0)], [(following[0], -1.0)]
    for alpha, beta, gamma, width, slope in limits:
        size, tiny = _absolute(alpha), SMALLEST * _absolute(beta) + 1e-100
        reciprocal = 1.0 / select(size < tiny, tiny, size)
        signed = select(alpha < 0.0, -reciprocal, reciprocal)
        room, change = width * reciprocal, slope * reciprocal
        middle, drift = -signed * gamma, -signed * beta
        upper.append((middle + room, drift + change))
        lower.append((middle - room, drift - change))
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


def controllable(steps: int, following: Any, rows: Any, after: Any, *rest: Any) -> Any:
    """
    Return the set of x at the start of an interval, for the set at its end.

    Sets are rows (least x, largest x, error of both). `rest` is the limits in the middle, if
    there are any, and the largest x at the start.
    """
    *middles, most = rest
    lines = _bounds(following, [*_in_interval(rows, after), *(
        limit for each in middles for limit in each.T)])
    high, error = _root(lines, _steady(rows, most[()]), 1.0, steps)
    # The least x is 0, unless a limit excludes slow motion.
    low, low_error = _root(lines, 0.0 * most[()], -1.0, 1 if steps == NEWTON_STEPS[0] else steps)
    return np.array([low, high, select(low_error < error, error, low_error)])


def reached(x: Any, following: Any, rows: Any, after: Any, *middles: Any) -> Any:
    """Return the largest x at the end of an interval, in the set there, for x at its start."""
    upper, _ = _bounds(following, [*_in_interval(rows, after), *(
        limit for each in middles for limit in each.T)])
    end = x[()] + _extreme([(at + slope * x[()], slope) for at, slope in upper], 1.0)[0]
    return select(end < following[0], following[0], end)


def end_limit(limits: Limits) -> float:
    """Return the largest x at the end of the path."""
    return float(_steady(limits.rows[-1], limits.most[-1]))


@cache
def _kernel(name: str, m: int, middles: int, steps: int) -> Kernel:
    """Return the kernel of one interval of a pass, for m limits at vertices and some within."""
    back = name == 'controllable'
    inputs: list[tuple[str, tuple[int, ...]]] = [
        ('following', (3,)), ('rows', (5, m)), ('after', (5, m))]
    inputs += [('middles', (5, middles))] if middles else []
    inputs = [*inputs, ('most', ())] if back else [('x', ()), *inputs]
    function = partial(controllable, steps) if back else reached

    def program() -> Program:
        return trace_program(name, function, inputs)
    return Kernel(name, program, f'{name} {m} {middles} {steps}', [
        Argument(*each) for each in inputs[:-1]], np.zeros(inputs[-1][1]), (3,) if back else ())


def compile_passes(m: int) -> None:
    """Compile the passes for m limits at each vertex, so that no request waits for them."""
    _kernel('controllable', m, 0, NEWTON_STEPS[0])
    _kernel('reached', m, 0, 0)


def _run(kernel: Kernel, rows: Sequence[Array], count: int, backward: bool) -> None:
    """Repeat a kernel along arrays with one row per step; `rows` begin at the first step."""
    addresses = [row.ctypes.data for row in rows]
    strides = [-row.strides[0] if backward else row.strides[0] for row in rows]
    repeat(kernel.address, addresses, strides, count)


class Infeasible(Exception):  # noqa: N818 - raised only inside this package
    """No profile satisfies the limits; `vertex` is the last from which the end is unreachable."""

    def __init__(self, vertex: int) -> None:
        super().__init__(vertex)
        self.vertex = vertex


def controllable_sets(limits: Limits, last: tuple[float, float]) -> Array:
    """
    Return the controllable sets of all vertices, (N + 1, 3): least and largest x, and its error.

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
    within = [middles[-1:]] if middles.size else []
    for steps in NEWTON_STEPS:
        sets = np.zeros((count + 1, 3))
        sets[-1] = *last, 0.0
        _run(_kernel('controllable', rows.shape[2], middles.shape[2], steps),
             [sets[-1:], rows[-2:], rows[-1:], *within, most[-2:], sets[-2:]], count, True)
        slack = ROUNDING * sets[:, 1]
        bad = np.flatnonzero(~((sets[:, 2] <= slack) & (sets[:, 0] <= sets[:, 1] + slack)))
        if not bad.size:
            return sets
        if not sets[bad[-1], 2] < EMPTY:
            break
    raise Infeasible(int(bad[-1]))


def fastest_profile(limits: Limits, sets: Array, first: float) -> Array:
    """Return the largest profile x, (N + 1,), from x = `first` at the start."""
    rows, middles, _ = limits
    count = len(rows) - 1
    x = np.zeros(count + 1)
    x[0] = first
    _run(_kernel('reached', rows.shape[2], middles.shape[2], 0),
         [x, sets[1:], rows, rows[1:], *([middles] if middles.size else []), x[1:]], count, False)
    return x
