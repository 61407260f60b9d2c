"""
Generate LLVM IR: one straight-line function per program.

With `lanes` > 1 every scalar of the program is a vector of `lanes` numbers, one state
per lane, in registers and in the memory of arguments and results. For one state,
`abreast` arguments of elementary functions are packed into a vector; processors without
SIMD registers have 1. A program of one state may call others in lanes, for several
states at once (`tracing.side_by_side`).

A program of one state may also compute with rows (`tracing.wide`): `LANES` doubles in
SIMD registers, which `Rows` generates. `Function` generates everything else.
"""

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.native.backends.llvm_math import (constant_vector, FUNCTION_LANES,
                                                     intrinsic_end, literal, transpose,
                                                     Vector, vector_type)
from kane_dynamics.native.tracing.expression import Expr, operands
from kane_dynamics.native.tracing.program import CALLS, PLACING, Program, ROWS
from kane_dynamics.native.tracing.side_by_side import SideBySide
from kane_dynamics.native.tracing.subroutine import is_first
import numpy as np

# Structurally zero results from which memset is smaller than single stores.
MEMSET_ZEROS = 16
LOOP_OF_ZEROS = 4096  # bytes of results from which a loop is faster than memset
ARITHMETIC = {'add': 'fadd', 'sub': 'fsub', 'mul': 'fmul', 'div': 'fdiv'}
# Elementary functions that share their work, and a label.
TOGETHER = (('sc', ('sin', 'cos')), ('th', ('tanh',)), ('ex', ('exp',)),
            ('lg', ('log',)), ('at', ('arctan',)))
ELEMENTARY = frozenset(op for _, ops in TOGETHER for op in ops)
ROW_TYPE = vector_type(LANES)
CHUNK = 256 * LANES  # numbers of a loop's results that one pointer reaches in few bytes
ROW_ARITHMETIC = {'wide_add': 'fadd', 'wide_sub': 'fsub', 'wide_mul': 'fmul',
                  'wide_div': 'fdiv'}


Destination = tuple[str, int]  # name of a pointer, and place from there on
# Instead of the place of a result: it has none, or is read elsewhere too.
NOWHERE, SEVERAL = -1, -2


@dataclass(frozen=True, eq=False)
class PlacedProgram(Program):
    """
    The step of a loop whose last results are not stored after the others.

    Attributes
    ----------
    kept : int
        Number of results that are.
    places : tuple of (int, int) or None
        Of each other result: the number of its pointer among those after that of the
        results, and its place from there on; None if it is not stored.

    """

    kept: int
    places: tuple[tuple[int, int] | None, ...]

    @property
    def pointers(self) -> int:
        """Return the number of pointers for results that are not kept."""
        numbers = [place[0] for place in self.places if place is not None]
        return max(numbers) + 1

    def destinations(self) -> list[Destination | None]:
        """Return where each result is stored."""
        # What the loop keeps stands in its own memory, one after the other.
        result: list[Destination | None] = [('%in.result', k) for k in range(self.kept)]
        for place in self.places:
            if place is None:
                result.append(None)
            else:
                number, offset = place
                result.append((f'%in.result{number}', offset))
        return result


class Names(dict[int, str]):
    """
    IR names of values by the index of their node.

    Results of loops have none: they stay in memory, and each use loads them. In
    registers from the loop on, most of them would be spilled to other memory.

    Parameters
    ----------
    lines : list of str
        Instructions of the function, to which loads are appended.

    Attributes
    ----------
    in_memory : dict
        Type, pointer and place in numbers of each such value by the index of its node.

    """

    def __init__(self, lines: list[str]) -> None:
        """Begin without values."""
        super().__init__()
        self.lines = lines
        self.in_memory: dict[int, tuple[str, str, int]] = {}
        self._loads = 0

    def __missing__(self, index: int) -> str:
        """Load a value from memory and return its name."""
        kind, pointer, place = self.in_memory[index]
        name = f'%load{self._loads}'
        # Each load has a name of its own: a value may be loaded again in another block.
        self._loads += 1
        at = f'{name}.at'
        self.lines += [f'  {at} = getelementptr double, ptr {pointer}, i64 {place}',
                       f'  {name} = load {kind}, ptr {at}, align 8']
        return name


