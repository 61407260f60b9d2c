"""Extremes of the states of a chunk."""

from kane_dynamics.simulation.observers import Chunk
import numpy as np
import pytest


def extremes_after(buffer):
    """Return the extremes of a chunk's states, (N, K + 1, size), first one earlier."""
    return Chunk(0, np.arange(buffer.shape[1]), buffer, None, None).extremes


@pytest.mark.parametrize('simulations', [0, 1, 3])
@pytest.mark.parametrize('count', [1, 63, 64, 65, 200])
def test_extremes_are_the_least_and_largest_of_each_entry(simulations, count):
    buffer = np.random.default_rng(count).normal(size=(simulations, count + 1, 5))
    low, high = extremes_after(buffer)
    np.testing.assert_array_equal(low, buffer[:, 1:].min(axis=1))
    np.testing.assert_array_equal(high, buffer[:, 1:].max(axis=1))


@pytest.mark.parametrize('place', [0, 70, 128])
def test_an_entry_that_is_not_a_number_has_no_extremes(place):
    states = np.zeros((2, 130, 3))
    states[1, 1 + place, 2] = np.nan
    for extreme in extremes_after(states):
        assert np.argwhere(np.isnan(extreme)).tolist() == [[1, 2]]
