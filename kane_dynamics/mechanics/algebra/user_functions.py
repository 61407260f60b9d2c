"""
User-defined functions of the configuration and time, over any scalar.

These are, for example, position(t), value(t), A(q, t) and Y(q, t).

A user-defined function is called with `Unknown` numbers, which hold floats, dual numbers
or traced values. They support arithmetic, comparisons, and the NumPy functions that have
a derivative. All other operations raise an error that names them, also on floats: a
decision in Python (an `if`, a conversion to float) would be compiled with the value that
it has during tracing.
"""

from collections.abc import Callable
import math
import numbers
import operator
import re
from typing import Any

from kane_dynamics._util.typing import Scalar
from kane_dynamics.errors import ConstraintError, KaneError
from kane_dynamics.mechanics.algebra.choice import magnitude, select
from kane_dynamics.mechanics.algebra.jet import terms_of_order
import numpy as np


class NotFiniteError(ConstraintError):
    """A user-defined function that is not finite at a configuration and time."""


class _Unsupported(TypeError):
    """An operation that is not defined for a number whose value is not known."""


def _tan(x: Scalar) -> Scalar:
    return np.sin(x) / np.cos(x)


def _cosh(x: Scalar) -> Scalar:
    return 0.5 * (np.exp(x) + np.exp(-x))


def _arctan2(y: Scalar, x: Scalar) -> Scalar:
    """Return the angle of (x, y): by y / x near the x axis, by x / y elsewhere."""
    # With y / x near the x axis, where |x| > |y|, and x / y near the y axis, both
    # arguments are at most 1.
    steep = operator.lt(magnitude(x), magnitude(y))
    half_turn = select(operator.lt(y, 0.0), -math.pi, math.pi)

    # The divisor of the branch that is not taken is 1, so that it has no infinite slope.
    flat = np.arctan(y / select(steep, 1.0, x))
    flat = flat + select(operator.lt(x, 0.0), half_turn, 0.0)
    upright = 0.5 * half_turn - np.arctan(x / select(steep, y, 1.0))
    return select(steep, upright, flat)


def _minimum(x: Scalar, y: Scalar) -> Scalar:
    return select(operator.lt(y, x), y, x)


def _maximum(x: Scalar, y: Scalar) -> Scalar:
    return select(operator.lt(x, y), y, x)


def _clip(x: Scalar, low: Scalar, high: Scalar) -> Scalar:
    return _minimum(_maximum(x, low), high)


def _power(x: Scalar, exponent: Scalar) -> Scalar:
    if isinstance(exponent, numbers.Real):
        # NumPy's power is NaN for a negative base, where Python's is complex.
        if isinstance(x, numbers.Real):
            x = np.float64(x)
        return x ** exponent
    if isinstance(x, numbers.Real) and x <= 0.0:
        raise _Unsupported(f'a power of {x} with an exponent that varies')
    # x^y = exp(y log x).
    return np.exp(exponent * np.log(x))


def _sign(x: Scalar) -> Scalar:
    positive = operator.lt(0.0, x)
    negative = operator.lt(x, 0.0)
    return select(positive, 1.0, select(negative, -1.0, 0.0))


def _heaviside(x: Scalar, at_zero: Scalar) -> Scalar:
    negative = operator.lt(x, 0.0)
    positive = operator.lt(0.0, x)
    return select(negative, 0.0, select(positive, 1.0, at_zero))


