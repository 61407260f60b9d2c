"""The equations of motion of a small mechanism in closed form, and their size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from kane_dynamics._util.checks import instance
from kane_dynamics.closed_forms.polynomials import shortened
from kane_dynamics.closed_forms.symbolic import (
    exact_model, Parameter, parametrised, symbols, unwrapped)
from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.ball_joints import require_angles
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.mechanics.definition.kinematics import configurations
from kane_dynamics.mechanics.friction import refuse_load_friction
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
        """Return operation counts of mass matrix and bias, subexpressions shared."""
        upper = [self.M[place] for place in _upper_triangle(len(self.q))]
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
    instance(model, Model, 'model')
    require_angles(model, 'closed form')
    if friction:
        refuse_load_friction(model, f"closed form of '{model.name}'")
    n = model.n
    if not 0 < n <= MOST:
        raise InputError(f"closed form of '{model.name}': {n} coordinates; expected 1 "
                         f'to {MOST}: choose fewer with --joints, --base or --tip')
    q, q_scalar = symbols(f'q{r + 1}' for r in range(n))
    u, u_scalar = symbols(f'u{r + 1}' for r in range(n))
    parameters: list[Parameter] = []
    if numbers:
        view = exact_model(model)
    else:
        view, parameters = parametrised(model)

    # Kane's equations as the textbook defines them, over symbols.
    M = kane.mass_matrix(view, q_scalar)
    bias = kane.bias_force(view, q_scalar, u_scalar, friction=friction)
    tables = _partial_velocities(view, q_scalar)

    # All entries are shortened together, because their polynomials share the generators.
    upper = _upper_triangle(n)
    entries = [M[place] for place in upper]
    entries += list(bias)
    for table in tables.values():
        entries += list(table.ravel())
    expressions = list(map(unwrapped, entries))
    short = shortened(expressions, q, u, progress=progress)
    if numbers:
        short = list(map(_rounded, short))

    # Back to matrices: M, then the bias, then a table for each body.
    by_place = dict(zip(upper, short, strict=False))
    matrix = sp.Matrix(n, n, lambda r, s: by_place[min(r, s), max(r, s)])
    begin = len(upper)
    h = sp.Matrix(short[begin:begin + n])
    begin += n
    partials = {}
    for body in tables:
        partials[body] = sp.Matrix(6, n, short[begin:begin + 6 * n])
        begin += 6 * n

    # The parameters that appear.
    used = set(matrix.free_symbols | h.free_symbols)
    for table in partials.values():
        used |= table.free_symbols
    appearing = [parameter for parameter in parameters if parameter.symbol in used]
    return ClosedForm(model, q, u, appearing, matrix, h, partials)


def _partial_velocities(view: Any, q: Any) -> dict[str, Any]:
    """Return the partial velocities of bodies with mass, (6, n), in their own axes."""
    tables = {}
    for body, configuration in zip(view.bodies, configurations(view, q), strict=True):
        if unwrapped(body.inertial.mass) == 0 and not np.any(body.inertial.inertia):
            continue
        angular = configuration.partial_angular_velocity @ configuration.R_wb
        linear = configuration.partial_velocity @ configuration.R_wb
        tables[body.name] = np.concatenate([angular, linear], axis=1).T
    return tables


def _upper_triangle(n: int) -> list[tuple[int, int]]:
    """Return the places of the upper triangle, row by row."""
    return [(r, s) for r in range(n) for s in range(r, n)]


def _rounded(expression: Any) -> Any:
    """Return an expression with its fractions and roots rounded, but no exponents."""
    if not expression.args:
        is_fraction = expression.is_Rational and not expression.is_Integer
        return _decimal(expression) if is_fraction else expression
    if expression.is_Pow and not expression.free_symbols:
        return _decimal(expression)
    if expression.is_Pow:
        return expression.func(_rounded(expression.base), expression.exp)
    return expression.func(*map(_rounded, expression.args))


def _decimal(number: Any) -> Any:
    """Return a number with few digits."""
    return sp.Float(f'{float(number):.{DIGITS}g}')


def _count(expressions: list[Any]) -> OperationCount:
    """Return the operation count of expressions with shared common subexpressions."""
    shared, reduced = sp.cse(expressions)
    total = OperationCount()
    for _, value in shared:
        total += _operations(value)
    for expression in reduced:
        total += _operations(expression)
    return total


def _operations(x: Any) -> OperationCount:
    """Return the operation count of one expression; signs cost nothing."""
    inner = sum(map(_operations, x.args), OperationCount())
    if x.is_Add:
        return inner + OperationCount(additions=len(x.args) - 1)
    if x.is_Mul:
        factors = [factor for factor in x.args if factor != -1]
        return inner + OperationCount(multiplications=len(factors) - 1)
    if x.is_Pow:
        return inner + OperationCount(multiplications=int(abs(x.exp)) - 1,
                                      divisions=int(x.exp.is_negative))
    return inner + OperationCount(functions=int(x.is_Function))
