"""Equations of a derivation as straight-line code, in Python and C99, and its size."""

from collections.abc import Mapping
import re
from textwrap import indent
from typing import Any

from kane_dynamics.closed_forms.derivation import Derivation
from kane_dynamics.closed_forms.polynomials import operations
from kane_dynamics.errors import InputError
from kane_dynamics.native.tracing.program import OperationCount
import sympy as sp
from sympy.printing.c import C99CodePrinter
from sympy.printing.pycode import PythonCodePrinter

LANGUAGES = ('python', 'c')
Assignments = list[tuple[Any, Any]]


class StraightLineCode:
    """
    Assignments, each symbol after those that it needs, and results by name.

    Attributes
    ----------
    assignments : list of (symbol, expression)
        Common subexpressions, letters and dependent speeds.
    results : dict of str to SymPy Matrix

    """

    def __init__(self, letters: Mapping[Any, Any], results: Mapping[str, Any]) -> None:
        """Share common subexpressions, and leave out letters that are not needed."""
        expressions = [*letters.values()]
        for matrix in results.values():
            expressions += list(matrix)
        shared, reduced = sp.cse(expressions, symbols=sp.numbered_symbols('x'), order='none')
        values = dict(shared)
        values.update(zip(letters, reduced))
        self.results = {}
        begin = len(letters)
        for name, matrix in results.items():
            entries = reduced[begin:begin + len(matrix)]
            self.results[name] = sp.Matrix(*matrix.shape, entries)
            begin += len(matrix)
        self.assignments: Assignments = []
        self._known: set[Any] = set()
        for matrix in self.results.values():
            for entry in matrix:
                self._assign(entry, values)

    def _assign(self, expression: Any, values: Mapping[Any, Any]) -> None:
        """Append the assignments that an expression needs, in their order."""
        for symbol in sorted(expression.free_symbols, key=sp.default_sort_key):
            if symbol in values and symbol not in self._known:
                self._known.add(symbol)
                self._assign(values[symbol], values)
                self.assignments.append((symbol, values[symbol]))

    def operations(self) -> OperationCount:
        """Return the operation count of one evaluation."""
        expressions = [value for _, value in self.assignments]
        for matrix in self.results.values():
            expressions += list(matrix)
        return operations(expressions)


def equations_of_motion(form: Derivation) -> dict[str, Any]:
    """Return q', M and f of M u_I' = f, and the constraint forces, by name."""
    results = {'qdot': form.qdot, 'M': form.M, 'f': form.right_side}
    if form.auxiliary:
        results['forces'] = sp.Matrix(list(form.auxiliary.values()))
    return results


class _C(C99CodePrinter):  # type: ignore[misc]  # SymPy has no types
    """C99 with small powers as products, and no integers that an int cannot hold."""

    def _print_Integer(self, expr: Any) -> str:  # noqa: N802
        return str(expr) if abs(expr) < 2**31 else repr(float(expr))

    def _print_Pow(self, expr: Any) -> str:  # noqa: N802
        if expr.exp in (2, 3):
            product = sp.Mul(*[expr.base] * int(expr.exp), evaluate=False)
            return str(self._print(product))
        return str(super()._print_Pow(expr))


def as_code(form: Derivation, language: str) -> str:
    """
    Return a function that evaluates the equations of motion.

    Parameters
    ----------
    form : Derivation
        The equations.
    language : 'python' or 'c'
        C99 with the functions of math.h; matrices by rows.

    Raises
    ------
    InputError
        An unknown language.

    """
    if language not in LANGUAGES:
        raise InputError(f'language: {language!r}; expected one of '
                         f'{", ".join(LANGUAGES)}')
    is_c = language == 'c'
    write = (_C() if is_c else PythonCodePrinter()).doprint
    constant = 'const double {} = {};' if is_c else '{} = {}'
    program = StraightLineCode(form.letters, equations_of_motion(form))
    arguments = {'q': form.q, 'u': [form.u[r] for r in form.free], 'T': form.torques,
                 'wrench': form.wrench,
                 'udot': [form.udot[r] for r in form.free if form.auxiliary]}
    arguments = {name: entries for name, entries in arguments.items() if entries}

    # Arguments, parameters, common subexpressions and letters, then the results.
    lines = [constant.format(symbol, f'{argument}[{k}]')
             for argument, entries in arguments.items() for k, symbol in enumerate(entries)]
    lines += [constant.format(parameter.symbol, repr(parameter.value))
              for parameter in form.parameters]
    lines += [constant.format(symbol, write(x)) for symbol, x in program.assignments]
    for result, matrix in program.results.items():
        entries = list(map(write, matrix))
        if is_c:
            lines += [f'{result}[{k}] = {entry};' for k, entry in enumerate(entries)]
            continue
        if result == 'M':
            entries = [f'[{", ".join(map(write, row))}]' for row in matrix.tolist()]
        lines.append(f'{result} = [{", ".join(entries)}]')
    name = 'dynamics_of_' + re.sub(r'\W', '_', form.robot.model.name)
    if is_c:
        body = indent('\n'.join(lines), '    ')
        inputs = [f'const double *{argument}' for argument in arguments]
        outputs = [f'double *{result}' for result in program.results]
        signature = ', '.join([*inputs, 'double t', *outputs])
        return f'#include <math.h>\n\nvoid {name}({signature})\n{{\n{body}\n}}\n'
    lines.append(f'return {", ".join(program.results)}')
    body = indent('\n'.join(lines), '    ')
    return f'import math\n\n\ndef {name}({", ".join(arguments)}, t=0.0):\n{body}\n'
