"""Rules over any scalar: on numbers, only what is chosen is computed."""

from typing import Any, NamedTuple

from kane_dynamics import load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.mechanics.algebra.flags import branch, changed_if, flag, packed
import numpy as np
import pytest


class Memory(NamedTuple):
    count: Any
    row: Any


BEFORE = Memory(1.0, np.array([2.0, 3.0]))


def doubled(memory):
    return memory._replace(count=memory.count + 1.0, row=2.0 * memory.row)


def test_a_change_that_is_not_chosen_is_not_computed():
    def never(memory):
        raise AssertionError
    assert changed_if(0.0, BEFORE, never) is BEFORE
    with pytest.raises(AssertionError):
        changed_if(1.0, BEFORE, never)


@pytest.mark.parametrize('chosen', [0.0, 1.0])
def test_branches_on_numbers_equal_compiled_ones(chosen):
    robot = Robot(load_urdf(resource_path('urdf', 'two_link.urdf')))

    def rule(x, numbers):
        memory = Memory(numbers[0], numbers[1:])
        changed = changed_if(flag(x > 0.5), memory, doubled)
        return packed(branch(flag(x < 0.5), changed._replace(count=7.0), changed))
    kernel = robot.compiled(rule, name='branches', x=(), numbers=(3,), shape=(3,))
    numbers = packed(BEFORE)
    np.testing.assert_array_equal(kernel(chosen, numbers), rule(chosen, numbers))
    expected = [2.0, 4.0, 6.0] if chosen else [7.0, 2.0, 3.0]
    np.testing.assert_array_equal(rule(chosen, numbers), expected)
