"""
Jets: a scalar with its first time derivatives, over any scalar type.

This is forward-mode automatic differentiation by time; jets of order one are dual
numbers. Coefficients may be numbers, traced values or symbols.

A `Jet` holds the coefficients c_k = x^(k) / k! of a truncated Taylor series x(t + s) =
sum c_k s^k. Arithmetic on jets is that of the series, so that a function traced once on
jets yields its value and its time derivatives. Of a product, the k-th coefficient is the
sum of c_i d_(k-i), which takes fewer multiplications than nested dual numbers. The series
of functions follow from their differential equations.
"""

from collections.abc import Callable, Sequence
import math
import numbers
from typing import Any

from kane_dynamics._util.typing import Scalar
from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np

Series = Sequence[Scalar]


class Jet:
    """Scalar with time derivatives: the coefficients of its Taylor series."""

    __slots__ = ('c',)

    def __init__(self, coefficients: Series) -> None:
        """Create a jet from its Taylor coefficients, at least two."""
        self.c = tuple(coefficients)

    def __repr__(self) -> str:
        """Return the coefficients as text."""
        return f'Jet{self.c!r}'

    def __add__(self, other: Any) -> Any:
        if isinstance(other, Jet):
            return jet([a + b for a, b in zip(self.c, other.c)])
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Jet((self.c[0] + other, *self.c[1:]))

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Jet):
            return jet(_product(self.c, other.c))
        if isinstance(other, np.ndarray):
            return NotImplemented
        return jet([a * other for a in self.c])

    __radd__ = __add__
    __rmul__ = __mul__

    def __neg__(self) -> 'Jet':
        return Jet([-a for a in self.c])

    def __pos__(self) -> 'Jet':
        return self

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, Jet):
            return jet([a - b for a, b in zip(self.c, other.c)])
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Jet((self.c[0] - other, *self.c[1:]))

    def __rsub__(self, other: Any) -> Any:
        return -self + other

    def __truediv__(self, other: Any) -> Any:
        if isinstance(other, Jet):
            return jet(_quotient(self.c, other.c))
        if isinstance(other, np.ndarray):
            return NotImplemented
        return jet([a / other for a in self.c])

    def __rtruediv__(self, other: Any) -> Any:
        # A constant is a series of one term.
        constant = [other, *[0.0] * (len(self.c) - 1)]
        return jet(_quotient(constant, self.c))

    def __pow__(self, exponent: Any) -> Any:
        if not isinstance(exponent, numbers.Real):
            return NotImplemented
        return jet(_power_series(self.c, exponent))

    def __lt__(self, other: Any) -> Any:
        return self.c[0] < value_of(other)

    def __gt__(self, other: Any) -> Any:
        return self.c[0] > value_of(other)

    def sin(self) -> Any:
        """Return the sine; numpy.sin calls this on object arrays."""
        return jet(_sine_and_cosine(self.c)[0])

    def cos(self) -> Any:
        """Return the cosine; numpy.cos calls this on object arrays."""
        return jet(_sine_and_cosine(self.c)[1])

    def exp(self) -> Any:
        """Return the exponential; numpy.exp calls this on object arrays."""
        # y' = y x'.
        def slope(y: Series) -> Series:
            return y
        return jet(_integrated(self.c, np.exp(self.c[0]), slope))

    def tanh(self) -> Any:
        """Return the hyperbolic tangent; numpy.tanh calls this on object arrays."""
        # y' = (1 - y^2) x'.
        def slope(y: Series) -> Series:
            square = _product(y, y)
            return [1.0 - square[0], *[-s for s in square[1:]]]
        return jet(_integrated(self.c, np.tanh(self.c[0]), slope))

    def sqrt(self) -> Any:
        """Return the square root; numpy.sqrt calls this on object arrays."""
        # y y = x.
        x = self.c
        y = [np.sqrt(x[0])]
        for k in range(1, len(x)):
            remainder = x[k]
            for i in range(1, k):
                remainder = remainder - _times(y[i], y[k - i])
            y.append(remainder / (y[0] + y[0]))
        return jet(y)

    def log(self) -> Any:
        """Return the natural logarithm; numpy.log calls this on object arrays."""
        # y' = x' / x.
        return jet(_from_rate(np.log(self.c[0]), _quotient(_rate(self.c), self.c[:-1])))

    def arctan(self) -> Any:
        """Return the arctangent; numpy.arctan calls this on object arrays."""
        # y' = x' / (1 + x^2).
        square = _product(self.c, self.c)[:-1]
        rate = _quotient(_rate(self.c), [1.0 + square[0], *square[1:]])
        return jet(_from_rate(np.arctan(self.c[0]), rate))

    def __floor__(self) -> Any:
        """Return the floor, a constant; numpy.floor calls this on object arrays."""
        return np.floor(self.c[0])


