"""
Dual numbers: forward-mode automatic differentiation by time, over any scalar type.

A number a + b d with d d = 0 holds a value a and its time derivative b; arithmetic on it
applies the rules of differentiation exactly. Value and rate may be numbers, traced
values or symbols. So tracing a user-defined function of q and t once yields its value
and its time derivative.
"""

from collections.abc import Callable, Sequence
import numbers
from typing import Any

from kane_dynamics._util.typing import Scalar
from kane_dynamics.mechanics.algebra.jet import chosen, Jet
from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np


class Dual:
    """Dual number: a scalar and its time derivative. `moving` creates arrays of them."""

    __slots__ = ('value', 'rate')

    def __init__(self, value: Scalar, rate: Scalar) -> None:
        """Create a dual number from its value and rate."""
        self.value = value
        self.rate = rate

    def __repr__(self) -> str:
        """Return the value and the rate as text."""
        return f'Dual({self.value!r}, {self.rate!r})'

    def __add__(self, other: Any) -> Any:
        if isinstance(other, Dual):
            return _dual(self.value + other.value, self.rate + other.rate)
        # NumPy then calls this operator with every entry of the array.
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Dual(self.value + other, self.rate)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Dual):
            # (x y)' = x y' + x' y.
            product = self.value * other.value
            return _dual(product, self.value * other.rate + self.rate * other.value)
        if isinstance(other, np.ndarray):
            return NotImplemented
        return _dual(self.value * other, self.rate * other)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> 'Dual':
        return Dual(-self.value, -self.rate)

    def __pos__(self) -> 'Dual':
        return self

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, Dual):
            # With z = x / y: z' = (x' - z y') / y.
            quotient = self.value / other.value
            return _dual(quotient, (self.rate - quotient * other.rate) / other.value)
        if isinstance(other, np.ndarray):
            return NotImplemented
        return _dual(self.value / other, self.rate / other)

    def __rtruediv__(self, other: Any) -> Any:
        # With z = c / x: z' = -z x' / x.
        quotient = other / self.value
        return _dual(quotient, -(quotient * self.rate) / self.value)

    def __pow__(self, exponent: Any) -> Any:
        if not isinstance(exponent, numbers.Real):
            return NotImplemented
        # x^0 is the constant 1, also at 0, where the slope below would not be finite.
        if exponent == 0:
            return 1.0
        # (x^p)' = p x^(p - 1) x'.
        power = _power(self.value, exponent)
        slope = exponent * _power(self.value, exponent - 1)
        return _dual(power, slope * self.rate)

    def __lt__(self, other: Any) -> Any:
        return self.value < _value(other)

    def __gt__(self, other: Any) -> Any:
        return self.value > _value(other)

    def sin(self) -> Any:
        """Return the sine; numpy.sin calls this on object arrays."""
        return _dual(np.sin(self.value), np.cos(self.value) * self.rate)

    def cos(self) -> Any:
        """Return the cosine; numpy.cos calls this on object arrays."""
        return _dual(np.cos(self.value), -(np.sin(self.value) * self.rate))

    def tanh(self) -> Any:
        """Return the hyperbolic tangent; numpy.tanh calls this on object arrays."""
        y = np.tanh(self.value)
        return _dual(y, (1.0 - y * y) * self.rate)

    def sqrt(self) -> Any:
        """Return the square root; numpy.sqrt calls this on object arrays."""
        y = np.sqrt(self.value)
        return _dual(y, self.rate / (y + y))

    def exp(self) -> Any:
        """Return the exponential; numpy.exp calls this on object arrays."""
        y = np.exp(self.value)
        return _dual(y, y * self.rate)

    def log(self) -> Any:
        """Return the natural logarithm; numpy.log calls this on object arrays."""
        return _dual(np.log(self.value), self.rate / self.value)

    def arctan(self) -> Any:
        """Return the arctangent; numpy.arctan calls this on object arrays."""
        return _dual(np.arctan(self.value), self.rate / (1.0 + self.value * self.value))

    def __floor__(self) -> Any:
        """Return the floor, a constant; numpy.floor calls this on object arrays."""
        return np.floor(self.value)


