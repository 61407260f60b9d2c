"""Mechanics with SymPy symbols: a scalar type, and models with symbolic constants."""

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from kane_dynamics._util.frozen import freeze
from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelError
from kane_dynamics.mechanics.friction import has_dry_friction
from kane_dynamics.model.drive import ElasticJoint, StiffnessCurve
from kane_dynamics.model.model import Body, Joint, Model
import numpy as np
import sympy as sp

AXES = 'xyz'
ROOTS = (sp.sqrt(2) / 2, sp.sqrt(3) / 2, sp.sqrt(2), sp.sqrt(3))


class Symbolic:
    """SymPy expression as a scalar type for the mechanics; its numbers are exact."""

    __slots__ = ('value',)

    def __init__(self, value: Any) -> None:
        """Create a scalar from an expression or a number."""
        if not isinstance(value, sp.Basic):
            value = exact(float(value))
        self.value = value

    def __add__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Symbolic(self.value + unwrapped(other))

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Symbolic(self.value * unwrapped(other))

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> 'Symbolic':
        return Symbolic(-self.value)

    def __sub__(self, other: Any) -> Any:
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Symbolic(self.value / unwrapped(other))

    def __rtruediv__(self, other: Any) -> Any:
        return Symbolic(unwrapped(other) / self.value)

    def __lt__(self, other: Any) -> 'Condition':
        return Condition(self.value < unwrapped(other))

    def __gt__(self, other: Any) -> 'Condition':
        return Condition(self.value > unwrapped(other))

    def sin(self) -> 'Symbolic':
        """Return the sine; numpy.sin calls this on object arrays."""
        return Symbolic(sp.sin(self.value))

    def cos(self) -> 'Symbolic':
        """Return the cosine; numpy.cos calls this on object arrays."""
        return Symbolic(sp.cos(self.value))

    def tanh(self) -> 'Symbolic':
        """Return the hyperbolic tangent; numpy.tanh calls this on object arrays."""
        return Symbolic(sp.tanh(self.value))

    def exp(self) -> 'Symbolic':
        """Return the exponential; numpy.exp calls this on object arrays."""
        return Symbolic(sp.exp(self.value))

    def sqrt(self) -> 'Symbolic':
        """Return the square root; numpy.sqrt calls this on object arrays."""
        return Symbolic(sp.sqrt(self.value))


class Condition:
    """Comparison of SymPy expressions, for `mechanics.algebra.dual.select`."""

    def __init__(self, comparison: Any) -> None:
        """Store a SymPy relation."""
        self.comparison = comparison

    def select(self, x: Any, y: Any) -> Symbolic:
        """Return x if the comparison holds, else y; -y if y < 0, else y, is |y|."""
        first, second = unwrapped(x), unwrapped(y)
        if first == -second and self.comparison == (second < 0):
            return Symbolic(sp.Abs(second))
        return Symbolic(sp.Piecewise((first, self.comparison), (second, True)))


def exact(value: float) -> Any:
    """Return a number as exact SymPy number: its shortest decimal, or a root."""
    for root in ROOTS:
        if abs(abs(value) - float(root)) < 1e-15:
            return root if value > 0.0 else -root
    return sp.Rational(repr(value))


def unwrapped(value: Any) -> Any:
    """Return the SymPy expression of a Symbolic or of a number."""
    return value.value if isinstance(value, Symbolic) else Symbolic(value).value


def symbols(names: Iterable[str], **assumptions: bool) -> tuple[tuple[Any, ...], Any]:
    """Return real SymPy symbols, and an array of them as `Symbolic` scalars."""
    plain = tuple(sp.Symbol(name, real=True, **assumptions) for name in names)
    return plain, np.array([Symbolic(symbol) for symbol in plain], dtype=object)


@dataclass(frozen=True)
class Parameter:
    """Constant of the mechanism and its symbol."""

    symbol: Any
    value: float
    unit: str
    meaning: str


class ParameterSymbols:
    """Symbols for the constants of a model, in the order of their use."""

    def __init__(self) -> None:
        """Create an empty table."""
        self.parameters: dict[str, Parameter] = {}

    def scalar(self, name: str, value: float, unit: str, meaning: str) -> Any:
        """Return 0, or plus or minus a positive symbol."""
        if value == 0.0:
            return 0.0
        symbol = sp.Symbol(name, positive=True)
        parameter = Parameter(symbol, abs(float(value)), unit, meaning)
        self.parameters.setdefault(name, parameter)
        signed = symbol if value > 0.0 else -symbol
        return Symbolic(signed)

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


