"""Accuracy and special values of sine, cosine and hyperbolic tangent in native code."""

from kane_dynamics import InputError
from kane_dynamics.native.backends.llvm_math import POSITION_LIMIT
from kane_dynamics.native.backends.llvm_scalar import module_text
from kane_dynamics.native.backends.llvm_simd import lane_text, width
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime.kernel import Argument, Kernel
from kane_dynamics.native.runtime.loops import repeat, run_batch, Strided
from kane_dynamics.native.tracing.program import trace_program
import mpmath
import numpy as np
import pytest

N = 1000


def evaluator(f, entries, width):
    """Return a compiled function of rows of entries, in lanes of a width."""
    program = trace_program('f', f, [('x', (entries,)), ('none', (1,))])
    code = llvm.Code(llvm.assemble(module_text(program, 'f') if width == 1
                                   else lane_text(program, 'f', width)))

    def run(x):
        x = np.ascontiguousarray(x, dtype=np.float64)
        none = np.zeros(1)
        out = np.empty((len(x), len(program.outputs)))
        rows = [Strided(x.ctypes.data, 8 * entries), Strided(none.ctypes.data),
                Strided(out.ctypes.data, out.strides[0])]
        if width == 1:
            repeat(code.address('f'), [row.address for row in rows],
                   [row.lane for row in rows], len(x))
        else:
            run_batch(code.address('f'), rows, len(x), width=width)
        return out
    return run


@pytest.fixture(scope='module', params=[1, 2, 4, 8])
def functions(request):
    """Evaluate (sin, cos, tanh) of an array, in lanes of every width."""
    return evaluator(lambda x, none: [np.sin(x[0]), np.cos(x[0]), np.tanh(x[0])], 1,
                     request.param)


@pytest.mark.parametrize('size', [1e-300, 1e-8, 1e-3, 0.3, 1.0, 3.0, 100.0, 1e4, 1e6])
def test_sine_and_cosine_err_by_two_ulp_at_most_and_tanh_by_three(functions, size):
    x = np.random.default_rng(1).uniform(-size, size, N)
    got = functions(x)
    with mpmath.workprec(200):
        for k, exact in enumerate((mpmath.sin, mpmath.cos, mpmath.tanh)):
            error = np.empty(N)
            ulp = np.empty(N)
            for i in range(N):
                true = exact(mpmath.mpf(x[i]))
                error[i] = abs(mpmath.mpf(got[i, k]) - true)
                ulp[i] = np.spacing(abs(float(true)))
            assert (error / ulp).max() <= (2.0 if k < 2 else 3.0)


@pytest.mark.parametrize('size', [1e9, POSITION_LIMIT, 8e2 * POSITION_LIMIT])
def test_sine_and_cosine_are_accurate_beyond_the_position_limit(functions, size):
    x = np.random.default_rng(2).uniform(-size, size, N)
    got = functions(x)
    with mpmath.workprec(200):
        exact = np.array([[float(mpmath.sin(mpmath.mpf(v))),
                           float(mpmath.cos(mpmath.mpf(v)))] for v in x])
    np.testing.assert_allclose(got[:, :2], exact, rtol=0.0, atol=1e-15)


def test_near_multiples_of_a_quarter_turn_the_relative_error_stays_small(functions):
    x = np.arange(-2000, 2000) * (np.pi / 2)
    got = functions(x)
    with mpmath.workprec(300):
        exact = np.array([[float(mpmath.sin(mpmath.mpf(v))),
                           float(mpmath.cos(mpmath.mpf(v)))] for v in x])
    np.testing.assert_allclose(got[:, :2], exact, rtol=1e-12, atol=0.0)


def test_nan_and_infinity_never_become_plausible_numbers(functions):
    got = functions([np.nan, np.inf, -np.inf])
    assert np.isnan(got[:, :2]).all()
    assert np.isnan(got[0, 2])
    assert got[1, 2] == 1.0 and got[2, 2] == -1.0


def test_zero_and_saturation_are_exact(functions):
    got = functions([0.0, -0.0, 50.0, -1e300])
    assert (got[:2, 0] == 0.0).all()
    assert (got[:2, 1] == 1.0).all()
    assert np.signbit(got[1, 2])
    assert got[2, 2] == 1.0 and got[3, 2] == -1.0


@pytest.mark.parametrize('size', [3, 300])
def test_positions_beyond_the_limit_are_rejected_by_every_entry_point(size):
    kernel = Kernel('f', lambda: trace_program('f', lambda q, none: [np.sin(q[1])], [
        ('q', (size,)), ('none', (1,))]), None, [Argument('q', (size,))], np.zeros(1),
                    (1,))
    q = np.full(size, -1e12)
    result = np.empty(1)
    ways = [kernel.entry('', kernel), kernel.bind([q], result, ''), kernel, kernel]
    arguments_of_ways = [(q,), (), (list(q),), (np.tile(q, (width() + 1, 1)),)]
    for entry_point, arguments in zip(ways, arguments_of_ways):
        np.testing.assert_allclose(entry_point(*arguments).ravel(), np.sin(-1e12),
                                   atol=1e-15)
    q[1] = arguments_of_ways[2][0][1] = arguments_of_ways[3][0][1, 1] = -1.001e12
    for entry_point, arguments in zip(ways, arguments_of_ways):
        with pytest.raises(InputError,
                           match=r'q\[(1|1, 1)\]: -1001000000000.0; expected a '
                           r'finite number of at most 1e\+12 rad or m'):
            entry_point(*arguments)


@pytest.fixture(scope='module', params=[1, 2, 4, 8])
def further_functions(request):
    """Evaluate exp, log, arctan, floor, comparison, choice, in lanes of all widths."""
    def f(x, none):
        return [np.exp(x[0]), np.log(x[0]), np.arctan(x[0]), np.floor(x[0]),
                (x[0] < x[1]) * 1.0, (x[0] < x[1]).select(x[0], 2.0 * x[1])]
    return evaluator(f, 2, request.param)


@pytest.mark.parametrize('size', [1e-300, 1e-8, 0.3, 1.0, 3.0, 100.0, 700.0])
def test_exp_log_and_arctan_err_by_two_ulp_at_most(further_functions, size):
    x = np.random.default_rng(4).uniform(-size, size, (N, 2))
    got = further_functions(x)
    with mpmath.workprec(200):
        for k, exact in enumerate((mpmath.exp, mpmath.log, mpmath.atan)):
            for value, of in zip(got[:, k], x[:, 0]):
                if k == 1 and of < 0.0:
                    assert np.isnan(value)
                    continue
                true = exact(mpmath.mpf(of))
                assert abs(mpmath.mpf(value) - true) <= 2.0 * np.spacing(
                    abs(float(true)))
    np.testing.assert_array_equal(got[:, 3], np.floor(x[:, 0]))
    np.testing.assert_array_equal(got[:, 4], x[:, 0] < x[:, 1])
    np.testing.assert_array_equal(got[:, 5],
                                  np.where(x[:, 0] < x[:, 1], x[:, 0], 2.0 * x[:, 1]))


def test_exp_log_and_arctan_are_numpys_at_the_edges(further_functions):
    x = np.array(
        [0.0, -0.0, np.inf, -np.inf, np.nan, 1.0, 709.7, 710.0, -745.0, -750.0, 5e-324])
    got = further_functions(np.column_stack([x, x]))
    with np.errstate(all='ignore'):
        for k, exact in enumerate((np.exp, np.log, np.arctan, np.floor)):
            np.testing.assert_allclose(got[:, k], exact(x), rtol=1e-15, atol=5e-324)