def select(condition: Scalar, x: Scalar, y: Scalar) -> Scalar:
    """Return x if a comparison (`a < b`, over any scalar) holds, else y."""
    if isinstance(condition, bool | int | float | np.bool_):
        return x if condition else y
    if isinstance(x, Dual) or isinstance(y, Dual):
        # Value and rate are those of the same branch.
        value = select(condition, _value(x), _value(y))
        return _dual(value, select(condition, _rate(x), _rate(y)))
    if isinstance(x, Jet) or isinstance(y, Jet):
        return chosen(condition, x, y, select)
    if isinstance(condition, np.ndarray):  # of many numbers
        return np.where(condition, x, y)
    return condition.select(x, y)


def magnitude(x: Scalar) -> Scalar:
    """Return the magnitude of a number, over any scalar."""
    return select(x < 0.0, -x, x)


def largest(values: Sequence[Scalar]) -> Scalar:
    """Return the largest of several numbers, over any scalar."""
    if len(values) == 1:
        return values[0]
    a = largest(values[::2])
    b = largest(values[1::2])
    return select(a < b, b, a)


def smallest(values: Sequence[Scalar]) -> Scalar:
    """Return the smallest of several numbers, over any scalar."""
    if len(values) == 1:
        return values[0]
    # In pairs, so that the comparisons do not wait for each other.
    a = smallest(values[::2])
    b = smallest(values[1::2])
    return select(b < a, b, a)


def _power(x: Scalar, exponent: Any) -> Scalar:
    """Return a power; NaN for a negative base with a non-integer exponent."""
    if isinstance(x, float | int):
        with np.errstate(all='ignore'):
            return np.float64(x) ** exponent
    return x ** exponent


def _value(x: Scalar) -> Scalar:
    """Return the value of a scalar that may be Dual."""
    return x.value if isinstance(x, Dual) else x


def _rate(x: Scalar) -> Scalar:
    """Return the time derivative of a scalar; zero if it is not Dual."""
    return x.rate if isinstance(x, Dual) else 0.0


def _dual(value: Scalar, rate: Scalar) -> Scalar:
    """Return a Dual, or only the value if the rate is structurally zero."""
    return value if is_zero(rate) else Dual(value, rate)


def moving(values: Any, rates: Any) -> Any:
    """Return dual numbers with these values and rates; any shape, or one scalar."""
    values = np.asarray(values, dtype=object)
    rates = np.asarray(rates, dtype=object)
    result = np.empty(values.shape, dtype=object)
    for k in np.ndindex(result.shape):
        result[k] = _dual(values[k], rates[k])
    return result if result.shape else result[()]


def values(array: Any) -> Any:
    """Return the values of an array of scalars, some of which may be Dual."""
    return _part(array, _value)


def rates(array: Any) -> Any:
    """Return the time derivatives of an array of scalars; zero if they are not Dual."""
    return _part(array, _rate)


def derivatives(x: Scalar, order: int) -> list[Scalar]:
    """Return the parts of a scalar that are its derivatives of an order (0: value)."""
    if not isinstance(x, Dual):
        return [] if order else [x]
    if not order:
        return derivatives(x.value, 0)
    # In nested dual numbers, what `order` rates lead to is a derivative of that order.
    return derivatives(x.value, order) + derivatives(x.rate, order - 1)


def _part(array: Any, take: Callable[[Scalar], Scalar]) -> Any:
    """Return a part of every entry, as floats where all are."""
    source = np.asarray(array, dtype=object)
    result = np.empty(source.shape, dtype=object)
    for k in np.ndindex(source.shape):
        result[k] = take(source[k])
    try:
        return result.astype(np.float64)
    except TypeError:  # traced values and symbols are not converted
        return result
