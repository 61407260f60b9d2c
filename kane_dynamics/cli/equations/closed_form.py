"""The equations of motion of a small mechanism in closed form: `kane-dynamics equations`."""

from collections.abc import Callable
import csv
from dataclasses import asdict, dataclass
import io
from itertools import islice
from typing import Any

from kane_dynamics.cli.equations.symbolic import (Parameter, parametrised, shortened, Symbolic,
                                                  symbols, unwrapped)
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.definition.kinematics import configurations
from kane_dynamics.model.model import Model
from kane_dynamics.native.tracing.program import OperationCount
import numpy as np
import sympy as sp

MOST = 4  # coordinates; closed forms of more are too long to read
DIGITS = 6


@dataclass(frozen=True)
class ClosedForm:
    """
    M(q) udot + bias(q, u) = tau in closed form.

    Attributes
    ----------
    model : Model
    q, u : tuples of n symbols
    parameters : list of Parameter
        Those that appear.
    M : (n, n) SymPy Matrix
    bias : (n, 1) SymPy Matrix
    partials : dict of str to (6, n) SymPy Matrix
        By body: omega^r, then v^r of the center of mass, in the axes of the body.

    """

    model: Model
    q: tuple[Any, ...]
    u: tuple[Any, ...]
    parameters: list[Parameter]
    M: Any
    bias: Any
    partials: dict[str, Any]

    def operations(self) -> dict[str, OperationCount]:
        """Return operation counts of mass matrix and bias with shared common subexpressions."""
        n = len(self.q)
        upper = [self.M[r, s] for r in range(n) for s in range(r, n)]
        return {'mass_matrix': _count(upper), 'bias_force': _count(list(self.bias))}


def closed_form(model: Model, *, numbers: bool = False, friction: bool = True,
                progress: Callable[[float], object] = lambda done: None) -> ClosedForm:
    """
    Derive the equations of motion.

    Parameters
    ----------
    model : Model
        The mechanism.
    numbers : bool
        Keep the model's numbers, to six digits, instead of symbols for them.
    friction : bool
        Whether damping and Coulomb friction are part of the equations.
    progress : callable
        Called with the finished fraction of the work.

    Raises
    ------
    InputError
        If the model has more than `MOST` coordinates, or expressions of too many terms.

    """
    require_angles(model, 'closed form')
    n = model.n
    if not 0 < n <= MOST:
        raise InputError(f"closed form of '{model.name}': {n} coordinates; expected 1 to {MOST}: "
                         'choose fewer with --joints, --base or --tip')
    q, q_scalar = symbols(f'q{r + 1}' for r in range(n))
    u, u_scalar = symbols(f'u{r + 1}' for r in range(n))
    view, parameters = (_exact(model), []) if numbers else parametrised(model)

    M = kane.mass_matrix(view, q_scalar)
    bias = kane.bias_force(view, q_scalar, u_scalar, friction=friction)
    places = [(r, s) for r in range(n) for s in range(r, n)]
    tables = {body.name: np.concatenate([here.partial_angular_velocity @ here.R_wb,
                                         here.partial_velocity @ here.R_wb], axis=1).T
              for body, here in zip(view.bodies, configurations(view, q_scalar))
              if unwrapped(body.inertial.mass) != 0 or np.any(body.inertial.inertia)}
    entries = [*(M[place] for place in places), *bias,
               *(x for table in tables.values() for x in table.ravel())]
    short = iter(shortened([unwrapped(x) for x in entries], q, u, progress=progress))
    if numbers:
        short = map(_rounded, short)
    upper = dict(zip(places, short))
    h = sp.Matrix(list(islice(short, n)))
    partials = {name: sp.Matrix(6, n, list(islice(short, 6 * n))) for name in tables}
    form = ClosedForm(model, q, u, [], sp.Matrix(n, n, lambda r, s: upper[min(r, s), max(r, s)]),
                      h, partials)
    used = set().union(*(matrix.free_symbols for matrix in (form.M, form.bias,
                                                            *partials.values())))
    form.parameters.extend(p for p in parameters if p.symbol in used)
    return form


def as_text(form: ClosedForm, compiled: dict[str, OperationCount]) -> str:
    """Return everything as plain text; `compiled` has the operation counts of the kernels."""
    n = len(form.q)
    lines = [f'{form.model.name}: M(q) udot + bias(q, u) = tau, u = qdot', '']
    lines += [f'{row[0]:6}{row[1]:12}{row[2]}' for row in legend(form)]
    lines += ['', f'M, symmetric, {n} x {n}']
    lines += [f'M{r + 1}{s + 1} = {_plain(form.M[r, s])}' for r in range(n) for s in range(r, n)]
    lines += ['', 'bias']
    lines += [f'bias{r + 1} = {_plain(form.bias[r])}' for r in range(n)]
    lines += ['', f'partial velocities: {CAPTION}']
    for body, table in form.partials.items():
        lines += [f'{symbol}{r + 1} of {body} = {_vector(table[rows, r])}' for r in range(n)
                  for symbol, rows in (('omega', slice(0, 3)), ('v', slice(3, 6)))]
    lines += ['', f'operations: {", ".join(OperationCount.__dataclass_fields__)}']
    for name, count in form.operations().items():
        for kind, counted in (('closed form', count), ('compiled', compiled[name])):
            lines.append(f'{name}, {kind}: ' + ', '.join(map(str, asdict(counted).values())))
    return '\n'.join(lines) + '\n'


