"""
Derivations as text, Markdown, LaTeX, a table in CSV, and plain data.

All but data are written from the same steps: titles, sentences and equations.
"""

import csv
from dataclasses import asdict
import io
import re
from typing import Any, NamedTuple

from kane_dynamics.closed_forms.derivation import Derivation
from kane_dynamics.closed_forms.derivation_code import equations_of_motion, StraightLineCode
from kane_dynamics.native.tracing.program import OperationCount
import sympy as sp

DIGITS = 6
WIDTH = 90  # characters of LaTeX on a line of a sum
# Rows of a table of partial velocities.
VECTORS = {'omega': slice(0, 3), 'v': slice(3, 6)}
DOTS = {'omega': 'alpha', 'v': 'a'}
Row = tuple[str, str, str]
Counts = dict[str, OperationCount]


class Name(NamedTuple):
    """Name of a quantity: a letter, an index, dots for rates, and a body or source."""

    letter: str
    place: str = ''
    dots: int = 0
    of: str = ''

    def text(self) -> str:
        """Return the name as plain text."""
        owner = f' of {self.of}' if self.of else ''
        return self.letter + self.place + "'" * self.dots + owner

    def latex(self) -> str:
        """Return the name as LaTeX."""
        letter, mark = self.letter.rstrip('*'), self.letter.count('*') * '*'
        if letter in ('omega', 'alpha'):
            letter = '\\' + letter
        if self.dots:
            letter = rf'\dot {letter}'
        owner = rf'\text{{{_escaped(self.of)}}}' if self.of else ''
        above = f'^{{{mark}{owner}}}' if mark or owner else ''
        below = f'_{{{self.place}}}' if self.place else ''
        return f'{letter}{below}{above}'


class Equation(NamedTuple):
    """A name and the expression that it equals; a matrix is a vector."""

    name: Name
    value: Any


class Step(NamedTuple):
    """A step: its title, a sentence, and equations."""

    title: str
    sentence: str
    equations: list[Equation]


def steps(form: Derivation) -> list[Step]:
    """Return the steps of the derivation, in the order of the book."""
    independent = [form.u[r] for r in form.free]
    result = [
        Step('Generalized speeds', "Generalized speeds u = Y q' + Z of the joint rates q'.",
             _speeds(form)),
        Step('Kinematical differential equations', 'The rates of the coordinates.',
             [Equation(Name('q', str(k + 1), 1), x) for k, x in enumerate(form.qdot)])]
    if form.dependent:
        names = ', '.join(map(str, independent))
        equations = [Equation(_plain_name(form.u[r]), form.letters[form.u[r]])
                     for r in form.dependent]
        equations += [Equation(_plain_name(form.u[r], 1), _rate(form, k))
                      for k, r in enumerate(form.dependent)]
        result.append(Step('Constraints', f'Dependent speeds u_D = A u_I + B of the '
                           f'independent speeds {names}, and their rates.', equations))
    where = {'own': 'of each body', 'world': 'of the world'}
    axes = where.get(form.axes, f'of {form.axes}')
    result += [
        Step('Velocities', f'Angular velocities, and velocities of centers of mass and '
             f'points, in the axes {axes}.', _vectors(form.velocities, VECTORS)),
        Step('Partial velocities', f'Coefficients of the independent speeds, in the axes '
             f'{axes}.', _partials(form)),
        Step('Accelerations', f'Angular accelerations and accelerations, in the axes '
             f'{axes}.', _vectors(form.accelerations,
                                  {DOTS[k]: rows for k, rows in VECTORS.items()})),
        Step('Generalized active forces', 'By source; the sum is F.',
             [Equation(Name('F', str(form.free[r] + 1), 0, source), x)
              for source, force in form.active.items() for r, x in enumerate(force)]),
        Step('Generalized inertia forces', "F* of Kane's sums over the bodies.",
             [Equation(Name('F*', str(form.free[r] + 1)), x)
              for r, x in enumerate(form.inertia_force)])]
    if form.energy:
        result.append(Step('Generalized forces by variations of vectors',
                           'An independent derivation, with the same result.',
                           [Equation(Name('F', str(form.free[r] + 1), 0, source), x)
                            for source, force in form.energy.items()
                            for r, x in enumerate(force)]))
    result.append(Step("Kane's equations", "F + F* = 0 as M u' = f.", _matrix_form(form)))
    if form.auxiliary:
        result.append(Step(
            'Constraint forces', 'Each by the equation of its auxiliary speed, which is '
            'zero in the motion.',
            [Equation(Name('F', '', 0, force), x) for force, x in form.auxiliary.items()]))
    letters = [Equation(_plain_name(symbol), x) for symbol, x in form.letters.items()
               if symbol not in form.u and symbol in form.symbols_of_equations]
    if letters:
        result.append(Step('Letters', 'In the order of their evaluation.', letters))
    return [step for step in result if step.equations]