class Rows:
    """
    Generates the nodes of `kane_dynamics.native.tracing.wide` for one function.

    Parameters
    ----------
    lines : list of str
        The function's instructions, to which those of each node are appended.
    names : Names
    outputs : sequence of Expr or float
        The function's results.
    destinations : sequence of (str, int) or None
        Pointer and place at which each result is stored; None for those that are not.

    Attributes
    ----------
    stored : set of int
        Results that are stored with their row: in memory instead of registers for the
        rest of the function.

    """

    def __init__(self, lines: list[str], names: Names, outputs: Sequence[Any],
                 destinations: Sequence[Destination | None]) -> None:
        """Generate into a function."""
        self.lines = lines
        self.names = names
        self._destinations = destinations
        self._tiles: dict[int, list[str]] = {}
        self._runs: dict[int, list[tuple[int, int, int]]] = {}
        self.stored: set[int] = set()
        self._in_memory: set[int] = set()  # rows
        for place, row, first, count in _runs(outputs, destinations):
            self._runs.setdefault(row.index, []).append((place, first, count))
            self.stored.update(range(place, place + count))

    def value(self, node: Expr) -> str:
        """Append the instructions of a node and its stores; return its IR name."""
        name = self._value(node)
        self._store(node, name)
        return name

    def _value(self, node: Expr) -> str:
        v = Vector(self.lines, f'w{node.index}', LANES)
        # Between scalars and rows: packing, and columns of a tile that was transposed.
        args = node.args
        if node.op == 'pack':
            return self._packed(v, args)
        if node.op == 'column':
            tile, k = args
            return self._tiles[tile.index][int(k)]
        # Operations on rows: shuffles of lanes, then arithmetic by lane.
        rows = [self.names[x.index] for x in args if isinstance(x, Expr)]
        if node.op == 'transposed':
            self._tiles[node.index] = transpose(v, rows)
            return ''
        if node.op == 'lane':
            return v.new(f'extractelement {ROW_TYPE} {rows[0]}, i32 {args[1]}')
        if node.op == 'blend':
            mask = ', '.join(f'i1 {int(chosen)}' for chosen in args[2])
            return v.new(f'select <{LANES} x i1> <{mask}>, {ROW_TYPE} {rows[0]}, '
                         f'{ROW_TYPE} {rows[1]}')
        if node.op == 'gather':
            return v.shuffle(rows[0], 'zeroinitializer', list(args[1]))
        if node.op == 'wide_neg':
            return v.new(f'fneg {ROW_TYPE} {rows[0]}')
        if node.op == 'wide_less':  # used by selections alone
            return v.new(f'fcmp olt {ROW_TYPE} {rows[0]}, {rows[1]}')
        if node.op == 'wide_select':
            return v.new(f'select <{LANES} x i1> {rows[0]}, {ROW_TYPE} {rows[1]}, '
                         f'{ROW_TYPE} {rows[2]}')
        return v.new(f'{ROW_ARITHMETIC[node.op]} contract {ROW_TYPE} {rows[0]}, '
                     f'{rows[1]}')

    def _packed(self, v: Vector, entries: Sequence[Expr | float]) -> str:
        """Return a row of scalars."""
        first = entries[0]
        if all(x is first for x in entries) and isinstance(first, Expr):
            # One scalar in every lane; a lane of another row is loaded from memory.
            if first.op == 'lane':
                one = self._loaded(v, *first.args)
            else:
                one = self.names[first.index]
            one = v.new(f'insertelement {ROW_TYPE} poison, double {one}, i32 0')
            return v.shuffle(one, 'poison', [0] * LANES)
        # The constants as a literal, into which the traced scalars are inserted.
        constants = ['0x0' if isinstance(x, Expr) else literal(x) for x in entries]
        row = '<' + ', '.join(f'double {constant}' for constant in constants) + '>'
        for k, x in enumerate(entries):
            if isinstance(x, Expr):
                scalar = self.names[x.index]
                row = v.new(f'insertelement {ROW_TYPE} {row}, double {scalar}, i32 {k}')
        return row

    def _loaded(self, v: Vector, row: Expr, k: int) -> str:
        """Return a lane from memory: loads broadcast without shuffles."""
        place = f'%kept{row.index}'
        if row.index not in self._in_memory:
            self._in_memory.add(row.index)
            self.lines += [f'  {place} = alloca {ROW_TYPE}, align {8 * LANES}',
                           f'  store {ROW_TYPE} {self.names[row.index]}, ptr {place}']
        at = v.new(f'getelementptr double, ptr {place}, i64 {k}')
        return v.new(f'load double, ptr {at}')

    def _store(self, node: Expr, name: str) -> None:
        """Store the results that are consecutive values of a computed row."""
        for place, first, count in self._runs.get(node.index, ()):
            # A run shorter than a row is cut out of it, and stored at once.
            v = Vector(self.lines, f'to{place}', LANES)
            part = name
            kind = vector_type(count)
            if count < LANES:
                lanes = ', '.join(f'i32 {first + k}' for k in range(count))
                part = v.new(f'shufflevector {ROW_TYPE} {name}, {ROW_TYPE} poison, '
                             f'<{count} x i32> <{lanes}>')
            destination = self._destinations[place]
            assert destination is not None
            pointer, offset = destination
            at = v.new(f'getelementptr double, ptr {pointer}, i64 {offset}')
            self.lines.append(f'  store {kind} {part}, ptr {at}, align 8')


def _runs(outputs: Sequence[Any], destinations: Sequence[Destination | None]
          ) -> Iterator[tuple[int, Expr, int, int]]:
    """
    Yield (place, row, first lane, length) of each run of outputs.

    A run is a sequence of outputs, from `place` on, that are consecutive lanes of one
    row and go to consecutive places in memory.
    """
    k = 0
    while k < len(outputs):
        # Count the outputs that are the next lanes of the same row.
        # A run begins at an output that is a lane of a row.
        x = outputs[k]
        destination = destinations[k]
        count = 1
        if isinstance(x, Expr) and x.op == 'lane' and destination is not None:
            row, lane = x.args
            pointer, offset = destination
            while (k + count < len(outputs)
                   and _is_lane(outputs[k + count], row, lane + count)
                   and destinations[k + count] == (pointer, offset + count)):
                count += 1
            if count > 1:
                yield k, row, lane, count
        k += count


class PlacedResults(NamedTuple):
    """
    Results of a loop that its step stores among those of the function.

    Attributes
    ----------
    program : PlacedProgram
        The step.
    begins, strides : lists of int
        Of each further pointer of the step: its place in the first row, and the
        distance from row to row.
    outputs : frozenset of int
        Places of these results.

    """

    program: PlacedProgram
    begins: list[int]
    strides: list[int]
    outputs: frozenset[int]


def placements(program: Program, symbol: str) -> dict[int, PlacedResults]:
    """
    Return which results of loops go straight to the results of a program, by loop.

    These are results of all turns that nothing else reads, at places that are equally
    far apart from turn to turn. Loops that read arguments in place, and those before
    such a loop or call, store none, since results may overlap arguments in memory.
    """
    loops: list[Expr] = []
    read: list[Expr] = []
    # Results may overlap arguments: a loop may write in place only if no later loop
    # reads inputs.
    for group in _levels(program.schedule()):
        for node in group:
            read += operands(node)
            if node.op == 'loop':
                loops.append(node)
            if _reads_arguments(node):
                loops = []

    # Places among the results, by loop and result.
    places: dict[int, dict[int, int]] = {node.index: {} for node in loops}
    # A result that an operation reads must stay in the memory of its loop.
    for operand in read:
        if _of_loops(operand, places):
            source, k = operand.args
            places[source.index][k] = SEVERAL
    for place, x in enumerate(program.outputs):
        if isinstance(x, Expr) and _of_loops(x, places):
            source, k = x.args
            among = places[source.index]
            among[k] = SEVERAL if k in among else place
    known: dict[tuple[Any, ...], PlacedProgram] = {}
    result = {}
    for node in loops:
        loop = node.args[0]
        placement = _placement(loop, places[node.index], known, symbol)
        if loop.count > 1 and placement is not None:
            result[node.index] = placement
    return result


