"""Programs in latency order compute the same; chains of operations alternate."""

from kane_dynamics import Drive, load_urdf, Robot, with_drives
from kane_dynamics._util.resources import resource_path
from kane_dynamics.mechanics.algebra.dual import select
from kane_dynamics.native.tracing.latency_order import by_latency, LONGEST
from kane_dynamics.native.tracing.program import evaluate, trace_program
from kane_dynamics.simulation.step_kernels import step_program, StepChoice
import numpy as np
import pytest


def chain(x, factor, length):
    """Return a chain of dependent operations."""
    for _ in range(length):
        x = factor * x + 1.0
    return x


def two_chains(x):
    """Return the results of two chains, which are traced one after the other."""
    return np.array([chain(x[0], 0.5, 100), chain(x[1], 0.25, 100)])


def everything(x):
    """Return results of operations of every kind."""
    larger = select(x[0] < x[1], x[1], x[0])
    return np.array(
        [np.sin(x[0]) / np.cos(x[1]), np.sqrt(x[0]), np.tanh(larger), -x[1], 2.0])


@pytest.mark.parametrize('function', [two_chains, everything])
def test_the_same_operations_give_the_same_numbers(function):
    program = trace_program('f', function, [('x', (2,))])
    moved = by_latency(program)
    assert moved.operation_count() == program.operation_count()
    assert moved.inputs == program.inputs
    x = [np.array([0.3, 0.7])]
    np.testing.assert_array_equal(evaluate(moved, x), evaluate(program, x))


def test_operands_come_before_their_users_in_a_step():
    rigid = load_urdf(resource_path('urdf', 'two_link.urdf'))
    robot = Robot(with_drives(rigid, {name: Drive(300.0, 0.4, rotor_inertia=0.05)
                                      for name in rigid.joint_names}))
    program = step_program(robot, 'step', StepChoice(True, 'implicit'))
    moved = by_latency(program)
    values = [np.linspace(0.1, 0.4, int(np.prod(shape))) for _, shape in program.inputs]
    np.testing.assert_array_equal(evaluate(moved, values), evaluate(program, values))


def test_independent_chains_alternate():
    program = trace_program('f', two_chains, [('x', (2,))])
    half = len(program.schedule()) // 2

    def first_half_of(program):
        factors = [node.args for node in program.schedule()[:half] if node.op == 'mul']
        return {factor for args in factors
                for factor in args if isinstance(factor, float)}
    assert first_half_of(program) == {0.5}
    assert first_half_of(by_latency(program)) == {0.5, 0.25}


def test_long_programs_stay_as_they_are():
    program = trace_program('f', lambda x: chain(x, 0.5, LONGEST), [('x', ())])
    assert by_latency(program) is program
