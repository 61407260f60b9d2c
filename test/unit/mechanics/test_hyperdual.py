"""Hyper-dual arithmetic against derivatives taken by hand."""

from hyperdual import joined, parts, seeded
import numpy as np
import pytest

X = 0.7
Y = -1.3
X_RATE = 0.4
Y_RATE = 2.1

# f(x, y), its two slopes, and its second slopes xx, xy, yy.
FUNCTIONS = {
    'a quotient': (lambda x, y: x / y, lambda x, y: (1 / y, -x / y**2),
                   lambda x, y: (0.0, -1 / y**2, 2 * x / y**3)),
    'a number over it': (lambda x, y: 3.0 / x, lambda x, y: (-3 / x**2, 0.0),
                         lambda x, y: (6 / x**3, 0.0, 0.0)),
    'a power': (lambda x, y: +(x**3 * y**2),
                lambda x, y: (3 * x**2 * y**2, 2 * x**3 * y),
                lambda x, y: (6 * x * y**2, 6 * x**2 * y, 2 * x**3)),
    'a square root': (lambda x, y: np.sqrt(x), lambda x, y: (0.5 * x**-0.5, 0.0),
                      lambda x, y: (-0.25 * x**-1.5, 0.0, 0.0)),
    'a constant': (lambda x, y: x**0, lambda x, y: (0.0, 0.0),
                   lambda x, y: (0.0, 0.0, 0.0)),
}


@pytest.mark.parametrize('name', FUNCTIONS)
def test_parts_are_the_derivatives(name):
    function, slopes, second = FUNCTIONS[name]
    derivatives = parts(np.array([function(*seeded([X, Y], [X_RATE, Y_RATE], 0, 2))]), 2)
    fx, fy = slopes(X, Y)
    fxx, fxy, fyy = second(X, Y)
    np.testing.assert_allclose(derivatives.value, [function(X, Y)], rtol=1e-14)
    np.testing.assert_allclose(derivatives.gradient, [[fx, fy]], rtol=1e-14)
    np.testing.assert_allclose(derivatives.rate, [fx * X_RATE + fy * Y_RATE], rtol=1e-14)
    np.testing.assert_allclose(
        derivatives.gradient_rate,
        [[fxx * X_RATE + fxy * Y_RATE, fxy * X_RATE + fyy * Y_RATE]], rtol=1e-14)


def test_parts_joined_are_the_same_numbers():
    numbers = np.sin(seeded([X, Y], [X_RATE, Y_RATE], 0, 2))[:, None]
    for one, counterpart in zip(parts(joined(parts(numbers, 2)), 2), parts(numbers, 2)):
        np.testing.assert_array_equal(one, counterpart)
