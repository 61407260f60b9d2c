"""
User-defined functions, such as position(t), value(t), A(q, t) and Y(q, t), over any scalar.

A user-defined function is called with `Unknown` numbers, which hold floats, dual numbers or traced
values. They support arithmetic, comparisons, and the NumPy functions that have a derivative. All
other operations raise an error that names them, also on floats: a decision in Python (an `if`, a
conversion to float) would be compiled with the value that it has during tracing.
"""

from collections.abc import Callable
import math
import numbers
import operator
import re
from typing import Any

from kane_dynamics.errors import ConstraintError, KaneError
from kane_dynamics.mechanics.algebra.dual import derivatives, select
import numpy as np


class NotFiniteError(ConstraintError):
    """A user-defined function that is not finite at a configuration and time."""


class _Unsupported(TypeError):
    """An operation that is not defined for a number whose value is not known."""


def _tan(x: Any) -> Any:
    return np.sin(x) / np.cos(x)


def _cosh(x: Any) -> Any:
    return 0.5 * (np.exp(x) + np.exp(-x))


def _arctan2(y: Any, x: Any) -> Any:
    """Return the angle of (x, y): by y / x near the x axis, by x / y elsewhere."""
    steep = operator.lt(_absolute(x), _absolute(y))
    turned = select(operator.lt(y, 0.0), -math.pi, math.pi)
    flat = np.arctan(y / select(steep, 1.0, x)) + select(operator.lt(x, 0.0), turned, 0.0)
    return select(steep, 0.5 * turned - np.arctan(x / select(steep, y, 1.0)), flat)


def _absolute(x: Any) -> Any:
    return select(operator.lt(x, 0.0), -x, x)


def _minimum(x: Any, y: Any) -> Any:
    return select(operator.lt(y, x), y, x)


def _maximum(x: Any, y: Any) -> Any:
    return select(operator.lt(x, y), y, x)


def _power(x: Any, exponent: Any) -> Any:
    if isinstance(exponent, numbers.Real):
        return np.float64(x) ** exponent if isinstance(x, numbers.Real) else x ** exponent
    if isinstance(x, numbers.Real) and x <= 0.0:
        raise _Unsupported(f'a power of {x} with an exponent that varies')
    return np.exp(exponent * np.log(x))


def _sign(x: Any) -> Any:
    return select(operator.lt(0.0, x), 1.0, select(operator.lt(x, 0.0), -1.0, 0.0))


def _heaviside(x: Any, at_zero: Any) -> Any:
    return select(operator.lt(x, 0.0), 0.0, select(operator.lt(0.0, x), 1.0, at_zero))


