"""Mechanics with SymPy symbols: scalar type, symbolic models, simplification."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from kane_dynamics.cli.equations.polynomials import Polynomials
from kane_dynamics.errors import ModelError
from kane_dynamics.model.model import Body, Joint, Model
import numpy as np
import sympy as sp
from sympy.simplify.fu import TR8

MOST_SHORTENED = 200  # terms; simplifying more takes minutes
ROOTS = (sp.sqrt(2) / 2, sp.sqrt(3) / 2, sp.sqrt(2), sp.sqrt(3))


class Symbolic:
    """SymPy expression as a scalar type for the mechanics; its numbers are exact."""

    __slots__ = ('value',)

    def __init__(self, value: Any) -> None:
        """Create a scalar from an expression or a number."""
        self.value = value if isinstance(value, sp.Basic) else exact(float(value))

    def __add__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Symbolic(self.value + unwrapped(other))

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Symbolic(self.value * unwrapped(other))

    __radd__, __rmul__ = __add__, __mul__

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

    def sin(self) -> 'Symbolic':
        """Return the sine; numpy.sin calls this on object arrays."""
        return Symbolic(sp.sin(self.value))

    def cos(self) -> 'Symbolic':
        """Return the cosine; numpy.cos calls this on object arrays."""
        return Symbolic(sp.cos(self.value))

    def tanh(self) -> 'Symbolic':
        """Return the hyperbolic tangent; numpy.tanh calls this on object arrays."""
        return Symbolic(sp.tanh(self.value))

    def sqrt(self) -> 'Symbolic':
        """Return the square root; numpy.sqrt calls this on object arrays."""
        return Symbolic(sp.sqrt(self.value))


def exact(value: float) -> Any:
    """Return a number as exact SymPy number: its shortest decimal, or a root that it rounds."""
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
        """Create an empty collection."""
        self.found: dict[str, Parameter] = {}

    def scalar(self, name: str, value: float, unit: str, meaning: str) -> Any:
        """Return 0, or plus or minus a positive symbol."""
        if value == 0.0:
            return 0.0
        symbol = sp.Symbol(name, positive=True)
        self.found.setdefault(name, Parameter(symbol, abs(float(value)), unit, meaning))
        return Symbolic(symbol if value > 0.0 else -symbol)

    def vector(self, name: str, values: Any, unit: str, meaning: str) -> Any:
        """Return a vector; the names of several nonzero components contain the axis."""
        several = np.count_nonzero(values) > 1
        return np.array([self.scalar(name + (axis if several else ''), value, unit,
                                     f'{meaning}, along {"-" if value < 0.0 else ""}{axis}')
                         for axis, value in zip('xyz', values)], dtype=object)

    def tensor(self, name: str, values: Any, meaning: str) -> Any:
        """Return a symmetric tensor; moments that are equal share a symbol."""
        result = np.zeros((3, 3), dtype=object)
        moments = np.diag(values)
        alike = len(set(moments[moments != 0.0].tolist())) == 1
        for i in range(3):
            for j in range(i, 3):
                twin = max(k for k in range(3) if moments[k] == moments[i]) if i == j else j
                suffix = '' if alike and i == j else 'xyz'[twin if i == j else i] + 'xyz'[twin]
                shared = [k for k in range(3) if moments[k] == moments[i]] if i == j else []
                part = ' and '.join(2 * 'xyz'[k] for k in shared) or (
                    ('-' if values[i, j] < 0.0 else '') + 'xyz'[i] + 'xyz'[j])
                result[i, j] = result[j, i] = self.scalar(name + suffix, values[i, j], 'kg m^2',
                                                          f'{meaning}, {part}')
        return result


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
        Object with the attributes of a Model; axes, rotations and multipliers stay numbers.
    parameters : list of Parameter
        m mass, r center of mass, I moment of inertia, l place of the joint, k stiffness, s rest
        position, d damping, f friction and w its speed, J armature, with the body's number.

    Raises
    ------
    ModelError
        If a body is flexible.

    """
    if model.flexible:
        raise ModelError(f"closed form of '{model.name}': flexible bodies; expected rigid bodies")
    given = ParameterSymbols()
    g = model.gravity
    bodies = [SimpleNamespace(name=body.name, parent=body.parent,
                              inertial=_inertial(given, k + 1, body),
                              joint=_joint(given, k + 1, body.joint), beam=None)
              for k, body in enumerate(model.bodies)]
    gravity = given.vector('g', g, 'm/s^2', 'gravity')
    return (SimpleNamespace(n=model.n, bodies=bodies, gravity=gravity, name=model.name,
                            coordinate_names=model.coordinate_names, balls=()),
            list(given.found.values()))


