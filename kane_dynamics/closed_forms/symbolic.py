"""Mechanics with SymPy symbols: a scalar type, and models with symbolic constants."""

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
import numbers
import operator
from typing import Any

from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array
from kane_dynamics.closed_forms.polynomials import as_polynomial
from kane_dynamics.errors import ModelError
from kane_dynamics.mechanics.constraints.mechanism import Mechanism
from kane_dynamics.mechanics.definition import kane
from kane_dynamics.model.drive import StiffnessCurve
from kane_dynamics.model.model import Body, Joint
import numpy as np
import sympy as sp

AXES = 'xyz'
UNITS = {'revolute': ('N m', 'rad', 'kg m^2'), 'prismatic': ('N', 'm', 'kg')}
LETTERS = {  # of joints, drives and constraints: letter, unit (F, L, I: `UNITS`), meaning
    'stiffness': ('k', 'F/L', 'stiffness'),
    'rest': ('s', 'L', "spring's rest"),
    'damping': ('d', 'F s/L', 'damping'),
    'fast_damping': ('df', 'F s/L', 'damping at high rates'),
    'damping_speed': ('wd', 'L/s', 'damping speed'),
    'friction': ('f', 'F', 'Coulomb friction'),
    'friction_backward': ('fb', 'F', 'Coulomb friction at negative rates'),
    'friction_speed': ('w', 'L/s', 'friction speed'),
    'breakaway_friction': ('fs', 'F', 'breakaway friction'),
    'stribeck_speed': ('ws', 'L/s', 'Stribeck speed'),
    'friction_offset': ('b', 'F', 'friction at rest'),
    'armature': ('J', 'I', 'armature'),
    'radius': ('R', 'm', 'radius'),
    'height': ('h', 'm', 'height'),
    'surface_radius': ('Rs', 'm', 'surface radius'),
    'length': ('L', 'm', 'length'),
    'value': ('v', 'm/s or rad/s', 'value')}
ROOTS = (sp.sqrt(2) / 2, sp.sqrt(3) / 2, sp.sqrt(2), sp.sqrt(3))


def _operator(operation: Callable[[Any, Any], Any]) -> Any:
    """Return the method of an operator with another scalar."""
    def method(self: 'Symbolic', other: Any) -> Any:
        if not isinstance(other, Symbolic | numbers.Real | sp.Expr):
            return NotImplemented  # an array, whose entries come one by one
        return scalar(operation(self.value, unwrapped(other)))
    return method


def _function(function: Callable[[Any], Any]) -> Any:
    """Return the method of a function, which numpy calls on object arrays."""
    def method(self: 'Symbolic') -> Any:
        return scalar(function(self.value))
    return method


class Symbolic:
    """SymPy expression as a scalar type for the mechanics; its numbers are exact."""

    __slots__ = ('value',)

    def __init__(self, value: Any) -> None:
        """Create a scalar from an expression or a number."""
        if not isinstance(value, sp.Basic):
            value = exact(float(value))
        self.value = value

    def __lt__(self, other: Any) -> 'Condition':
        return Condition(self.value, unwrapped(other))

    def __gt__(self, other: Any) -> 'Condition':
        return Condition(unwrapped(other), self.value)

    __add__ = __radd__ = _operator(operator.add)
    __mul__ = __rmul__ = _operator(operator.mul)
    __sub__ = _operator(operator.sub)
    __rsub__ = _operator(lambda x, y: y - x)
    __truediv__ = _operator(operator.truediv)
    __rtruediv__ = _operator(lambda x, y: y / x)
    __pow__ = _operator(operator.pow)
    __neg__ = _function(operator.neg)
    __pos__ = _function(operator.pos)
    __floor__ = _function(sp.floor)
    sin = _function(sp.sin)
    cos = _function(sp.cos)
    tanh = _function(sp.tanh)
    exp = _function(sp.exp)
    log = _function(sp.log)
    arctan = _function(sp.atan)
    sqrt = _function(lambda x: sp.sqrt(as_polynomial(x)))


def scalar(expression: Any) -> Any:
    """Return an expression as a scalar; 0 and units as numbers, zero by structure."""
    if expression in (-1, 0, 1):
        return float(expression)
    return Symbolic(expression)


