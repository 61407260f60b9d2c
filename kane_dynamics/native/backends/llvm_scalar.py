"""
Generate LLVM IR: one straight-line function per program.

With `lanes` > 1 every scalar of the program is a vector of `lanes` numbers, one state
per lane, in registers and in the memory of arguments and results. For one state,
`abreast` arguments of elementary functions are packed into a vector; processors without
SIMD registers have 1.

A program of one state may also compute with rows (`tracing.wide`): `LANES` doubles in
SIMD registers, which `Rows` generates. `Function` generates everything else.
"""

from collections.abc import Iterator, Sequence
import math
from typing import Any

from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.native.backends.llvm_math import (constant_vector, FUNCTION_LANES,
                                                     intrinsic_end, literal, transpose,
                                                     Vector, vector_type)
from kane_dynamics.native.tracing.expression import Expr, operands
from kane_dynamics.native.tracing.program import PLACING, Program, ROWS
from kane_dynamics.native.tracing.subroutine import is_first

# Structurally zero results from which memset is smaller than single stores.
MEMSET_ZEROS = 16
ARITHMETIC = {'add': 'fadd', 'sub': 'fsub', 'mul': 'fmul', 'div': 'fdiv'}
# Elementary functions that share their work, and a label.
TOGETHER = (('sc', ('sin', 'cos')), ('th', ('tanh',)), ('ex', ('exp',)),
            ('lg', ('log',)), ('at', ('arctan',)))
ELEMENTARY = frozenset(op for _, ops in TOGETHER for op in ops)
ROW_TYPE = vector_type(LANES)
ROW_ARITHMETIC = {'wide_add': 'fadd', 'wide_sub': 'fsub', 'wide_mul': 'fmul',
                  'wide_div': 'fdiv'}


class Rows:
    """
    Generates the nodes of `kane_dynamics.native.tracing.wide` for one function.

    Parameters
    ----------
    lines : list of str
        The function's instructions, to which those of each node are appended.
    names : dict
        IR names of values by the index of their node.
    outputs : sequence of Expr or float
        Results that may be stored as soon as they are computed.

    Attributes
    ----------
    stored : set of int
        Results that are stored with their row: in memory instead of registers for the
        rest of the function.

    """

    def __init__(self, lines: list[str], names: dict[int, str],
                 outputs: Sequence[Any]) -> None:
        """Generate into a function."""
        self.lines = lines
        self.names = names
        self._tiles: dict[int, list[str]] = {}
        self._runs: dict[int, list[tuple[int, int, int]]] = {}
        self.stored: set[int] = set()
        self._in_memory: set[int] = set()  # rows
        for place, row, first, count in _runs(outputs):
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
            at = v.new(f'getelementptr double, ptr %in.result, i64 {place}')
            self.lines.append(f'  store {kind} {part}, ptr {at}, align 8')


def _runs(outputs: Sequence[Any]) -> Iterator[tuple[int, Expr, int, int]]:
    """
    Yield (place, row, first lane, length) of each run of outputs.

    A run is a sequence of outputs, from `place` on, that are consecutive lanes of one row.
    """
    k = 0
    while k < len(outputs):
        # Count the outputs that are the next lanes of the same row.
        # A run begins at an output that is a lane of a row.
        x = outputs[k]
        count = 1
        if isinstance(x, Expr) and x.op == 'lane':
            row, lane = x.args
            while (k + count < len(outputs)
                   and _is_lane(outputs[k + count], row, lane + count)):
                count += 1
            if count > 1:
                yield k, row, lane, count
        k += count


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