def jet(coefficients: Series) -> Scalar:
    """Return a Jet, or only the value if the other coefficients are zero by structure."""
    if all(map(is_zero, coefficients[1:])):
        return coefficients[0]
    return Jet(coefficients)


def moving(*derivatives: Any) -> Any:
    """
    Return jets from values, first, second ... derivatives: arrays, or scalars.

    Jets of values and rates alone are dual numbers: a function of them returns its value
    and its rate.
    """
    arrays = [np.asarray(array, dtype=object) for array in derivatives]
    result = np.empty(arrays[0].shape, dtype=object)
    for k in np.ndindex(result.shape):
        # c_k = x^(k) / k!.
        coefficients = [array[k] for array in arrays[:2]]
        for order, array in enumerate(arrays[2:], 2):
            coefficients.append(array[k] * (1.0 / math.factorial(order)))
        result[k] = jet(coefficients)
    return result if result.shape else result[()]


def series_array(terms: Sequence[Any]) -> Any:
    """Return an array of jets from arrays of their Taylor coefficients, lowest first."""
    # A constant has one coefficient and needs no jet, so that it costs no arithmetic.
    if len(terms) == 1:
        return terms[0]
    arrays = [np.asarray(array, dtype=object) for array in terms]
    # Entry by entry, because NumPy would take the terms of a jet as a further axis.
    result = np.empty(arrays[0].shape, dtype=object)
    for k in np.ndindex(result.shape):
        result[k] = jet([array[k] for array in arrays])
    return result


def term(array: Any, order: int) -> Any:
    """Return the Taylor coefficients of one order, of an array of jets or numbers."""
    source = np.asarray(array, dtype=object)
    result = np.empty(source.shape, dtype=object)
    for k in np.ndindex(source.shape):
        result[k] = series_of(source[k], order + 1)[order]
    return result


def values(array: Any) -> Any:
    """Return the values of an array of scalars, some of which may be jets."""
    return _as_floats(term(array, 0))


def rates(array: Any) -> Any:
    """Return the time derivatives of an array of scalars; zero if they are no jets."""
    return _as_floats(term(array, 1))


def _as_floats(array: Any) -> Any:
    """Return an array of scalars as floats where all are."""
    try:
        return array.astype(np.float64)
    except TypeError:  # traced values and symbols are not converted
        return array


def terms_of_order(x: Scalar, order: int) -> list[Scalar]:
    """Return the parts of a scalar that are its Taylor terms of an order (0: value)."""
    if not isinstance(x, Jet):
        return [] if order else [x]
    # In nested jets, the orders of both add up.
    parts = []
    for k, coefficient in enumerate(x.c[:order + 1]):
        parts.extend(terms_of_order(coefficient, order - k))
    return parts


def derivative(array: Any, order: int) -> Any:
    """Return the time derivatives of an order (0: values) of an array of scalars."""
    return term(array, order) * float(math.factorial(order))


def value_of(x: Scalar) -> Scalar:
    """Return the value of a scalar that may be a Jet."""
    return x.c[0] if isinstance(x, Jet) else x


def series_of(x: Scalar, length: int) -> Series:
    """Return the Taylor coefficients of a scalar that may be a Jet."""
    if isinstance(x, Jet):
        return x.c
    return [x, *[0.0] * (length - 1)]


