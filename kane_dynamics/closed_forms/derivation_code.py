"""Equations of a derivation as straight-line code, in Python and C99."""

import re
from textwrap import indent
from typing import Any

from kane_dynamics.closed_forms.derivation import Derivation
from kane_dynamics.errors import InputError
import sympy as sp
from sympy.codegen.rewriting import create_expand_pow_optimization
from sympy.printing.c import C99CodePrinter
from sympy.printing.pycode import PythonCodePrinter

LANGUAGES = ('python', 'c')
POWERS_AS_PRODUCTS = create_expand_pow_optimization(3)


class _C(C99CodePrinter):  # type: ignore[misc]  # SymPy has no types
    """C99 without integers that an int cannot hold."""

    def _print_Integer(self, expr: Any) -> str:  # noqa: N802
        return str(expr) if abs(expr) < 2**31 else repr(float(expr))


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
    printer = _C() if is_c else PythonCodePrinter()
    constant = 'const double {} = {};' if is_c else '{} = {}'

    def write(expression: Any) -> str:
        return str(printer.doprint(POWERS_AS_PRODUCTS(expression)))
    equations = {'qdot': form.qdot, 'M': form.M, 'f': form.right_side}
    if form.auxiliary:
        equations['forces'] = sp.Matrix(list(form.auxiliary.values()))
    shared, matrices = sp.cse(list(map(form.expanded, equations.values())), order='none')
    arguments = {'q': form.q, 'u': [form.u[r] for r in form.free], 'T': form.torques,
                 'wrench': form.wrench,
                 'udot': [form.udot[r] for r in form.free if form.auxiliary]}
    arguments = {name: entries for name, entries in arguments.items() if entries}

    # Arguments, parameters and common subexpressions, then the results.
    lines = [constant.format(symbol, f'{argument}[{k}]')
             for argument, entries in arguments.items() for k, symbol in enumerate(entries)]
    lines += [constant.format(parameter.symbol, repr(parameter.value))
              for parameter in form.parameters]
    lines += [constant.format(symbol, write(POWERS_AS_PRODUCTS(x))) for symbol, x in shared]
    for result, matrix in zip(equations, matrices):
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
        outputs = [f'double *{result}' for result in equations]
        signature = ', '.join([*inputs, 'double t', *outputs])
        return f'#include <math.h>\n\nvoid {name}({signature})\n{{\n{body}\n}}\n'
    lines.append(f'return {", ".join(equations)}')
    body = indent('\n'.join(lines), '    ')
    return f'import math\n\n\ndef {name}({", ".join(arguments)}, t=0.0):\n{body}\n'
