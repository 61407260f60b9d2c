"""Damping by ratio: the inverse square root without eigenvalues."""

from hypothesis import given, settings, strategies as st
from kane_dynamics.task_space.modal_damping import (inverse_root_times, RESOLVENTS,
                                                    SLOWEST)
import numpy as np


def test_the_resolvents_are_the_inverse_square_root_over_their_range():
    x = np.geomspace(SLOWEST**2, 1.0, 1001)
    total = sum(weight / (x + shift) for shift, weight in RESOLVENTS)
    assert np.abs(total * np.sqrt(x) - 1.0).max() < 1.5e-6
    assert all(weight > 0.0 and shift > 0.0 for shift, weight in RESOLVENTS)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(0, 6), st.floats(-8.0, 8.0))
def test_inverse_roots_of_matrices_of_every_rank_and_size(seed, size, rank, exponent):
    rng = np.random.default_rng(seed)
    G = rng.normal(size=(size, rank)) * 10.0**exponent
    B = G @ G.T
    y = rng.normal(size=size)
    result = np.array(inverse_root_times(B, y), dtype=float)
    if not np.trace(B):
        assert np.isfinite(result).all()
        return
    values, vectors = np.linalg.eigh(B + SLOWEST**2 * np.trace(B) * np.eye(size))
    expected = vectors @ (vectors.T @ y / np.sqrt(values))
    np.testing.assert_allclose(result, expected, atol=2e-6 * np.abs(expected).max())


def test_diagonal_matrices_with_zeros():
    B = np.diag([1.0, 0.0, 4.0, 0.0, 9.0, 0.0])
    result = np.array(inverse_root_times(B, np.ones(6)), dtype=float)
    floor = SLOWEST**2 * 14.0
    np.testing.assert_allclose(result, 1.0 / np.sqrt(np.diag(B) + floor), rtol=2e-6)