# Functions of numpy by name, of numbers that are floats, dual numbers or traced values.
FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: getattr(np, name) for name in (
        'sin', 'cos', 'tanh', 'sqrt', 'exp', 'log', 'arctan', 'floor')},
    'tan': _tan, 'cosh': _cosh, 'sinh': lambda x: np.tanh(x) * _cosh(x),
    'expm1': lambda x: np.tanh(0.5 * x) * (np.exp(x) + 1.0),
    'exp2': lambda x: np.exp(math.log(2.0) * x),
    'log2': lambda x: np.log(x) * (1.0 / math.log(2.0)),
    'log10': lambda x: np.log(x) * (1.0 / math.log(10.0)),
    'arcsin': lambda x: np.arctan(x / np.sqrt((1.0 - x) * (1.0 + x))),
    'arccos': lambda x: 2.0 * np.arctan(np.sqrt((1.0 - x) / (1.0 + x))),
    'arctan2': _arctan2, 'hypot': lambda x, y: np.sqrt(x * x + y * y),
    'absolute': _absolute, 'fabs': _absolute, 'sign': _sign, 'heaviside': _heaviside,
    'minimum': _minimum, 'maximum': _maximum, 'fmin': _minimum, 'fmax': _maximum,
    'square': lambda x: x * x, 'reciprocal': lambda x: 1.0 / x, 'ceil': lambda x: -np.floor(-x),
    'deg2rad': lambda x: x * (math.pi / 180.0), 'radians': lambda x: x * (math.pi / 180.0),
    'rad2deg': lambda x: x * (180.0 / math.pi), 'degrees': lambda x: x * (180.0 / math.pi),
    'add': lambda x, y: x + y, 'subtract': lambda x, y: x - y, 'multiply': lambda x, y: x * y,
    'divide': lambda x, y: x / y, 'negative': lambda x: -x, 'positive': lambda x: x,
    'power': _power, 'float_power': _power, 'remainder': lambda x, y: x - y * np.floor(x / y),
    'floor_divide': lambda x, y: np.floor(x / y), 'conjugate': lambda x: x,
    'less': operator.lt, 'greater': lambda x, y: y < x,
    'less_equal': lambda x, y: 1.0 - (y < x), 'greater_equal': lambda x, y: 1.0 - (x < y),
    'equal': lambda x, y: (1.0 - (y < x)) * (1.0 - (x < y)),
    'not_equal': lambda x, y: 1.0 - (1.0 - (y < x)) * (1.0 - (x < y)),
    'logical_and': lambda x, y: x * y, 'bitwise_and': lambda x, y: x * y,
    'logical_or': lambda x, y: x + y - x * y, 'bitwise_or': lambda x, y: x + y - x * y,
    'logical_not': lambda x: 1.0 - x, 'invert': lambda x: 1.0 - x,
    'where': select, 'clip': lambda x, low, high: _minimum(_maximum(x, low), high),
}
KNOWN = ('arithmetic, powers, comparisons for numpy.where, and of numpy: abs, arccos, arcsin, '
         'arctan, arctan2, ceil, clip, cos, cosh, exp, floor, heaviside, hypot, log, maximum, '
         'minimum, piecewise, polyval, sign, sin, sinh, sqrt, tan, tanh, where')
OPERATORS = {'add': 'add', 'sub': 'subtract', 'mul': 'multiply', 'truediv': 'divide',
             'floordiv': 'floor_divide', 'mod': 'remainder', 'pow': 'power',
             'and': 'bitwise_and', 'or': 'bitwise_or'}
COMPARISONS = {'lt': 'less', 'gt': 'greater', 'le': 'less_equal', 'ge': 'greater_equal',
               'eq': 'equal', 'ne': 'not_equal'}
