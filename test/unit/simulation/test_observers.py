"""Extremes of the states of a chunk."""

from kane_dynamics.simulation.observers import extremes_of
import numpy as np
import pytest


@pytest.mark.parametrize('simulations', [0, 1, 3])
@pytest.mark.parametrize('count', [1, 63, 64, 65, 200])
def test_extremes_are_the_least_and_largest_of_each_entry(simulations, count):
    buffer = np.random.default_rng(count).normal(size=(simulations, count + 1, 5))
    low, high = extremes_of(buffer[:, 1:])
    np.testing.assert_array_equal(low, buffer[:, 1:].min(axis=1))
    np.testing.assert_array_equal(high, buffer[:, 1:].max(axis=1))


@pytest.mark.parametrize('place', [0, 70, 128])
def test_an_entry_that_is_not_a_number_has_no_extremes(place):
    states = np.zeros((2, 129, 3))
    states[1, place, 2] = np.nan
    for extreme in extremes_of(states):
        assert np.argwhere(np.isnan(extreme)).tolist() == [[1, 2]]
