"""
Hyper-dual numbers: exact first derivatives, and exact mixed second ones.

A number a + g.e + b d + h.e d with e_i e_j = 0 and d d = 0 carries, besides its value, its
derivatives g by k variables, its derivative b along one direction (time, say), and the
derivatives h of b by the k variables. Arithmetic is exact to rounding: no step size anywhere.
Source: Fike & Alonso, AIAA 2011-886; here one of the two infinitesimals is a vector.
"""

import math
from typing import Any

from kane_dynamics.model import Array
import numpy as np


class HyperDual:
    """
    A scalar with its derivatives.

    Parameters
    ----------
    value : float
    gradient : (k,) array
        By the k variables.
    rate : float
        Along the direction.
    gradient_rate : (k,) array
        Of the rate by the k variables.

    """

    __slots__ = ('value', 'gradient', 'rate', 'gradient_rate')

    def __init__(self, value: float, gradient: Array, rate: float,
                 gradient_rate: Array) -> None:
        """Keep the four parts."""
        self.value = value
        self.gradient = gradient
        self.rate = rate
        self.gradient_rate = gradient_rate

    def __repr__(self) -> str:
        """Show the four parts."""
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

    def __truediv__(self, other: float) -> Any:
        """Return the quotient by a number."""
        return self * (1.0 / other)

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> 'HyperDual':
        """Return the negative."""
        return HyperDual(-self.value, -self.gradient, -self.rate, -self.gradient_rate)

    def __sub__(self, other: Any) -> Any:
        """Return the difference."""
        return self + -other

    def __rsub__(self, other: Any) -> Any:
        """Return the difference from a number."""
        return -self + other

    def sin(self) -> 'HyperDual':
        """Return the sine: numpy's sin calls this."""
        s, c = math.sin(self.value), math.cos(self.value)
        return self._mapped(s, c, -s)

    def cos(self) -> 'HyperDual':
        """Return the cosine: numpy's cos calls this."""
        s, c = math.sin(self.value), math.cos(self.value)
        return self._mapped(c, -s, -c)

    def tanh(self) -> 'HyperDual':
        """Return the hyperbolic tangent: numpy's tanh calls this."""
        y = math.tanh(self.value)
        return self._mapped(y, 1.0 - y * y, -2.0 * y * (1.0 - y * y))

    def _mapped(self, value: float, first: float, second: float) -> 'HyperDual':
        """Apply a function whose value and two derivatives are given: the chain rule."""
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
        Number of the first of them among the `count` variables that are differentiated by.
    count : int
        How many.

    """
    unit = np.eye(count)
    result = np.empty(len(values), dtype=object)
    result[:] = [HyperDual(float(x), unit[first + i], float(r), np.zeros(count))
                 for i, (x, r) in enumerate(zip(values, rates))]
    return result
