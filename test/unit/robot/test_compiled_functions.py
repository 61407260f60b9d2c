"""`Robot.compiled` makes native code of a function and supplies what the robot has."""

import copy

from kane_dynamics.errors import InputError
from kane_dynamics.mechanics.constraints import Prescribed
from kane_dynamics.model.model import Inertial
from kane_dynamics.native.tracing.program import origin
from kane_dynamics.robot.robot import Robot
from mechanisms import random_model
import numpy as np
import pytest

ROW = (4,)
RANDOM = np.random.default_rng(5)


@pytest.fixture(scope='module')
def robot():
    """Return an arm with a payload frame and a frame for wrenches."""
    model = random_model(3, 4)
    frame = model.frames[-1].name
    return Robot(model, payload_frame=frame, wrench_frames=(frame,))


def states(count):
    """Return random q, u and udot."""
    return RANDOM.normal(size=(3, count, 4))


def test_a_function_of_states_equals_itself_for_one_state_and_for_a_batch(robot):
    def power(q, u, tau):
        return tau @ u + np.sin(q[0])
    kernel = robot.compiled(power, q=ROW, u=ROW, tau=ROW, shape=())
    q, u, tau = states(7)
    expected = [power(*row) for row in zip(q, u, tau)]
    assert np.allclose(kernel(q, u, tau), expected, rtol=1e-14, atol=1e-14)
    assert abs(kernel(q[0], u[0], tau[0]) - expected[0]) < 1e-14


def test_gravity_payload_and_wrench_are_those_of_the_robot_at_each_call(robot):
    def torque(q, u, udot, wrench, parameters):
        return np.array(
            robot.equations.rigid_dynamics(q, u, udot, wrench, parameters)) + (
                robot.equations.friction_force(u))
    kernel = robot.compiled(torque, q=ROW, u=ROW, udot=ROW, shape=ROW)
    q, u, udot = states(3)
    wrench = RANDOM.normal(size=(3, 1, 6))
    moon = robot.copy()
    moon.parameters.gravity = [0.0, 0.0, -1.62]
    moon.parameters.payload = Inertial(2.0, (0.1, 0.0, 0.2), np.diag([0.1, 0.1, 0.1]))
    on_moon = moon.compiled(torque, q=ROW, u=ROW, udot=ROW, shape=ROW)
    for one_robot, function in ((robot, kernel), (moon, on_moon)):
        assert np.allclose(function(q, u, udot), one_robot.inverse_dynamics(q, u, udot),
                           rtol=1e-12)
        assert np.allclose(function(q, u, udot, wrench),
                           one_robot.inverse_dynamics(q, u, udot, wrench=wrench),
                           rtol=1e-12)
    assert not np.allclose(kernel(q, u, udot), on_moon(q, u, udot))


def test_time_is_an_argument_where_the_equations_depend_on_it_and_zero_elsewhere():
    model = random_model(3, 2)
    joint = model.coordinate_names[0]
    timed = Robot(model, constraints=[Prescribed(joint, np.sin)])

    def shifted(q, t):
        return q[0] + t
    kernel = timed.compiled(shifted, q=(2,), shape=())
    assert kernel(np.ones(2), 3.0) == 4.0
    assert kernel(np.ones(2)) == 1.0
    assert np.array_equal(kernel(np.ones((2, 2)), [3.0, 4.0]), [4.0, 5.0])
    assert Robot(model).compiled(shifted, q=(2,), shape=())(np.ones(2)) == 1.0


def test_calls_may_end_with_a_time_that_nothing_depends_on():
    def shifted(q, u, t):
        return q + u + t

    def without_time(q, u):
        return q + u
    robot = Robot(random_model(3, 2))
    q, u = RANDOM.normal(size=(2, 2))
    kernel = robot.compiled(shifted, q=(2,), u=(2,), shape=(2,))
    entry = kernel.entry('', kernel)
    for function in (kernel, entry):
        for time in (3.0, np.nan, np.array(2.0), None):
            assert np.array_equal(function(q, u, time), q + u)
        assert np.array_equal(function(q, u), q + u)
        assert np.array_equal(function(q.tolist(), u, 3.0), q + u)
        with pytest.raises(InputError, match='nan; expected a finite number'):
            function(np.full(2, np.nan), u, 3.0)
        with pytest.raises(InputError, match='u is missing'):
            function(q)
        with pytest.raises((TypeError, ValueError)):
            function(q, u, 3.0, 4.0)
    assert np.array_equal(kernel(np.stack([q, u]), np.stack([u, u]), 3.0),
                          [q + u, u + u])
    # A function that does not ask for the time has none.
    strict = robot.compiled(without_time, q=(2,), u=(2,), shape=(2,))
    for function in (strict, strict.entry('', strict)):
        with pytest.raises((TypeError, ValueError)):
            function(q, u, 3.0)


def test_a_native_entry_with_a_memory_reads_no_time():
    def summed(q, memory, t):
        return np.concatenate([q + memory + t, memory + 1.0])
    robot = Robot(random_model(3, 2))
    kernel = robot.compiled(summed, q=(2,), memory=(2,), shape=(4,))
    entry = kernel.entry_with_memory('', 'memory')
    memory = np.zeros(2)
    q = RANDOM.normal(size=2)
    assert np.array_equal(entry(q, memory, 5.0), q)
    assert np.array_equal(entry(q.tolist(), memory, 5.0), q + 1.0)
    assert np.array_equal(memory, [2.0, 2.0])


