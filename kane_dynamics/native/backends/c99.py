"""From a program to C99: one straight-line function a program, no dependency but libm."""

from collections.abc import Mapping
import re

from kane_dynamics.errors import CompileError
from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.program import Program, size_of
import numpy as np

ARITHMETIC = {'add': '+', 'sub': '-', 'mul': '*', 'div': '/'}


def literal(value: float) -> str:
    """Return a double as C writes it: the shortest decimal that reads back bit for bit."""
    if not np.isfinite(value):
        raise CompileError(f'the program holds the constant {value}, which C has no literal for')
    return repr(float(value))


def identifier(text: str) -> str:
    """Return a text as a C identifier: whatever C does not allow becomes an underscore."""
    name = re.sub(r'[^A-Za-z0-9_]', '_', text)
    return name if name[:1].isalpha() else f'x{name}'


def comment(text: str) -> str:
    """Return a text that may stand in a C comment, whatever it says."""
    plain = text.encode('ascii', 'replace').decode()
    return re.sub(r'[^ -~]', ' ', plain).replace('*/', '* /').replace('/*', '/ *')


def string(text: str) -> str:
    """Return a text as a C string literal."""
    escaped = [chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f'\\{b:03o}'
               for b in text.encode()]
    return f'"{"".join(escaped)}"'


class _Function:
    """The C body of one program."""

    def __init__(self, program: Program, prefix: str) -> None:
        """Write it; `lines` is the result, `callees` what it calls."""
        self.prefix = prefix
        self.names: dict[int, str] = {}
        self.lines: list[str] = []
        self.callees: list[Program] = []
        schedule = program.schedule()
        read = set()
        for node in schedule:  # before anything is written: the result may overlay an argument
            if node.op == 'input':
                name, k = node.args
                read.add(name)
                self._define(node, f'{name}_{k}', f'{name}[{k}]')
        self.lines += [f'    (void){name};' for name, _ in program.inputs if name not in read]
        for node in schedule:
            if node.op != 'input':
                self._operation(node)
        self.lines += [f'    result[{k}] = {self._value(x)};'
                       for k, x in enumerate(program.outputs)]
        if not program.outputs:
            self.lines.append('    (void)result;')

    def _define(self, node: Expr, name: str, expression: str) -> None:
        self.lines.append(f'    const double {name} = {expression};')
        self.names[node.index] = name

    def _value(self, x: Expr | float) -> str:
        return self.names[x.index] if isinstance(x, Expr) else literal(x)

    def _operation(self, node: Expr) -> None:
        name = f'v{node.index}'
        if node.op == 'call':
            self._call(node)
        elif node.op == 'output':
            source, k = node.args
            self.names[node.index] = f'r{source.index}[{k}]'
        elif node.op == 'neg':
            self._define(node, name, f'-{self._value(node.args[0])}')
        elif node.op in ARITHMETIC:
            a, b = (self._value(arg) for arg in node.args)
            self._define(node, name, f'{a} {ARITHMETIC[node.op]} {b}')
        else:
            self._define(node, name, f'{node.op}({self._value(node.args[0])})')

    def _call(self, node: Expr) -> None:
        """Lay the arguments out in memory and call."""
        callee, *flat = node.args
        if callee not in self.callees:
            self.callees.append(callee)
        given, i = [], node.index
        for k, (_, shape) in enumerate(callee.inputs):
            entries, flat = flat[:size_of(shape)], flat[size_of(shape):]
            values = ', '.join(self._value(x) for x in entries)
            self.lines.append(f'    const double a{i}_{k}[{len(entries)}] = {{{values}}};')
            given.append(f'a{i}_{k}')
        self.lines += [f'    double r{i}[{max(callee.n_outputs, 1)}];',
                       f'    {self.prefix}_{callee.name}({", ".join([*given, f"r{i}"])});']


def prototype(program: Program, name: str) -> str:
    """Return the head of a program's function: its inputs, then the result it writes."""
    inputs = [f'const double *{argument}' for argument, _ in program.inputs]
    return f'void {name}({", ".join([*inputs, "double *result"])})'


def c_functions(program: Program, name: str, defaults: Mapping[str, str]) -> str:
    """
    Return a program as the C function `name`, and what it calls as static functions before it.

    Parameters
    ----------
    program : Program
        What to write.
    name : str
        A C identifier; also the prefix of the static functions' names.
    defaults : mapping
        C arrays that stand in for the inputs of these names when NULL is passed.

    Raises
    ------
    CompileError
        A constant of the program is not finite.

    """
    main = _Function(program, name)
    heads = [f'{prototype(program, name)}\n{{']
    heads += [f'    if ({argument} == NULL) {argument} = {array};'
              for argument, array in defaults.items()]
    texts = ['\n'.join([*heads, *main.lines, '}'])]
    pending, known = list(main.callees), set()
    while pending:
        callee = pending.pop(0)
        if callee.name not in known:
            known.add(callee.name)
            function = _Function(callee, name)
            head = f'static {prototype(callee, f"{name}_{callee.name}")}\n{{'
            texts.insert(0, '\n'.join([head, *function.lines, '}']))
            pending += function.callees
    return '\n\n'.join(texts)
