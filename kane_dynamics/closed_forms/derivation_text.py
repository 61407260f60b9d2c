"""
Derivations as text, Markdown and LaTeX, and as plain data.

All are written from the same steps: titles, sentences and equations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple
import re
from typing import Any, NamedTuple, TYPE_CHECKING

from kane_dynamics.closed_forms.polynomials import operations
from kane_dynamics.native.tracing.program import OperationCount
import sympy as sp

if TYPE_CHECKING:
    from kane_dynamics.closed_forms.derivation import Derivation

DIGITS = 6
VECTORS = {'omega': slice(0, 3), 'v': slice(3, 6)}  # rows of a table of velocities
ACCELERATIONS = {'alpha': slice(0, 3), 'a': slice(3, 6)}
Counts = dict[str, OperationCount]
Equation = tuple[str, Any]  # a name, and an expression or a vector


class Step(NamedTuple):
    """A step: its title, a sentence, and equations."""

    title: str
    sentence: str
    equations: list[Equation]


def steps(form: Derivation) -> list[Step]:
    """Return the steps of the derivation, in the order of the book."""
    independent = [str(form.u[r]) for r in form.free]
    places = [r + 1 for r in form.free]
    udot = sp.Matrix([form.udot[r] for r in form.free])
    joint_rates = sp.Matrix(sp.symbols(f'qdot1:{form.Y.cols + 1}'))
    where = {'own': 'of each body', 'world': 'of the world'}
    axes = f'in the axes {where.get(form.axes, f"of {form.axes}")}.'
    dependent = [form.u[r] for r in form.dependent]
    dependent_rates = form.A * udot + form.drift
    partials = [(f'{letter}{r + 1} of {body}', table[rows, column])
                for body, table in form.partials.items()
                for column, r in enumerate(form.speeds_of_tables)
                for letter, rows in VECTORS.items()]
    inertia = [(f'F*{r}', x) for r, x in zip(places, form.inertia_force)]
    matrix = [(f'M{r + 1}{s + 1}', form.M[r, s])
              for r in range(len(places)) for s in range(r, len(places))]
    needed = form.symbols_of_equations
    result = [
        Step('Generalized speeds', "Generalized speeds u = Y q' + Z of the joint rates q'.",
             list(zip(map(str, form.u), form.Y * joint_rates + form.Z))),
        Step('Kinematical differential equations', 'The rates of the coordinates.',
             [(f"q{k}'", x) for k, x in enumerate(form.qdot, 1)]),
        Step('Constraints', f'Dependent speeds u_D = A u_I + B of the independent speeds '
             f'{", ".join(independent)}, and their rates.',
             [*((str(u), form.letters[u]) for u in dependent),
              *((f"{u}'", x) for u, x in zip(dependent, dependent_rates))]),
        Step('Velocities', 'Angular velocities, and velocities of centers of mass and '
             f'points, {axes}', _vectors(form.velocities, VECTORS)),
        Step('Partial velocities', f'Coefficients of the independent speeds, {axes}',
             partials),
        Step('Accelerations', f'Angular accelerations and accelerations, {axes}',
             _vectors(form.accelerations, ACCELERATIONS)),
        Step('Generalized active forces', 'By source; the sum is F.',
             _forces(places, form.active)),
        Step('Generalized inertia forces', "F* of Kane's sums over the bodies.", inertia),
        Step('Generalized forces by variations of vectors',
             'An independent derivation, with the same result.',
             _forces(places, form.energy)),
        Step("Kane's equations", "F + F* = 0 as M u' = f.",
             [*matrix, *((f'f{r}', x) for r, x in enumerate(form.right_side, 1)),
              *((f'bias{r}', x) for r, x in enumerate(form.bias, 1))]),
        Step('Constraint forces', 'Each by the equation of its auxiliary speed, which is '
             'zero in the motion.',
             [(f'F of {name}', x) for name, x in form.auxiliary.items()]),
        Step('Letters', 'In the order of their evaluation.',
             [(str(letter), x) for letter, x in form.letters.items()
              if letter not in form.u and letter in needed])]
    return [step for step in result if step.equations]


def _vectors(tables: dict[str, Any], rows: dict[str, slice]) -> list[Equation]:
    """Return the angular and linear vectors of bodies and points."""
    return [(f'{letter} of {body}', table[part, :])
            for body, table in tables.items() for letter, part in rows.items()]


def _forces(places: list[int], by_source: dict[str, Any]) -> list[Equation]:
    """Return generalized forces by source; `places` are those of the speeds."""
    return [(f'F{r} of {source}', x)
            for source, force in by_source.items() for r, x in zip(places, force)]


def legend(form: Derivation) -> list[tuple[str, str, str]]:
    """Return symbol, value and meaning of coordinates, speeds and parameters."""
    robot = form.robot
    table = []
    for symbol, name in zip(form.q, robot.model.coordinate_names):
        unit = 'm' if name in robot.model.sliding else 'rad'
        table.append((str(symbol), '', f'{name} [{unit}]'))
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


def _rounded(expression: Any) -> Any:
    """Return an expression or matrix with its long fractions rounded."""
    fractions = {x: sp.Float(x, DIGITS) for x in expression.atoms(sp.Rational) if x.q > 1000}
    return expression.xreplace(fractions)


def _plain(value: Any) -> str:
    """Return an expression as text."""
    return str(sp.sstr(_rounded(value), full_prec=False))


def _latex(value: Any) -> str:
    """Return an expression as LaTeX that a line may end in: no fractions of sums."""
    value = _rounded(value)
    # Letters of parameters have the number and the axes as their index.
    names = {}
    for symbol in value.free_symbols:
        letter, index = re.findall(r'^(.*?)(\d*[xyz]*)$', symbol.name)[0]
        if letter and index and not letter.endswith('dot'):
            names[symbol] = f'{letter}_{{{index}}}'
    powers = {power: sp.Dummy() for power in value.atoms(sp.Pow)
              if power.exp.is_negative and power.free_symbols}
    for power, symbol in powers.items():
        base = _latex(power.base)
        names[symbol] = rf'({base})^{{{_latex(power.exp)}}}'
    text = sp.latex(value.xreplace(powers), symbol_names=names, full_prec=False,
                    root_notation=False, long_frac_ratio=1)
    return re.sub(r'\\(left|right)', '', text)


def _latex_by_terms(value: Any) -> str:
    """Return an expression as LaTeX with a term on each line, which TeX limits."""
    return re.sub(' ([+-]) ', r'\n\1 ', _latex(value))


def _latex_name(name: str) -> str:
    """Return a name such as u1', omega2 of link or F*3 as LaTeX."""
    letter, mark, index, dot, owner = re.fullmatch(  # type: ignore[union-attr]
        r"(omega|alpha|bias|\w)(\*?)(\w*)('?)(?: of (.*))?", name).groups('')
    above = rf'{mark}\text{{{_escaped(owner)}}}' if owner else mark
    symbol = _latex(sp.Symbol(letter + 'dot' * len(dot)))
    return symbol + f'_{{{index}}}' * bool(index) + f'^{{{above}}}' * bool(above)


