"""Generate C99: one straight-line function per program that needs only libm."""

from collections.abc import Mapping, Sequence
from itertools import islice
import math
import re

from kane_dynamics.errors import CompileError
from kane_dynamics.native.backends.c99_math import literal, Precision
from kane_dynamics.native.tracing.expression import Expr, operands
from kane_dynamics.native.tracing.program import Program
from kane_dynamics.native.tracing.subroutine import is_first
import numpy as np

FUNCTION_LANES = 4  # elementary functions that are evaluated together
ELEMENTARY = ('sin', 'cos', 'tanh')
ARITHMETIC = {'add': '+', 'sub': '-', 'mul': '*', 'div': '/'}
IN_C = {'arctan': 'atan'}  # functions that C calls otherwise than numpy


def c_literal(value: float, precision: Precision) -> str:
    """Return a number as a C literal: the shortest decimal that reads back exactly."""
    if np.isnan(value):
        return f'({precision.c})NAN'  # of math.h, a float
    if not np.isfinite(value):
        raise CompileError(f'constant: {value}; expected a finite number or NaN: C has '
                           'no other literal')
    return literal(value, precision)


def c_identifier(text: str) -> str:
    """Return a C identifier: replace characters that C does not allow by underscores."""
    name = re.sub(r'[^A-Za-z0-9_]', '_', text)
    return name if name[:1].isalpha() else f'x{name}'


def comment(text: str) -> str:
    """Return the text as printable ASCII that cannot end or open a C comment."""
    plain = text.encode('ascii', 'replace').decode()
    return re.sub(r'[^ -~]', ' ', plain).replace('*/', '* /').replace('/*', '/ *')


def string(text: str) -> str:
    """Return the text as a C string literal."""
    escaped = [chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f'\\{b:03o}'
               for b in text.encode()]
    return f'"{"".join(escaped)}"'


class _Function:
    """C function body of one program."""

    def __init__(self, program: Program, prefix: str, precision: Precision) -> None:
        """Generate the body: `lines` holds the code, `callees` the programs it calls."""
        self.prefix = prefix
        self.precision = precision
        self.names: dict[int, str] = {}
        self.lines: list[str] = []
        self.callees: list[Program] = []
        schedule = program.schedule()
        read = set()
        # Load inputs first: the result may overlap an argument in memory.
        for node in schedule:
            if node.op == 'input':
                name, k = node.args
                read.add(name)
                self._define(node, f'{name}_{k}', f'{name}[{k}]')
        # An input that is not read must still be named, for compilers that warn of it.
        for name, _ in program.inputs:
            if name not in read:
                self.lines.append(f'    (void){name};')
        for node in self._elementary_first(schedule):
            if node.index not in self.names:
                self._operation(node)
        # Results last, for the same reason.
        self.lines += [f'    result[{k}] = {self._value(x)};'
                       for k, x in enumerate(program.outputs)]
        if not program.outputs:
            self.lines.append('    (void)result;')

    def _elementary_first(self, schedule: list[Expr]) -> list[Expr]:
        """
        Emit the elementary functions with known arguments, each kind in one call.

        Their arguments are written before. Return the schedule of all the rest.
        """
        # Values that need no elementary function: arithmetic on the inputs.
        plain: set[int] = set()
        for node in schedule:
            is_arithmetic = node.op not in (*ELEMENTARY, 'call', 'output', 'sqrt',
                                            'input')
            of_plain = all(x.index in plain for x in operands(node))
            if node.op == 'input' or (is_arithmetic and of_plain):
                plain.add(node.index)
        early = []
        for node in schedule:
            if node.op in ELEMENTARY:
                x = node.args[0]
                if isinstance(x, Expr) and x.index in plain:
                    early.append(node)

        # Write what their arguments are computed from.
        needed: set[int] = set()
        pending = [node.args[0] for node in early]
        while pending:
            node = pending.pop()
            if node.index not in needed:
                needed.add(node.index)
                pending += operands(node)
        for node in schedule:
            if node.index in needed and node.op != 'input':
                self._operation(node)
        # Call each function for all of its arguments at once.
        for kinds, function, results in ((('sin', 'cos'), 'sin_cos', ('s', 'c')),
                                         (('tanh',), 'tanh_each', ('y',))):
            chosen = [node for node in early if node.op in kinds]
            angles = list(dict.fromkeys(node.args[0] for node in chosen))
            if angles:
                angles = _grouped(angles)
                self._elementary(function, angles, results)
                for node in chosen:
                    array = results[kinds.index(node.op)]
                    place = angles.index(node.args[0])
                    self.names[node.index] = f'{function}_{array}[{place}]'
        return schedule

    def _elementary(self, function: str, angles: list[Expr],
                    results: Sequence[str]) -> None:
        """Call an elementary function for all its arguments."""
        real = self.precision.c
        count = len(angles)
        values = ', '.join(self._value(x) for x in angles)
        # An array of arguments, and one for each result: {sin_cos_s, sin_cos_c}.
        arrays = [f'{function}_{name}' for name in results]
        declared = ', '.join(f'{name}[{count}]' for name in arrays)
        self.lines += [f'    const {real} {function}_x[{count}] = {{{values}}};',
                       f'    {real} {declared};',
                       f'    {function}({function}_x, {count}, {", ".join(arrays)});']

    def _define(self, node: Expr, name: str, expression: str) -> None:
        self.lines.append(f'    const {self.precision.c} {name} = {expression};')
        self.names[node.index] = name

    def _value(self, x: Expr | float) -> str:
        if isinstance(x, Expr):
            return self.names[x.index]
        return c_literal(x, self.precision)

    def _operation(self, node: Expr) -> None:
        name = f'v{node.index}'
        if node.op == 'call':
            self._call(node)
        elif node.op == 'output':
            source, k = node.args
            self.names[node.index] = f'r{source.index}[{k}]'
        elif node.op == 'neg':
            self._define(node, name, f'-{self._value(node.args[0])}')
        # Binary arithmetic is infix; a comparison is 1 or 0; all else is a function of
        # math.h.
        elif node.op in ARITHMETIC:
            a, b = (self._value(arg) for arg in node.args)
            self._define(node, name, f'{a} {ARITHMETIC[node.op]} {b}')
        elif node.op == 'less':
            a, b = (self._value(arg) for arg in node.args)
            one, zero = (c_literal(value, self.precision) for value in (1.0, 0.0))
            self._define(node, name, f'{a} < {b} ? {one} : {zero}')
        elif node.op == 'select':
            chosen, a, b = (self._value(arg) for arg in node.args)
            self._define(node, name, f'{chosen} != 0 ? {a} : {b}')
        else:
            function = f'{IN_C.get(node.op, node.op)}{self.precision.suffix}'
            self._define(node, name, f'{function}({self._value(node.args[0])})')

    def _call(self, node: Expr) -> None:
        """Store the arguments in arrays and call the subroutine."""
        # Subroutines are emitted once, before the functions that call them.
        callee, *flat = node.args
        if callee not in self.callees:
            self.callees.append(callee)
        # One array for each input of the subroutine, and one for its results.
        i = node.index
        real = self.precision.c
        arguments = []
        remaining = iter(flat)
        for k, (_, shape) in enumerate(callee.inputs):
            entries = list(islice(remaining, math.prod(shape)))
            values = ', '.join(self._value(x) for x in entries)
            self.lines.append(
                f'    const {real} a{i}_{k}[{len(entries)}] = {{{values}}};')
            arguments.append(f'a{i}_{k}')
        arguments.append(f'r{i}')
        self.lines += [f'    {real} r{i}[{max(len(callee.outputs), 1)}];',
                       f'    {self.prefix}_{callee.name}({", ".join(arguments)});']