class Condition:
    """Comparison of SymPy expressions, for `mechanics.algebra.choice.select`."""

    def __init__(self, smaller: Any, larger: Any) -> None:
        """Store the two sides of smaller < larger."""
        self.smaller = smaller
        self.larger = larger

    def select(self, x: Any, y: Any) -> Any:
        """Return x if the comparison holds, else y; -y if y < 0, else y, is |y|."""
        first, second = unwrapped(x), unwrapped(y)
        if first == -second and (self.smaller, self.larger) == (second, 0):
            return scalar(sp.Abs(second))
        comparison = sp.StrictLessThan(self.smaller, self.larger, evaluate=False)
        return Symbolic(sp.Piecewise((first, comparison), (second, True),
                                     evaluate=False))


@cache
def exact(value: float) -> Any:
    """Return a number as exact SymPy number: its shortest decimal, or a root."""
    for root in ROOTS:
        if abs(abs(value) - float(root)) < 1e-15:
            return root if value > 0.0 else -root
    return sp.Rational(repr(value))


def unwrapped(value: Any) -> Any:
    """Return the SymPy expression of a Symbolic or of a number."""
    return value.value if isinstance(value, Symbolic) else Symbolic(value).value


def as_matrix(array: Any) -> Any:
    """Return an array of scalars as a SymPy matrix; a vector as a column."""
    entries = np.asarray(array, dtype=object)
    rows, columns = entries.shape if entries.ndim == 2 else (len(entries), 1)
    return sp.Matrix(rows, columns, [unwrapped(x) for x in entries.ravel()])


def as_scalars(matrix: Any) -> Any:
    """Return a SymPy matrix as an array of scalars."""
    entries = np.array([scalar(x) for x in matrix], dtype=object)
    return entries.reshape(matrix.shape)


def symbols(names: Iterable[str]) -> tuple[tuple[Any, ...], Any]:
    """Return real SymPy symbols, and an array of them as `Symbolic` scalars."""
    plain = tuple(sp.Symbol(name, real=True) for name in names)
    return plain, np.array([Symbolic(symbol) for symbol in plain], dtype=object)


@dataclass(frozen=True)
class Parameter:
    """Constant of the mechanism and its symbol."""

    symbol: Any
    value: float
    unit: str
    meaning: str


class ParameterSymbols:
    """Symbols, or exact numbers, for the constants of a model, in the order of use."""

    def __init__(self, numbers: bool = False) -> None:
        """Create an empty table."""
        self.numbers = numbers
        self.parameters: dict[str, Parameter] = {}

    def scalar(self, name: str, value: float, unit: str, meaning: str) -> Any:
        """Return 0, or plus or minus a positive symbol, or the exact number."""
        if value == 0.0:
            return 0.0
        if self.numbers:
            return scalar(exact(float(value)))
        symbol = sp.Symbol(name, positive=True)
        parameter = Parameter(symbol, abs(float(value)), unit, meaning)
        self.parameters.setdefault(name, parameter)
        signed = symbol if value > 0.0 else -symbol
        return Symbolic(signed)

    def used(self, symbols: Any) -> list[Parameter]:
        """Return the parameters that are among some symbols."""
        return [p for p in self.parameters.values() if p.symbol in symbols]

    def vector(self, name: str, values: Any, unit: str, meaning: str) -> Any:
        """Return a vector; the names of several nonzero components contain the axis."""
        has_several = np.count_nonzero(values) > 1
        components = []
        for axis, value in zip(AXES, values, strict=True):
            suffix = axis if has_several else ''
            sign = '-' if value < 0.0 else ''
            components.append(self.scalar(name + suffix, value, unit,
                                          f'{meaning}, along {sign}{axis}'))
        return np.array(components, dtype=object)

    def tensor(self, name: str, values: Any, meaning: str) -> Any:
        """Return a symmetric tensor; moments that are equal share a symbol."""
        result = np.zeros((3, 3), dtype=object)
        for i in range(3):
            result[i, i] = self._moment(name, np.diag(values), i, meaning)
            for j in range(i + 1, 3):
                sign = '-' if values[i, j] < 0.0 else ''
                pair = AXES[i] + AXES[j]
                result[i, j] = result[j, i] = self.scalar(
                    name + pair, values[i, j], 'kg m^2', f'{meaning}, {sign}{pair}')
        return result

    def _moment(self, name: str, moments: Array, i: int, meaning: str) -> Any:
        """Return a moment of inertia, under one symbol with those that equal it."""
        equal_axes = [k for k in range(3) if moments[k] == moments[i]]
        nonzero = moments[moments != 0.0]
        # One symbol for all moments needs no axis; else it has that of its last one.
        only_one_value = len(set(nonzero.tolist())) == 1
        suffix = '' if only_one_value else 2 * AXES[max(equal_axes)]
        axes = ' and '.join(2 * AXES[k] for k in equal_axes)
        return self.scalar(name + suffix, moments[i], 'kg m^2', f'{meaning}, {axes}')


