"""Products of matrices by rows of lanes are those of NumPy, at every size."""

from kane_dynamics.mechanics.algebra.lane_products import (by_entries, product,
                                                           solutions, transpose)
from kane_dynamics.mechanics.algebra.lanes import LANES, Lanes
from kane_dynamics.mechanics.algebra.ltdl import factorize
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.native.tracing.wide import WideLanes
import numpy as np
import pytest

SIZES = (1, 3, 7, LANES, LANES + 1, 2 * LANES + 3)


def results(n):
    """Return a function of the entries of matrices, and the expected result."""
    rng = np.random.default_rng(n)
    A = rng.normal(size=(6, n))
    B = rng.normal(size=(n, n))
    x = rng.normal(size=n)
    M = B @ B.T + np.eye(n)
    given = np.concatenate([A.ravel(), M.ravel(), x])

    def function(given, lanes):
        A = given[:6 * n].reshape(6, n)
        M = given[6 * n:6 * n + n * n].reshape(n, n)
        x = given[6 * n + n * n:]
        order = list(range(n))
        of_mass = solutions(factorize(M, order), order, A.T, lanes)
        parts = [product(A, M, lanes), product(x, M, lanes), transpose(A, lanes),
                 of_mass, product(x, product(M, transpose(A, lanes), lanes), lanes),
                 by_entries(lambda a, b: a - 2.0 / b, lanes, x, x + A[0])]
        return np.concatenate([np.ravel(part) for part in parts])
    expected = [A @ M, x @ M, A.T, np.linalg.solve(M, A.T), x @ M @ A.T,
                x - 2.0 / (x + A[0])]
    return function, given, np.concatenate([part.ravel() for part in expected])


@pytest.mark.parametrize('n', SIZES)
@pytest.mark.parametrize('traced', [False, True])
def test_products_in_lanes_are_those_of_numpy(n, traced):
    function, inputs, expected = results(n)
    if traced:
        def program():
            return trace_program('products',
                                 lambda x, _: function(x, WideLanes(x[0].trace)),
                                 [('x', inputs.shape), ('parameters', (1,))])
        kernel = Kernel('products', program, None, [Argument('x', inputs.shape)],
                        np.zeros(1), expected.shape)
        result = kernel(inputs)
    else:
        result = np.array(function(inputs, Lanes), dtype=float)
    np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-9)