def test_functions_of_one_name_and_code_with_other_values_are_compiled_apart(robot):
    def scaled(factors):
        return lambda q: factors * q
    for factors in (np.array([1.0, 2.0, 3.0, 4.0]), np.full(4, 5.0)):
        kernel = robot.compiled(scaled(factors), name='scaled', q=ROW, shape=ROW)
        assert np.array_equal(kernel(np.ones(4)), factors)
        assert np.array_equal(kernel(np.ones((3, 4))), [factors] * 3)


def test_a_function_is_compiled_once(robot):
    def doubled(q):
        return 2.0 * q
    kernel = robot.compiled(doubled, q=ROW, shape=ROW)
    assert robot.compiled(doubled, q=ROW, shape=ROW) is kernel


def test_a_function_is_compiled_for_each_shape_of_its_inputs_and_result(robot):
    def doubled(q):
        return q + q
    short = robot.compiled(doubled, q=(2,), shape=(2,))
    long = robot.compiled(doubled, q=(3,), shape=(3,))
    assert short([1.0, 2.0]).tolist() == [2.0, 4.0]
    assert long([1.0, 2.0, 3.0]).tolist() == [2.0, 4.0, 6.0]
    with pytest.raises(InputError, match=r'doubled: the function returns shape \(2,\)'):
        robot.compiled(doubled, q=(2,), shape=())


def test_shapes_are_tuples_of_integers_and_there_is_an_input(robot):
    def doubled(q):
        return q + q
    assert robot.compiled(doubled, q=[2], shape=[2]) is robot.compiled(
        doubled, q=(2,), shape=(2,))
    with pytest.raises(InputError, match='shape of q: 4; expected a tuple of integers'):
        robot.compiled(doubled, q=4, shape=ROW)
    with pytest.raises(InputError, match='shape: -1; expected an integer >= 0'):
        robot.compiled(doubled, q=ROW, shape=(-1,))
    with pytest.raises(InputError, match=r'constant: no inputs; expected .* q=\(4,\)'):
        robot.compiled(lambda: 1.0, name='constant', shape=())


def test_functions_of_the_library_are_told_apart_by_code_and_plain_values(robot):
    def scaled(factor):
        function = lambda q: factor * q  # noqa: E731
        function.__module__ = 'kane_dynamics.stand_in'
        return function
    first = robot.compiled(scaled(2.0), name='scaled', q=ROW, shape=ROW)
    second = robot.compiled(scaled(3.0), name='scaled', q=ROW, shape=ROW)
    assert np.array_equal([first(np.ones(4)), second(np.ones(4))],
                          [[2.0] * 4, [3.0] * 4])
    assert robot.compiled(scaled(2.0), name='scaled', q=ROW, shape=ROW) is first


def returns_two(q):
    """Return the first two entries."""
    return q[:2]


@pytest.mark.parametrize(('function', 'inputs', 'message'), [
    (returns_two, {'q': ROW},
     r'returns_two: the function returns shape \(2,\); expected \(4,\)'),
    (returns_two, {'q': ROW, 'u': ROW},
     'returns_two: the function takes q; expected 2 inputs'),
    (lambda q, mass: mass * q, {'q': ROW}, 'name: .<lambda>.; expected an identifier')])
def test_a_function_that_does_not_fit_is_refused(robot, function, inputs, message):
    with pytest.raises(InputError, match=message):
        robot.compiled(function, **inputs, shape=ROW)


def test_an_unknown_name_that_the_function_asks_for_is_refused(robot):
    with pytest.raises(InputError,
                       match='takes q, mass; expected 1 inputs, then some of wrench'):
        robot.compiled(lambda q, mass: mass * q, name='scaled', q=ROW, shape=ROW)


def test_errors_name_the_joint(robot):
    kernel = robot.compiled(lambda q: 1.0 * q, name='copied', q=ROW, shape=ROW)
    with pytest.raises(InputError,
                       match=r"q\[1\] \(joint '.*'\): nan; expected a finite"):
        kernel([0.0, np.nan, 0.0, 0.0])


@pytest.mark.parametrize(('one', 'other'), [
    ([0, 1], [1, 0]), (np.array([1.0, 2.0]), np.array([1.0, 3.0])), ({'a': 1}, {'a': 2}),
    (slice(2), slice(3)), (np.intp(1), np.intp(2)),
    ((np.zeros(2),), (np.zeros((2, 1)),)),
    (np.array([0, 1], dtype=object), np.array([1, 0], dtype=object)),
    (np.zeros(2).astype(object), np.zeros((2, 1)).astype(object))])
def test_constants_of_a_function_tell_its_machine_code_from_others(one, other):
    """Otherwise the cache would give one function the machine code of the other."""
    def enclosing(constant):
        def function(x):
            return x, constant
        return function
    assert origin(enclosing(one)) == origin(enclosing(copy.deepcopy(one)))
    assert origin(enclosing(one)) != origin(enclosing(other))
