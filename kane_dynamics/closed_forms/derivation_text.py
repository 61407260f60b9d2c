"""
Derivations as text, Markdown and LaTeX, and as plain data.

The texts are written from the same steps: titles, sentences and equations.
"""

from __future__ import annotations

from dataclasses import asdict
import re
from typing import Any, NamedTuple, TYPE_CHECKING

from kane_dynamics.closed_forms.derivation_code import equations_of_motion, StraightLineCode
from kane_dynamics.native.tracing.program import OperationCount
import sympy as sp

if TYPE_CHECKING:
    from kane_dynamics.closed_forms.derivation import Derivation

DIGITS = 6
WIDTH = 58  # glyphs on a line of LaTeX: a column of 12 cm in letters of 10 points
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


def as_text(form: Derivation, compiled: Counts | None = None) -> str:
    """Return a derivation and its operation counts as plain text."""
    lines = [f'{form.robot.model.name}: M(q) udot + bias(q, u) = tau', '']
    lines += [f'{symbol:6}{value:12}{meaning}' for symbol, value, meaning in legend(form)]
    lines += [f'valid where {_plain(condition)} > 0' for condition in form.conditions]
    for number, step in enumerate(steps(form), 1):
        lines += ['', f'{number}. {step.title}: {step.sentence}']
        lines += [f'{name} = {_plain(value)}' for name, value in step.equations]
    lines += ['', f'operations: {", ".join(OperationCount.__dataclass_fields__)}']
    for name, count in operation_counts(form, compiled).items():
        lines.append(f'{name}: {", ".join(map(str, asdict(count).values()))}')
    return '\n'.join(lines) + '\n'


def as_latex(form: Derivation) -> str:
    """Return the steps as LaTeX for a document with the package amsmath."""
    lines = [f'% {"  ".join(row)}'.rstrip() for row in legend(form)]
    lines.append(r'\allowdisplaybreaks')
    lines += [rf'Valid where \( {_latex(condition)} > 0 \).'
              for condition in form.conditions]
    for step in steps(form):
        lines.append(rf'\paragraph{{{step.title}.}} {_escaped(step.sentence)}')
        for equation in step.equations:
            lines.append(rf'\begin{{align*}} {_display(equation)} \end{{align*}}')
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
            lines += ['$$', rf'\begin{{aligned}} {_display(equation)} \end{{aligned}}', '$$']
    return '\n'.join(lines) + '\n'


def _table(form: Derivation) -> list[str]:
    """Return the table of partial velocities: a row per speed, two columns per body."""
    header = [f'{letter} of {body}' for body in form.partials for letter in VECTORS]
    rows = [['r', *header], ['---'] * (len(header) + 1)]
    for column, r in enumerate(form.speeds_of_tables):
        cells = [f'${_latex(table[part, column].T)}$'
                 for table in form.partials.values() for part in VECTORS.values()]
        rows.append([str(r + 1), *cells])
    return [f'| {" | ".join(row)} |' for row in rows]


def as_data(form: Derivation, compiled: Counts | None = None) -> Any:
    """Return everything as plain data; expressions are texts for SymPy."""
    return _data({
        'joint_names': form.robot.joint_names,
        'q': form.q,
        'u': [form.u[r] for r in form.free],
        'parameters': {str(parameter.symbol): {'value': parameter.value,
                                               'unit': parameter.unit,
                                               'meaning': parameter.meaning}
                       for parameter in form.parameters},
        'letters': form.letters,
        'conditions': form.conditions,
        'qdot': list(form.qdot),
        'velocities': form.velocities,
        'partial_velocities': form.partials,
        'accelerations': form.accelerations,
        'active_forces': form.active,
        'mass_matrix': form.M,
        'bias_force': list(form.bias),
        'constraint_forces': form.auxiliary,
        'operations': {name: asdict(count) for name, count
                       in operation_counts(form, compiled).items()}})


def _data(value: Any) -> Any:
    """Return plain data: dictionaries, lists, numbers, and texts of expressions."""
    if isinstance(value, dict):
        return {str(key): _data(entry) for key, entry in value.items()}
    if isinstance(value, sp.MatrixBase):
        return _data(value.tolist())
    if isinstance(value, list | tuple):
        return [_data(entry) for entry in value]
    return _plain(value) if isinstance(value, sp.Basic) else value


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


def _display(equation: Equation) -> str:
    """Return the lines of an equation for the environment `align`."""
    name, value = equation
    left = _latex_name(name)
    if not isinstance(value, sp.MatrixBase):
        return _on_lines(left, value)
    if _width(left) + max(_width(_latex(x)) for x in value) <= WIDTH:
        return f'& {left} = {_latex(value)}'
    # A vector with a long entry: an equation for each component.
    return r' \\ '.join(_on_lines(rf'\bigl({left}\bigr)_{axis}', x)
                        for axis, x in zip('xyz', value))


