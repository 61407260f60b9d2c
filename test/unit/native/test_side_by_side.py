"""Parts of a program that several states compute side by side give single results."""

from dataclasses import astuple

from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.tracing.program import evaluate, trace_program
from kane_dynamics.native.tracing.side_by_side import call_side_by_side, divided, KNOWN
from kane_dynamics.native.tracing.subroutine import call
import numpy as np
import pytest

STATES = 2
X = np.random.default_rng(0).uniform(0.2, 1.0, (STATES, 3))
Y = np.random.default_rng(1).uniform(0.2, 1.0, (STATES, 2))
SCALE = np.array([1.7])


def function(x, y, scale):
    """Return results of an early input x, a late input y, of both, and a constant."""
    of_x = np.array(
        [np.sin(x[0]) / x[1], np.sqrt(x[2]) + scale[0], np.tanh(x[0]) * x[2]])
    mixed = of_x[0] * y[0] + of_x[1] * np.cos(y[1])
    return np.array([mixed, of_x[2], x[1], 2.0 * y[1] - x[0], 3.0])


def parts():
    """Return the program of the function, and its two parts."""
    program = trace_program('f', function, [('x', (3,)), ('y', (2,)), ('scale', (1,))])
    return program, *divided(program, ('x', 'scale'), STATES)


def operations(program):
    """Return the number of all operations of a program."""
    return sum(astuple(program.operation_count()))


def test_the_first_part_depends_on_the_early_inputs_alone():
    program, first, second = parts()
    assert [name for name, _ in first.program.inputs] == ['x', 'scale']
    assert [name for name, _ in second.inputs] == [KNOWN, 'y']
    read = {node.args[0] for node in first.program.schedule() if node.op == 'input'}
    assert read == {'x', 'scale'}
    # No operation is done twice.
    assert (operations(first.program) + operations(second)) == operations(program)
    assert first.operation_count() == first.program.operation_count().times(STATES)
    assert len(first.outputs) == STATES * len(first.program.outputs)


def test_both_parts_one_after_the_other_are_the_program():
    program, first, second = parts()
    for x, y in zip(X, Y):
        known = evaluate(first.program, [x, SCALE])
        expected = evaluate(program, [x, y, SCALE])
        np.testing.assert_array_equal(evaluate(second, [known, y]), expected)


def compiled(function_of_states):
    """Return a function of all states, computed by a kernel of one state."""
    shape = (STATES * 5,)

    def program():
        return trace_program('both', lambda x, y, scale: function_of_states(x, y, scale),
                             [('x', X.shape), ('y', Y.shape), ('parameters', (1,))])
    kernel = Kernel('both', program, None,
                    [Argument('x', X.shape), Argument('y', Y.shape)], SCALE, shape)
    return kernel(X, Y).reshape(STATES, 5)


def test_states_side_by_side_give_what_each_gives_alone():
    program, first, second = parts()

    def of_states(x, y, scale):
        known = call_side_by_side(first, [[row, scale] for row in x])
        return np.concatenate([call(second, at_x, row) for at_x, row in zip(known, y)])
    expected = [evaluate(program, [x, y, SCALE]) for x, y in zip(X, Y)]
    np.testing.assert_allclose(compiled(of_states), expected, rtol=1e-14)


def test_the_rest_is_refused_without_the_results_of_one_state():
    _, first, second = parts()

    def of_other_values(x, y, scale):
        known = call_side_by_side(first, [[row, scale] for row in x])
        mixed = [*known[0][:-1], known[1][-1]]
        return np.concatenate([call(second, mixed, row) for row in y])
    with pytest.raises(ValueError, match='expected the results of one state'):
        compiled(of_other_values)


def test_a_subroutine_that_both_parts_call_is_that_of_one_state():
    """A module has one function of each name, and a subroutine only one name."""
    inner = trace_program('inner', lambda z: np.array([np.exp(z[0]) + z[0]]),
                          [('z', (1,))])

    def calling(x, y, scale):
        of_x, = call(inner, x[:1] * scale)
        of_y, = call(inner, y[:1])
        return np.array([of_x * y[0], of_y + np.sin(x[1]), of_x, x[2] * scale[0], of_y])
    program = trace_program('calling', calling,
                            [('x', (3,)), ('y', (2,)), ('scale', (1,))])
    first, second = divided(program, ('x', 'scale'), STATES)

    def of_states(x, y, scale):
        known = call_side_by_side(first, [[row, scale] for row in x])
        return np.concatenate([call(second, at_x, row) for at_x, row in zip(known, y)])
    expected = [evaluate(program, [x, y, SCALE]) for x, y in zip(X, Y)]
    np.testing.assert_allclose(compiled(of_states), expected, rtol=1e-14)
