"""
Hyper-dual numbers: automatic differentiation to first and mixed second derivatives.

A number a + g.e + b d + h.e d with e_i e_j = 0 and d d = 0 holds a value a, its gradient
g with respect to k variables, its directional derivative b (for example, by time), and
the gradient h of b. The derivatives are exact to rounding. Source: Fike & Alonso, AIAA
2011-886; here one of the two infinitesimals is a vector.
"""

import math
import numbers
from typing import Any, NamedTuple

from kane_dynamics._util.typing import Array, Scalar, Vector
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
            return HyperDual(self.value + other.value,
                             self.gradient + other.gradient,
                             self.rate + other.rate,
                             self.gradient_rate + other.gradient_rate)
        if isinstance(other, np.ndarray):
            return NotImplemented
        return HyperDual(self.value + other, self.gradient, self.rate,
                         self.gradient_rate)

    def __mul__(self, other: Any) -> Any:
        """Return the product, by the product rule."""
        if isinstance(other, HyperDual):
            return _product(self, other)
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
        # x^p with its derivatives p x^(p - 1) and p (p - 1) x^(p - 2).
        x = np.float64(self.value)
        p = float(exponent)
        value = _scaled_power(1.0, x, p)
        first = _scaled_power(p, x, p - 1.0)
        second = _scaled_power(p * (p - 1.0), x, p - 2.0)
        return self._mapped(value, first, second)

    def __lt__(self, other: Any) -> bool:
        """Compare the values."""
        return bool(self.value < _value(other))

    def __gt__(self, other: Any) -> bool:
        """Compare the values."""
        return bool(self.value > _value(other))

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
        s = math.sin(self.value)
        c = math.cos(self.value)
        return self._mapped(s, c, -s)

    def cos(self) -> 'HyperDual':
        """Return the cosine; numpy.cos calls this on object arrays."""
        s = math.sin(self.value)
        c = math.cos(self.value)
        return self._mapped(c, -s, -c)

    def tanh(self) -> 'HyperDual':
        """Return the hyperbolic tangent; numpy.tanh calls this on object arrays."""
        y = math.tanh(self.value)
        # y' = 1 - y^2, y'' = -2 y y'.
        return self._mapped(y, 1.0 - y * y, -2.0 * y * (1.0 - y * y))

    def sqrt(self) -> 'HyperDual':
        """Return the square root; numpy.sqrt calls this on object arrays."""
        # NaN, as of NumPy, where the function of `math` raises an error.
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
        # y' = 1 / (1 + x^2), y'' = -2 x y'^2.
        slope = 1.0 / (1.0 + self.value * self.value)
        second = -2.0 * self.value * slope * slope
        return self._mapped(math.atan(self.value), slope, second)

    def __floor__(self) -> float:
        """Return the floor, a constant; numpy.floor calls this on object arrays."""
        return float(math.floor(self.value))

    def _reciprocal(self) -> 'HyperDual':
        # y' = -1 / x^2, y'' = 2 / x^3.
        y = 1.0 / self.value
        return self._mapped(y, -y * y, 2.0 * y * y * y)

    def _mapped(self, value: float, first: float, second: float) -> 'HyperDual':
        """Apply the chain rule for a function with this value and two derivatives."""
        # The gradient of f'(x) b is f' h + f'' b g.
        gradient_rate = first * self.gradient_rate + (second * self.rate) * self.gradient
        return HyperDual(value, first * self.gradient, first * self.rate, gradient_rate)


def _product(a: HyperDual, b: HyperDual) -> HyperDual:
    """Return the product, by the product rule."""
    gradient = a.value * b.gradient + b.value * a.gradient
    rate = a.value * b.rate + b.value * a.rate
    # Both second derivatives of the factors, and both products of first ones.
    gradient_rate = (a.value * b.gradient_rate + b.value * a.gradient_rate
                     + b.rate * a.gradient + a.rate * b.gradient)
    return HyperDual(a.value * b.value, gradient, rate, gradient_rate)


def _scaled_power(factor: float, x: np.float64, exponent: float) -> float:
    """Return factor x^exponent: 0 for the factor 0, also of an infinite power."""
    if not factor:
        return 0.0
    with np.errstate(all='ignore'):
        return float(factor * x ** exponent)


def _value(x: Scalar) -> Scalar:
    """Return the value of a HyperDual or of a number."""
    return x.value if isinstance(x, HyperDual) else x


def seeded(values: Vector, rates: Vector, first: int, count: int) -> Vector:
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
    for i, (value, rate) in enumerate(zip(values, rates)):
        # A variable has a unit vector as gradient and no second derivatives.
        gradient = unit[first + i]
        result[i] = HyperDual(float(value), gradient, float(rate), np.zeros(count))
    return result


def lifted(value: Scalar, count: int) -> HyperDual:
    """Return a scalar as a HyperDual of `count` variables; a number is constant."""
    if isinstance(value, HyperDual):
        return value
    return HyperDual(float(value), np.zeros(count), 0.0, np.zeros(count))


class Parts(NamedTuple):
    """Arrays of the four parts; the gradients' last axis runs over the variables."""

    value: Array
    gradient: Array
    rate: Array
    gradient_rate: Array


def parts(array: Any, count: int) -> Parts:
    """Return the parts of an array of scalars of any shape; numbers are constant."""
    source = np.asarray(array, dtype=object)
    value = np.empty(source.shape)
    gradient = np.empty((*source.shape, count))
    rate = np.empty(source.shape)
    gradient_rate = np.empty((*source.shape, count))
    # Plain numbers among the scalars become constants with derivatives of zero.
    for k in np.ndindex(source.shape):
        scalar = lifted(source[k], count)
        value[k] = scalar.value
        gradient[k] = scalar.gradient
        rate[k] = scalar.rate
        gradient_rate[k] = scalar.gradient_rate
    return Parts(value, gradient, rate, gradient_rate)


def joined(four: Parts) -> Any:
    """Return an array of HyperDual with these parts; the inverse of `parts`."""
    result = np.empty(four.value.shape, dtype=object)
    for k in np.ndindex(result.shape):
        result[k] = HyperDual(float(four.value[k]), four.gradient[k],
                              float(four.rate[k]), four.gradient_rate[k])
    return result