def as_text(form: Derivation, compiled: Counts | None = None) -> str:
    """Return a derivation and its operation counts as plain text."""
    lines = [f'{form.robot.model.name}: M(q) udot + bias(q, u) = tau', '']
    for symbol, value, meaning in legend(form):
        lines.append(f'{symbol:6}{value:12}{meaning}')
    for condition in form.conditions:
        lines.append(f'valid where {_plain(condition)} > 0')
    for number, step in enumerate(steps(form), 1):
        lines += ['', f'{number}. {step.title}: {step.sentence}']
        for equation in step.equations:
            lines.append(f'{equation.name.text()} = {_value(equation.value)}')
    # What one evaluation costs: as derived, shortened and shared, and compiled.
    lines += ['', f'operations: {", ".join(OperationCount.__dataclass_fields__)}']
    for name, count in operation_counts(form, compiled).items():
        lines.append(f'{name}: {_counts(count)}')
    return '\n'.join(lines) + '\n'


def as_latex(form: Derivation) -> str:
    """Return the steps as LaTeX for a document with the package amsmath."""
    # The legend as comments, then a paragraph for each step.
    lines = [r'% ' + '  '.join(row).rstrip() for row in legend(form)]
    for condition in form.conditions:
        lines.append(rf'Valid where \( {_latex(condition)} > 0 \).')
    for step in steps(form):
        lines += [rf'\paragraph{{{_escaped(step.title)}.}} {_escaped(step.sentence)}']
        for equation in step.equations:
            lines.append(rf'\[ {_display(equation)} \]')
    return '\n'.join(lines) + '\n'


def as_markdown(form: Derivation) -> str:
    """Return the steps as Markdown, partial velocities as a table."""
    lines = [f'## {form.robot.model.name}', '', '| symbol | value | meaning |',
             '|---|---|---|']
    for symbol, value, meaning in legend(form):
        lines.append(f'| ${_latex(sp.Symbol(symbol))}$ | {value} | {meaning} |')
    for condition in form.conditions:
        lines += ['', f'Valid where ${_latex(condition)} > 0$.']
    for number, step in enumerate(steps(form), 1):
        lines += ['', f'### {number}. {step.title}', '', step.sentence, '']
        if step.title == 'Partial velocities':
            lines += _table(form)
            continue
        for equation in step.equations:
            lines += ['$$', _display(equation), '$$']
    return '\n'.join(lines) + '\n'


