"""
Compiled loops, calls and rows give the numbers of their steps, wherever stored.

The compiler stores results of loops and rows straight among those of a program, reads
tables of loops where they are in memory, copies runs of results, and clears zeros at
once. Random programs reach each of these. Their results may overlap their arguments in
memory.
"""

from collections import Counter
import re

from hypothesis import given, strategies as st
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.recursive.subroutines import directly, one_by_one
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.runtime.loops import repeat
from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.loop import Loops
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.native.tracing.subroutine import Subroutines
from kane_dynamics.native.tracing.wide import WideLanes
import numpy as np
import pytest

WIDTH = 3  # entries of a carry and of a row
CASES = 60  # random programs of one test
MANY_ZEROS = 1200  # of a large matrix
TOLERANCE = 1e-12  # all numbers are of size 1
# Expressions of the compiled text that show a way of storing or reading numbers, by its
# name.
WAYS = {
    'results of a loop among those of the program': r'%into\d',
    'a run of results of a loop, copied': r'%copied\.',
    'results of a row, stored at once': r'%to\d',
    'zeros, cleared at once': 'call void @llvm.memset',
    'many zeros, cleared by rows': '%clear.at',
    'a loop from the last row': r'%last\d',
    'a table of constants': '@table.',
    'a table of mixed entries': r'%table\d',
    'a part of an argument or result, in place': r'%row\d',
    'an argument of a call, stored before': r'%arg\d',
    'a lane, from memory': r'%kept\d',
}


class Compiled:
    """Loops, calls and rows of a traced program."""

    def __init__(self):
        """Make registries of the steps and subroutines of one program."""
        self.loop = Loops()
        self.call = Subroutines()

    def lanes(self, x):
        """Return the functions of rows for a scalar."""
        return WideLanes(x.trace)


class Evaluated:
    """The same for numbers, step by step."""

    loop = staticmethod(one_by_one)
    call = staticmethod(directly)

    def lanes(self, x):
        """Return the functions of rows for a scalar."""
        return Lanes


def vector(*entries):
    """Return an array of scalars."""
    return np.array(entries, dtype=object)


def sine(x):
    return np.sin(x if isinstance(x, Expr) else np.float64(x))


def product(a, b):
    """Return the function of the subroutine: numbers of size 1 for such numbers."""
    return vector(0.5 * (a[0] * a[1] - b[0]), a[1] * b[2], 0.5 * (b[1] + a[2]))


def steps_of(tools):
    """Return steps by name: each gives the next carry, then further results."""
    def short(carry, row):
        return vector(*(0.5 * (carry + row)), *(carry * row))

    def with_constants(carry, row):
        return vector(*(0.5 * (carry + row)), 0.0, *(carry * row), 0.75)

    def of_two(carry, row, other):
        return vector(*(0.5 * (carry + row * other)), *(0.5 * (row - other)),
                      *(other * carry))

    def of_functions(carry, row):
        return vector(*map(sine, carry + row), *(carry * row))

    def of_rows(carry, row):
        lanes = tools.lanes(carry[0])
        a = lanes.pack([*carry, *row, 0.25])
        b = lanes.pack([*row, *carry, 1.0, 0.5])
        c = 0.5 * (a * b - a)
        return vector(*(0.5 * (carry + row)), *[lanes.lane(c, k) for k in range(LANES)])

    def of_a_loop(carry, row):
        inner = tools.loop('short', short, carry, np.array([row, 0.5 * row, carry]))
        return vector(*inner[-1, :WIDTH], *inner[1, WIDTH:], *inner[:, 0])

    def of_a_call(carry, row):
        called = tools.call('product', product, carry, row)
        return vector(*(0.5 * (carry + called)), *called, carry[0])

    steps = short, with_constants, of_two, of_functions, of_rows, of_a_loop, of_a_call
    return {step.__name__: step for step in steps}