# Functions of numpy by name, of numbers that are floats, dual numbers or traced values.
# The first ones are methods of these.
FUNCTIONS: dict[str, Callable[..., Any]] = {
    'sin': np.sin,
    'cos': np.cos,
    'tanh': np.tanh,
    'sqrt': np.sqrt,
    'exp': np.exp,
    'log': np.log,
    'arctan': np.arctan,
    'floor': np.floor,

    # Functions of these.
    'tan': _tan,
    'cosh': _cosh,
    'sinh': lambda x: np.tanh(x) * _cosh(x),
    'expm1': lambda x: np.tanh(0.5 * x) * (np.exp(x) + 1.0),
    'exp2': lambda x: np.exp(math.log(2.0) * x),
    'log2': lambda x: np.log(x) * (1.0 / math.log(2.0)),
    'log10': lambda x: np.log(x) * (1.0 / math.log(10.0)),
    'arcsin': lambda x: np.arctan(x / np.sqrt((1.0 - x) * (1.0 + x))),
    'arccos': lambda x: 2.0 * np.arctan(np.sqrt((1.0 - x) / (1.0 + x))),
    'arctan2': _arctan2,
    'hypot': lambda x, y: np.sqrt(x * x + y * y),
    'square': lambda x: x * x,
    'reciprocal': lambda x: 1.0 / x,
    'ceil': lambda x: -np.floor(-x),
    'deg2rad': lambda x: x * (math.pi / 180.0),
    'radians': lambda x: x * (math.pi / 180.0),
    'rad2deg': lambda x: x * (180.0 / math.pi),
    'degrees': lambda x: x * (180.0 / math.pi),

    # Arithmetic.
    'add': lambda x, y: x + y,
    'subtract': lambda x, y: x - y,
    'multiply': lambda x, y: x * y,
    'divide': lambda x, y: x / y,
    'negative': lambda x: -x,
    'positive': lambda x: x,
    'power': _power,
    'float_power': _power,
    'remainder': lambda x, y: x - y * np.floor(x / y),
    'floor_divide': lambda x, y: np.floor(x / y),
    'conjugate': lambda x: x,

    # Comparisons: 1 if true, else 0; logic by arithmetic of these.
    'less': operator.lt,
    'greater': lambda x, y: y < x,
    'less_equal': lambda x, y: 1.0 - (y < x),
    'greater_equal': lambda x, y: 1.0 - (x < y),
    'equal': lambda x, y: (1.0 - (y < x)) * (1.0 - (x < y)),
    'not_equal': lambda x, y: 1.0 - (1.0 - (y < x)) * (1.0 - (x < y)),
    'logical_and': lambda x, y: x * y,
    'bitwise_and': lambda x, y: x * y,
    'logical_or': lambda x, y: x + y - x * y,
    'bitwise_or': lambda x, y: x + y - x * y,
    'logical_not': lambda x: 1.0 - x,
    'invert': lambda x: 1.0 - x,

    # Choices by a comparison.
    'where': select,
    'clip': _clip,
    'absolute': magnitude,
    'fabs': magnitude,
    'sign': _sign,
    'heaviside': _heaviside,
    'minimum': _minimum,
    'maximum': _maximum,
    'fmin': _minimum,
    'fmax': _maximum,
}
KNOWN = ('arithmetic, powers, comparisons for numpy.where, and of numpy: abs, arccos, '
         'arcsin, arctan, arctan2, ceil, clip, cos, cosh, exp, floor, heaviside, hypot, '
         'log, maximum, minimum, piecewise, polyval, sign, sin, sinh, sqrt, tan, tanh, '
         'where')

# Methods of Python's operators, by the function of numpy.
OPERATORS = {'add': 'add', 'sub': 'subtract', 'mul': 'multiply', 'truediv': 'divide',
             'floordiv': 'floor_divide', 'mod': 'remainder', 'pow': 'power',
             'and': 'bitwise_and', 'or': 'bitwise_or'}
COMPARISONS = {'lt': 'less', 'gt': 'greater', 'le': 'less_equal', 'ge': 'greater_equal',
               'eq': 'equal', 'ne': 'not_equal'}

# Methods of Python's conversions, and what calls them.
CONVERSIONS = {'bool': 'a decision of Python (if, and, or, max, min) on a value; use '
                       'numpy.where, numpy.maximum or numpy.minimum',
               'float': 'float(), or a function of math',
               'int': 'int()', 'index': 'an index that varies', 'round': 'round()',
               'complex': 'complex()', 'hash': 'a dictionary or set of values'}
HINTS = {'interp': ', whose velocity jumps; give Prescribed a Motion or a table instead'}