def _latex_name(name: str) -> str:
    """Return a name such as u1', omega2 of link or F*3 as LaTeX."""
    letter, mark, index, dot, owner = re.fullmatch(  # type: ignore[union-attr]
        r"(omega|alpha|bias|\w)(\*?)(\w*)('?)(?: of (.*))?", name).groups('')
    above = rf'{mark}\text{{{_escaped(owner)}}}' if owner else mark
    symbol = _latex(sp.Symbol(letter + 'dot' * len(dot)))
    return symbol + f'_{{{index}}}' * bool(index) + f'^{{{above}}}' * bool(above)


def _on_lines(left: str, value: Any) -> str:
    """Return an equation in LaTeX, on several lines where it is long."""
    text = _latex(value)
    if _width(left) + _width(text) <= WIDTH:
        return f'& {left} = {text}'
    # Words outside of braces; a line ends before a sign, or else between two factors.
    words = [f'{left} =']
    depth = 0
    for word in _flat(_rounded(value)).split():
        if depth:
            words[-1] += f' {word}'
        else:
            words.append(word)
        depth += word.count('{') - word.count('}')
    lines = []
    line: list[str] = []
    for word in words:
        line.append(word)
        signs = [k for k, x in enumerate(line) if k and x in ('+', '-')]
        if len(line) > 1 and _width(' '.join(line)) > WIDTH:
            end = signs[-1] if signs else len(line) - 1
            lines.append(' '.join(line[:end]))
            line = line[end:] if signs else [r'\times', word]
    return '& ' + r' \\ &\quad '.join([*lines, ' '.join(line)])


def _flat(value: Any) -> str:
    """Return LaTeX without fractions and roots of sums, and with brackets of one size."""
    powers = {power: sp.Dummy() for power in value.atoms(sp.Pow) if power.free_symbols
              and not (power.exp.is_Integer and power.exp > 0)}
    fractions = {x: sp.Dummy() for x in map(abs, value.atoms(sp.Rational)) if x.q > 1}
    signed = fractions | {-x: -symbol for x, symbol in fractions.items()}
    outer = value.xreplace(powers | signed)
    names = {symbol: rf'\tfrac{{{x.p}}}{{{x.q}}}' for x, symbol in fractions.items()}
    # Powers inside of other powers are written with them.
    names |= {symbol: f'({_flat(power.base)})^{{{_latex(power.exp)}}}'
              for power, symbol in powers.items() if symbol in outer.free_symbols}
    text = _latex(outer, symbol_names=names)
    return re.sub(r'\\(left|right)', '', text)


def _width(text: str) -> int:
    """Return about how many glyphs wide LaTeX is; a sign has space around it."""
    signs = len(re.findall(r' [+-] ', text))
    return signs + len(re.sub(r'\\(left|right|dot|frac|text)|[{}^_\\\s]', '', text))


def _latex(value: Any, **settings: Any) -> str:
    # Letters of parameters have the number and the axes as their index.
    names = {}
    for symbol in value.free_symbols:
        letter = symbol.name.rstrip('xyz').rstrip('0123456789')
        index = symbol.name.removeprefix(letter)
        if letter and index and not letter.endswith('dot'):
            names[symbol] = f'{letter}_{{{index}}}'
    settings['symbol_names'] = names | settings.get('symbol_names', {})
    return str(sp.latex(_rounded(value), full_prec=False, mat_str='matrix', mat_delim='(',
                        **settings))


def _escaped(text: str) -> str:
    """Return text with the special characters of LaTeX escaped."""
    return re.sub(r'([_&%#$])', r'\\\1', text)


def _plain(value: Any) -> str:
    """Return an expression as text, or a vector: 0, or its three components."""
    if not isinstance(value, sp.MatrixBase):
        return str(sp.sstr(_rounded(value), full_prec=False))
    if value.is_zero_matrix:
        return '0'
    return f'({", ".join(map(_plain, value))})'


def _rounded(expression: Any) -> Any:
    """Return an expression with its long fractions and roots rounded, no exponents."""
    if isinstance(expression, sp.MatrixBase):
        return expression.applyfunc(_rounded)
    long_fraction = expression.is_Rational and expression.q > 1000
    root = expression.is_Pow and not expression.free_symbols
    if long_fraction or (root and not expression.base.is_Integer):
        return sp.Float(f'{float(expression):.{DIGITS}g}')
    if expression.is_Pow and not root:
        return expression.func(_rounded(expression.base), expression.exp)
    if not expression.args or root:
        return expression
    return expression.func(*map(_rounded, expression.args))
