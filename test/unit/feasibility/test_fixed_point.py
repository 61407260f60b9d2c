"""Fixed points are found where repetition alone does not converge."""

import math

from kane_dynamics.errors import InputError
from kane_dynamics.feasibility.fixed_point import upper_fixed_point
import pytest

LOW = 1e-3
PRECISION = 1e-12


def fixed_point(value):
    return upper_fixed_point(value, LOW, PRECISION,
                             'speed: none found; expected another')


@pytest.mark.parametrize('slope', [0.9, 0.2, 0.0, -0.5, -0.99, -1.0, -4.0, -1e6])
def test_the_fixed_point_of_a_line_is_found_for_every_slope_below_one(slope):
    assert fixed_point(lambda x: 3.0 + slope * (x - 3.0)) == pytest.approx(
        3.0, rel=2e-11)


@pytest.mark.parametrize('error', [False, True])
def test_values_that_do_not_exist_above_the_fixed_point_are_no_hindrance(error):
    def value(x):
        if x <= 4.0:
            return 12.0 - 3.0 * x if x > 0.1 else 1e4
        if error:
            raise InputError('too much')
        return None
    assert fixed_point(value) == pytest.approx(3.0, rel=1e-11)


def test_a_function_without_a_fixed_point_gives_infinity_none_or_an_error():
    assert fixed_point(lambda x: math.inf) == math.inf
    assert fixed_point(lambda x: None) is None
    assert fixed_point(lambda x: 0.1 * LOW) == 0.1 * LOW  # not above the least one

    def breaks(x):
        if x > 2.0:
            raise InputError('broken')
        return 5.0
    with pytest.raises(InputError, match='broken'):
        fixed_point(breaks)
    with pytest.raises(InputError, match='speed: none found; expected another'):
        fixed_point(lambda x: 5.0 if x < 2.0 else 1.0)