def _reads_arguments(node: Expr) -> bool:
    """Return whether a node is a call or loop that may read arguments in place."""
    return node.op in CALLS and any(x.op == 'input' for x in operands(node))


def _of_loops(x: Expr, loops: Container[int]) -> bool:
    """Return whether a scalar is a result of one of these loops."""
    return x.op == 'output' and x.args[0].index in loops


def _regular_places(loop: Any, places: Mapping[int, int]
                    ) -> tuple[int, dict[int, tuple[int, int] | None]]:
    """
    Return how many results of each turn stay with the loop, and where the others go.

    This is the place of each result in the first turn and its distance to the next; None
    of results that nothing needs.
    """
    # The results that the next turn needs are first; they always stay.
    size = len(loop.program.outputs)
    kept = math.prod(loop.program.inputs[0][1])
    regular: dict[int, tuple[int, int] | None] = {}
    for k in range(kept, size):
        # Where this result goes in each turn: nowhere, at equal distances, or anywhere.
        of_turns = [places.get(turn * size + k, NOWHERE) for turn in range(loop.count)]
        distances = set(np.diff(of_turns).tolist())
        if all(place == NOWHERE for place in of_turns):
            regular[k] = None
        elif min(of_turns) < 0 or len(distances) != 1:
            kept = k + 1
        else:
            regular[k] = of_turns[0], distances.pop()
    return kept, regular


def _placement(loop: Any, places: Mapping[int, int],
               known: dict[tuple[Any, ...], PlacedProgram],
               symbol: str) -> PlacedResults | None:
    """Return the placement of a loop's results; programs are shared by `known`."""
    step = loop.program
    size = len(step.outputs)
    kept, regular = _regular_places(loop, places)

    # One pointer for each distance.
    begins: dict[int, int] = {}
    stored = [regular[k] for k in range(kept, size)]
    for entry in stored:
        if entry is not None:
            place, distance = entry
            begins[distance] = min(place, begins.get(distance, place))
    if not begins:
        return None
    # Each result is a pointer, by number, and an offset from it.
    numbers = {distance: number for number, distance in enumerate(begins)}
    relative: list[tuple[int, int] | None] = []
    for entry in stored:
        if entry is None:
            relative.append(None)
        else:
            place, distance = entry
            relative.append((numbers[distance], place - begins[distance]))
    # Loops of one program with the same layout share its code.
    key = step, kept, tuple(relative)
    if key not in known:
        name = f'{step.name}_in_{symbol}_{len(known)}'
        known[key] = PlacedProgram(name, step.inputs, step.outputs, step.shape, kept,
                                   tuple(relative), nodes=step.nodes)
    outputs = set()
    for turn in range(loop.count):
        for k in range(kept, size):
            if regular[k] is not None:
                outputs.add(places[turn * size + k])
    return PlacedResults(known[key], list(begins.values()), list(begins),
                         frozenset(outputs))


def _loop_runs(outputs: Sequence[Any], stored: Container[int]
               ) -> Iterator[tuple[int, int]]:
    """
    Yield (place, length) of each run of outputs that are consecutive results of a loop.

    Runs have at most as many as a row of lanes, and none of the results that are stored
    already.
    """
    # Results of a loop lie one after the other in memory, so that a run is one copy.
    k = 0
    while k < len(outputs):
        x = outputs[k]
        count = 1
        is_loops = isinstance(x, Expr) and x.op == 'output' and x.args[0].op == 'loop'
        if is_loops and k not in stored:
            source, first = x.args
            while (k + count < len(outputs) and count < LANES and k + count not in stored
                   and _is_result(outputs[k + count], source, first + count)):
                count += 1
            if count > 1:
                yield k, count
        k += count


def _is_result(x: Any, source: Expr, place: int) -> bool:
    """Return whether a scalar is this result of a call or loop."""
    return (isinstance(x, Expr) and x.op == 'output' and x.args[0] is source
            and bool(x.args[1] == place))


def _is_row_of_loop(entries: Sequence[Any]) -> bool:
    """Return whether scalars are consecutive results of a loop."""
    first = entries[0]
    if not (isinstance(first, Expr) and first.op == 'output'):
        return False
    source, place = first.args
    if source.op != 'loop':
        return False
    return all(_is_result(x, source, place + k) for k, x in enumerate(entries))


def _row_of_lanes(entries: Sequence[Any]) -> Expr | None:
    """Return the row whose lanes the scalars are, all of them in order, or None."""
    first = entries[0]
    if len(entries) != LANES or not (isinstance(first, Expr) and first.op == 'lane'):
        return None
    row: Expr = first.args[0]
    if all(_is_lane(x, row, lane) for lane, x in enumerate(entries)):
        return row
    return None


def _entries_key(entries: Sequence[Expr | float]) -> tuple[object, ...]:
    """Return a key that is equal for equal lists of scalars of one function."""
    key: list[object] = []
    for x in entries:
        # A node by its number; a constant in a tuple, apart from all numbers of nodes.
        key.append(x.index if isinstance(x, Expr) else (x,))
    return tuple(key)


def _is_lane(x: Any, row: Expr, lane: int) -> bool:
    """Return whether a scalar is this lane of a row."""
    if not (isinstance(x, Expr) and x.op == 'lane'):
        return False
    source, place = x.args
    return source is row and bool(place == lane)


