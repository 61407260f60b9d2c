"""Comparison of results that differ only by the order and kind of their operations."""

import numpy as np

AGREEMENT = 1e-12  # of the largest entry, as documented for all results


def assert_same_numbers(found, expected):
    """Assert agreement to `AGREEMENT`; batches have other sines than single states."""
    found = np.asarray(found)
    expected = np.asarray(expected)
    assert found.shape == expected.shape
    largest = np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=AGREEMENT * largest)