def as_csv(form: Derivation) -> str:
    """Return the table of partial velocities: a row for each speed of each body."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    header = ['speed', 'body']
    for symbol in VECTORS:
        header += [f'{symbol}_{axis}' for axis in 'xyz']
    writer.writerow(header)
    for body, table in form.partials.items():
        for column, r in enumerate(form.free):
            writer.writerow([str(form.u[r]), body, *map(_plain, table[:, column])])
    return stream.getvalue()


def as_data(form: Derivation, compiled: Counts | None = None) -> dict[str, Any]:
    """Return everything as plain data; expressions are texts for SymPy."""
    parameters = {}
    for parameter in form.parameters:
        parameters[str(parameter.symbol)] = {
            'value': parameter.value,
            'unit': parameter.unit,
            'meaning': parameter.meaning}
    data: dict[str, Any] = {
        'joint_names': form.robot.joint_names,
        'q': list(map(str, form.q)),
        'u': [str(form.u[r]) for r in form.free],
        'parameters': parameters,
        'letters': {str(symbol): _plain(x) for symbol, x in form.letters.items()},
        'conditions': list(map(_plain, form.conditions)),
        'qdot': list(map(_plain, form.qdot)),
        'mass_matrix': _rows(form.M),
        'bias_force': list(map(_plain, form.bias)),
        'constraint_forces': {name: _plain(x) for name, x in form.auxiliary.items()},
        'operations': {name: asdict(count) for name, count
                       in operation_counts(form, compiled).items()}}
    for name in ('velocities', 'partial_velocities', 'accelerations', 'active_forces'):
        attribute = {'partial_velocities': 'partials', 'active_forces': 'active'}
        matrices = getattr(form, attribute.get(name, name))
        data[name] = {label: _rows(matrix) for label, matrix in matrices.items()}
    return data


def operation_counts(form: Derivation, compiled: Counts | None) -> Counts:
    """Return operations of M and bias: as derived, in closed form, and of kernels."""
    counts = {'mass_matrix and bias_force, as derived': form.operations_before}
    for name, matrix in (('mass_matrix', form.M), ('bias_force', form.bias)):
        program = StraightLineCode(form.letters, {name: matrix})
        counts[f'{name}, closed form'] = program.operations()
        if compiled is not None:
            counts[f'{name}, compiled'] = compiled[name]
    everything = StraightLineCode(form.letters, equations_of_motion(form))
    counts['all, closed form'] = everything.operations()
    return counts


def legend(form: Derivation) -> list[Row]:
    """Return symbol, value and meaning of coordinates, speeds and parameters."""
    robot = form.robot
    table = []
    for k, name in enumerate(robot.model.coordinate_names):
        unit = 'm' if name in robot.model.sliding else 'rad'
        table.append((f'q{k + 1}', '', f'{name} [{unit}]'))
    for r, name in enumerate(robot.mechanism.speeds.names):
        kind = 'dependent speed' if r in form.dependent else 'speed'
        table.append((f'u{r + 1}', '', f'{kind} {name}'))
    for symbol in form.torques:
        joint = robot.model.joint_names[int(str(symbol)[1:]) - 1]
        table.append((str(symbol), '', f'actuator of {joint}'))
    for parameter in form.parameters:
        table.append((str(parameter.symbol), f'{parameter.value:.{DIGITS}g}',
                      f'{parameter.meaning} [{parameter.unit}]'))
    return table


def _speeds(form: Derivation) -> list[Equation]:
    """Return the speeds in terms of the joint rates."""
    rates = sp.Matrix([sp.Symbol(f'qdot{r + 1}') for r in range(form.Y.shape[1])])
    speeds = form.Y * rates + form.Z
    return [Equation(_plain_name(symbol), x) for symbol, x in zip(form.u, speeds)]


def _rate(form: Derivation, k: int) -> Any:
    """Return the rate of a dependent speed, A u_I' + drift."""
    total = form.drift[k]
    for column, r in enumerate(form.free):
        total += form.A[k, column] * form.udot[r]
    return total


def _plain_name(symbol: Any, dots: int = 0) -> Name:
    """Return the name of a symbol with an index at its end."""
    letter, index = re.fullmatch(r'(\D+)(\d*)', str(symbol)).groups()  # type: ignore
    return Name(letter, index, dots)


def _vectors(matrices: dict[str, Any], rows: dict[str, slice]) -> list[Equation]:
    """Return the vectors of bodies and points."""
    equations = []
    for body, vectors in matrices.items():
        for letter, part in rows.items():
            equations.append(Equation(Name(letter, '', 0, body), vectors[part, :]))
    return equations