def _times(a: Scalar, b: Scalar) -> Scalar:
    """Return a product, 0 if a factor is zero by structure."""
    return 0.0 if is_zero(a) or is_zero(b) else a * b


def _product(a: Series, b: Series) -> list[Scalar]:
    """Return the product of two series; equal cross terms of a square count once."""
    result = []
    for k in range(len(a)):
        if a is b:
            # c_k = 2 sum_(i < k / 2) a_i a_(k - i),
            # plus the square of the middle term for even k.
            total: Scalar = 0.0
            for i in range((k + 1) // 2):
                total = total + _times(a[i], a[k - i])
            total = total + total
            if k % 2 == 0:
                total = total + _times(a[k // 2], a[k // 2])
        else:
            total = 0.0
            for i in range(k + 1):
                total = total + _times(a[i], b[k - i])
        result.append(total)
    return result


def _quotient(a: Series, b: Series) -> list[Scalar]:
    """Return the quotient y of two series: y b = a."""
    y: list[Scalar] = []
    # y_k = (a_k - sum_(i < k) y_i b_(k - i)) / b_0.
    for k in range(len(a)):
        remainder = a[k]
        for i in range(k):
            remainder = remainder - _times(y[i], b[k - i])
        y.append(remainder / b[0])
    return y


def _sine_and_cosine(x: Series) -> tuple[list[Scalar], list[Scalar]]:
    """Return the series of sine and cosine: s' = c x', c' = -s x'."""
    s = [np.sin(x[0])]
    c = [np.cos(x[0])]
    # k s_k = sum_i i x_i c_(k - i),
    # the coefficient of s^(k - 1) of s' = c x'; likewise c.
    for k in range(1, len(x)):
        sine: Scalar = 0.0
        cosine: Scalar = 0.0
        for i in range(1, k + 1):
            share = _share(i, k, x[i])
            sine = sine + _times(c[k - i], share)
            cosine = cosine - _times(s[k - i], share)
        s.append(sine)
        c.append(cosine)
    return s, c


def _integrated(x: Series, value: Scalar,
                slope: Callable[[Series], Series]) -> list[Scalar]:
    """Return the series y of a function of x with y' = slope(y) x'."""
    y = [value]
    # k y_k = sum_i i x_i slope_(k - i), where slope_(k - i) needs no later terms of y.
    for k in range(1, len(x)):
        rate = slope(y)  # of the terms known so far
        total: Scalar = 0.0
        for i in range(1, k + 1):
            total = total + _share(i, k, _times(rate[k - i], x[i]))
        y.append(total)
    return y


def _rate(x: Series) -> list[Scalar]:
    """Return the series of the time derivative, one term shorter."""
    return [x[1], *[float(k) * x[k] for k in range(2, len(x))]]


def _from_rate(value: Scalar, rate: Series) -> list[Scalar]:
    """Return the series with a value and a rate."""
    return [value, rate[0], *[r * (1.0 / k) for k, r in enumerate(rate[1:], 2)]]


def _share(i: int, k: int, x: Scalar) -> Scalar:
    """Return i / k of a scalar."""
    return x if i == k else (i / k) * x


def _power_series(x: Series, exponent: Any) -> list[Scalar]:
    """Return the series of a power."""
    # x^0 is the constant 1, also at 0, where the slope below would not be finite.
    if exponent == 0:
        return [1.0, *[0.0] * (len(x) - 1)]
    value = _power(x[0], exponent)
    if len(x) == 1:
        return [value]
    # y' = p x^(p - 1) x', where x^(p - 1) is needed to one order less.
    slope = [exponent * y for y in _power_series(x[:-1], exponent - 1)]
    return _from_rate(value, _product(slope, _rate(x)))


def _power(x: Scalar, exponent: Any) -> Scalar:
    """Return a power; NaN for a negative base with a non-integer exponent."""
    if isinstance(x, float | int):
        with np.errstate(all='ignore'):
            return np.float64(x) ** exponent
    return x ** exponent