def _escaped(text: str) -> str:
    """Return text with the special characters of LaTeX escaped."""
    return re.sub(r'([_&%#$])', r'\\\1', text)


class Format(NamedTuple):
    """A format of derivations: templates of its parts, and writers of mathematics."""

    title: str
    symbol: str
    condition: str
    step: str
    equation: str
    name: Callable[[str], str]
    expression: Callable[[Any], str]
    comma: str = ', '
    words: Callable[[str], str] = str


TEXT = Format(
    '{}: M(q) udot + bias(q, u) = tau\n', '{:6}{:12}{}', 'valid where {} > 0',
    '\n{}. {}: {}', '{} = {}', str, _plain)
MARKDOWN = Format(
    '## {}\n\n| symbol | value | meaning |\n|---|---|---|', '| {} | {} | {} |',
    '\nValid where ${} > 0$.', '\n### {}. {}\n\n{}\n', '${} = {}$\n', _latex_name, _latex)
LATEX = Format(
    '% {}\n{{\\raggedright\\parindent0pt', '% {}  {}  {}', 'Valid where \\({} > 0\\).\n',
    '\n\\paragraph{{{1}.}} {2}\n', '\\(\\displaystyle {} = {}\\)\n', _latex_name,
    _latex_by_terms, r',\allowbreak\ ', _escaped)