def parametrised(model: Model) -> tuple[Any, list[Parameter]]:
    """
    Return a model whose constants are symbols, for `mechanics.definition.kane`.

    Parameters
    ----------
    model : Model
        The mechanism.

    Returns
    -------
    model : object
        Object with the attributes of a Model; axes, rotations and multipliers stay
        numbers.
    parameters : list of Parameter
        m mass, r center of mass, I moment of inertia, l place of the joint, k stiffness,
        s rest position, d damping, c quadratic damping, f friction and w its speed, J
        armature, ke and de stiffness and damping of a drive, and others, with the body's
        number.

    Raises
    ------
    ModelError
        If a body is flexible, or a drive has a stiffness curve.

    """
    if model.flexible:
        raise ModelError(f"closed form of '{model.name}': flexible bodies; expected "
                         'rigid bodies')
    table = ParameterSymbols()
    bodies = []
    for number, body in enumerate(model.bodies, 1):
        bodies.append(_unchecked_copy(body, inertial=_inertial(table, number, body),
                                      joint=_joint(table, number, body.joint)))
    # The model's interface as `definition.kane` reads it, with symbols in place of
    # numbers.
    gravity = table.vector('g', model.gravity, 'm/s^2', 'gravity')
    view = SimpleNamespace(n=model.n, bodies=bodies, gravity=gravity, name=model.name,
                           coordinate_names=model.coordinate_names, balls=(),
                           drives=_drives(table, model))
    return view, list(table.parameters.values())


def exact_model(model: Model) -> Any:
    """Return a model as `parametrised` does, with exact numbers in place of symbols."""
    view, parameters = parametrised(model)
    # The numbers of the symbols, as exact ones.
    values = {parameter.symbol: unwrapped(parameter.value) for parameter in parameters}

    def numbers_of(value: Any) -> Any:
        if isinstance(value, Symbolic):
            return Symbolic(value.value.xreplace(values))
        if isinstance(value, np.ndarray):
            entries = [numbers_of(entry) for entry in value.ravel()]
            return np.array(entries, dtype=object).reshape(value.shape)
        return value

    # All constants of the bodies, joints and drives, and gravity.
    parts = [elastic.drive for elastic in view.drives]
    for body in view.bodies:
        parts += [body.inertial, body.joint]
    for part in parts:
        fields = vars(part)
        for name, value in list(fields.items()):
            fields[name] = numbers_of(value)
    view.gravity = numbers_of(view.gravity)
    return view


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
    """Return a joint whose properties are symbols."""
    units = {'revolute': ('rad', 'N m', 'kg m^2'), 'prismatic': ('m', 'N', 'kg')}
    length, force, inertia = units[joint.kind]
    rest_meaning = "spring's rest at"
    if joint.rest < 0.0:
        rest_meaning = f'minus the {rest_meaning}'

    # The symbol's letter, the unit and the meaning of each property.
    letters = {
        'stiffness': ('k', f'{force}/{length}', 'stiffness at'),
        'rest': ('s', length, rest_meaning),
        'damping': ('d', f'{force} s/{length}', 'damping at'),
        'quadratic_damping': ('c', f'{force} s^2/{length}^2', 'quadratic damping at'),
        'friction': ('f', force, 'Coulomb friction at'),
        'friction_backward': ('fb', force, 'Coulomb friction at negative rates at'),
        'breakaway_friction': ('fs', force, 'breakaway friction at'),
        'stribeck_speed': ('ws', f'{length}/s', 'Stribeck speed at'),
        'load_friction': ('e', '', 'load friction at'),
        'load_friction_backdriven': ('eb', '', 'load friction of a driven motor at'),
        'friction_offset': ('b', force, 'friction at rest at'),
        'armature': ('J', inertia, 'armature at')}
    properties: dict[str, Any] = {}
    for name, (letter, unit, meaning) in letters.items():
        value = getattr(joint, name)
        if value is None:  # as in the other direction
            properties[name] = None
            continue
        properties[name] = table.scalar(f'{letter}{number}', value, unit,
                                        f'{meaning} {joint.name}')
    speed: Any = 1.0
    if has_dry_friction(joint):
        speed = table.scalar(f'w{number}', joint.friction_speed, f'{length}/s',
                             f'friction speed at {joint.name}')
    place = table.vector(f'l{number}', joint.translation, 'm',
                         f'position of {joint.name}')
    return _unchecked_copy(joint, translation=place, friction_speed=speed, **properties)


def _drives(table: ParameterSymbols, model: Model) -> tuple[ElasticJoint, ...]:
    """Return the elastic joints, with symbols for stiffness and damping."""
    numbers = {body.joint.name: number for number, body in enumerate(model.bodies, 1)}
    elastic_joints = []
    # Symbols are numbered as the bodies, as those of the joints are.
    for elastic in model.drives:
        drive = elastic.drive
        joint = f'of the drive at {elastic.name}'
        if isinstance(drive.stiffness, StiffnessCurve):
            raise ModelError(f"closed form of '{model.name}': a stiffness curve {joint}; "
                             'expected a constant stiffness')
        number = numbers[elastic.name]
        # Units of a joint that turns, or slides.
        length, force = 'rad', 'N m'
        if elastic.name in model.sliding:
            length, force = 'm', 'N'
        stiffness = table.scalar(f'ke{number}', drive.stiffness, f'{force}/{length}',
                                 f'stiffness {joint}')
        damping = table.scalar(f'de{number}', drive.damping, f'{force} s/{length}',
                               f'damping {joint}')
        symbolic = _unchecked_copy(drive, stiffness=stiffness, damping=damping)
        elastic_joints.append(elastic._replace(drive=symbolic))
    return tuple(elastic_joints)


def _unchecked_copy(record: Any, **symbols: Any) -> Any:
    """Return a copy of a frozen record with symbols in fields that are checked for numbers."""
    result = copy(record)
    for name, value in symbols.items():
        freeze(result, name, value)
    return result
