"""LLVM IR of traced lanes: rows of doubles in SIMD registers of a program of one state."""

from collections.abc import Iterator, Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.native.backends.llvm_math import transpose, Vector
from kane_dynamics.native.backends.real_types import literal, vector_type
from kane_dynamics.native.tracing.expression import Expr

TYPE = vector_type(LANES)
ARITHMETIC = {'wide_add': 'fadd', 'wide_sub': 'fsub', 'wide_mul': 'fmul'}


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
        The function's results.

    Attributes
    ----------
    stored : set of int
        Results that are stored with their row: in memory instead of registers for the rest of
        the function.

    """

    def __init__(self, lines: list[str], names: dict[int, str], outputs: Sequence[Any]) -> None:
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
        """Append the instructions of a node and of its stores; return the IR name of its value."""
        name = self._value(node)
        self._store(node, name)
        return name

    def _value(self, node: Expr) -> str:
        v = Vector(self.lines, f'w{node.index}', LANES)
        args = node.args
        if node.op == 'pack':
            return self._packed(v, args)
        if node.op == 'column':
            tile, k = args
            return self._tiles[tile.index][int(k)]
        rows = [self.names[x.index] for x in args if isinstance(x, Expr)]
        if node.op == 'transposed':
            self._tiles[node.index] = transpose(v, rows)
            return ''
        if node.op == 'lane':
            return v.new(f'extractelement {TYPE} {rows[0]}, i32 {args[1]}')
        if node.op == 'blend':
            mask = ', '.join(f'i1 {int(chosen)}' for chosen in args[2])
            return v.new(f'select <{LANES} x i1> <{mask}>, {TYPE} {rows[0]}, {TYPE} {rows[1]}')
        if node.op == 'gather':
            return v.shuffle(rows[0], 'zeroinitializer', list(args[1]))
        if node.op == 'wide_neg':
            return v.new(f'fneg {TYPE} {rows[0]}')
        return v.new(f'{ARITHMETIC[node.op]} contract {TYPE} {rows[0]}, {rows[1]}')

    def _packed(self, v: Vector, entries: Sequence[Expr | float]) -> str:
        """Return a row of scalars."""
        first = entries[0]
        if all(x is first for x in entries) and isinstance(first, Expr):
            # One scalar in every lane; a lane of another row is loaded from memory.
            is_lane = first.op == 'lane'
            one = self._loaded(v, *first.args) if is_lane else self.names[first.index]
            one = v.new(f'insertelement {TYPE} poison, double {one}, i32 0')
            return v.shuffle(one, 'poison', [0] * LANES)
        # The constants as a literal, into which the traced scalars are inserted.
        constants = ['0x0' if isinstance(x, Expr) else literal(x) for x in entries]
        row = '<' + ', '.join(f'double {constant}' for constant in constants) + '>'
        for k, x in enumerate(entries):
            if isinstance(x, Expr):
                row = v.new(f'insertelement {TYPE} {row}, double {self.names[x.index]}, i32 {k}')
        return row

    def _loaded(self, v: Vector, row: Expr, k: int) -> str:
        """Return a lane from memory: loads broadcast without shuffles."""
        place = f'%kept{row.index}'
        if row.index not in self._in_memory:
            self._in_memory.add(row.index)
            self.lines += [f'  {place} = alloca {TYPE}, align {8 * LANES}',
                           f'  store {TYPE} {self.names[row.index]}, ptr {place}']
        at = v.new(f'getelementptr double, ptr {place}, i64 {k}')
        return v.new(f'load double, ptr {at}')

    def _store(self, node: Expr, name: str) -> None:
        """Store the results that are consecutive values of a row, now that they are computed."""
        for place, first, count in self._runs.get(node.index, ()):
            v = Vector(self.lines, f'to{place}', LANES)
            part = name
            kind = vector_type(count)
            if count < LANES:
                lanes = ', '.join(f'i32 {first + k}' for k in range(count))
                part = v.new(f'shufflevector {TYPE} {name}, {TYPE} poison, '
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
        x = outputs[k]
        count = 1
        if isinstance(x, Expr) and x.op == 'lane':
            row, lane = x.args
            while k + count < len(outputs) and _is_lane(outputs[k + count], row, lane + count):
                count += 1
            if count > 1:
                yield k, row, lane, count
        k += count


def _is_lane(x: Any, row: Expr, lane: int) -> bool:
    return isinstance(x, Expr) and x.op == 'lane' and x.args[0] is row and x.args[1] == lane
