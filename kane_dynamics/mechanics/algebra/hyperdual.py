"""
Hyper-dual numbers: automatic differentiation to first and mixed second derivatives.

A number a + g.e + b d + h.e d with e_i e_j = 0 and d d = 0 holds a value a, its gradient g with
respect to k variables, its directional derivative b (for example, by time), and the gradient h of
b. The derivatives are exact to rounding. Source: Fike & Alonso, AIAA 2011-886; here one of the two
infinitesimals is a vector.
"""

import math
import numbers
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array
import numpy as np


class HyperDual:
    """
    Hyper-dual number: a scalar with its first and mixed second derivatives.

    Parameters
    ----------
    value : float
    gradient : (k,) array
        Derivatives with respect to the k variables.
    rate : float
        Derivative along the direction.
    gradient_rate : (k,) array
        Derivatives of the rate with respect to the k variables.

    """

    __slots__ = ('value', 'gradient', 'rate', 'gradient_rate')

    def __init__(self, value: float, gradient: Array, rate: float,
                 gradient_rate: Array) -> None:
        """Create a hyper-dual number from its four parts."""
        self.value = value
        self.gradient = gradient
        self.rate = rate
        self.gradient_rate = gradient_rate

    def __repr__(self) -> str:
        """Return the four parts as text."""
        return (f'HyperDual({self.value}, {self.gradient.tolist()}, {self.rate}, '
                f'{self.gradient_rate.tolist()})')

    def __add__(self, other: Any) -> Any:
        """Return the sum."""
        if isinstance(other, HyperDual):
            return HyperDual(self.value + other.value, self.gradient + other.gradient,
                             self.rate + other.rate, self.gradient_rate + other.gradient_rate)
        if isinstance(other, np.ndarray):
            return NotImplemented
        return HyperDual(self.value + other, self.gradient, self.rate, self.gradient_rate)

    def __mul__(self, other: Any) -> Any:
        """Return the product, by the product rule."""
        if isinstance(other, HyperDual):
            a, b = self, other
            return HyperDual(
                a.value * b.value, a.value * b.gradient + b.value * a.gradient,
                a.value * b.rate + b.value * a.rate,
                a.value * b.gradient_rate + b.value * a.gradient_rate
                + b.rate * a.gradient + a.rate * b.gradient)
        if isinstance(other, np.ndarray):
            return NotImplemented
        return HyperDual(self.value * other, self.gradient * other, self.rate * other,
                         self.gradient_rate * other)

    def __truediv__(self, other: Any) -> Any:
        """Return the quotient."""
        if isinstance(other, HyperDual):
            return self * other._reciprocal()
        if isinstance(other, np.ndarray):
            return NotImplemented
        return self * (1.0 / other)

    def __rtruediv__(self, other: Any) -> Any:
        """Return a number divided by this one."""
        return other * self._reciprocal()

    def __pow__(self, exponent: Any) -> Any:
        """Return a real power."""
        if not isinstance(exponent, numbers.Real):
            return NotImplemented
        x, p = np.float64(self.value), float(exponent)
        with np.errstate(all='ignore'):
            return self._mapped(*(
                float(factor * x ** power) if factor else 0.0 for factor, power in (
                    (1.0, p), (p, p - 1.0), (p * (p - 1.0), p - 2.0))))

    def __lt__(self, other: Any) -> bool:
        """Compare the values."""
        return bool(self.value < (other.value if isinstance(other, HyperDual) else other))

    def __gt__(self, other: Any) -> bool:
        """Compare the values."""
        return bool(self.value > (other.value if isinstance(other, HyperDual) else other))

    __radd__ = __add__
    __rmul__ = __mul__

    def __pos__(self) -> 'HyperDual':
        """Return the number itself."""
        return self

    def __neg__(self) -> 'HyperDual':
        """Return the negative."""
        return HyperDual(-self.value, -self.gradient, -self.rate, -self.gradient_rate)

    def __sub__(self, other: Any) -> Any:
        """Return the difference."""
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        """Return a number minus this one."""
        return -self + other

    def sin(self) -> 'HyperDual':
        """Return the sine; numpy.sin calls this on object arrays."""
        s, c = math.sin(self.value), math.cos(self.value)
        return self._mapped(s, c, -s)

    def cos(self) -> 'HyperDual':
        """Return the cosine; numpy.cos calls this on object arrays."""
        s, c = math.sin(self.value), math.cos(self.value)
        return self._mapped(c, -s, -c)

    def tanh(self) -> 'HyperDual':
        """Return the hyperbolic tangent; numpy.tanh calls this on object arrays."""
        y = math.tanh(self.value)
        return self._mapped(y, 1.0 - y * y, -2.0 * y * (1.0 - y * y))

    def sqrt(self) -> 'HyperDual':
        """Return the square root; numpy.sqrt calls this on object arrays."""
        y = math.sqrt(self.value) if self.value >= 0.0 else math.nan
        return self._mapped(y, 0.5 / y, -0.25 / (y * self.value))

    def exp(self) -> 'HyperDual':
        """Return the exponential; numpy.exp calls this on object arrays."""
        y = math.exp(self.value)
        return self._mapped(y, y, y)

    def log(self) -> 'HyperDual':
        """Return the natural logarithm; numpy.log calls this on object arrays."""
        y = 1.0 / self.value
        value = math.log(self.value) if self.value > 0.0 else math.nan
        return self._mapped(value, y, -y * y)

    def arctan(self) -> 'HyperDual':
        """Return the arctangent; numpy.arctan calls this on object arrays."""
        slope = 1.0 / (1.0 + self.value * self.value)
        return self._mapped(math.atan(self.value), slope, -2.0 * self.value * slope * slope)

    def __floor__(self) -> float:
        """Return the floor, a constant; numpy.floor calls this on object arrays."""
        return float(math.floor(self.value))

    def _reciprocal(self) -> 'HyperDual':
        y = 1.0 / self.value
        return self._mapped(y, -y * y, 2.0 * y * y * y)

    def _mapped(self, value: float, first: float, second: float) -> 'HyperDual':
        """Apply the chain rule for a function with this value and these two derivatives."""
        return HyperDual(value, first * self.gradient, first * self.rate,
                         first * self.gradient_rate + (second * self.rate) * self.gradient)


