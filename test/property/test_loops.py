"""Compiled loops give the numbers of their steps, whoever reads the results."""

from hypothesis import given, strategies as st
from kane_dynamics.mechanics.recursive.subroutines import one_by_one
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.tracing.loop import Loops
from kane_dynamics.native.tracing.program import trace_program
import numpy as np

WIDTH = 3  # entries of a row, of the carry, and of the further results of a step


def step(carry, row):
    """Return the next carry, then further results."""
    return np.array([*(0.5 * carry + row), *(carry * row - 1.0)])


def two_loops(x, repeat, turns, read, reverse, places):
    """
    Return results of two loops in an arrangement.

    The second loop reads the columns `read` of the results of the first. A place names a
    loop, a turn and a column; None is a zero.
    """
    # Computed: a loop that reads arguments does not write results in place.
    table = 2.0 * x.reshape(turns, WIDTH)
    carry = np.array([0.1, 0.2, 0.3])
    first = repeat('first', step, carry, table)
    second = repeat('second', step, carry, first[:, read], reverse=reverse)
    loops = first, second
    entries = []
    for place in places:
        if place is None:
            entries.append(0.0)
        else:
            loop, turn, column = place
            entries.append(loops[loop][turn, column])
    return np.array(entries)


@st.composite
def arrangements(draw):
    """Return the arguments of `two_loops` after `repeat`; places are mostly regular."""
    turns = draw(st.integers(1, 5))
    read = draw(st.lists(st.integers(0, 2 * WIDTH - 1), min_size=WIDTH, max_size=WIDTH))
    columns = st.tuples(st.integers(0, 1), st.integers(0, 2 * WIDTH - 1))
    chosen = draw(st.lists(columns, min_size=1, max_size=12))
    places = [(loop, turn, column) for turn in range(turns) for loop, column in chosen]
    if draw(st.booleans()):
        k = draw(st.integers(0, len(places) - 1))
        places[k] = None
    return turns, read, draw(st.booleans()), places


@given(arrangements())
def test_results_of_loops_are_right_whether_other_loops_or_the_caller_reads_them(arrangement):
    count = WIDTH * arrangement[0]
    size = len(arrangement[-1])

    def program():
        return trace_program('two_loops', lambda x, _: two_loops(x, Loops(), *arrangement),
                             [('x', (count,)), ('parameters', (0,))])
    kernel = Kernel('two_loops', program, None, [Argument('x', (count,))], np.zeros(0), (size,))
    x = np.random.default_rng(0).uniform(-1.0, 1.0, count)
    expected = two_loops(x, one_by_one, *arrangement)
    assert np.allclose(kernel(x), expected, rtol=1e-14, atol=1e-15)