class Unknown:
    """Argument of a user-defined function; `inner` is the scalar that it represents."""

    __slots__ = ('inner',)

    def __init__(self, inner: Any) -> None:
        """Represent a float, a dual number or a traced value."""
        self.inner = inner

    def __neg__(self) -> Any:
        return Unknown(-self.inner)

    def __pos__(self) -> Any:
        return self

    def __abs__(self) -> Any:
        return Unknown(magnitude(self.inner))

    def __invert__(self) -> Any:
        return Unknown(1.0 - self.inner)

    def __getattr__(self, name: str) -> Any:
        """Return a NumPy function as a method, which NumPy calls on object arrays."""
        if name in FUNCTIONS:
            return lambda *operands: _applied(name, (self, *operands))
        raise AttributeError(f"no '{name}' of a number that varies")

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any,
                        **options: Any) -> Any:
        """Apply a NumPy ufunc, entry by entry to arrays."""
        if method != '__call__' or options:
            raise _Unsupported(f'numpy.{ufunc.__name__} with {method} or options')
        return _applied(ufunc.__name__, inputs)

    def __array_function__(self, function: Any, types: Any, arguments: Any,
                           options: Any) -> Any:
        """Apply a NumPy function that is not a ufunc."""
        name = function.__name__
        # Of functions that are no ufuncs, these three also work on arrays of `Unknown`.
        if options or name not in (*FUNCTIONS, 'polyval', 'piecewise', 'real'):
            with_options = ' with options' if options else ''
            raise _Unsupported(f'numpy.{name}{with_options}' + HINTS.get(name, ''))
        # Two are evaluated by operations of `Unknown` itself; `real` changes nothing.
        if name == 'polyval':
            return _polyval(*arguments)
        if name == 'piecewise':
            return _piecewise(*arguments)
        if name == 'real':
            return self
        return _applied(name, arguments)


def _install(name: str, function: str) -> None:
    """Add an operator and its reflected form to `Unknown`."""
    def applied(self: Unknown, other: Any) -> Any:
        return _applied(function, (self, other))

    def reflected(self: Unknown, other: Any) -> Any:
        return _applied(function, (other, self))
    setattr(Unknown, f'__{name}__', applied)
    if name not in COMPARISONS:
        setattr(Unknown, f'__r{name}__', reflected)


def _refuse(name: str, what: str) -> None:
    """Make a conversion of `Unknown` raise an error that names it."""
    def conversion(self: Unknown, *_: Any) -> Any:
        raise _Unsupported(what)
    setattr(Unknown, f'__{name}__', conversion)


for _name, _function in {**OPERATORS, **COMPARISONS}.items():
    _install(_name, _function)
for _name, _what in CONVERSIONS.items():
    _refuse(_name, _what)


def _polyval(coefficients: Any, x: Any) -> Any:
    """Return the value of a polynomial, its highest power first, as numpy.polyval."""
    value: Any = 0.0
    # Horner's rule.
    for coefficient in coefficients:
        value = value * x + coefficient
    return value


def _piecewise(x: Any, conditions: Any, functions: Any) -> Any:
    """Return the value of the last true condition, else the default."""
    if not isinstance(conditions, list | tuple):
        conditions = [conditions]
    values = []
    for function in functions:
        values.append(function(x) if callable(function) else function)

    # The default is the value without a condition, or 0.
    value: Any = 0.0
    if len(values) > len(conditions):
        value = values[-1]

    # NumPy's rule: a later condition overrides earlier ones.
    for condition, piece in zip(conditions, values):
        value = _applied('where', (condition, piece, value))
    return value


def _applied(name: str, inputs: tuple[Any, ...]) -> Any:
    """Apply a function to numbers, or entry by entry to arrays of numbers."""
    if name not in FUNCTIONS:
        raise _Unsupported(f'numpy.{name}')
    shapes = [x.shape for x in inputs if isinstance(x, np.ndarray) and x.ndim]
    if not shapes:
        return Unknown(FUNCTIONS[name](*map(_inner, inputs)))

    # Entry by entry of the common shape; numbers count for every entry.
    shape = np.broadcast_shapes(*shapes)
    operands = [_broadcast(x, shape) for x in inputs]
    result = np.empty(shape, dtype=object)
    for k in np.ndindex(shape):
        entries = []
        for x in operands:
            entries.append(x[k] if isinstance(x, np.ndarray) else x)
        result[k] = _applied(name, tuple(entries))
    return result


def _broadcast(x: Any, shape: tuple[int, ...]) -> Any:
    """Return an array of a shape, or a number unchanged."""
    return np.broadcast_to(x, shape) if isinstance(x, np.ndarray) else x


