"""Derivatives of functions of matrices, and the library CasADi loads, without it."""

import ctypes
from math import prod

from kane_dynamics.native.backends.casadi_library import casadi_text
from kane_dynamics.native.machine_code import llvm, shared_library
from kane_dynamics.native.tracing.matrix_function import dependence, full, MatrixFunction
from kane_dynamics.native.tracing.program import evaluate, trace_program
from kane_dynamics.native.tracing.subroutine import Subroutines
import numpy as np
import pytest

Q = np.array([0.4, -0.9, 1.3])
P = np.array([0.7, -0.2])


def example():
    """Return a function of two arguments with a subroutine and constant entries."""
    share = Subroutines()

    def turned(x, p):
        return np.array([np.sin(x[0]) * p[0], x[1] * x[1], 3.0], dtype=object)

    def function(q, p):
        a = share('turned', turned, q[:2], p)
        b = share('turned', turned, q[1:], p)
        return np.array([a[0] + b[1], a[1] * p[1], b[0], a[2], q[2]])
    inputs = (full('q', (3, 1)), full('p', (1, 2)))
    program = trace_program('example', function, [('q', (3,)), ('p', (2,))])
    return MatrixFunction('example', inputs, (full('y', (5, 1)),), program)


def slopes(function, *given, step=1e-6):
    """Return a function's derivative by central differences, a row for each entry."""
    x = np.concatenate(given)
    ends = np.cumsum([len(array) for array in given])[:-1]

    def value(x):
        return evaluate(function.program, np.split(x, ends))
    return np.array([(value(x + step * e) - value(x - step * e)) / (2.0 * step)
                     for e in np.eye(len(x))]).T


def matrices(jacobian, *given):
    """Return the blocks of a derivative as matrices."""
    entries = evaluate(jacobian.program, given)
    blocks = []
    for block in jacobian.outputs:
        matrix = np.zeros(prod(block.shape))
        matrix[list(block.places)], entries = np.split(entries, [len(block.places)])
        blocks.append(matrix.reshape(block.shape, order='F'))
    assert len(entries) == 0
    return blocks


@pytest.mark.parametrize('way', ['jacobian', 'jacobian_by_columns'])
def test_both_ways_to_a_jacobian_give_the_derivative_and_its_zeros(way):
    function = example()
    derived = getattr(function, way)()
    assert derived.name == 'jac_example'
    assert [block.name for block in derived.inputs] == ['q', 'p', 'out_y']
    assert [block.name for block in derived.outputs] == ['jac_y_q', 'jac_y_p']
    np.testing.assert_allclose(np.hstack(matrices(derived, Q, P)),
                               slopes(function, Q, P), atol=1e-8)
    assert derived.outputs[0].places == (0, 6, 7, 10, 14)


def test_derivatives_of_gradients_are_second_derivatives():
    gradient = example().reverse()
    weights = np.array([0.3, -1.1, 0.8, 0.5, 2.0])
    derived = gradient.jacobian_by_columns()
    expected = slopes(gradient, Q, P, weights)
    derivatives = matrices(derived, Q, P, weights)
    assert [block.shape for block in derived.outputs[:4]] == [
        (3, 3), (3, 2), (3, 5), (3, 5)]
    rows = [np.hstack(derivatives[k:k + 4]) for k in (0, 4)]
    # Without those of `out_y`, which is not read.
    columns = [0, 1, 2, 3, 4, *range(10, 15)]
    np.testing.assert_allclose(np.vstack(rows)[:, columns], expected, atol=1e-8)
    rates = gradient.forward()
    np.testing.assert_allclose(evaluate(rates.program, [Q, P, weights, Q, P, weights]),
                               expected @ np.concatenate([Q, P, weights]), atol=1e-8)


def test_an_output_depends_on_the_inputs_that_it_is_computed_from():
    masks = dependence(example().program)
    assert [f'{mask:05b}' for mask in masks] == ['01101', '10010', '01010', '00000',
                                                 '00100']


@pytest.mark.skipif(shared_library.linker() is None, reason='no linker on the PATH')
def test_a_library_follows_casadis_conventions(tmp_path):
    function = example().jacobian()
    path = tmp_path / 'example.so'
    path.write_bytes(shared_library.linked(shared_library.linker(), [
        llvm.assemble(casadi_text(function), shared=True)]))
    library = ctypes.CDLL(str(path))
    for end, blocks in (('in', function.inputs), ('out', function.outputs)):
        assert getattr(library, f'jac_example_n_{end}')() == len(blocks)
        name = getattr(library, f'jac_example_name_{end}')
        name.argtypes = [ctypes.c_longlong]
        name.restype = ctypes.c_char_p
        sparsity = getattr(library, f'jac_example_sparsity_{end}')
        sparsity.argtypes = [ctypes.c_longlong]
        sparsity.restype = ctypes.POINTER(ctypes.c_longlong)
        assert name(len(blocks)) is None
        for k, block in enumerate(blocks):
            assert name(k) == block.name.encode()
            rows, columns = block.shape
            begins = sparsity(k)[2:3 + columns]
            assert sparsity(k)[:2] == [rows, columns] and begins[-1] == len(block.places)
            # CasADi's compressed columns: sizes, where columns begin, then the rows.
            rows_of_entries = sparsity(k)[3 + columns:3 + columns + begins[-1]]
            places = []
            for column in range(columns):
                for entry in range(begins[column], begins[column + 1]):
                    places.append(rows_of_entries[entry] + rows * column)
            assert tuple(places) == block.places
    q = np.ascontiguousarray(Q)
    p = np.ascontiguousarray(P)
    work = np.ascontiguousarray(np.zeros(100))
    results = [np.zeros(len(block.places)) for block in function.outputs]

    def pointers(arrays):
        addresses = [None if x is None else x.ctypes.data for x in arrays]
        return (ctypes.c_void_p * len(arrays))(*addresses)
    # An argument that is not there counts as zeros, a result is not written.
    for arguments, present in (((q, p), (0, 1)), ((q, None), (1,)), ((None, p), (0,))):
        for result in results:
            result[:] = 7.0
        wanted = [results[k] if k in present else None for k in range(2)]
        status = library.jac_example(
            pointers([*arguments, None]), pointers(wanted), None,
            ctypes.c_void_p(work.ctypes.data), 0)
        assert status == 0
        numbers = [np.zeros(n) if x is None else x for x, n in zip(arguments, (3, 2))]
        expected = evaluate(function.program, numbers)
        ends = np.cumsum([len(block.places) for block in function.outputs])
        for k, part in enumerate(np.split(expected, ends[:-1])):
            np.testing.assert_allclose(results[k], part if k in present else 7.0,
                                       atol=1e-15)