class RandomProgram:
    """
    A program of random loops, calls, functions and rows, fixed once it is drawn.

    Parameters
    ----------
    seed : int
    tools : Compiled or Evaluated
    arguments : list of arrays

    """

    def __init__(self, seed, tools, arguments):
        """Store the arguments, from which all other numbers follow."""
        self.rng = np.random.default_rng(seed)
        self.tools = tools
        self.steps = steps_of(tools)
        self.vectors = [vector(*x) for x in arguments]
        # Loops that read arguments store no results in place.
        if self.rng.random() < 0.6:
            self.vectors = [0.75 * x for x in self.vectors]
        self.results = []  # of loops, (count, entries)

    def result(self):
        """Return the result of the program, (k,)."""
        operations = (self.looped, self.looped, self.looped, self.called, self.evaluated,
                      self.row)
        for _ in range(self.rng.integers(1, 7)):
            self.rng.choice(operations)()
        entries = []
        for _ in range(self.rng.integers(1, 6)):
            entries += self.part_of_result()
        return vector(*entries)

    # Operations.

    def looped(self):
        name = str(self.rng.choice(list(self.steps)))
        count = int(self.rng.integers(1, 6))
        tables = []
        for _ in range(2 if name == 'of_two' else 1):
            tables.append(self.table(count))
        carry = self.entries(WIDTH).copy()
        carry[0] = 0.5 * self.vectors[0][0]  # a loop has a traced entry
        self.results.append(self.tools.loop(name, self.steps[name], carry, *tables,
                                            reverse=bool(self.rng.random() < 0.4)))

    def called(self):
        arguments = self.entries(WIDTH), self.entries(WIDTH)
        self.vectors.append(vector(*self.tools.call('product', product, *arguments)))

    def evaluated(self):
        self.vectors.append(vector(*map(sine, self.entries(4))))

    def row(self):
        lanes = self.tools.lanes(self.vectors[0][0])
        a, b = (lanes.pack(list(self.entries(LANES))) for _ in range(2))
        # A scalar, then a lane of the row, for all lanes.
        c = 0.5 * (a * b + self.vectors[0][0])
        c = c * lanes.pack([lanes.lane(c, 1)] * LANES)
        self.vectors.append(vector(*[lanes.lane(c, k) for k in range(LANES)]))

    # What operations read.

    def entries(self, count):
        """Return scalars that are together in memory, or not, or constants."""
        kind = self.rng.integers(6)
        source = self.vectors[self.rng.integers(len(self.vectors))]
        if kind == 0:
            return vector(*self.rng.choice([0.0, 0.5, -1.0], count))
        if kind == 1 and self.results:
            of_loop = self.results[self.rng.integers(len(self.results))]
            source = of_loop[self.rng.integers(len(of_loop))]
        if kind <= 3 and len(source) >= count:
            begin = self.rng.integers(len(source) - count + 1)
            return source[begin:begin + count]
        scattered = source[self.rng.integers(len(source), size=count)]
        if self.rng.random() < 0.3:
            scattered[self.rng.integers(count)] = 0.75
        return scattered

    def table(self, count):
        """Return rows that are at equal distances in memory, or not, or constants."""
        kind = self.rng.integers(6)
        flat = [*self.vectors, *map(np.ravel, self.results)]
        source = flat[self.rng.integers(len(flat))]
        distance = int(self.rng.integers(1, 8))
        last = len(source) - (count - 1) * distance - WIDTH
        if kind == 0:
            return self.rng.uniform(-1.0, 1.0, (count, WIDTH)).astype(object)
        if kind == 1 and last >= 0:
            begin = self.rng.integers(last + 1)
            places = begin + distance * np.arange(count)
            return np.array([source[k:k + WIDTH] for k in places])
        if kind <= 4 and self.results:
            of_loop = self.results[self.rng.integers(len(self.results))]
            if len(of_loop) >= count:
                return self.columns(of_loop[:count])
        return np.array([self.entries(WIDTH) for _ in range(count)])

    def columns(self, of_loop):
        """Return some columns of results of a loop, mostly side by side."""
        begin = self.rng.integers(of_loop.shape[1] - WIDTH + 1)
        chosen = of_loop[:, begin:begin + WIDTH]
        if self.rng.random() < 0.1:
            chosen = of_loop[:, self.rng.integers(of_loop.shape[1], size=WIDTH)]
        return chosen[::-1] if self.rng.random() < 0.2 else chosen

    def part_of_result(self):
        """Return entries of the result: zeros, whole vectors, or columns of loops."""
        kind = self.rng.integers(6)
        if kind == 0:
            few = self.rng.integers(1, 20)
            return [0.0] * int(self.rng.choice([few, MANY_ZEROS], p=[0.5, 0.5]))
        if kind == 1 or not self.results:
            return list(self.vectors[self.rng.integers(len(self.vectors))])
        of_loop = self.results[self.rng.integers(len(self.results))]
        if kind == 2:
            return list(of_loop.flat)
        begin, end = np.sort(self.rng.choice(of_loop.shape[1] + 1, 2, replace=False))
        block = of_loop[:, begin:end]
        if self.rng.random() < 0.3:
            block = block.T
        if self.rng.random() < 0.3:
            block = block[::-1]
        gap = [0.0] * int(self.rng.integers(0, 3))
        return [x for row in block for x in [*row, *gap]]


