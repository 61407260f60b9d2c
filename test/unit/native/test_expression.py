"""Traced scalars: constant folding, shared subexpressions, rejected operations."""

import math

from kane_dynamics.native.tracing.expression import Expr, Trace
from kane_dynamics.native.tracing.program import factored, Program, trace_program
import numpy as np
import pytest


@pytest.fixture
def xy():
    """Two inputs of a fresh trace."""
    return Trace().inputs('x', 2)


def test_arithmetic_with_zero_and_one_leaves_no_node(xy):
    x = xy[0]
    assert x + 0.0 is x and 0.0 + x is x and x - 0 is x and x * 1.0 is x and x / 1.0 is x
    assert x * 0.0 == 0.0 and type(x * 0.0) is float
    assert x - x == 0.0 and 0.0 / x == 0.0
    assert -(-x) is x and x * -1.0 is -x and 0.0 - x is -x


def test_added_and_subtracted_terms_cancel(xy):
    x, y = xy
    assert (x + y) - y is x and (x - y) + y is x
    assert x - (x + y) is -y and (x - y) - x is -y
    assert (x + 2.0) - 2.0 is x


def test_constants_merge(xy):
    x = xy[0]
    assert 2.0 * x * 3.0 is x * 6.0
    assert (x + 2.0) + 3.0 is x + 5.0
    assert x + x is x * 2.0
    assert -(x * 2.0) is x * -2.0


def test_equal_operations_are_one_node(xy):
    x, y = xy
    assert x + y is y + x and x * y is y * x
    assert np.sin(x) is np.sin(x)
    assert np.sin(-x) is -np.sin(x) and np.cos(-x) is np.cos(x)


def test_signs_move_out_of_products_and_into_differences(xy):
    x, y = xy
    assert (-x) * y is -(x * y) and (-x) * (-y) is x * y
    assert x + (-y) is x - y and x - (-y) is x + y and -(x - y) is y - x
    assert x + y * -2.0 is x - y * 2.0


@pytest.mark.parametrize('use',
                         [bool, float, lambda x: 1.0 if x else 2.0, lambda x: x and 1.0])
def test_traced_value_cannot_be_converted_to_float_or_bool(xy, use):
    with pytest.raises(TypeError, match='traced value'):
        use(xy[0])


def test_numpy_operations_work_on_object_arrays(xy):
    A = np.array([[1.0, 0.0], [2.0, -1.0]])
    result = A @ xy
    assert result[0] is xy[0]
    assert result[1] is xy[0] * 2.0 - xy[1]
    assert all(isinstance(v, Expr) for v in np.sin(xy))
    assert (xy * np.float64(2.0))[0] is xy[0] * 2.0
    assert np.float64(2.0) * xy[0] is xy[0] * 2.0


def test_an_array_beside_a_scalar_is_left_to_numpy(xy):
    assert (xy[0] * np.array([1.0, 0.0]))[1] == 0.0


def test_powers_are_products(xy):
    x = xy[0]
    assert x**2 is x * x and x**0 == 1.0
    assert x**0.5 is np.sqrt(x) and x**-2 is 1.0 / (x * x)
    with pytest.raises(TypeError):
        x**'2'


def test_only_what_the_outputs_need_is_scheduled():
    program = trace_program('f', lambda x: [x[0] + x[1], (x[0] * x[1], x[0])[1]],
                            [('x', (2,))])
    assert [node.op for node in program.schedule()] == ['input', 'input', 'add']
    assert program.operation_count().multiplications == 0


def test_common_factors_are_taken_out_once():
    program = trace_program('f', lambda x: x[0] * x[2] - x[1] * x[2], [('x', (3,))])
    count = program.operation_count()
    assert (count.multiplications, count.additions) == (1, 1)


def test_difference_and_its_negative_share_one_subtraction():
    program = trace_program('f', lambda x: [(x[0] - x[1]) * x[2], (x[1] - x[0]) * x[3]],
                            [('x', (4,))])
    assert program.operation_count().additions == 1


def test_product_with_two_uses_is_not_factored():
    def function(x):
        shared = x[0] * x[2]
        return [shared + x[1] * x[2], shared]
    assert trace_program(
        'f', function, [('x', (3,))]).operation_count().multiplications == 2


def test_factoring_keeps_the_value():
    trace = Trace()
    x = trace.inputs('x', 3)
    y = (x[0] * 3.0 + x[1] * 3.0) * np.sin(x[2]) - np.tanh(x[0]) / (x[1] * x[1] + 1.0)
    program = Program('f', (('x', (3,)),), (y,), ())
    values = [0.3, -1.2, 0.7]
    assert evaluate(factored(program), values)[0] == pytest.approx(
        evaluate(program, values)[0], rel=1e-15)


def evaluate(program, values):
    """Run a program of one input in plain Python."""
    known = {}
    do = {
        'add': lambda a, b: a + b, 'sub': lambda a, b: a - b, 'mul': lambda a, b: a * b,
        'div': lambda a, b: a / b, 'neg': lambda a: -a, 'sin': math.sin, 'cos': math.cos,
        'tanh': math.tanh, 'sqrt': math.sqrt}

    def of(arg):
        return known[arg.index] if isinstance(arg, Expr) else arg
    for node in program.schedule():
        known[node.index] = (values[node.args[1]] if node.op == 'input'
                             else do[node.op](*map(of, node.args)))
    return [of(x) for x in program.outputs]