def as_latex(form: ClosedForm) -> str:
    """Return mass matrix, bias and partial velocities as LaTeX displays."""
    def latex(value: Any) -> str:
        return str(sp.latex(value, full_prec=False))
    n = len(form.q)
    lines = [r'% ' + '  '.join(row).rstrip() for row in legend(form)]
    lines += [r'\[ M = ' + latex(form.M) + r' \]', r'\[ h = ' + latex(form.bias) + r' \]']
    for body, table in form.partials.items():
        label = rf'\text{{{body}}}'.replace('_', r'\_')
        for r in range(n):
            lines.append(rf'\[ \omega_{{{r + 1}}}^{{{label}}} = {latex(table[:3, r])}, \quad '
                         rf'v_{{{r + 1}}}^{{{label}}} = {latex(table[3:, r])} \]')
    return '\n'.join(lines) + '\n'


CAPTION = 'omega, and v of the center of mass, in the axes of each body'


def as_markdown(form: ClosedForm) -> str:
    """Return the table of partial velocities: one row per speed, two columns per body."""
    header = ['r', *(f'{symbol} of {body}' for body in form.partials for symbol in ('omega', 'v'))]
    rows = [[f'{r + 1}', *(_vector(table[rows, r]) for table in form.partials.values()
                           for rows in (slice(0, 3), slice(3, 6)))] for r in range(len(form.q))]
    lines = [header, ['---'] * len(header), *rows]
    return ''.join(f'| {" | ".join(line)} |\n' for line in lines)


def as_csv(form: ClosedForm) -> str:
    """Return the table of partial velocities: a row for each speed of each body."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator='\n')
    writer.writerow(['speed', 'body', *(f'{symbol}_{axis}' for symbol in ('omega', 'v')
                                        for axis in 'xyz')])
    for body, table in form.partials.items():
        writer.writerows([str(u), body, *map(_plain, table[:, r])] for r, u in enumerate(form.u))
    return stream.getvalue()


def as_data(form: ClosedForm, compiled: dict[str, OperationCount]) -> dict[str, Any]:
    """Return everything as plain data; expressions are texts for SymPy."""
    n = len(form.q)
    return {'joint_names': form.model.joint_names, 'q': list(map(str, form.q)),
            'u': list(map(str, form.u)),
            'parameters': {str(p.symbol): {'value': p.value, 'unit': p.unit, 'meaning': p.meaning}
                           for p in form.parameters},
            'mass_matrix': [[_plain(form.M[r, s]) for s in range(n)] for r in range(n)],
            'bias_force': list(map(_plain, form.bias)),
            'partial_velocities': {body: [[_plain(table[k, r]) for r in range(n)]
                                          for k in range(6)]
                                   for body, table in form.partials.items()},
            'operations': {name: {'closed_form': asdict(count),
                                  'compiled': asdict(compiled[name])}
                           for name, count in form.operations().items()}}


def legend(form: ClosedForm) -> list[tuple[str, str, str]]:
    """Return symbol, value and meaning of coordinates, speeds and parameters."""
    rows = []
    for r, joint in enumerate(form.model.coordinate_joints):
        unit = 'm' if joint.kind == 'prismatic' else 'rad'
        rows.append((f'q{r + 1}', '', f'{joint.name} [{unit}]; u{r + 1} is its rate'))
    return rows + [(str(p.symbol), f'{p.value:.{DIGITS}g}', f'{p.meaning} [{p.unit}]')
                   for p in form.parameters]


def _exact(model: Model) -> Any:
    """Return a model whose parameters are exact SymPy numbers."""
    view, parameters = parametrised(model)
    values = {p.symbol: unwrapped(p.value) for p in parameters}

    def put(value: Any) -> Any:
        if isinstance(value, Symbolic):
            return Symbolic(value.value.xreplace(values))
        if isinstance(value, np.ndarray):
            return np.array([put(x) for x in value.ravel()], dtype=object).reshape(value.shape)
        return value
    for body in view.bodies:
        for part in (body.inertial, body.joint):
            vars(part).update({name: put(value) for name, value in vars(part).items()})
    view.gravity = put(view.gravity)
    return view


def _rounded(expression: Any) -> Any:
    """Return an expression with rounded numbers, except exponents and small fractions."""
    if not expression.args:
        plain = not expression.is_Rational or expression.is_Integer
        return expression if plain else sp.Float(f'{float(expression):.{DIGITS}g}')
    if expression.is_Pow and not expression.free_symbols:
        return sp.Float(f'{float(expression):.{DIGITS}g}')
    if expression.is_Pow:
        return expression.func(_rounded(expression.base), expression.exp)
    return expression.func(*map(_rounded, expression.args))


def _count(expressions: list[Any]) -> OperationCount:
    """Return the operation count of expressions with shared common subexpressions."""
    shared, reduced = sp.cse(expressions)
    return sum((_operations(x) for x in (*(value for _, value in shared), *reduced)),
               OperationCount())


def _operations(x: Any) -> OperationCount:
    """Return the operation count of one expression; signs cost nothing."""
    inner = sum(map(_operations, x.args), OperationCount())
    if x.is_Add:
        return inner + OperationCount(additions=len(x.args) - 1)
    if x.is_Mul:
        return inner + OperationCount(multiplications=len([a for a in x.args if a != -1]) - 1)
    if x.is_Pow:
        divides = x.exp.is_negative
        return inner + OperationCount(multiplications=int(abs(x.exp)) - 1, divisions=int(divides))
    return inner + OperationCount(functions=int(x.is_Function))


def _vector(column: Any) -> str:
    """Return a vector as text: 0, or its three components."""
    return '0' if column.is_zero_matrix else f'({", ".join(map(_plain, column))})'


def _plain(expression: Any) -> str:
    return str(sp.sstr(expression, full_prec=False))
