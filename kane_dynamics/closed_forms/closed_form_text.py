"""Closed forms as text, LaTeX, tables in Markdown and CSV, and plain data."""

import csv
from dataclasses import asdict
import io
from typing import Any

from kane_dynamics.closed_forms.closed_form import ClosedForm, DIGITS
from kane_dynamics.native.tracing.program import OperationCount
import sympy as sp

CAPTION = 'omega, and v of the center of mass, in the axes of each body'
# Rows of a table of partial velocities.
VECTORS = {'omega': slice(0, 3), 'v': slice(3, 6)}
Row = tuple[str, str, str]


def as_text(form: ClosedForm, compiled: dict[str, OperationCount]) -> str:
    """Return a closed form, and the operation counts of its kernels, as plain text."""
    n = len(form.q)
    lines = [f'{form.model.name}: M(q) udot + bias(q, u) = tau, u = qdot', '']
    for symbol, value, meaning in legend(form):
        lines.append(f'{symbol:6}{value:12}{meaning}')
    # The upper triangle is enough of a symmetric matrix.
    lines += ['', f'M, symmetric, {n} x {n}']
    for r in range(n):
        for s in range(r, n):
            lines.append(f'M{r + 1}{s + 1} = {_plain(form.M[r, s])}')
    lines += ['', 'bias']
    lines += [f'bias{r + 1} = {_plain(form.bias[r])}' for r in range(n)]
    lines += ['', f'partial velocities: {CAPTION}']
    for body, table in form.partials.items():
        for r in range(n):
            for symbol, rows in VECTORS.items():
                lines.append(f'{symbol}{r + 1} of {body} = {_vector(table[rows, r])}')
    # What one evaluation costs, by the expressions and by the compiled kernels.
    lines += ['', f'operations: {", ".join(OperationCount.__dataclass_fields__)}']
    for name, count in form.operations().items():
        lines.append(f'{name}, closed form: {_counts(count)}')
        lines.append(f'{name}, compiled: {_counts(compiled[name])}')
    return '\n'.join(lines) + '\n'


def as_latex(form: ClosedForm) -> str:
    """Return mass matrix, bias and partial velocities as LaTeX displays."""
    def latex(value: Any) -> str:
        return str(sp.latex(value, full_prec=False))

    # The legend as comments, then a display for each quantity.
    lines = [r'% ' + '  '.join(row).rstrip() for row in legend(form)]
    lines.append(r'\[ M = ' + latex(form.M) + r' \]')
    lines.append(r'\[ h = ' + latex(form.bias) + r' \]')
    for body, table in form.partials.items():
        label = rf'\text{{{body}}}'.replace('_', r'\_')
        for r in range(len(form.q)):
            angular = latex(table[:3, r])
            linear = latex(table[3:, r])
            place = rf'_{{{r + 1}}}^{{{label}}}'
            lines.append(rf'\[ \omega{place} = {angular}, \quad v{place} = {linear} \]')
    return '\n'.join(lines) + '\n'


def as_markdown(form: ClosedForm) -> str:
    """Return the table of partial velocities: a row per speed, two columns per body."""
    header = ['r']
    for body in form.partials:
        for symbol in VECTORS:
            header.append(f'{symbol} of {body}')
    lines = [header, ['---'] * len(header)]

    # A row for each speed, with the partial velocities of all bodies.
    for r in range(len(form.q)):
        row = [f'{r + 1}']
        for table in form.partials.values():
            for part in VECTORS.values():
                row.append(_vector(table[part, r]))
        lines.append(row)
    return ''.join(f'| {" | ".join(line)} |\n' for line in lines)


def as_csv(form: ClosedForm) -> str:
    """Return the table of partial velocities: a row for each speed of each body."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    header = ['speed', 'body']
    for symbol in VECTORS:
        header += [f'{symbol}_{axis}' for axis in 'xyz']
    writer.writerow(header)
    for body, table in form.partials.items():
        for r, speed in enumerate(form.u):
            writer.writerow([str(speed), body, *map(_plain, table[:, r])])
    return stream.getvalue()


def as_data(form: ClosedForm, compiled: dict[str, OperationCount]) -> dict[str, Any]:
    """Return everything as plain data; expressions are texts for SymPy."""
    parameters = {}
    for parameter in form.parameters:
        parameters[str(parameter.symbol)] = {
            'value': parameter.value,
            'unit': parameter.unit,
            'meaning': parameter.meaning}
    operations = {}
    for name, count in form.operations().items():
        operations[name] = {'closed_form': asdict(count),
                            'compiled': asdict(compiled[name])}
    partial_velocities = {body: _rows(table) for body, table in form.partials.items()}
    # Expressions as texts that SymPy reads back.
    return {'joint_names': form.model.joint_names,
            'q': list(map(str, form.q)),
            'u': list(map(str, form.u)),
            'parameters': parameters,
            'mass_matrix': _rows(form.M),
            'bias_force': list(map(_plain, form.bias)),
            'partial_velocities': partial_velocities,
            'operations': operations}


def legend(form: ClosedForm) -> list[Row]:
    """Return symbol, value and meaning of coordinates, speeds and parameters."""
    table = []
    for r, joint in enumerate(form.model.coordinate_joints):
        unit = 'm' if joint.kind == 'prismatic' else 'rad'
        table.append((f'q{r + 1}', '', f'{joint.name} [{unit}]; u{r + 1} is its rate'))
    for parameter in form.parameters:
        table.append((str(parameter.symbol), f'{parameter.value:.{DIGITS}g}',
                      f'{parameter.meaning} [{parameter.unit}]'))
    return table


def _rows(matrix: Any) -> list[list[str]]:
    """Return the entries of a matrix as texts, by rows."""
    return [list(map(_plain, row)) for row in matrix.tolist()]


def _vector(column: Any) -> str:
    """Return a vector as text: 0, or its three components."""
    if column.is_zero_matrix:
        return '0'
    components = ', '.join(map(_plain, column))
    return f'({components})'


def _counts(count: OperationCount) -> str:
    return ', '.join(map(str, asdict(count).values()))


def _plain(expression: Any) -> str:
    return str(sp.sstr(expression, full_prec=False))
