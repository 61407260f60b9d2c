"""Differentiation of traced programs: rules, subroutines, branches, second order."""

from hyperdual import HyperDual
from kane_dynamics import Robot
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.jet import moving, rates
from kane_dynamics.native.backends.llvm_scalar import ARITHMETIC, ELEMENTARY
from kane_dynamics.native.tracing import differentiation
from kane_dynamics.native.tracing.differentiation import (forward, jacobian, reverse,
                                                          SLOPES)
from kane_dynamics.native.tracing.program import evaluate, trace_program
from kane_dynamics.native.tracing.subroutine import Subroutines
from kane_dynamics.robot.derivative_kernels import Derivative
from kane_dynamics.robot.kernel_set import LARGE
from mechanisms import random_model
import numpy as np
import pytest

X = np.array([0.7, 1.3])
DX = np.array([0.4, -1.1])

FUNCTIONS = {
    'add': lambda x, y: x + y, 'sub': lambda x, y: x - y, 'mul': lambda x, y: x * y * x,
    'div': lambda x, y: x / y + 2.0 / x, 'neg': lambda x, y: -x * y,
    'sin': lambda x, y: np.sin(x * y), 'cos': lambda x, y: np.cos(x * y),
    'tanh': lambda x, y: np.tanh(x - y), 'sqrt': lambda x, y: np.sqrt(x + y * y),
    'exp': lambda x, y: np.exp(x * y), 'log': lambda x, y: np.log(x + y),
    'arctan': lambda x, y: np.arctan(x / y), 'floor': lambda x, y: np.floor(3.0 * y) * x,
    'less': lambda x, y: (x < y) * x * y,
    'select': lambda x, y: select(x < y, x * x, y) + select(y < x, x * x, x * y),
}


def modes(function, x, tangents, cotangents):
    """Return a function's tangents, its gradient and its Jacobian at x."""
    x = np.asarray(x, dtype=float)

    def derived(x, dx, w):
        y = np.ravel(function(*x))
        return np.concatenate([forward(y, [*x], dx, Subroutines()),
                               reverse(y, w, [*x], Subroutines()),
                               np.ravel(jacobian(y, [*x], Subroutines()))])
    program = trace_program('derived', derived, [('x', x.shape), ('dx', x.shape),
                                                 ('w', np.shape(cotangents))])
    m = len(cotangents)
    n = len(x)
    values = evaluate(program, [x, tangents, cotangents])
    return values[:m], values[m:m + n], values[m + n:].reshape(m, n)


def test_every_operation_has_a_rule():
    assert set(SLOPES) == {*ARITHMETIC, *ELEMENTARY, 'neg', 'sqrt', 'floor', 'less',
                           'select'}
    assert set(FUNCTIONS) == set(SLOPES)


