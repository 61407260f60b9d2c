"""The mechanics on SymPy symbols: a scalar, a model whose constants are symbols, short forms."""

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

MOST_SHORTENED = 200  # terms: the search for a shorter form of more takes minutes
ROOTS = (sp.sqrt(2) / 2, sp.sqrt(3) / 2, sp.sqrt(2), sp.sqrt(3))


class Symbolic:
    """A SymPy expression as a scalar of the mechanics; numbers in it are exact."""

    __slots__ = ('value',)

    def __init__(self, value: Any) -> None:
        """Take an expression or a number."""
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
        """Return the sine: numpy's sin calls this."""
        return Symbolic(sp.sin(self.value))

    def cos(self) -> 'Symbolic':
        """Return the cosine: numpy's cos calls this."""
        return Symbolic(sp.cos(self.value))

    def tanh(self) -> 'Symbolic':
        """Return the hyperbolic tangent: numpy's tanh calls this."""
        return Symbolic(sp.tanh(self.value))

    def sqrt(self) -> 'Symbolic':
        """Return the square root: numpy's sqrt calls this."""
        return Symbolic(sp.sqrt(self.value))


def exact(value: float) -> Any:
    """Return a number as SymPy's: what its shortest decimal says, or a root that it rounds."""
    for root in ROOTS:
        if abs(abs(value) - float(root)) < 1e-15:
            return root if value > 0.0 else -root
    return sp.Rational(repr(value))


def unwrapped(value: Any) -> Any:
    """Return the SymPy expression of a Symbolic or of a number."""
    return value.value if isinstance(value, Symbolic) else Symbolic(value).value


def symbols(names: Iterable[str], **assumptions: bool) -> tuple[tuple[Any, ...], Any]:
    """Return SymPy symbols, real, and an array of them as scalars of the mechanics."""
    plain = tuple(sp.Symbol(name, real=True, **assumptions) for name in names)
    return plain, np.array([Symbolic(symbol) for symbol in plain], dtype=object)


@dataclass(frozen=True)
class Parameter:
    """A constant of the mechanism that has a symbol."""

    symbol: Any
    value: float
    unit: str
    meaning: str


class Parameters:
    """Symbols for the constants of a model, one for each size, in the order of their use."""

    def __init__(self) -> None:
        """Start without any."""
        self.found: dict[str, Parameter] = {}

    def scalar(self, name: str, value: float, unit: str, meaning: str) -> Any:
        """Return 0, or plus or minus a positive symbol."""
        if value == 0.0:
            return 0.0
        symbol = sp.Symbol(name, positive=True)
        self.found.setdefault(name, Parameter(symbol, abs(float(value)), unit, meaning))
        return Symbolic(symbol if value > 0.0 else -symbol)

    def vector(self, name: str, values: Any, unit: str, meaning: str) -> Any:
        """Return a vector; its components have their axis in the name where there are several."""
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
                part = ('-' if values[i, j] < 0.0 else '') + 'xyz'[i] + 'xyz'[j]
                result[i, j] = result[j, i] = self.scalar(name + suffix, values[i, j], 'kg m^2',
                                                          f'{meaning}, {part}')
        return result


def parametrised(model: Model) -> tuple[Any, list[Parameter]]:
    """
    Return a model whose constants are symbols, for the functions of `mechanics.kane`.

    Parameters
    ----------
    model : Model
        The mechanism.

    Returns
    -------
    model : object
        With the attributes of a Model; axes, rotations and multipliers stay numbers.
    parameters : list of Parameter
        m mass, r mass centre, I moment of inertia, l place of the joint, k stiffness, s rest
        position, d damping, f friction and w its speed, J armature, with the body's number.

    Raises
    ------
    ModelError
        A body of it bends.

    """
    if model.flexible:
        raise ModelError(f"model '{model.name}' bends: closed forms are of rigid bodies")
    given = Parameters()
    g = model.gravity
    bodies = [SimpleNamespace(name=body.name, parent=body.parent,
                              inertial=_inertial(given, k + 1, body),
                              joint=_joint(given, k + 1, body.joint), beam=None)
              for k, body in enumerate(model.bodies)]
    gravity = given.vector('g', g, 'm/s^2', 'gravity')
    return (SimpleNamespace(n=model.n, bodies=bodies, gravity=gravity, name=model.name,
                            coordinate_names=model.coordinate_names), list(given.found.values()))


def _inertial(given: Parameters, k: int, body: Body) -> Any:
    own = body.inertial
    return SimpleNamespace(
        mass=given.scalar(f'm{k}', own.mass, 'kg', f'mass of {body.name}'),
        com=given.vector(f'r{k}', own.com, 'm', f'mass centre of {body.name}'),
        inertia=given.tensor(f'I{k}', own.inertia, f'central moment of inertia of {body.name}'))


def _joint(given: Parameters, k: int, joint: Joint) -> Any:
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
                          f'speed at which friction sets in at {joint.name}')
             if joint.friction else 1.0)
    place = given.vector(f'l{k}', joint.translation, 'm', f'place of {joint.name}')
    return SimpleNamespace(name=joint.name, kind=joint.kind, axis=joint.axis,
                           rotation=joint.rotation, translation=place,
                           coordinate=joint.coordinate, multiplier=joint.multiplier,
                           offset=joint.offset, friction_speed=speed, deflection=None,
                           **values)


def shortened(expressions: Sequence[Any], q: Iterable[Any], u: Iterable[Any] = (), *,
              progress: Callable[[float], object] = lambda done: None) -> list[Any]:
    """
    Return expressions in a short form: sin^2 + cos^2 folded, or angles summed.

    Parameters
    ----------
    expressions : sequence of SymPy expressions
        In sines and cosines of q, and polynomial in u (tanh of it apart).
    q, u : symbols
        Coordinates and speeds; the coefficient of each product of speeds is shortened by itself,
        and left multiplied out where it has more than `MOST_SHORTENED` terms.
    progress : callable
        Called with the share of the expressions that is done.

    Raises
    ------
    InputError
        An expression has too many terms.

    """
    angles, polynomials, short = list(q), Polynomials(expressions), []
    speeds = [*u, *(x for x in polynomials.generators if isinstance(x, sp.tanh))]
    for done, expression in enumerate(expressions):
        parts = polynomials.by(polynomials.of(expression), speeds)
        short.append(sp.Add(*(product * _short(part, angles) for product, part in parts.items())))
        progress((done + 1) / len(expressions))
    return short


def _short(polynomial: Any, q: list[Any]) -> Any:
    """Return the shorter of a polynomial in sines and cosines of q, and in those of sums."""
    products = polynomial.as_expr()
    if len(polynomial) > MOST_SHORTENED:
        return products
    sums = sp.expand(TR8(products))
    for x in q:
        products = min(products, _lowered(products, sp.cos(x), sp.sin(x)), key=sp.count_ops)
    return min(map(sp.factor_terms, (products, sums)), key=sp.count_ops)


def _lowered(expression: Any, high: Any, low: Any) -> Any:
    """Return a polynomial in which high^2 is replaced by 1 - low^2."""
    terms = sp.Poly(expression, high, domain='EX').terms()
    return sp.expand(sp.Add(*(coefficient * high**(k % 2) * (1 - low**2)**(k // 2)
                              for (k,), coefficient in terms)))