def seeded(values: Any, rates: Any, first: int, count: int) -> Any:
    """
    Return independent variables as an array of HyperDual.

    Parameters
    ----------
    values, rates : (m,) arrays of float
        The variables and their derivatives along the direction.
    first : int
        Index of the first one among all variables of differentiation.
    count : int
        Number of variables of differentiation.

    """
    unit = np.eye(count)
    result = np.empty(len(values), dtype=object)
    result[:] = [HyperDual(float(x), unit[first + i], float(r), np.zeros(count))
                 for i, (x, r) in enumerate(zip(values, rates))]
    return result


def lifted(value: Any, count: int) -> HyperDual:
    """Return a scalar as a HyperDual of `count` variables; a plain number is constant."""
    if isinstance(value, HyperDual):
        return value
    return HyperDual(float(value), np.zeros(count), 0.0, np.zeros(count))


class Parts(NamedTuple):
    """Arrays of the four parts; the last axis of the gradients runs over the variables."""

    value: Array
    gradient: Array
    rate: Array
    gradient_rate: Array


def parts(array: Any, count: int) -> Parts:
    """Return the parts of an array of scalars of any shape; plain numbers are constant."""
    source = np.asarray(array, dtype=object)
    scalars = [lifted(x, count) for x in source.ravel()]
    of_scalar, of_gradient = source.shape, (*source.shape, count)
    return Parts(np.array([x.value for x in scalars], dtype=float).reshape(of_scalar),
                 np.array([x.gradient for x in scalars], dtype=float).reshape(of_gradient),
                 np.array([x.rate for x in scalars], dtype=float).reshape(of_scalar),
                 np.array([x.gradient_rate for x in scalars], dtype=float).reshape(of_gradient))


def joined(given: Parts) -> Any:
    """Return an array of HyperDual with these parts; the inverse of `parts`."""
    result = np.empty(given.value.shape, dtype=object)
    for k in np.ndindex(result.shape):
        result[k] = HyperDual(float(given.value[k]), given.gradient[k], float(given.rate[k]),
                              given.gradient_rate[k])
    return result