def _reads_arguments(node: Expr) -> bool:
    """Return whether a node is a call that may read arguments in place."""
    return node.op == 'call' and any(x.op == 'input' for x in operands(node))


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
        # IR names of values by the index of their node.
        self.names: dict[int, str] = {}
        self.callees: list[Program] = []
        # Pointers to stored arguments, by their entries.
        self._stored: dict[tuple[object, ...], str] = {}
        schedule = program.schedule()
        # Rows store their results as soon as they are computed, unless a call may read
        # arguments after that: results may overlap arguments in memory.
        later = any(map(_reads_arguments, schedule))
        self._wide = Rows(self.lines, self.names, () if later else program.outputs)
        self._cleared = False
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
        self.lines.insert(0, f'define void @{symbol}({self.pointers}){aligned} {{')

    def callee(self, program: Program) -> 'Function':
        """Return the function of a subroutine."""
        return Function(program, program.name, self.lanes, self.abreast)

    def value(self, x: Expr | float) -> str:
        """Return the IR name or literal of an operand."""
        if isinstance(x, Expr):
            return self.names[x.index]
        return constant_vector('double', literal(x), self.lanes)

    def _load_inputs(self, schedule: list[Expr]) -> None:
        """Load all inputs first: results may overlap arguments in memory."""
        pointers = [name for name, _ in self.program.inputs] + ['result']
        # The table of arguments holds a pointer for each input, then for the result.
        for k, name in enumerate(pointers):
            self.lines += [f'  %slot.{name} = getelementptr ptr, ptr %args, i64 {k}',
                           f'  %in.{name} = load ptr, ptr %slot.{name}']
        # Each input that the program uses is loaded once.
        for node in schedule:
            if node.op == 'input':
                name, k = node.args
                at = f'%at.{name}.{k}'
                row = f'ptr %in.{name}'
                self.lines += [f'  {at} = getelementptr {self.type}, {row}, i64 {k}',
                               f'  %{name}.{k} = load {self.type}, ptr {at}']
                self.names[node.index] = f'%{name}.{k}'

    def _clear_results(self) -> None:
        """Set all results of a sparse matrix to zero at once, instead of one by one."""
        outputs = self.program.outputs
        self._cleared = True
        self._zeros = set()
        # Results that are zero in every state.
        for k, x in enumerate(outputs):
            if not isinstance(x, Expr) and x == 0.0:
                self._zeros.add(k)
        # A few zeros are stored one by one, which is faster than a call.
        if len(self._zeros) < MEMSET_ZEROS:
            self._zeros = set()
            return
        size = 8 * self.lanes * len(outputs)
        self.lines.append('  call void @llvm.memset.p0.i64(ptr %in.result, i8 0, i64 '
                          f'{size}, i1 false)')

    def _store_outputs(self) -> None:
        if not self._cleared:
            self._clear_results()
        written = set(self._zeros) | self._wide.stored
        for k, x in enumerate(self.program.outputs):
            if k in written:
                continue
            self.lines += [
                f'  %to.{k} = getelementptr {self.type}, ptr %in.result, i64 {k}',
                f'  store {self.type} {self.value(x)}, ptr %to.{k}']
        self.lines += ['  ret void', '}']

    def _operation(self, node: Expr) -> None:
        name = f'%v{node.index}'
        if node.op == 'input':
            return
        # Calls leave their results in memory, from which `output` loads.
        if node.op == 'call':
            self._call(node)
        elif node.op in PLACING or node.op in ROWS:
            name = self._wide.value(node)
        elif node.op == 'output':
            source, k = node.args
            at = f'%got{node.index}'
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
        size = max(len(callee.outputs), 1)
        # A subroutine takes a table of pointers.
        self.lines += [f'  %ptrs{i} = alloca [{len(callee.inputs) + 1} x ptr]',
                       f'  %ret{i} = alloca [{size} x {self.type}]']
        offset = 0
        # Pointers to the arguments, then to the results.
        for k, (name, shape) in enumerate([*callee.inputs, ('result', ())]):
            entries = flat[offset:offset + math.prod(shape)]
            offset += len(entries)
            if name == 'result':
                where = f'%ret{i}'
            else:
                where = self._argument(i, k, entries)
            self.lines += [f'  %slot{i}.{k} = getelementptr ptr, ptr %ptrs{i}, i64 {k}',
                           f'  store ptr {where}, ptr %slot{i}.{k}']
        self.lines.append(f'  call void @{callee.name}(ptr %ptrs{i})')

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

    def _contiguous(self, i: int, k: int, entries: list[Expr | float]) -> str | None:
        """Return a pointer into an argument or result with the entries, or None."""
        # Entries that lie one after the other in memory are passed where they are.
        begin = self._address(entries[0]) if entries else None
        if begin is None:
            return None
        pointer, place = begin
        for j, x in enumerate(entries):
            if self._address(x) != (pointer, place + j):
                return None
        if place == 0:
            return pointer
        self.lines.append(f'  %row{i}.{k} = getelementptr {self.type}, ptr {pointer}, i64 '
                          f'{place}')
        return f'%row{i}.{k}'

    def _address(self, x: Any) -> tuple[str, int] | None:
        """Return pointer and place of a scalar of an argument or result, or None."""
        if not (isinstance(x, Expr) and x.op in self.in_place):
            return None
        source, k = x.args
        if x.op == 'input':
            return f'%in.{source}', k
        return f'%ret{source.index}', k

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
    named: dict[str, Program] = {}
    functions: list[list[str]] = []
    pending = list(main.callees)
    widths = {main.width}
    # A subroutine that several functions call is emitted once.
    while pending:
        current = pending.pop()
        if is_first(current, named):
            function = main.callee(current)
            functions.append(function.lines)
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
    return '\n'.join(lines)