CONVERSIONS = {'bool': 'a decision of Python (if, and, or, max, min) on a value; use numpy.where, '
                       'numpy.maximum or numpy.minimum', 'float': 'float(), or a function of math',
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
        return Unknown(_absolute(self.inner))

    def __invert__(self) -> Any:
        return Unknown(1.0 - self.inner)

    def __getattr__(self, name: str) -> Any:
        """Return a NumPy function as a method, which NumPy calls on object arrays."""
        if name in FUNCTIONS:
            return lambda *others: _applied(name, (self, *others))
        raise AttributeError(f"no '{name}' of a number that varies")

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        """Apply a NumPy ufunc, entry by entry to arrays."""
        if method != '__call__' or options:
            raise _Unsupported(f'numpy.{ufunc.__name__} with {method} or options')
        return _applied(ufunc.__name__, inputs)

    def __array_function__(self, function: Any, types: Any, arguments: Any, options: Any) -> Any:
        """Apply a NumPy function that is not a ufunc."""
        name = function.__name__
        if options or name not in (*FUNCTIONS, 'polyval', 'piecewise', 'real'):
            raise _Unsupported(f'numpy.{name}{" with options" if options else ""}'
                               + HINTS.get(name, ''))
        if name == 'polyval':
            value: Any = 0.0
            for coefficient in arguments[0]:
                value = value * arguments[1] + coefficient
            return value
        if name == 'piecewise':
            return _piecewise(*arguments)
        return self if name == 'real' else _applied(name, arguments)


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


def _piecewise(x: Any, conditions: Any, functions: Any) -> Any:
    """Return the value of the last true condition, as numpy.piecewise; else the default or 0."""
    conditions = conditions if isinstance(conditions, list | tuple) else [conditions]
    values = [each(x) if callable(each) else each for each in functions]
    value: Any = values[-1] if len(values) > len(conditions) else 0.0
    for condition, each in zip(conditions, values):  # numpy's rule: a later one overrides
        value = _applied('where', (condition, each, value))
    return value


def _applied(name: str, inputs: tuple[Any, ...]) -> Any:
    """Apply a function to numbers, or entry by entry to arrays of numbers."""
    if name not in FUNCTIONS:
        raise _Unsupported(f'numpy.{name}')
    arrays = [x for x in inputs if isinstance(x, np.ndarray) and x.ndim]
    if not arrays:
        return Unknown(FUNCTIONS[name](*map(_inner, inputs)))
    whole = np.broadcast_shapes(*(x.shape for x in arrays))
    result = np.empty(whole, dtype=object)
    spread = [np.broadcast_to(x, whole) if isinstance(x, np.ndarray) else x for x in inputs]
    for k in np.ndindex(whole):
        result[k] = _applied(name, tuple(x[k] if isinstance(x, np.ndarray) else x
                                         for x in spread))
    return result


def _inner(x: Any) -> Any:
    """Return the scalar that a number represents."""
    if isinstance(x, Unknown):
        return float(x.inner) if isinstance(x.inner, bool | np.bool_) else x.inner
    if isinstance(x, np.ndarray) and not x.ndim:
        return _inner(x[()])
    if isinstance(x, numbers.Real | np.bool_):
        return float(x)
    raise _Unsupported(f'{str(x)!r}, where a number is')


def _given(x: Any) -> Any:
    """Return a number, or an array of numbers, as an argument of a user-defined function."""
    if not isinstance(x, np.ndarray) or not x.ndim:
        return Unknown(_inner(x) if isinstance(x, np.ndarray | numbers.Real) else x)
    result = np.empty(x.shape, dtype=object)
    for k in np.ndindex(x.shape):
        result[k] = Unknown(x[k])
    return result


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
        The function uses an unsupported operation, raises an error, or does not return numbers;
        a NotFiniteError if it is not finite there.

    """
    try:
        with np.errstate(all='ignore'):
            given = np.asarray(function(*map(_given, arguments)))
            result = np.empty(given.shape, dtype=object)
            for k in np.ndindex(given.shape):
                result[k] = _inner(given[k])
    except KaneError:
        raise
    except ZeroDivisionError:
        raise NotFiniteError(f'{what} divides by zero at {_shown(arguments)}; expected finite '
                             'numbers') from None
    except Exception as error:  # a user-defined function may raise anything
        used = re.search(r'no callable (\w+) method', str(error))
        if used or isinstance(error, _Unsupported):
            name = f'numpy.{used[1]}' if used else str(error)
            raise ConstraintError(f'{what} uses {name}; expected {KNOWN}') from error
        raise ConstraintError(f'{what} raises {type(error).__name__}: {error}; expected a '
                              f'function of {KNOWN}') from error
    owner, colon, name = what.rpartition(': ')
    for order, returned in enumerate((f'{name} returns', f'the first derivative of {name} is',
                                      f'the second derivative of {name} is')):
        for x in (x for entry in result.ravel() for x in derivatives(entry, order)):
            if isinstance(x, float) and not math.isfinite(x):
                raise NotFiniteError(f'{owner}{colon}{returned} {x} at {_shown(arguments)}; '
                                     'expected finite numbers')
    if all(isinstance(x, float) for x in result.ravel()):
        result = result.astype(np.float64)
    return result if result.shape else result[()]


def _shown(arguments: tuple[Any, ...]) -> str:
    """Return arguments, (q, t) or (t,), for a message."""
    shown = [[_plain(derivatives(y, 0)[0]) for y in np.ravel(x)] for x in arguments]
    configuration = [f'q = {x}, ' for x in shown[:-1]]
    return f'{"".join(configuration)}t = {shown[-1][0]} s'


def _plain(x: Any) -> Any:
    """Return a number without NumPy's type, whose text names it; other scalars unchanged."""
    return float(x) if isinstance(x, numbers.Real) else x


def evaluated_scalar(function: Callable[..., Any], what: str, *arguments: Any) -> Any:
    """Return the value of a user-defined function; ConstraintError unless it is one number."""
    result = evaluated(function, what, *arguments)
    if np.ndim(result):
        raise ConstraintError(f'{what} returns shape {result.shape}; expected a number')
    return result