def _partials(form: Derivation) -> list[Equation]:
    """Return the partial velocities of bodies and points, speed by speed."""
    equations = []
    for body, table in form.partials.items():
        for column, r in enumerate(form.speeds_of_tables):
            for letter, rows in VECTORS.items():
                name = Name(letter, str(r + 1), 0, body)
                equations.append(Equation(name, table[rows, column]))
    return equations


def _matrix_form(form: Derivation) -> list[Equation]:
    """Return the upper triangle of M, then f and the bias."""
    equations = []
    for r in range(len(form.free)):
        for s in range(r, len(form.free)):
            equations.append(Equation(Name('M', f'{r + 1}{s + 1}'), form.M[r, s]))
    for letter, column in (('f', form.right_side), ('bias', form.bias)):
        equations += [Equation(Name(letter, str(r + 1)), x) for r, x in enumerate(column)]
    return equations


def _table(form: Derivation) -> list[str]:
    """Return the table of partial velocities: a row per speed, two columns per body."""
    header = ['r']
    for body in form.partials:
        header += [f'{symbol} of {body}' for symbol in VECTORS]
    rows = [header, ['---'] * len(header)]
    for column, r in enumerate(form.speeds_of_tables):
        row = [str(r + 1)]
        for table in form.partials.values():
            row += [f'${_latex(table[part, column].T)}$' for part in VECTORS.values()]
        rows.append(row)
    return [f'| {" | ".join(row)} |' for row in rows]


def _display(equation: Equation) -> str:
    """Return an equation as LaTeX, with long sums on several lines."""
    name, value = equation
    left = name.latex()
    right = _latex(value)
    if getattr(value, 'is_Matrix', False) or not value.is_Add or len(right) < WIDTH:
        return f'{left} = {right}'
    lines = ['']
    for term in value.as_ordered_terms():
        text = _latex(term)
        if not text.startswith('-'):
            text = f'+ {text}'
        if lines[-1] and len(lines[-1]) + len(text) > WIDTH:
            lines.append('')
        lines[-1] += f' {text}'
    lines[0] = lines[0].removeprefix(' + ')
    body = r' \\ &\quad '.join(lines)
    return rf'\begin{{aligned}} {left} &= {body} \end{{aligned}}'


def _latex(value: Any) -> str:
    return str(sp.latex(_rounded(value), full_prec=False, mat_str='matrix',
                        mat_delim='('))


def _escaped(text: str) -> str:
    """Return text with the special characters of LaTeX escaped."""
    return re.sub(r'([_&%#$])', r'\\\1', text)


def _rows(matrix: Any) -> list[list[str]]:
    """Return the entries of a matrix as texts, by rows."""
    return [list(map(_plain, row)) for row in matrix.tolist()]


def _value(value: Any) -> str:
    """Return an expression as text, or a vector: 0, or its three components."""
    if not getattr(value, 'is_Matrix', False):
        return _plain(value)
    if value.is_zero_matrix:
        return '0'
    components = ', '.join(map(_plain, value))
    return f'({components})'


def _counts(count: OperationCount) -> str:
    return ', '.join(map(str, asdict(count).values()))


def _plain(expression: Any) -> str:
    return str(sp.sstr(_rounded(expression), full_prec=False))


def _rounded(expression: Any) -> Any:
    """Return an expression with its long fractions and roots rounded, no exponents."""
    if getattr(expression, 'is_Matrix', False):
        return expression.applyfunc(_rounded)
    if not expression.args:
        is_fraction = expression.is_Rational and expression.q > 1000
        return _decimal(expression) if is_fraction else expression
    if expression.is_Pow and not expression.free_symbols:
        return expression if expression.base.is_Integer else _decimal(expression)
    if expression.is_Pow:
        return expression.func(_rounded(expression.base), expression.exp)
    return expression.func(*map(_rounded, expression.args))


def _decimal(number: Any) -> Any:
    """Return a number with few digits."""
    return sp.Float(f'{float(number):.{DIGITS}g}')