def _levels(schedule: list[Expr]) -> Iterator[list[Expr]]:
    """Group a schedule by the depth of nested functions; a depth uses vectors."""
    # The depth of a node is the largest number of elementary functions on a path to it.
    depths: dict[int, int] = {}
    groups: dict[int, tuple[list[Expr], list[Expr]]] = {}
    for node in schedule:
        depth = 0
        for operand in operands(node):
            is_function = operand.op in ELEMENTARY
            depth = max(depth, depths[operand.index] + is_function)
        depths[node.index] = depth
        plain, functions = groups.setdefault(depth, ([], []))
        group = functions if node.op in ELEMENTARY else plain
        group.append(node)
    # The functions of a depth do not depend on each other. Their arguments are complete
    # after the plain operations of that depth.
    for depth in sorted(groups):
        plain, functions = groups[depth]
        yield plain
        yield functions


class Function:
    """LLVM IR function of one program."""

    in_place: tuple[str, ...] = ('input', 'output')  # values in memory
    permutes = False  # as of `Vector`
    pointers = 'ptr %args'  # parameters of the function

    def __init__(self, program: Program, symbol: str, lanes: int = 1,
                 abreast: int = FUNCTION_LANES) -> None:
        """Generate the function; `lines` holds the IR."""
        self.program = program
        self.symbol = symbol
        self.lanes = lanes
        self.abreast = abreast
        self.type = vector_type(lanes)
        self.width = abreast * lanes  # of elementary functions
        self.lines: list[str] = []
        self.names = Names(self.lines)
        self.callees: list[Program | SideBySide] = []
        # Memory of the function, reserved once before its loops; and constants.
        self.reserved: list[str] = []
        self.tables: list[str] = []
        self._chunks: set[str] = set()  # pointers into results of loops
        # Pointers to stored arguments, by their entries.
        self._stored: dict[tuple[object, ...], str] = {}
        # Where each result is stored: one after the other, or as its place says.
        self._destinations: list[Destination | None]
        self._destinations = [('%in.result', k) for k in range(len(program.outputs))]
        if isinstance(program, PlacedProgram):
            self._destinations = program.destinations()
        schedule = program.schedule()
        # Rows store their results as soon as they are computed, unless a call or loop may
        # read arguments after that: results may overlap arguments in memory.
        later = any(map(_reads_arguments, schedule))
        at_once = [None] * len(self._destinations) if later else self._destinations
        self._wide = Rows(self.lines, self.names, program.outputs, at_once)
        # Results of loops that are stored among the function's own, or copied there.
        self._placements: dict[int, PlacedResults] = {}
        self._from_loops: set[int] = set()
        self._copied: dict[int, int] = {}
        self._cleared = False
        has_loops = any(node.op == 'loop' for node in schedule)
        if has_loops and lanes == 1 and not isinstance(program, PlacedProgram):
            self._placements = placements(program, symbol)
            for placement in self._placements.values():
                self._from_loops |= placement.outputs
            self._copied = dict(_loop_runs(program.outputs, self._from_loops))
        for place, count in self._copied.items():
            self._from_loops.update(range(place, place + count))
        # Values that other nodes than loops read; loops read results of loops in place.
        self._read: set[int] = set()
        for k, x in enumerate(program.outputs):
            if isinstance(x, Expr) and k not in self._from_loops:
                self._read.add(x.index)
        for node in schedule:
            if node.op != 'loop':
                self._read.update(x.index for x in operands(node))
        self._load_inputs(schedule)
        if self._wide.stored:  # before their stores
            self._clear_results()
        for group in _levels(schedule):
            if group and group[0].op in ELEMENTARY:
                self._functions(group)
            else:
                for node in group:
                    self._operation(node)
        self._store_outputs()
        # Spilled rows need an aligned stack.
        aligned = f' alignstack({8 * LANES})' if self._wide.stored else ''
        head = f'define void @{symbol}({self.pointers}){aligned} {{'
        self.lines[:0] = [head, *self.reserved]

    def callee(self, program: Program | SideBySide) -> 'Function':
        """Return the function of a subroutine."""
        if isinstance(program, SideBySide):
            return Function(program.program, program.name, program.states,
                            self.abreast)
        return Function(program, program.name, self.lanes, self.abreast)

    def value(self, x: Expr | float) -> str:
        """Return the IR name or literal of an operand."""
        if isinstance(x, Expr):
            return self.names[x.index]
        return constant_vector('double', literal(x), self.lanes)

    def _load_inputs(self, schedule: list[Expr]) -> None:
        """Load all inputs first: results may overlap arguments in memory."""
        pointers = [name for name, _ in self.program.inputs] + ['result']
        if isinstance(self.program, PlacedProgram):
            pointers += [f'result{k}' for k in range(self.program.pointers)]
        # The table of arguments holds a pointer for each input, then for each result.
        for k, name in enumerate(pointers):
            self.lines += [f'  %slot.{name} = getelementptr ptr, ptr %args, i64 {k}',
                           f'  %in.{name} = load ptr, ptr %slot.{name}']
        # The first input may be one state's of rows of several; see `Program.stride`.
        spread = self.program.inputs[0][0] if self.program.inputs else ''
        stride = self.program.stride
        # Each input that the program uses is loaded once.
        for node in schedule:
            if node.op == 'input':
                name, k = node.args
                at = f'%at.{name}.{k}'
                row = f'ptr %in.{name}'
                place = k * stride if name == spread else k
                self.lines += [f'  {at} = getelementptr {self.type}, {row}, i64 {place}',
                               f'  %{name}.{k} = load {self.type}, ptr {at}']
                self.names[node.index] = f'%{name}.{k}'

    def _clear_results(self) -> None:
        """Set all results of a sparse matrix to zero at once, instead of one by one."""
        outputs = self.program.outputs
        self._cleared = True
        self._zeros = set()
        if isinstance(self.program, PlacedProgram):
            return
        # Results that are zero in every state.
        for k, x in enumerate(outputs):
            if not isinstance(x, Expr) and x == 0.0:
                self._zeros.add(k)
        # A few zeros are stored one by one, which is faster than a call.
        if len(self._zeros) < MEMSET_ZEROS:
            self._zeros = set()
            return
        size = 8 * self.lanes * len(outputs)
        if self._wide.stored and size >= LOOP_OF_ZEROS:
            self._clear_by_rows(size)
            return
        self.lines.append('  call void @llvm.memset.p0.i64(ptr %in.result, i8 0, i64 '
                          f'{size}, i1 false)')

    def _clear_by_rows(self, size: int) -> None:
        """
        Set `size` bytes of results to zero by a loop of rows.

        For large matrices, memset took 1.2 to 1.5 times as long.
        """
        row = 8 * LANES
        turn = 4 * row
        zero = f'store {ROW_TYPE} zeroinitializer, ptr'
        # The first row, and the last ones, wherever they begin; between them whole rows
        # of the cache.
        self.lines += [f'  {zero} %in.result, align 8',
                       '  %clear.number = ptrtoint ptr %in.result to i64',
                       f'  %clear.over = add i64 %clear.number, {row}',
                       f'  %clear.first = and i64 %clear.over, {-row}',
                       '  %clear.begin = inttoptr i64 %clear.first to ptr',
                       f'  %clear.end = add i64 %clear.number, {size}',
                       f'  %clear.last = sub i64 %clear.end, {turn}',
                       '  br label %clear.before', 'clear.before:',
                       '  br label %clear', 'clear:',
                       ('  %clear.at = phi ptr [%clear.begin, %clear.before], '
                        '[%clear.next, %clear]')]
        # Four rows a turn; the last turn may overlap the one before.
        for k in range(4):
            at = f'%clear.at{k}'
            self.lines += [f'  {at} = getelementptr i8, ptr %clear.at, i64 {k * row}',
                           f'  {zero} {at}, align {row}']
        self.lines += [f'  %clear.next = getelementptr i8, ptr %clear.at, i64 {turn}',
                       '  %clear.next.number = ptrtoint ptr %clear.next to i64',
                       '  %clear.more = icmp ule i64 %clear.next.number, %clear.last',
                       '  br i1 %clear.more, label %clear, label %cleared', 'cleared:']
        for k in range(4):
            at = f'%clear.tail{k}'
            place = size - turn + k * row
            self.lines += [f'  {at} = getelementptr i8, ptr %in.result, i64 {place}',
                           f'  {zero} {at}, align 8']

    def _store_outputs(self) -> None:
        if not self._cleared:
            self._clear_results()
        # What was stored already: zeros, runs of rows, results that loops wrote in
        # place.
        written = set(self._zeros) | self._wide.stored | self._from_loops
        for place, count in self._copied.items():
            self._copy(place, count)
        for k, x in enumerate(self.program.outputs):
            destination = self._destinations[k]
            if k in written or destination is None:
                continue
            pointer, offset = destination
            row = f'ptr {pointer}'
            self.lines += [f'  %to.{k} = getelementptr {self.type}, {row}, i64 {offset}',
                           f'  store {self.type} {self.value(x)}, ptr %to.{k}']
        self.lines += ['  ret void', '}']

    def _memory(self, source: Expr, k: int) -> tuple[str, int]:
        """Return a pointer for a result of a loop, and its place from there in numbers."""
        place = self.lanes * self._place(source, k)
        chunk = place // CHUNK
        pointer = f'%chunk{source.index}.{chunk}'
        if pointer not in self._chunks:
            # Loads near this pointer have displacements of one byte, others of four. The
            # compiler would compute it from the stack pointer again if it knew it.
            self._chunks.add(pointer)
            middle = chunk * CHUNK + CHUNK // 2
            self.reserved.append(f'  {pointer}.slot = alloca ptr')
            memory = f'ptr %ret{source.index}'
            number = 'double'
            self.lines += [f'  {pointer}.at = getelementptr {number}, {memory}, i64 {middle}',
                           f'  store volatile ptr {pointer}.at, ptr {pointer}.slot',
                           f'  {pointer} = load volatile ptr, ptr {pointer}.slot']
        return pointer, place - chunk * CHUNK - CHUNK // 2

    def _place(self, source: Expr, k: int) -> int:
        """Return where a result of a call or loop is in its memory."""
        placement = self._placements.get(source.index)
        if placement is None:
            return k
        turn, place = divmod(k, len(placement.program.outputs))
        assert place < placement.program.kept  # others are not in this memory
        return turn * placement.program.kept + place

    def _copy(self, place: int, count: int) -> None:
        """Copy results of a loop to this place of the function's own."""
        # The results of the loop stay in its memory; only those outside it are copied.
        output = self.program.outputs[place]
        assert isinstance(output, Expr)
        source, k = output.args
        k = self._place(source, k)
        kind = vector_type(count)
        memory = f'ptr %ret{source.index}'
        self.lines += [
            f'  %from.{place} = getelementptr {self.type}, {memory}, i64 {k}',
            f'  %copied.{place} = load {kind}, ptr %from.{place}, align 8',
            f'  %to.{place} = getelementptr {self.type}, ptr %in.result, i64 {place}',
            f'  store {kind} %copied.{place}, ptr %to.{place}, align 8']

    def _operation(self, node: Expr) -> None:
        name = f'%v{node.index}'
        if node.op == 'input':
            return
        # Control first: calls and loops leave their results in memory, from which
        # `output` loads.
        if node.op in ('call', 'side_by_side'):
            self._call(node)
        elif node.op == 'loop':
            self._loop(node)
        elif node.op == 'pack' and _is_row_of_loop(node.args):
            source, k = node.args[0].args
            self.names.in_memory[node.index] = ROW_TYPE, *self._memory(source, k)
            return
        elif node.op in PLACING or node.op in ROWS:
            name = self._wide.value(node)
        elif node.op == 'output':
            source, k = node.args
            if source.op == 'loop' and node.index not in self._read:
                return  # a row of another loop, in place
            if source.op == 'loop':
                self.names.in_memory[node.index] = self.type, *self._memory(source, k)
                return
            at = f'%got{node.index}'
            k = self._place(source, k)
            row = f'ptr %ret{source.index}'
            self.lines += [f'  {at} = getelementptr {self.type}, {row}, i64 {k}',
                           f'  {name} = load {self.type}, ptr {at}']
        # Arithmetic, operation by operation.
        elif node.op == 'neg':
            self.lines.append(f'  {name} = fneg {self.type} {self.value(node.args[0])}')
        elif node.op in ('sqrt', 'floor'):
            kind = intrinsic_end(self.lanes)
            self.lines.append(f'  {name} = call {self.type} '
                              f'@llvm.{node.op}.{kind}({self.type} '
                              f'{self.value(node.args[0])})')
        elif node.op == 'less':
            a, b = map(self.value, node.args)
            self._choice(name, f'fcmp olt {self.type} {a}, {b}', self.value(1.0),
                         self.value(0.0))
        elif node.op == 'select':
            chosen, a, b = map(self.value, node.args)
            # Of a comparison, take its truth: not the number made of it, compared again.
            self._choice(name, f'{chosen}.if' if node.args[0].op == 'less' else
                         f'fcmp une {self.type} {chosen}, {self.value(0.0)}', a, b)
        else:
            a, b = map(self.value, node.args)
            self.lines.append(f'  {name} = {ARITHMETIC[node.op]} contract {self.type} '
                              f'{a}, {b}')
        self.names[node.index] = name

    def _choice(self, name: str, comparison: str, a: str, b: str) -> None:
        """Emit a selection: a if a comparison (instruction or name) holds, else b."""
        truth = 'i1' if self.lanes == 1 else f'<{self.lanes} x i1>'
        if not comparison.startswith('%'):
            self.lines.append(f'  {name}.if = {comparison}')
            comparison = f'{name}.if'
        self.lines.append(
            f'  {name} = select {truth} {comparison}, {self.type} {a}, {self.type} {b}')

    def _call(self, node: Expr) -> None:
        """Store the arguments, call the subroutine; its results stay in memory."""
        callee, *flat = node.args
        if callee not in self.callees:
            self.callees.append(callee)
        i = node.index
        states = 1
        kind = self.type
        size = max(len(callee.outputs), 1)
        if node.op == 'side_by_side':  # the results are rows
            states = callee.states
            kind = vector_type(states)
            size = size // states
        # A subroutine takes a table of pointers.
        self.lines += [f'  %ptrs{i} = alloca [{len(callee.inputs) + 1} x ptr]',
                       f'  %ret{i} = alloca [{size} x {kind}]']
        offset = 0
        # Pointers to the arguments, then to the results.
        for k, (name, shape) in enumerate([*callee.inputs, ('result', ())]):
            entries = flat[offset:offset + math.prod(shape)]
            offset += len(entries)
            if name == 'result':
                where = f'%ret{i}'
            elif states > 1:
                where = self._rows_of_states(i, k, entries, states)
            elif k == 0 and callee.stride > 1:
                where = self._of_one_state(i, entries, callee.stride)
            else:
                where = self._argument(i, k, entries)
            self.lines += [f'  %slot{i}.{k} = getelementptr ptr, ptr %ptrs{i}, i64 {k}',
                           f'  store ptr {where}, ptr %slot{i}.{k}']
        self.lines.append(f'  call void @{callee.name}(ptr %ptrs{i})')

    def _of_one_state(self, i: int, entries: list[Expr | float], stride: int) -> str:
        """Return a pointer to one state's results of a subroutine of several states."""
        where = self._contiguous(i, 0, entries, stride)
        if where is None:
            raise ValueError(f'call {i}: the first argument of {self.symbol}; expected the '
                             'results of one state of `call_side_by_side`')
        return where

    def _rows_of_states(self, i: int, k: int, entries: list[Expr | float],
                        states: int) -> str:
        """Store the entries of an argument of several states as rows; return a pointer."""
        key = (states, *_entries_key(entries))
        where = self._stored.get(key)
        if where is not None:  # an earlier call has the same argument
            return where
        where = f'%arg{i}.{k}'
        self._stored[key] = where
        row = vector_type(states)
        align = states * 8
        count = len(entries) // states
        self.lines.append(f'  {where} = alloca [{count} x {row}], align {align}')
        # A row is stored at once, because a load of a row would wait for several stores.
        for j in range(count):
            vector = 'poison'
            for lane in range(states):
                name = f'%put{i}.{k}.{j}.{lane}'
                x = self.value(entries[j * states + lane])
                self.lines.append(f'  {name} = insertelement {row} {vector}, '
                                  f'{self.type} {x}, i32 {lane}')
                vector = name
            put = f'%put{i}.{k}.{j}'
            self.lines += [f'  {put} = getelementptr {row}, ptr {where}, i64 {j}',
                           f'  store {row} {vector}, ptr {put}, align {align}']
        return where

    def _loop(self, node: Expr) -> None:
        """Call a subroutine for each row of tables; its results stay in memory."""
        loop, *flat = node.args
        callee = loop.program
        size = len(callee.outputs)
        placement = self._placements.get(node.index)
        if placement is not None:
            callee = placement.program
            size = callee.kept
            if not self._cleared:
                self._clear_results()
        if callee not in self.callees:
            self.callees.append(callee)
        i = node.index
        inputs = callee.inputs
        results = f'%ret{i}'

        # Where each input begins and how far apart its rows are; then the result.
        # Input 0 is the carry, which every turn gets from the turn before.
        n_carry = math.prod(inputs[0][1])
        begins = [self._table(i, 0, [flat[:n_carry]])[0]]
        strides = [0]
        offset = n_carry
        for k, (_, shape) in enumerate(inputs[1:], 1):
            width = math.prod(shape)
            rows: list[list[Expr | float]] = []
            for _ in range(loop.count):
                rows.append(flat[offset:offset + width])
                offset += width
            begin, stride = self._table(i, k, rows)
            begins.append(begin)
            strides.append(stride)
        of_results = len(begins)
        begins.append(results)
        strides.append(size)
        # Results that go straight to those of the function, each with a stride of its
        # own.
        if placement is not None:
            for place, stride in zip(placement.begins, placement.strides):
                into = f'%into{i}.{len(begins)}'
                self.lines.append(f'  {into} = getelementptr {self.type}, ptr '
                                  f'%in.result, i64 {place}')
                begins.append(into)
                strides.append(stride)
        self.reserved.append(f'  %ptrs{i} = alloca [{len(begins)} x ptr]')
        self.reserved.append(f'  {results} = alloca [{loop.count * size} x {self.type}], '
                             f'align {8 * LANES}')
        # A reverse loop begins at the last row and steps back.
        if loop.reverse:
            for k in range(1, len(begins)):
                last = f'%last{i}.{k}'
                self.lines.append(f'  {last} = getelementptr {self.type}, ptr '
                                  f'{begins[k]}, i64 {(loop.count - 1) * strides[k]}')
                begins[k] = last
                strides[k] = -strides[k]

        # The carry is in the result of the step before.
        loop_label = f'loop{i}'
        self.lines += [f'  br label %before{i}', f'before{i}:',
                       f'  br label %{loop_label}', f'{loop_label}:',
                       f'  %k{i} = phi i64 [0, %before{i}], [%next{i}, %{loop_label}]']
        # One pointer for each table, which moves by its stride from turn to turn.
        turns = []
        for k, begin in enumerate(begins):
            turn = f'%turn{i}.{k}'
            following = f'%turn{i}.{of_results}' if k == 0 else f'%following{i}.{k}'
            self.lines.append(f'  {turn} = phi ptr [{begin}, %before{i}], '
                              f'[{following}, %{loop_label}]')
            turns.append(turn)
        for k, turn in enumerate(turns):
            self.lines += [f'  %slot{i}.{k} = getelementptr ptr, ptr %ptrs{i}, i64 {k}',
                           f'  store ptr {turn}, ptr %slot{i}.{k}']
            if k > 0:
                self.lines.append(f'  %following{i}.{k} = getelementptr {self.type}, '
                                  f'ptr {turn}, i64 {strides[k]}')
        self.lines += [f'  call void @{callee.name}(ptr %ptrs{i})',
                       f'  %next{i} = add i64 %k{i}, 1',
                       f'  %more{i} = icmp ult i64 %next{i}, {loop.count}',
                       f'  br i1 %more{i}, label %{loop_label}, label %after{i}',
                       f'after{i}:']

    def _table(self, i: int, k: int,
               rows: Sequence[Sequence[Expr | float]]) -> tuple[str, int]:
        """Return a pointer to the first row of a table and the distance of its rows."""
        width = len(rows[0])
        if width == 0:
            return 'null', 0
        stride = self._stride(rows)
        # Rows at equal distances in an argument or result need no copy.
        if stride is not None:
            where = self._contiguous(i, k, list(rows[0]))
            if where is not None:
                return where, stride
        entries: list[Expr | float] = []
        for row in rows:
            entries += row
        # Constants become a table of the module, others are stored in memory of the
        # function.
        if not any(isinstance(x, Expr) for x in entries):
            name = f'@table.{self.symbol}.{i}.{k}'
            values = ', '.join(f'{self.type} {self.value(x)}' for x in entries)
            self.tables.append(f'{name} = private unnamed_addr constant '
                               f'[{len(entries)} x {self.type}] [{values}], align '
                               f'{8 * LANES}')
            return name, width
        key = _entries_key(entries)
        if key in self._stored:  # an earlier loop reads the same table
            return self._stored[key], width
        where = f'%table{i}.{k}'
        self._stored[key] = where
        self.reserved.append(f'  {where} = alloca [{len(entries)} x {self.type}], align '
                             f'{8 * LANES}')
        j = 0
        while j < len(entries):
            x = entries[j]
            put = f'%put{i}.{k}.{j}'
            self.lines.append(f'  {put} = getelementptr {self.type}, ptr {where}, i64 {j}')
            # A whole row is stored at once.
            lanes_of = _row_of_lanes(entries[j:j + LANES])
            if lanes_of is not None:
                self.lines.append(f'  store {ROW_TYPE} {self.names[lanes_of.index]}, '
                                  f'ptr {put}, align 8')
                j += LANES
                continue
            if isinstance(x, Expr) and x.index not in self.names:
                self._read.add(x.index)
                self._operation(x)
            self.lines.append(f'  store {self.type} {self.value(x)}, ptr {put}')
            j += 1
        return where, width

    def _stride(self, rows: Sequence[Sequence[Any]]) -> int | None:
        """Return the distance in memory of the rows of a table; None elsewhere."""
        # One array, and places at equal distances: then the loop reads the rows where
        # they are.
        pointers = set()
        places = []
        for row in rows:
            begin = self._begin(row)
            if begin is None:
                return None
            pointer, place = begin
            pointers.add(pointer)
            places.append(place)
        distances = set(np.diff(places).tolist()) if len(rows) > 1 else {len(rows[0])}
        if len(pointers) > 1 or len(distances) > 1:
            return None
        stride: int = distances.pop()
        return stride

    def _argument(self, i: int, k: int, entries: list[Expr | float]) -> str:
        """Return a pointer to the entries; store them unless they are contiguous."""
        where = self._contiguous(i, k, entries)
        if where is not None:
            return where
        # Equal arguments have equal keys: the index of a traced value, or the number.
        key = _entries_key(entries)
        where = self._stored.get(key)
        if where is not None:  # an earlier call has the same argument
            return where
        where = f'%arg{i}.{k}'
        self._stored[key] = where
        self.lines.append(f'  {where} = alloca [{len(entries)} x {self.type}]')
        for j, x in enumerate(entries):
            put = f'%put{i}.{k}.{j}'
            self.lines += [f'  {put} = getelementptr {self.type}, ptr {where}, i64 {j}',
                           f'  store {self.type} {self.value(x)}, ptr {put}']
        return where

    def _contiguous(self, i: int, k: int, entries: list[Expr | float],
                    stride: int = 1) -> str | None:
        """Return a pointer into an argument or result with the entries, or None."""
        # Entries that lie one after the other in memory are passed where they are.
        begin = self._begin(entries, stride) if entries else None
        if begin is None:
            return None
        pointer, place = begin
        if place == 0:
            return pointer
        self.lines.append(f'  %row{i}.{k} = getelementptr {self.type}, ptr {pointer}, i64 '
                          f'{place}')
        return f'%row{i}.{k}'

    def _begin(self, entries: Sequence[Any], stride: int = 1) -> tuple[str, int] | None:
        """Return pointer and place of entries that are `stride` apart in memory, or None."""
        begin = self._address(entries[0])
        if begin is None:
            return None
        pointer, place = begin
        for j, x in enumerate(entries):
            if self._address(x) != (pointer, place + j * stride):
                return None
        return begin

    def _address(self, x: Any) -> tuple[str, int] | None:
        """Return pointer and place of a scalar of an argument or result, or None."""
        if not (isinstance(x, Expr) and x.op in self.in_place):
            return None
        source, k = x.args
        if x.op == 'input':
            return f'%in.{source}', k
        return f'%ret{source.index}', self._place(source, k)

    def _functions(self, group: list[Expr]) -> None:
        """Evaluate the elementary functions of a group."""
        for label, ops in TOGETHER:
            # Sine and cosine of one argument are evaluated together.
            chosen = []
            by_index = {}
            for node in group:
                if node.op in ops and node.index not in self.names:
                    chosen.append(node)
                    by_index[node.args[0].index] = node.args[0]
            arguments = list(by_index.values())
            for start in range(0, len(arguments), self.abreast):
                chunk = arguments[start:start + self.abreast]
                # States side by side keep the processor busy, a single state does not.
                vector = Vector(self.lines, f'{label}{chunk[0].index}', self.width,
                                few_operations=self.lanes > 1,
                                permutes=self.permutes)
                packed = self._packed(vector, chunk)
                if label == 'sc':
                    results = dict(zip(ops, vector.sin_cos(packed)))
                else:
                    results = {ops[0]: getattr(vector, ops[0])(packed)}
                for node in chosen:
                    if node.args[0] in chunk:
                        place = chunk.index(node.args[0])
                        name = self._unpacked(vector, results[node.op], place)
                        self.names[node.index] = name

    def _packed(self, vector: Vector, chunk: list[Expr]) -> str:
        """Pack scalars into one vector; a vector value is returned unchanged."""
        if self.abreast == 1:
            return self.value(chunk[0])
        packed = 'zeroinitializer'
        for place, arg in enumerate(chunk):
            for lane in range(self.lanes):
                x = self.value(arg)
                if self.lanes > 1:
                    x = vector.new(f'extractelement {self.type} {x}, i32 {lane}')
                packed = vector.new(f'insertelement {vector.type} {packed}, '
                                    f'double {x}, i32 '
                                    f'{place * self.lanes + lane}')
        return packed

    def _unpacked(self, vector: Vector, packed: str, place: int) -> str:
        """Return the scalar in a lane of a packed vector."""
        if self.abreast == 1:
            return packed
        if self.lanes == 1:
            return vector.new(f'extractelement {vector.type} {packed}, i32 {place}')
        first = place * self.lanes
        lanes = ', '.join(f'i32 {first + lane}' for lane in range(self.lanes))
        return vector.new(f'shufflevector {vector.type} {packed}, {vector.type} poison, '
                          f'<{self.lanes} x i32> <{lanes}>')


