"""The boxed complementarity problem, with boxes and with discs."""

from itertools import product

from kane_dynamics import ConstraintError
from kane_dynamics.mechanics.complementarity import Disc, lcp, with_discs
import numpy as np
import pytest


def random_matrix(random, k, rank=None):
    """Return a random positive semidefinite matrix."""
    factor = random.normal(size=(k, rank or 2 * k))
    return factor @ factor.T


def by_enumeration(A, b, lower, upper):
    """Return the solution by a trial of all sets of rows at their bounds."""
    for ends in product((-1, 0, 1), repeat=len(b)):
        ends = np.array(ends)
        x = np.where(ends < 0, lower, upper)
        free = ends == 0
        x[free] = np.linalg.solve(A[np.ix_(free, free)],
                                  -b[free] - A[np.ix_(free, ~free)] @ x[~free])
        w = A @ x + b
        inside = (x >= lower - 1e-12) & (x <= upper + 1e-12)
        if inside.all() and (ends * w <= 1e-9).all():
            return x
    raise AssertionError('no solution')


@pytest.mark.parametrize('seed', range(20))
def test_the_solution_is_that_of_a_trial_of_all_sets(seed):
    random = np.random.default_rng(seed)
    k = 5
    A, b = random_matrix(random, k), 10.0 * random.normal(size=k)
    lower, upper = -random.uniform(size=k), random.uniform(size=k)
    lower[:2] = 0.0
    expected = by_enumeration(A, b, lower, upper)
    np.testing.assert_allclose(lcp(A, b, lower, upper), expected, atol=1e-8)


def test_redundant_rows_share_with_the_least_sum_of_squares():
    row = np.array([[1.0, 0.5], [1.0, 0.5], [2.0, 1.0]])
    A = row @ row.T
    b = -A @ [1.0, 2.0, 3.0]
    x = lcp(A, b, np.full(3, -100.0), np.full(3, 100.0))
    np.testing.assert_allclose(x, np.linalg.pinv(A) @ -b, atol=1e-3)
    np.testing.assert_allclose(A @ x + b, 0.0, atol=1e-9)


@pytest.mark.parametrize('seed', range(40))
def test_forces_of_contacts_stay_in_their_discs_and_oppose_the_slip(seed):
    random = np.random.default_rng(seed)
    count = 1 + seed % 4
    A = random_matrix(random, 3 * count)
    b = random.normal(size=3 * count)
    b[::3] -= 1.0
    lower, upper = np.zeros((2, 3 * count))
    upper[::3] = np.inf
    mu = random.uniform(0.0, 0.4, size=count)
    discs = [Disc(3 * i, 3 * i + 1, 3 * i + 2, mu[i]) for i in range(count)]
    x = with_discs(A, b, lower, upper, discs)
    w = A @ x + b
    for normal, first, second, friction in discs:
        force, slip = x[[first, second]], w[[first, second]]
        assert x[normal] >= 0.0 and w[normal] > -1e-10
        assert abs(x[normal] * w[normal]) < 1e-10
        size = np.linalg.norm(force)
        assert size <= friction * x[normal] * (1.0 + 1e-10) + 1e-14
        if np.linalg.norm(slip) > 1e-9:
            expected = -friction * x[normal] * slip / np.linalg.norm(slip)
            np.testing.assert_allclose(force, expected, atol=1e-9)


def test_rows_that_contradict_each_other_are_refused():
    with pytest.raises(ConstraintError, match='are not determined to rounding'):
        lcp(np.array([[-1.0]]), np.array([-1.0]), np.zeros(1), np.full(1, np.inf))


def test_a_joint_that_sticks_at_a_jammed_contact_begins_to_slide():
    # Friction of a contact that slides makes A asymmetric, and its determinant negative.
    A = np.array([[2.5013, 1.24932], [1.19305, 0.59588]])
    b = np.array([-27.07, -3.483])
    x = lcp(A, b, np.array([-0.5, 0.0]), np.array([0.5, np.inf]))
    np.testing.assert_allclose(x, [0.5, (3.483 - 0.5 * 1.19305) / 0.59588], rtol=1e-9)


def test_a_jammed_contact_without_a_solution_is_refused():
    A = np.array([[2.5013, 1.24932], [1.19305, 0.59588]])
    with pytest.raises(ConstraintError, match='less friction'):
        lcp(A, np.array([-27.07, -14.0]), np.array([-np.inf, 0.0]), np.full(2, np.inf))