def _inertial(given: ParameterSymbols, k: int, body: Body) -> Any:
    own = body.inertial
    return SimpleNamespace(
        mass=given.scalar(f'm{k}', own.mass, 'kg', f'mass of {body.name}'),
        com=given.vector(f'r{k}', own.com, 'm', f'center of mass of {body.name}'),
        inertia=given.tensor(f'I{k}', own.inertia, f'central moment of inertia of {body.name}'))


def _joint(given: ParameterSymbols, k: int, joint: Joint) -> Any:
    length, force = ('m', 'N') if joint.kind == 'prismatic' else ('rad', 'N m')
    inertia = 'kg' if joint.kind == 'prismatic' else 'kg m^2'
    one = {
        'stiffness': ('k', f'{force}/{length}', 'stiffness at'),
        'rest': ('s', length, ('minus the ' if joint.rest < 0.0 else '') + "spring's rest at"),
        'damping': ('d', f'{force} s/{length}', 'damping at'),
        'friction': ('f', force, 'Coulomb friction at'),
        'friction_offset': ('b', force, 'friction at rest at'),
        'armature': ('J', inertia, 'armature at')}
    values = {name: given.scalar(f'{letter}{k}', getattr(joint, name), unit,
                                 f'{meaning} {joint.name}')
              for name, (letter, unit, meaning) in one.items()}
    speed = (given.scalar(f'w{k}', joint.friction_speed, f'{length}/s',
                          f'friction speed at {joint.name}')
             if joint.friction else 1.0)
    place = given.vector(f'l{k}', joint.translation, 'm', f'position of {joint.name}')
    return SimpleNamespace(name=joint.name, kind=joint.kind, axis=joint.axis,
                           rotation=joint.rotation, translation=place,
                           coordinate=joint.coordinate, multiplier=joint.multiplier,
                           offset=joint.offset, friction_speed=speed, deflection=None,
                           **values)


def shortened(expressions: Sequence[Any], q: Iterable[Any], u: Iterable[Any] = (), *,
              progress: Callable[[float], object] = lambda done: None) -> list[Any]:
    """
    Return simplified expressions, with sin^2 + cos^2 = 1 and sums of angles applied.

    Parameters
    ----------
    expressions : sequence of SymPy expressions
        Expressions in sines and cosines of q, polynomial in u and tanh(u).
    q, u : symbols
        Coordinates and speeds; the coefficient of each product of speeds is simplified by itself,
        and left expanded if it has more than `MOST_SHORTENED` terms.
    progress : callable
        Called with the finished fraction of the expressions.

    Raises
    ------
    InputError
        If an expression has too many terms.

    """
    angles, polynomials, short = list(q), Polynomials(expressions), []
    speeds = [*u, *(x for x in polynomials.generators if isinstance(x, sp.tanh))]
    for done, expression in enumerate(expressions):
        parts = polynomials.by(polynomials.of(expression), speeds)
        short.append(sp.Add(*(product * _short(part, angles) for product, part in parts.items())))
        progress((done + 1) / len(expressions))
    return short


def _short(polynomial: Any, q: list[Any]) -> Any:
    """Return the shorter form of a polynomial: in sines and cosines of q, or of sums of q."""
    products = polynomial.as_expr()
    if len(polynomial) > MOST_SHORTENED:
        return products
    sums = sp.expand(TR8(products))
    for x in q:
        products = min(products, _lowered(products, sp.cos(x), sp.sin(x)), key=sp.count_ops)
    return min(map(sp.factor_terms, (products, sums)), key=sp.count_ops)


def _lowered(expression: Any, high: Any, low: Any) -> Any:
    """Return a polynomial with high^2 replaced by 1 - low^2."""
    terms = sp.Poly(expression, high, domain='EX').terms()
    return sp.expand(sp.Add(*(coefficient * high**(k % 2) * (1 - low**2)**(k // 2)
                              for (k,), coefficient in terms)))
