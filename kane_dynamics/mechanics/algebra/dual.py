"""
Scalars that carry their time derivative: differentiation of any function, over any scalar.

A number a + b d with d d = 0 holds a value and its rate; arithmetic on it follows the rules of
differentiation exactly. Value and rate may themselves be numbers, traced values or symbols, so
one user-given function of q and t yields, traced once, both itself and its derivative in time.
"""

from collections.abc import Callable
from typing import Any

from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np


class Dual:
    """A scalar and its time derivative; `moving` makes them from arrays."""

    __slots__ = ('value', 'rate')

    def __init__(self, value: Any, rate: Any) -> None:
        """Keep the two parts."""
        self.value = value
        self.rate = rate

    def __repr__(self) -> str:
        """Show the two parts."""
        return f'Dual({self.value!r}, {self.rate!r})'

    def __add__(self, other: Any) -> Any:
        if isinstance(other, Dual):
            return _made(self.value + other.value, self.rate + other.rate)
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Dual(self.value + other, self.rate)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Dual):
            return _made(self.value * other.value,
                         self.value * other.rate + self.rate * other.value)
        if isinstance(other, np.ndarray):
            return NotImplemented
        return _made(self.value * other, self.rate * other)

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
            quotient = self.value / other.value
            return _made(quotient, (self.rate - quotient * other.rate) / other.value)
        if isinstance(other, np.ndarray):
            return NotImplemented
        return _made(self.value / other, self.rate / other)

    def __rtruediv__(self, other: Any) -> Any:
        quotient = other / self.value
        return _made(quotient, -(quotient * self.rate) / self.value)

    def __pow__(self, exponent: Any) -> Any:
        if not isinstance(exponent, int) or exponent < 0:
            return NotImplemented
        result: Any = 1.0
        for _ in range(exponent):
            result = result * self
        return result

    def sin(self) -> Any:
        """Return the sine: numpy's sin calls this."""
        return _made(np.sin(self.value), np.cos(self.value) * self.rate)

    def cos(self) -> Any:
        """Return the cosine: numpy's cos calls this."""
        return _made(np.cos(self.value), -(np.sin(self.value) * self.rate))

    def tanh(self) -> Any:
        """Return the hyperbolic tangent: numpy's tanh calls this."""
        y = np.tanh(self.value)
        return _made(y, (1.0 - y * y) * self.rate)

    def sqrt(self) -> Any:
        """Return the square root: numpy's sqrt calls this."""
        y = np.sqrt(self.value)
        return _made(y, self.rate / (y + y))


def _made(value: Any, rate: Any) -> Any:
    """Return a Dual, or the value alone where it is constant by structure."""
    return value if is_zero(rate) else Dual(value, rate)


def moving(values: Any, rates: Any) -> Any:
    """Return scalars, an array of any shape or a single one, that change at the given rates."""
    result = np.empty(np.shape(values), dtype=object)
    for k in np.ndindex(result.shape):
        result[k] = _made(np.asarray(values, dtype=object)[k], np.asarray(rates, dtype=object)[k])
    return result if result.shape else result[()]


def values(array: Any) -> Any:
    """Return the values of an array of scalars, some of which may be Dual."""
    return _part(array, lambda x: x.value if isinstance(x, Dual) else x)


def rates(array: Any) -> Any:
    """Return the time derivatives of an array of scalars; those that are not Dual rest."""
    return _part(array, lambda x: x.rate if isinstance(x, Dual) else 0.0)


def _part(array: Any, take: Callable[[Any], Any]) -> Any:
    source = np.asarray(array, dtype=object)
    result = np.empty(source.shape, dtype=object)
    for k in np.ndindex(source.shape):
        result[k] = take(source[k])
    try:
        return result.astype(np.float64)
    except TypeError:  # traced values or symbols stay what they are
        return result