def _lines(form: Derivation, style: Format) -> list[str]:
    """Return the lines of a derivation in a format."""
    lines = [style.title.format(form.robot.model.name)]
    lines += [style.symbol.format(*row) for row in legend(form)]
    lines += [style.condition.format(style.expression(x)) for x in form.conditions]
    for number, step in enumerate(steps(form), 1):
        lines.append(style.step.format(number, step.title, style.words(step.sentence)))
        if style is MARKDOWN and step.title == 'Partial velocities':
            lines += _table(form)
            continue
        for name, value in step.equations:
            lines.append(style.equation.format(style.name(name), _written(value, style)))
    return lines


def _written(value: Any, style: Format) -> str:
    """Return an expression, or a vector: 0, or its three components."""
    if not isinstance(value, sp.MatrixBase):
        return style.expression(value)
    if value.is_zero_matrix:
        return '0'
    return f'({style.comma.join(map(style.expression, value))})'


def as_text(form: Derivation, compiled: Counts | None = None) -> str:
    """Return a derivation and its operation counts as plain text."""
    counts = [f'{name}: {count}' for name, count in operation_counts(form, compiled).items()]
    return '\n'.join([*_lines(form, TEXT), '', 'operations:', *counts, ''])


def as_latex(form: Derivation) -> str:
    """Return the steps as LaTeX for a document with the package amsmath."""
    return '\n'.join([*_lines(form, LATEX), r'\par}', ''])


def as_markdown(form: Derivation) -> str:
    """Return the steps as Markdown, partial velocities as a table."""
    return '\n'.join([*_lines(form, MARKDOWN), ''])


def _table(form: Derivation) -> list[str]:
    """Return the table of partial velocities: a row per speed, two columns per body."""
    header = [f'{letter} of {body}' for body in form.partials for letter in VECTORS]
    rows = [['r', *header], ['---'] * (len(header) + 1)]
    for column, r in enumerate(form.speeds_of_tables):
        cells = [f'${_written(table[part, column], MARKDOWN)}$'
                 for table in form.partials.values() for part in VECTORS.values()]
        rows.append([str(r + 1), *cells])
    return [f'| {" | ".join(row)} |' for row in rows]


def as_data(form: Derivation, compiled: Counts | None = None) -> Any:
    """Return the steps as plain data; expressions are texts for SymPy, vectors lists."""
    data: dict[str, Any] = {
        'symbols': {symbol: {'value': value, 'meaning': meaning}
                    for symbol, value, meaning in legend(form)},
        'conditions': [_plain(condition) for condition in form.conditions],
        'steps': {},
        'operations': operation_counts(form, compiled)}
    for step in steps(form):
        data['steps'][step.title] = {
            name: list(map(_plain, value)) if isinstance(value, sp.MatrixBase)
            else _plain(value) for name, value in step.equations}
    return data


def operation_counts(form: Derivation, compiled: Counts | None) -> dict[str, int]:
    """Return operations of M and bias: as derived, in closed form, and of kernels."""
    results = {'mass_matrix': form.M, 'bias_force': form.bias}
    counts = {'mass_matrix and bias_force, as derived': form.operations_before}
    for name, matrix in results.items():
        counts[f'{name}, closed form'] = operations(list(form.expanded(matrix)))
        if compiled is not None:
            counts[f'{name}, compiled'] = sum(astuple(compiled[name]))
    return counts