def symbolic_mechanism(mechanism: Mechanism, table: ParameterSymbols,
                       auxiliary: Sequence[str] = ()) -> Mechanism:
    """
    Return a mechanism whose constants are symbols, for `mechanics.definition`.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism of numbers.
    table : ParameterSymbols
        Receives the symbols with the body's number: m mass, r center of mass, I moment of
        inertia, l place of the joint, `LETTERS` with e behind them for a drive; p place
        of a frame. Axes, rotations, multipliers and beams stay numbers.
    auxiliary : sequence of str
        Joints of auxiliary speeds, whose bodies have the number of the body before.

    Raises
    ------
    ModelError
        If a drive has a stiffness curve.

    """
    model = mechanism.model
    bodies = []
    number = 0
    for body in model.bodies:
        number += body.joint.name not in auxiliary
        bodies.append(_unchecked_copy(body, inertial=_inertial(table, number, body),
                                      joint=_joint(table, number, body.joint)))
    frames = []
    for number, frame in enumerate(model.frames, 1):
        place = table.vector(f'p{number}', frame.translation, 'm',
                             f'position of {frame.name}')
        frames.append(_unchecked_copy(frame, translation=place))
    view = _unchecked_copy(
        model, bodies=tuple(bodies), frames=tuple(frames),
        gravity=table.vector('g', model.gravity, 'm/s^2', 'gravity'))
    for name in ('drives', 'coordinate_joints'):  # kept with the numbers
        view.__dict__.pop(name, None)

    # The speeds are functions of the numbers' model, which for these alone has masses.
    result = copy(mechanism)
    result.model = view
    if mechanism.speeds.key == 'momenta':
        result.speeds = replace(mechanism.speeds, Y=lambda q, t: kane.mass_matrix(view, q))
    result.constraints = tuple(
        _with_symbols(table, constraint, f'{number}', f'of {constraint.name}')
        for number, constraint in enumerate(mechanism.constraints, 1))
    result._rolling = result._wheels_with_surface_rows()
    return result


def _with_symbols(table: ParameterSymbols, record: Any, number: str, owner: str,
                  kind: str = 'revolute') -> Any:
    """Return a joint, drive or constraint with symbols for its numbers."""
    force, length, inertia = UNITS[kind]
    fields = {}
    for name, (letter, unit, meaning) in LETTERS.items():
        value = getattr(record, name, None)
        if isinstance(value, numbers.Real):
            unit = unit.replace('F', force).replace('L', length).replace('I', inertia)
            sign = 'minus the ' if value < 0 else ''
            fields[name] = table.scalar(letter + number, float(value), unit,
                                        f'{sign}{meaning} {owner}')
    return _unchecked_copy(record, **fields)


def _inertial(table: ParameterSymbols, number: int, body: Body) -> Any:
    """Return the inertial properties of a body as symbols."""
    inertial = body.inertial
    return _unchecked_copy(
        inertial,
        mass=table.scalar(f'm{number}', inertial.mass, 'kg', f'mass of {body.name}'),
        com=table.vector(f'r{number}', inertial.com, 'm',
                         f'center of mass of {body.name}'),
        inertia=table.tensor(f'I{number}', inertial.inertia,
                             f'central moment of inertia of {body.name}'))


def _joint(table: ParameterSymbols, number: int, joint: Joint) -> Any:
    """Return a joint, with its drive, whose properties are symbols."""
    result = _with_symbols(table, joint, f'{number}', f'at {joint.name}', joint.kind)
    place = table.vector(f'l{number}', joint.translation, 'm',
                         f'position of {joint.name}')
    freeze(result, 'translation', place)
    if joint.drive is not None:
        owner = f'of the drive at {joint.name}'
        if isinstance(joint.drive.stiffness, StiffnessCurve):
            raise ModelError(f'derivation: a stiffness curve {owner}; expected a constant '
                             'stiffness')
        freeze(result, 'drive',
               _with_symbols(table, joint.drive, f'e{number}', owner, joint.kind))
    return result


def _unchecked_copy(record: Any, **symbols: Any) -> Any:
    """Return a copy of a frozen record with symbols in fields that are checked for numbers."""
    result = copy(record)
    for name, value in symbols.items():
        freeze(result, name, value)
    return result