def _inner(x: Any) -> Scalar:
    """Return the scalar that a number represents."""
    if isinstance(x, Unknown):
        # A comparison of numbers is 1 or 0, as one of traced values is.
        is_flag = isinstance(x.inner, bool | np.bool_)
        return float(x.inner) if is_flag else x.inner
    if isinstance(x, np.ndarray) and not x.ndim:
        return _inner(x[()])
    if isinstance(x, numbers.Real | np.bool_):
        return float(x)
    raise _Unsupported(f'{str(x)!r}, where a number is')


def _argument(x: Any) -> Any:
    """Return a number or an array of them as argument of a user-defined function."""
    if isinstance(x, np.ndarray) and x.ndim:
        result = np.empty(x.shape, dtype=object)
        for k in np.ndindex(x.shape):
            result[k] = Unknown(x[k])
        return result
    if isinstance(x, np.ndarray | numbers.Real):
        return Unknown(_inner(x))
    return Unknown(x)


def evaluated(function: Callable[..., Any], what: str, *arguments: Any) -> Any:
    """
    Return the value of a user-defined function, a scalar or an array of scalars.

    Parameters
    ----------
    function : callable
        Of `Unknown` numbers.
    what : str
        What it is, for errors: "constraint 'shaker': position(t)".
    *arguments : scalars or arrays of scalars
        Over any scalar.

    Raises
    ------
    ConstraintError
        The function uses an unsupported operation, raises an error, or does not return
        numbers; a NotFiniteError if it is not finite there.

    """
    try:
        with np.errstate(all='ignore'):
            returned = np.asarray(function(*map(_argument, arguments)))
            result = np.empty(returned.shape, dtype=object)
            for k in np.ndindex(returned.shape):
                result[k] = _inner(returned[k])
    except KaneError:
        raise
    except ZeroDivisionError:
        raise NotFiniteError(f'{what} divides by zero at {_shown(arguments)}; expected '
                             'finite numbers') from None
    except Exception as error:  # a user-defined function may raise anything
        raise ConstraintError(_failure(what, error)) from error
    _require_finite(result, what, arguments)

    # Floats where nothing is traced or dual.
    if all(isinstance(x, float) for x in result.ravel()):
        result = result.astype(np.float64)
    return result if result.shape else result[()]


def _failure(what: str, error: Exception) -> str:
    """Return the message about an error that a user-defined function has raised."""
    # NumPy calls a method of the entries of an object array for functions that it knows.
    method = re.search(r'no callable (\w+) method', str(error))
    if method:
        return f'{what} uses numpy.{method[1]}; expected {KNOWN}'
    if isinstance(error, _Unsupported):
        return f'{what} uses {error}; expected {KNOWN}'
    return (f'{what} raises {type(error).__name__}: {error}; expected a function of '
            f'{KNOWN}')


def _require_finite(result: Any, what: str, arguments: tuple[Any, ...]) -> None:
    """Raise NotFiniteError if an entry or one of two derivatives is not finite."""
    # `what` ends with the function's name, after its constraint's.
    owner, colon, name = what.rpartition(': ')
    quantities = (f'{name} returns', f'the first derivative of {name} is',
                  f'the second derivative of {name} is')
    for order, quantity in enumerate(quantities):
        for entry in result.ravel():
            for x in terms_of_order(entry, order):
                if isinstance(x, float) and not math.isfinite(x):
                    raise NotFiniteError(f'{owner}{colon}{quantity} {x} at '
                                         f'{_shown(arguments)}; expected finite numbers')


def _shown(arguments: tuple[Any, ...]) -> str:
    """Return arguments, (q, t) or (t,), for a message."""
    values = []
    for argument in arguments:
        # The value of each entry, whatever derivatives it carries.
        values.append([_plain(terms_of_order(x, 0)[0]) for x in np.ravel(argument)])
    *configuration, (t,) = values
    if not configuration:
        return f't = {t} s'
    q, = configuration
    return f'q = {q}, t = {t} s'


def _plain(x: Scalar) -> Scalar:
    """Return a number without NumPy's type, which its text names; or the scalar."""
    return float(x) if isinstance(x, numbers.Real) else x


def evaluated_scalar(function: Callable[..., Any], what: str, *arguments: Any) -> Any:
    """Return the value of a function; ConstraintError unless it is one number."""
    result = evaluated(function, what, *arguments)
    if np.ndim(result):
        raise ConstraintError(f'{what} returns shape {result.shape}; expected a number')
    return result