def module_text(program: Program, symbol: str) -> str:
    """Return the LLVM IR of a program as function `symbol`, with its subroutines."""
    return with_callees(Function(program, symbol), [])


def with_callees(main: Function, declarations: Sequence[str]) -> str:
    """Return the LLVM IR of a function, its subroutines and their declarations."""
    # A subroutine may call others; each is emitted once.
    named: dict[str, Program | SideBySide] = {}
    functions: list[list[str]] = []
    tables = list(main.tables)
    pending = list(main.callees)
    widths = {main.width}
    # A subroutine that several functions call is emitted once.
    while pending:
        current = pending.pop()
        if is_first(current, named):
            function = main.callee(current)
            functions.append(function.lines)
            tables += function.tables
            pending += function.callees
            widths.add(function.width)
    # Declarations of the intrinsics of elementary functions, as vectors and scalars.
    lines = list(declarations)
    for width in sorted(widths):
        v = vector_type(width)
        end = intrinsic_end(width)
        lines += [f'declare {v} @llvm.fma.{end}({v}, {v}, {v})',
                  f'declare {v} @llvm.fabs.{end}({v})',
                  f'declare {v} @llvm.copysign.{end}({v}, {v})',
                  f'declare {v} @llvm.sqrt.{end}({v})',
                  f'declare {v} @llvm.floor.{end}({v})']
    if 1 not in widths:
        x = 'double'
        scalar = intrinsic_end(1)
        lines += [f'declare {x} @llvm.sqrt.{scalar}({x})',
                  f'declare {x} @llvm.floor.{scalar}({x})']
    lines += ['declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)', *main.lines]
    for function_lines in functions:
        lines += function_lines
    lines += tables
    return '\n'.join(lines)
