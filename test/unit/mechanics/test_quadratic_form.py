"""Quadratic forms over any scalar."""

from kane_dynamics.mechanics.algebra.vector import quadratic
from kane_dynamics.native.tracing.program import evaluate, trace_program
import numpy as np
import pytest


@pytest.mark.parametrize('n', [1, 2, 5])
def test_the_form_of_numbers_and_of_traced_values_is_the_matrix_product(n):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n))
    x = rng.normal(size=n)
    A = A + A.T
    expected = x @ A @ x
    assert quadratic(A, x) == pytest.approx(expected, rel=1e-14)
    program = trace_program('form', lambda y: quadratic(A, y), [('y', (n,))])
    assert float(evaluate(program, [x])) == pytest.approx(expected, rel=1e-14)


def test_forms_of_the_same_vector_share_its_products():
    A = np.ones((2, 3, 3))
    program = trace_program('forms', lambda y: np.array([quadratic(A[0], y),
                                                         quadratic(3.0 * A[1], y)]),
                            [('y', (3,))])
    # Six products; the factors 2, 3 and 6 of the entries of A that are not 1 cost at
    # most nine more.
    assert program.operation_count().multiplications <= 15


def test_zeros_of_the_matrix_cost_nothing():
    A = np.diag([0.0, 2.0, 0.0])
    program = trace_program('form', lambda y: quadratic(A, y), [('y', (3,))])
    count = program.operation_count()
    assert (count.multiplications, count.additions) == (2, 0)