class Case:
    """A random program with its compiled kernel, arguments, and expected result."""

    def __init__(self, seed):
        """Evaluate the program, and trace it."""
        self.rng = np.random.default_rng((seed, 1))
        sizes = self.rng.integers(WIDTH, 16, self.rng.integers(1, 4)).tolist()
        self.arguments = [self.rng.uniform(-1.0, 1.0, size) for size in sizes]
        self.expected = RandomProgram(seed, Evaluated(), self.arguments).result().astype(
            float)
        inputs = [(f'x{k}', (size,)) for k, size in enumerate(sizes)]

        def traced(*values):
            return RandomProgram(seed, Compiled(), values[:-1]).result()
        self.program = trace_program('random', traced, [*inputs, ('parameters', (0,))])
        self.kernel = Kernel('random', lambda: self.program, None,
                             [Argument(*one) for one in inputs], np.zeros(0),
                             self.expected.shape)

    def compare(self, found):
        np.testing.assert_allclose(found, self.expected, rtol=TOLERANCE, atol=TOLERANCE)

    def overlapping(self):
        """Return the result, computed in the arguments' memory or beside it."""
        size = sum(map(len, self.arguments))
        memory = np.full(2 * size + len(self.expected), np.nan)
        begins = size // 2 + np.cumsum([0, *map(len, self.arguments)])
        pointers = []
        for begin, argument in zip(begins, self.arguments):
            part = memory[begin:begin + len(argument)]
            part[:] = argument
            pointers.append(part.ctypes.data)
        begin = int(self.rng.integers(begins[-1]))
        result = memory[begin:begin + len(self.expected)]
        pointers += [self.kernel.parameters.ctypes.data, result.ctypes.data]
        repeat(self.kernel.address, pointers, [0] * len(pointers), 1)
        return result


@pytest.mark.parametrize('first', range(0, 6 * CASES, CASES))
def test_random_programs_give_their_numbers_beside_and_over_their_arguments(first):
    for seed in range(first, first + CASES):
        case = Case(seed)
        case.compare(case.kernel(*case.arguments))
        for _ in range(4):
            case.compare(case.overlapping())


def test_random_programs_store_and_read_numbers_in_each_way():
    counts = Counter()
    for seed in range(6 * CASES):
        text = module_text(Case(seed).program, 'random')
        counts.update(access for access, part in WAYS.items() if re.search(part, text))
    assert set(counts) == set(WAYS)


def test_one_name_of_loops_with_rows_of_two_widths_has_a_step_for_each():
    def total(carry, row):
        return carry + sum(row)

    def function(x, _, loop):
        narrow = loop('total', total, x[:1], x.reshape(3, 2))
        return np.concatenate(
            [narrow[-1], loop('total', total, x[:1], x.reshape(2, 3))[-1]])
    program = trace_program('two', lambda x, _: function(x, _, Loops()),
                            [('x', (6,)), ('parameters', (0,))])
    kernel = Kernel('two', lambda: program, None, [Argument('x', (6,))], np.zeros(0),
                    (2,))
    x = np.arange(1.0, 7.0)
    np.testing.assert_allclose(kernel(x), function(x, None, one_by_one), rtol=1e-15)


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
    places = []
    for turn in range(turns):
        for loop, column in chosen:
            places.append((loop, turn, column))
    if draw(st.booleans()):
        k = draw(st.integers(0, len(places) - 1))
        places[k] = None
    return turns, read, draw(st.booleans()), places


@given(arrangements())
def test_results_of_loops_are_right_whether_other_loops_or_the_caller_reads_them(
        arrangement):
    count = WIDTH * arrangement[0]
    size = len(arrangement[-1])

    def program():
        return trace_program('two_loops',
                             lambda x, _: two_loops(x, Loops(), *arrangement),
                             [('x', (count,)), ('parameters', (0,))])
    kernel = Kernel('two_loops', program, None, [Argument('x', (count,))], np.zeros(0),
                    (size,))
    x = np.random.default_rng(0).uniform(-1.0, 1.0, count)
    expected = two_loops(x, one_by_one, *arrangement)
    assert np.allclose(kernel(x), expected, rtol=1e-14, atol=1e-15)
