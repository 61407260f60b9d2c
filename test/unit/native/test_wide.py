"""Traced lanes compute what the same operations on numbers give."""

from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.native.tracing.wide import WideLanes
import numpy as np
import pytest

SIZE = 2 * LANES
X = np.random.default_rng(0).uniform(-2.0, 2.0, SIZE)


def compiled(function, x):
    """Return ``function(x, lanes)``, computed by a kernel of one state."""
    def program():
        return trace_program('wide',
                             lambda given, _: function(given, WideLanes(given[0].trace)),
                             [('x', (SIZE,)), ('parameters', (1,))])
    shape = (len(program().outputs),)
    kernel = Kernel('wide', program, None, [Argument('x', (SIZE,))], np.zeros(1), shape)
    return kernel(x)


def entries(lanes, *rows):
    """Return all scalars of some rows."""
    return np.array([lanes.lane(row, k) for row in rows for k in range(LANES)])


CASES = {
    'arithmetic': lambda x, lanes, a, b: entries(
        lanes, a + b, a - b, a * b, -a, a + x[0], x[0] - a, 2.0 * a, 1.0 - a, a * 0.0,
        a + 0.0), 'packs': lambda x, lanes, a, b: entries(
            lanes, lanes.pack([x[3]] * LANES), lanes.pack([1.0, x[0], 2.0]),
            lanes.pack([1.0, 2.0]) * a, lanes.pack([3.0] * LANES)),
    'quotients': lambda x, lanes, a, b: entries(lanes, 1.0 / a, 2.0 / (a * b)),
    'selections': lambda x, lanes, a, b: entries(
        lanes, select(a < b, a, b), select(a < 0.0, -a, a), select(a > 0.5, 1.0, b),
        select(b > 0.5, x[3], a)),
    'beginnings': lambda x, lanes, a, b: np.array([
        lanes.lane(row, k) for row in (lanes.beginning(list(x[1:4])),
                                       lanes.beginning(list(entries(lanes, a * b)[:3])))
        for k in range(3)]), 'blend': lambda x, lanes, a, b: entries(
            lanes, lanes.blend([k % 3 == 0 for k in range(LANES)], a * b, 0.0),
            lanes.blend([True] * LANES, a, b), lanes.blend([False] * LANES, a, b)),
    'gathered': lambda x, lanes, a, b: entries(
        lanes, lanes.gathered([a, b],
                              [(0, 3), None, (1, 7), (1, 0), (0, 0), None, (0, 3),
                               (1, 2)]), lanes.gathered([a * b, x[2]], [(0, 7)] * LANES),
        lanes.gathered([a, b], [None] * LANES),
        lanes.gathered([x[2], b], [(0, 1), None, *[(1, 4)] * 6])),
    'transposed': lambda x, lanes, a, b: entries(
        lanes, *lanes.transposed([a, b, a + b, 0.0, x[5]])),
    'parts of rows': lambda x, lanes, a, b: np.array([
        0.0, *entries(lanes, a * b)[2:5], x[1], *entries(lanes, a + b)[::-1],
        lanes.lane(a, 7) + 1.0, *[0.0] * 20]),  # as many zeros as are cleared at once
}


@pytest.mark.parametrize('case', CASES)
def test_traced_lanes_are_lanes_of_numbers(case):
    def function(x, lanes):
        return CASES[case](x, lanes, lanes.pack(x[:LANES]), lanes.pack(x[LANES:]))
    expected = np.array(function(X, Lanes), dtype=float)
    assert np.abs(compiled(function, X) - expected).max() <= 4e-16 * np.abs(
        expected).max()


def test_a_result_may_be_written_over_the_argument():
    def function(x, lanes):
        a = lanes.pack(x[:LANES])
        b = lanes.pack(x[LANES:])
        return entries(lanes, a * b, a + b)
    program = trace_program('wide', lambda x, _: function(x, WideLanes(x[0].trace)),
                            [('x', (SIZE,)), ('parameters', (1,))])
    kernel = Kernel('wide', lambda: program, None, [Argument('x', (SIZE,))], np.zeros(1),
                    (SIZE,))
    x = X.copy()
    expected = kernel(X)
    kernel(x, out=x)
    assert np.array_equal(x, expected)


def test_operations_on_rows_count_once_a_lane():
    program = trace_program('wide',
                            lambda x: entries(WideLanes(x[0].trace), 2.0 * WideLanes(
                                x[0].trace).pack(x[:LANES])), [('x', (SIZE,))])
    assert program.operation_count().multiplications == LANES