@pytest.mark.parametrize('op', FUNCTIONS)
def test_both_modes_give_the_derivative_of_an_operation(op):
    function = FUNCTIONS[op]
    for value in (X, X[::-1]):
        slopes = np.array(
            [float(rates(function(*moving(value, unit)))) for unit in np.eye(2)])
        tangent, gradient, matrix = modes(function, value, DX, [2.0])
        np.testing.assert_allclose(tangent, [slopes @ DX], rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(gradient, 2.0 * slopes, rtol=1e-14, atol=1e-15)
        np.testing.assert_allclose(matrix, [slopes], rtol=1e-14, atol=1e-15)


def test_the_jacobian_is_the_same_by_either_mode():
    def wide(x, y, z):  # more inputs than results: reverse mode
        return np.array([np.sin(x * y) / z])

    def tall(x, y, z):  # forward mode
        return np.array([np.sin(x * y) / z, x * z, y - x, np.tanh(z) * x, 3.0])
    x = np.array([0.3, -0.8, 1.7])
    one = modes(wide, x, x, [1.0])
    many = modes(tall, x, x, np.ones(5))
    np.testing.assert_allclose(one[2][0], many[2][0], rtol=1e-14)
    np.testing.assert_allclose(many[2] @ x, many[0], rtol=1e-14)
    np.testing.assert_allclose(many[2].sum(axis=0), many[1], rtol=1e-14)
    assert (many[2][4] == 0.0).all()


@pytest.mark.parametrize('function', [
    lambda x: select(x > 0.0, np.sqrt(x), x),
    lambda x: select(x > 0.0, x * np.sqrt(x) + np.log(x) * np.sqrt(x), x)])
def test_a_branch_not_selected_does_not_spoil_the_derivative(function):
    # At 0 the slope of the root is infinite: 0 times it must not reach the result.
    with np.errstate(all='ignore'):
        for part in modes(function, [0.0], [1.0], [1.0]):
            np.testing.assert_array_equal(np.ravel(part), [1.0])


@pytest.mark.parametrize('function, slope', [
    (lambda x, y: select(x < 0.0, -x, x), [1.0, 0.0]),  # abs(x)
    (lambda x, y: select(x < y, y, x), [1.0, 0.0]),  # maximum(x, y)
    (lambda x, y: select(y < x, y, x), [1.0, 0.0]),  # minimum(x, y)
    (lambda x, y: np.floor(x) + (x < y), [0.0, 0.0])])
def test_at_a_kink_the_derivative_is_that_of_the_branch_that_gives_the_value(
        function, slope):
    np.testing.assert_array_equal(modes(function, [0.0, 0.0], DX, [1.0])[1], slope)


def nested(share):
    """Return a function of three inputs with subroutines that call subroutines."""
    def inner(v, w):
        return np.array([v[0] * np.sin(w[0]), v[1] / (2.0 + w[0] * w[0]), 4.0])

    def outer(v, w):
        a = share('inner', inner, v, w)
        b = share('inner', inner, a[:2], w)
        return np.array([a[0] + b[1], b[0] * a[1], a[2] * b[0]])

    def function(x, y, z):
        a = share('outer', outer, np.array([x, y]), np.array([z]))
        b = share('outer', outer, np.array([1.0, a[0]]), np.array([a[1]]))
        return np.array([*b, a[2]])
    return function


def test_subroutines_are_differentiated_as_subroutines():
    x = np.array([0.3, -0.8, 1.7])
    w = np.array([0.5, -1.0, 2.0, 0.7])
    plain = modes(nested(lambda name, function, *given: function(*given)), x,
                  DX[[0, 1, 0]], w)
    shared = modes(nested(Subroutines()), x, DX[[0, 1, 0]], w)
    for one, counterpart in zip(plain, shared):
        np.testing.assert_allclose(one, counterpart, rtol=1e-13)

    def gradient(x, w):
        return np.array(reverse(nested(Subroutines())(*x), w, [*x], Subroutines()))
    program = trace_program('gradient', gradient, [('x', (3,)), ('w', (4,))])
    subroutines = callees(program)
    assert sum('reverse' in subroutine.name for subroutine in subroutines) >= 2
    # Each is a function of its own.
    assert len({subroutine.name for subroutine in subroutines}) == len(subroutines)


@pytest.mark.parametrize('results', [1, 5])
def test_a_large_jacobian_is_computed_by_calls_of_one_pass(monkeypatch, results):
    def function(x, y, z):
        return np.array([np.sin(x * y) / z, 3.0, y - x, np.tanh(z) * x, z])[:results]

    def matrix(x):
        return jacobian(function(*x[:3]), [*x], Subroutines())  # x[3] has no effect
    x = np.array([0.3, -0.8, 1.7, 0.1])
    inputs = [('x', (4,))]
    plain = trace_program('plain', matrix, inputs)
    monkeypatch.setattr(differentiation, 'LARGE', 0)
    called = trace_program('called', matrix, inputs)
    assert (callees(plain), len(callees(called))) == (set(), 1)
    np.testing.assert_allclose(evaluate(called, [x]), evaluate(plain, [x]), rtol=1e-14)


def callees(program):
    """Return the subroutines of a program and theirs."""
    direct = {node.args[0] for node in program.schedule() if node.op == 'call'}
    return direct.union(*map(callees, direct))


def test_the_inverse_of_a_large_mass_matrix_is_differentiated_through_its_subroutines():
    robot = Robot(
        random_model(3, LARGE + 1, branching=0.5, axes='principal', passive=False))
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, robot.n)
    w = rng.normal(size=robot.n)
    program = robot.kernels.program('inverse_mass_matrix', '', Derivative('vjp', ('q',)))
    assert len({subroutine.name for subroutine in callees(program)}) == len(
        callees(program))
    gradient = evaluate(program, [np.outer(w, w), q, robot.parameters.block])
    # The gradient of w M^-1 w is minus that of x M x at x = M^-1 w.
    x = np.linalg.solve(np.array(robot.equations.mass_matrix(q, None), dtype=float), w)
    energy = robot.kernels.program('kinetic_energy', '', Derivative('vjp', ('q',)))
    expected = -2.0 * evaluate(energy, [1.0, q, x, robot.parameters.block])
    np.testing.assert_allclose(gradient, expected,
                               rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_a_pass_over_a_pass_gives_second_derivatives():
    def function(x, y):
        return np.sin(x * y) / (1.0 + np.exp(x)) + np.sqrt(y) * x

    def curvature(x, dx):  # the Hessian times dx: reverse mode over forward mode
        slope = forward([function(*x)], [*x], dx, Subroutines())
        return np.array(reverse(slope, [1.0], [*x], Subroutines()))
    program = trace_program('curvature', curvature, [('x', (2,)), ('dx', (2,))])
    hyper = function(
        *(HyperDual(v, e, r, np.zeros(2)) for v, e, r in zip(X, np.eye(2), DX)))
    np.testing.assert_allclose(evaluate(program, [X, DX]), hyper.gradient_rate,
                               rtol=1e-13)


@pytest.mark.parametrize('quantity', ['inverse_dynamics', 'forward_dynamics'])
def test_a_pass_costs_less_than_three_times_the_program(quantity):
    def operations(program):
        count = program.operation_count()
        return (count.multiplications + count.additions + count.divisions
                + count.functions + count.negations)
    kernels = Robot(random_model(7, 7, branching=0.0)).kernels
    plain_operations = operations(kernels.program(quantity))
    for mode in ('vjp', 'jvp'):
        derivative = Derivative(mode, kernels.arguments(quantity))
        assert operations(kernels.program(quantity, '',
                                          derivative)) < 3 * plain_operations
