"""Jets: time derivatives of every operation, against nested jets of order one."""

from kane_dynamics.mechanics.algebra.choice import magnitude, select
from kane_dynamics.mechanics.algebra.jet import derivative, Jet, moving, terms_of_order
import numpy as np
from numpy.testing import assert_allclose
import pytest

X = (0.7, -1.3, 0.4)
Y = (1.9, 0.6, -2.1)
FUNCTIONS = {
    'product': lambda x, y: x * y, 'square': lambda x, y: x * x,
    'quotient': lambda x, y: x / y, 'reciprocal': lambda x, y: 2.0 / y,
    'quotient of a number': lambda x, y: x / 3.0,
    'sum': lambda x, y: x + y, 'sum with a number': lambda x, y: 1.5 + x + 2.0,
    'difference': lambda x, y: x - y,
    'difference of a number': lambda x, y: 1.5 - x - 2.0, 'negative': lambda x, y: -x,
    'power': lambda x, y: y ** 2.5, 'cube': lambda x, y: x ** 3,
    'sine': lambda x, y: np.sin(x), 'cosine': lambda x, y: np.cos(x),
    'tanh': lambda x, y: np.tanh(x * y), 'exp': lambda x, y: np.exp(x),
    'log': lambda x, y: np.log(y), 'sqrt': lambda x, y: np.sqrt(y),
    'arctan': lambda x, y: np.arctan(x), 'magnitude': lambda x, y: magnitude(-x),
    'choice': lambda x, y: select(x < y, x * x, y),
    'other': lambda x, y: select(x > y, x, y)}


def nested(x):
    """Return a jet of jets of order one, with a value and two derivatives."""
    return Jet((Jet((x[0], x[1])), Jet((x[1], x[2]))))


@pytest.mark.parametrize('name', FUNCTIONS)
def test_derivatives_are_those_of_nested_jets(name):
    function = FUNCTIONS[name]
    arguments = np.array([nested(X), nested(Y)], dtype=object)
    expected = function(*arguments)
    result = np.array([function(*moving(*np.transpose([X, Y])))], dtype=object)
    values = [float(derivative(result, order)[0]) for order in range(3)]
    reference = [terms_of_order(expected, order)[0] for order in range(3)]
    assert_allclose(values, reference, rtol=1e-13, atol=1e-14)


def test_constants_stay_numbers():
    constant, changing = moving([2.0, 3.0], [0.0, 1.0], [0.0, 0.0])
    assert constant == 2.0 and isinstance(changing, Jet)
    assert (changing - changing) == 0.0
    assert changing ** 0 == 1.0
    assert float(np.floor(changing)) == 3.0