def _grouped(angles: list[Expr]) -> list[Expr]:
    """
    Return angles with some repeated, so that they fill vector registers.

    The last register holds the last angles, which are adjacent in memory like the
    others: a register assembled from separate values would wait for them to be stored.
    """
    missing = -len(angles) % FUNCTION_LANES
    if len(angles) < FUNCTION_LANES:
        return [*angles, *angles[-1:] * missing]
    return [*angles[:len(angles) + missing - FUNCTION_LANES], *angles[-FUNCTION_LANES:]]


def prototype(program: Program, name: str, precision: Precision) -> str:
    """Return a function's prototype: pointers to the inputs, then to the result."""
    inputs = [f'const {precision.c} *{argument}' for argument, _ in program.inputs]
    return f'void {name}({", ".join([*inputs, f"{precision.c} *result"])})'


def c_functions(program: Program, name: str, defaults: Mapping[str, str],
                precision: Precision, versions: str) -> str:
    """
    Return a program as the C function `name`, after its subroutines, static functions.

    Parameters
    ----------
    program : Program
        The program to generate code for.
    name : str
        Name of the function, a C identifier; also the prefix of the static functions'
        names.
    defaults : mapping
        Input name to the C array that replaces the input when NULL is passed.
    precision : Precision
        Precision of the arithmetic.
    versions : str
        Text before the function for compilers that generate several versions of it.

    Raises
    ------
    CompileError
        If a constant of the program is not finite.

    """
    main = _Function(program, name, precision)
    names = [argument for argument, _ in program.inputs]
    arguments = ', '.join([*names, 'result'])
    heads = [f'{versions}\nstatic {prototype(program, f"{name}_body", precision)}\n{{']
    heads += [f'    if ({argument} == NULL) {argument} = {array};'
              for argument, array in defaults.items()]
    # The body, as several versions where compilers can, and the function that calls it.
    body = [*heads, *main.lines, '}']
    caller = [prototype(program, name, precision), '{', f'    {name}_body({arguments});',
              '}']
    texts = ['\n'.join([*body, '', *caller])]

    # Subroutines stand before the functions that call them.
    pending = list(main.callees)
    named: dict[str, Program] = {}
    while pending:
        callee = pending.pop(0)
        if is_first(callee, named):
            function = _Function(callee, name, precision)
            head = f'static {prototype(callee, f"{name}_{callee.name}", precision)}\n{{'
            texts.insert(0, '\n'.join([head, *function.lines, '}']))
            pending += function.callees
    return '\n\n'.join(texts)
