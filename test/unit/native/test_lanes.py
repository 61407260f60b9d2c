"""Batches: results equal those of single states for any batch, lanes and threads."""

import itertools
import re
import threading
import time
from types import SimpleNamespace

from kane_dynamics import InputError, load_urdf, Robot
from kane_dynamics._util.resources import resource_path
from kane_dynamics.native.backends import llvm_simd
from kane_dynamics.native.backends.llvm_math import POSITION_LIMIT
from kane_dynamics.native.backends.llvm_simd import lane_text
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.runtime import loops, threads
from kane_dynamics.native.runtime.kernel import Argument, batch_kernel, Kernel
from kane_dynamics.native.runtime.loops import (address, BAD_INPUT, BAD_RESULT,
                                                run_batch, Strided)
from kane_dynamics.native.tracing.program import trace_program
from kane_dynamics.native.tracing.subroutine import call
from kane_dynamics.robot.kernel_set import FRAME_QUANTITIES, QUANTITIES, Sizes
from mechanisms import random_model
import numpy as np
import pytest

MODEL = random_model(3, 5, mimics=1)
FRAME = MODEL.frames[-1].name
W = llvm_simd.width()
COUNTS = (0, 1, W - 1, W, W + 1, 3 * W + 2, 1000)


@pytest.fixture(scope='module')
def robot():
    """Return a robot with a wrench frame at its last link."""
    return Robot(MODEL, wrench_frames=(FRAME,))


def batch(count, n=5, seed=1):
    """Return (3, count, n) numbers."""
    return np.random.default_rng(seed).normal(size=(3, count, n))


def close(batched, single):
    """Assert agreement to rounding, relative to the state's largest entry."""
    batched = np.asarray(batched)
    single = np.asarray(single)
    assert batched.shape == single.shape
    entries = tuple(range(1, single.ndim))
    size = np.abs(single).max(axis=entries) if single.size else 0.0
    error = np.abs(batched - single).max(axis=entries) if single.size else 0.0
    assert np.all(error <= 1e-13 * size), (error / size).max()


@pytest.mark.parametrize('name', QUANTITIES)
@pytest.mark.parametrize('count', COUNTS)
def test_a_batch_is_its_states_one_by_one(robot, name, count):
    inputs = batch(count)[:len(QUANTITIES[name].arguments)]

    def method(*state):
        result = getattr(robot, name)(*state)
        return np.stack(result, axis=-3) if isinstance(result, tuple) else result
    single = [method(*np.ascontiguousarray(row)) for row in inputs.transpose(1, 0, 2)]
    sizes = Sizes(5, 5, 5, len(robot.model.bodies), 0)
    rows = []
    for size in QUANTITIES[name].shape:
        rows.append(getattr(sizes, size) if isinstance(size, str) else size)
    shape = tuple(rows)
    close(method(*inputs), np.array(single).reshape(count, *shape))


@pytest.mark.parametrize('name', FRAME_QUANTITIES)
def test_a_batch_of_frames_is_its_states_one_by_one(robot, name):
    inputs = batch(W + 3)[:len(FRAME_QUANTITIES[name].arguments)]
    other_names = {'partial_velocities': 'jacobian',
                   'partial_velocity_rates': 'jacobian_rate'}
    method = getattr(robot, other_names.get(name, name))
    close(method(FRAME, *inputs),
          [method(FRAME, *row) for row in inputs.transpose(1, 0, 2)])


def test_wrench_may_differ_per_state_or_be_omitted(robot):
    q, u, udot = batch(W + 3)
    push = np.random.default_rng(2).normal(size=(W + 3, 1, 6))
    close(robot.inverse_dynamics(q, u, udot, wrench=push),
          [robot.inverse_dynamics(*row, wrench=w) for *row, w in zip(q, u, udot, push)])
    close(robot.inverse_dynamics(q, u, udot),
          robot.inverse_dynamics(q, u, udot, wrench=0 * push))


def test_batch_uses_the_current_parameters():
    robot = Robot(MODEL, payload_frame=FRAME)
    q, u, udot = batch(W + 3)
    under_old_gravity = robot.inverse_dynamics(q, u, udot)
    robot.parameters.gravity = (1.0, 2.0, 3.0)
    robot.parameters.payload = MODEL.bodies[0].inertial
    under_new_gravity = robot.inverse_dynamics(q, u, udot)
    assert np.abs(under_new_gravity - under_old_gravity).max() > 0.1
    close(under_new_gravity, [robot.inverse_dynamics(*row) for row in zip(q, u, udot)])


@pytest.mark.parametrize('name', [
    'inverse_dynamics', 'forward_dynamics', 'gravity_force', 'potential_energy',
    'inverse_dynamics_derivatives', 'regressor'])
def test_batches_follow_gravity_that_becomes_vertical_tilted_or_none(name):
    robot = Robot(load_urdf(resource_path('urdf', 'ur10e.urdf')))
    inputs = np.random.default_rng(4).normal(size=(3, W + 3, 6))
    inputs = inputs[:len(QUANTITIES[name].arguments)]

    def compare(robot):
        def method(*state):
            result = getattr(robot, name)(*state)
            return np.stack(result, axis=-3) if isinstance(result, tuple) else result
        close(method(*inputs), [method(*row) for row in inputs.transpose(1, 0, 2)])
    for gravity in ((0.0, 0.0, -9.81), (1.0, 2.0, -9.0), (0.0, -0.0, -1.62),
                    (0.0, 3.0, 0.0),
                    (0.0, 0.0, 0.0)):
        robot.parameters.gravity = gravity
        compare(robot)
        # A copy shares the machine code, and has its own parameters.
        moon = robot.copy()
        moon.parameters.gravity = (0.0, 1.0, -1.62)
        compare(moon)


@pytest.mark.parametrize('gravity', [(0.0, 0.0, -9.81), (1.0, 0.0, -9.0)])
def test_after_the_first_batch_a_change_of_gravity_compiles_nothing(
        gravity, monkeypatch):
    robot = Robot(load_urdf(resource_path('urdf', 'ur10e.urdf')))
    state = np.zeros((3, W + 3, 6))
    robot.parameters.gravity = gravity
    robot.inverse_dynamics(*state)
    monkeypatch.setattr(Kernel, '_function', None)  # which compiles
    for new_gravity in ((0.0, 0.0, -1.62), (0.0, 3.0, 0.0)):
        robot.parameters.gravity = new_gravity
        robot.inverse_dynamics(*state)


def test_an_angle_on_which_no_torque_depends_is_checked():
    robot = Robot(load_urdf(resource_path('urdf', 'ur10e.urdf')))
    q, u, udot = np.zeros((3, W + 3, 6))
    for value in (np.nan, np.inf, -2e12):
        q[W + 1, 0] = value
        with pytest.raises(InputError, match=rf'q\[{W + 1}, 0\]'):
            robot.inverse_dynamics(q, u, udot)


@pytest.mark.parametrize('convert', [
    list, lambda x: x.astype(np.float32), lambda x: np.repeat(x, 2, axis=0)[::2],
    lambda x: np.asfortranarray(x), lambda x: x.astype('>f8'),
    lambda x: x[::-1].copy()[::-1]])
def test_anything_convertible_is_converted(robot, convert):
    inputs = [convert(x) for x in batch(W + 3)]
    expected = robot.inverse_dynamics(*[np.array(x, dtype=np.float64) for x in inputs])
    assert np.array_equal(robot.inverse_dynamics(*inputs), expected)


def test_result_does_not_depend_on_batch_position_or_threads(robot, monkeypatch):
    q, u, udot = batch(20_000)
    monkeypatch.setenv(threads.VARIABLE, '1')
    whole = robot.forward_dynamics(q, u, udot)
    for first, last in ((0, 1), (1, W + 3), (777, 1800), (19_999, 20_000)):
        part = slice(first, last)
        assert np.array_equal(robot.forward_dynamics(q[part], u[part], udot[part]),
                              whole[part])
    monkeypatch.setattr(threads, 'THREAD_WORK', 1e-9)  # any work is worth a thread
    for count in (2, 3, 7):
        monkeypatch.setenv(threads.VARIABLE, str(count))
        assert np.array_equal(robot.forward_dynamics(q, u, udot), whole)


def test_out_is_written_to_and_may_be_an_argument(robot):
    q, u, udot = batch(3 * W + 1)
    expected = robot.inverse_dynamics(q, u, udot)
    out = np.empty_like(q)
    assert robot.inverse_dynamics(q, u, udot, out=out) is out
    assert np.array_equal(out, expected)
    strided = np.empty((3 * W + 1, 10))[:, ::2]
    assert robot.inverse_dynamics(q, u, udot, out=strided) is strided
    assert np.array_equal(strided, expected)
    overlaid = udot.copy()
    assert np.array_equal(robot.inverse_dynamics(q, u, overlaid, out=overlaid), expected)


def test_an_out_that_overlaps_other_states_changes_no_answer(robot):
    q, u, udot = batch(3 * W + 1)
    expected = robot.inverse_dynamics(q[:-1], u[:-1], udot[:-1])
    moved = udot.copy()
    robot.inverse_dynamics(q[:-1], u[:-1], moved[:-1], out=moved[1:])
    assert np.array_equal(moved[1:], expected)
    memory = np.zeros(5 * 5 * W)
    matrices = memory.reshape(W, 5, 5)
    memory[:5 * W] = q[:W].ravel()
    robot.mass_matrix(memory[:5 * W].reshape(W, 5), out=matrices)
    assert np.array_equal(matrices, robot.mass_matrix(q[:W]))


@pytest.mark.parametrize('place', [0, W - 1, W, 3 * W])
@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('argument', range(3))
def test_a_number_that_is_not_finite_is_named_with_row_and_joint(
        robot, place, value, argument):
    inputs = batch(3 * W + 1)
    inputs[argument, place, 2] = value
    name = ('q', 'u', 'udot')[argument]
    words = re.escape(
        f"{name}[{place}, 2] (joint 'joint2'): {value}; expected a finite number")
    with pytest.raises(InputError, match=words):
        robot.inverse_dynamics(*inputs)


def test_positions_near_the_limit_are_accepted_together_and_refused_beyond_it(robot):
    q, u, udot = batch(3 * W + 1)
    q[W + 1] = 0.99 * POSITION_LIMIT
    close(robot.inverse_dynamics(q, u, udot)[W + 1:W + 2],
          [robot.inverse_dynamics(q[W + 1], u[W + 1], udot[W + 1])])
    for joint in range(5):
        beyond = batch(3 * W + 1)
        beyond[0, W, joint] = -1.01 * POSITION_LIMIT
        with pytest.raises(InputError, match=re.escape(f'q[{W}, {joint}]')):
            robot.inverse_dynamics(*beyond)


def test_large_finite_numbers_are_no_error():
    kernel = batch_kernel('sums', lambda x: [x[0] + x[1], x[1] - x[2]], [('x', (3,))],
                          (2,))
    x = np.full((W + 1, 3), 1e307) * np.arange(1, W + 2)[:, None] / W
    assert np.array_equal(kernel(x),
                          np.stack([x[:, 0] + x[:, 1], 0.0 * x[:, 0]], axis=1))


def test_rows_of_several_blocks_and_steps_are_those_of_their_states():
    kernel = batch_kernel('carried', lambda x, y: [x[0] + y[0], x[1] * y[1]],
                          [('x', (2,)), ('y', (2,))], (2,))
    rng = np.random.default_rng(0)
    first = rng.normal(size=(3 * W + 2, 1, 2))
    y = rng.normal(size=(3 * W + 2, 4, 2))
    states = first.copy()
    assert kernel.rollout([states, y], states, 4) == 0
    added = first[:, 0, 0]
    multiplied = first[:, 0, 1]
    for step in range(4):
        added = added + y[:, step, 0]
        multiplied = multiplied * y[:, step, 1]
    assert np.array_equal(states[:, 0], np.stack([added, multiplied], axis=1))


def test_unused_arguments_must_be_finite_too():
    # M does not depend on q.
    slide = Robot(random_model(0, 1, prismatic=1.0, passive=False))
    with pytest.raises(InputError, match=re.escape('q[1, 0]')):
        slide.mass_matrix([[0.0], [np.nan]])


def test_a_result_that_is_not_finite_is_named_with_its_state(robot):
    q, u, udot = batch(3 * W + 1)
    udot[W + 1] = 1e308
    with pytest.raises(InputError, match=f'result of state {W + 1} is not finite'):
        robot.inverse_dynamics(q, u, udot)


@pytest.mark.parametrize('width', [2, 4, 8])
def test_lanes_of_every_width_compute_the_same(width):
    inner = trace_program('inner', lambda x: [np.sin(x[0]), x[0] / x[1]], [('x', (2,))])

    def outer(x, y, block):
        first = call(inner, x[:2])
        second = call(inner, [first[0], x[2]])
        return [*second, np.tanh(y[0]) * block[1], np.sqrt(y[1] * y[1]), 4.0, *first]
    program = trace_program('outer', outer, [('x', (3,)), ('y', (2,)), ('block', (2,))])
    code = llvm.Code(llvm.assemble(lane_text(program, 'f', width)))
    rng = np.random.default_rng(0)
    x = rng.normal(size=(13, 3))
    y = rng.normal(size=(13, 2))
    block = np.array([9.0, 3.0])
    out = np.full((14, 7), -7.0)
    rows = [Strided(x.ctypes.data, 24), Strided(y.ctypes.data, 16),
            Strided(block.ctypes.data), Strided(out.ctypes.data, 56)]
    assert run_batch(code.address('f'), rows, 13, width=width) == 0
    first = np.stack([np.sin(x[:, 0]), x[:, 0] / x[:, 1]], axis=1)
    expected = np.column_stack(
        [np.sin(first[:, 0]), first[:, 0] / x[:, 2],
         3.0 * np.tanh(y[:, 0]), np.abs(y[:, 1]), np.full(13, 4.0), first])
    np.testing.assert_allclose(out[:13], expected, rtol=1e-15)
    assert (out[13] == -7.0).all()  # nothing is written past the last state
    y[12, 0] = np.nan
    assert run_batch(code.address('f'), rows, 13, width=width) == BAD_INPUT | BAD_RESULT
    y[12, 0] = 0.0
    x[3, 1] = 0.0
    assert run_batch(code.address('f'), rows, 13, width=width) == BAD_RESULT


def test_numbered_rows_are_those_of_their_numbers():
    kernel = batch_kernel('scaled', lambda x, y: x * y[()], [('x', (3,)), ('y', ())],
                          (3,))
    rng = np.random.default_rng(0)
    x = rng.normal(size=(5, 3))
    y = rng.normal(size=19)
    numbers = rng.integers(0, 5, 19)
    out = np.empty((19, 3))
    assert kernel.run([x, y], out, 19, {'x': numbers}) == 0
    assert np.array_equal(out, x[numbers] * y[:, None])


@pytest.mark.parametrize('x, y, out, numbers, words', [
    (np.zeros((4, 3)), np.zeros(5), 5, None, 'x has 4 rows; expected 5'),
    (np.zeros((5, 3)), np.zeros(3), 5, None, 'y has 3 rows; expected 5'),
    (np.zeros((5, 3)), np.zeros(5), 4, None, 'result has 4 rows; expected 5'),
    (np.zeros((2, 3)), np.zeros(5), 5, 4, 'x has 4 rows; expected 5')])
def test_arrays_that_end_before_the_batch_are_refused(x, y, out, numbers, words):
    kernel = batch_kernel('scaled', lambda x, y: x * y[()], [('x', (3,)), ('y', ())],
                          (3,))
    chosen = {} if numbers is None else {'x': np.zeros(numbers, dtype=np.intp)}
    with pytest.raises(InputError, match=words):
        kernel.run([x, y], np.empty((out, 3)), 5, chosen)


def test_carries_that_end_before_the_result_are_refused():
    kernel = batch_kernel('sum', lambda x, y: x + y, [('x', (2,)), ('y', (2,))], (2,))
    with pytest.raises(InputError, match='input 1 has 3 rows; expected 4'):
        kernel.scan([np.zeros((4, 2)), np.zeros((3, 2))], np.zeros((4, 2)))


def test_rows_that_are_not_contiguous_are_refused():
    """Machine code reads a row as neighbouring numbers, whatever its strides are."""
    kernel = batch_kernel('sum', lambda x, y: x + y, [('x', (2,)), ('y', (2,))], (2,))
    x, columns = np.zeros((4, 2)), np.zeros((2, 4)).T
    words = 'strides .*; expected C-contiguous rows'
    with pytest.raises(InputError, match=f'input 1 has rows with {words}'):
        kernel.scan([x, columns], np.zeros((4, 2)))
    with pytest.raises(InputError, match=f'y has rows with {words}'):
        kernel.run([x, columns], np.zeros((4, 2)), 4)
    with pytest.raises(InputError, match=words):
        kernel.rollout([x[None], columns[None]], np.zeros((1, 4, 2)), 4)


def test_too_many_arguments_name_those_that_are_expected():
    kernel = batch_kernel('sum', lambda x, y: x + y, [('x', (2,)), ('y', (2,))], (2,))
    with pytest.raises(InputError, match='sum: 3 arguments; expected at most 2: x, y'):
        kernel(np.zeros(2), np.zeros(2), np.zeros(2))


def test_a_number_that_is_not_finite_has_no_place():
    kernel = batch_kernel('scaled', lambda x, y: x * y[()], [('x', (3,)), ('y', ())],
                          (3,))
    with pytest.raises(InputError, match=r'^y: nan; expected a finite number'):
        kernel(np.zeros(3), np.nan)


def test_addresses_of_arrays_are_those_of_ctypes():
    x = np.zeros((4, 5, 6))
    for view in (x, x[1:], x[:, 2], x[::-1, 1:, 3], x.T, np.array(1.0),
                 np.zeros((0, 3))):
        assert address(view) == view.ctypes.data


def test_long_rows_with_partial_tiles_are_transposed_correctly():
    def square(x, block):
        return [[a * b + block[0] for a in x] for b in x]
    kernel = Kernel('square', lambda: trace_program('square', square,
                                                    [('x', (33,)), ('block', (1,))]),
                    None, [Argument('x', (33,))], np.ones(1), (33, 33))
    x = np.random.default_rng(0).normal(size=(W + 1, 33))
    np.testing.assert_allclose(kernel(x), x[:, :, None] * x[:, None, :] + 1.0, rtol=0.0,
                               atol=1e-14)


def test_batches_release_the_gil(robot, monkeypatch):
    monkeypatch.setenv(threads.VARIABLE, '1')
    q, u, udot = batch(400_000)
    robot.forward_dynamics(q[:1], u[:1], udot[:1])
    ticks = itertools.count()
    stop = threading.Event()

    def tick():
        while not stop.is_set():
            next(ticks)
            time.sleep(5e-4)
    thread = threading.Thread(target=tick)
    thread.start()
    # A busy machine may give the thread no time during a batch; with the GIL, it ticks
    # before and after each at most.
    try:
        passed = 0
        for _ in range(100):
            before = next(ticks)
            robot.forward_dynamics(q, u, udot)
            passed = next(ticks) - before - 1
            if passed > 4:
                break
    finally:
        stop.set()
        thread.join()
    assert passed > 4


@pytest.mark.parametrize('value', ['0', '-1', 'two', '1.5', '', '257'])
def test_a_bad_number_of_threads_is_refused_by_name(robot, monkeypatch, value):
    monkeypatch.setenv(threads.VARIABLE, value)
    words = re.escape(
        f'KANE_DYNAMICS_THREADS: {value!r}; expected an integer from 1 to 256')
    with pytest.raises(InputError, match=words):
        robot.inverse_dynamics(*batch(100_000))
    assert robot.inverse_dynamics(*batch(2)[:, 0]).shape == (5,)


def test_threads_process_every_state_once(monkeypatch):
    monkeypatch.setenv(threads.VARIABLE, '5')
    monkeypatch.setattr(threads, 'THREAD_WORK', 1e-12)
    for count in (1, 8, 9, 63, 64, 65, 1000):
        ranges = []

        def work(begin, end, number, ranges=ranges):
            assert number <= 5
            ranges.append((begin, end))
            return 1 << (begin % 3)
        flags = threads.run_in_threads(work, count, 8, 2)
        assert [k for begin, end in ranges for k in range(begin, end)] == [*range(count)]
        assert all(begin % 8 == 0 and begin < end for begin, end in ranges)
        assert flags == np.bitwise_or.reduce([1 << (begin % 3) for begin, _ in ranges])


def test_work_is_divided_by_its_known_pace(monkeypatch):
    monkeypatch.setenv(threads.VARIABLE, '2')
    monkeypatch.setattr(threads, 'THREAD_WORK', 0.2)
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(threads, 'time', SimpleNamespace(perf_counter=lambda: clock.now))
    paces = {}
    runs = []

    def work(begin, end, number):
        runs.append((begin, end, number))
        clock.now += pause
        return 1
    pause = 0.0
    assert threads.run_in_threads(work, 1000, 8, 2, paces, 'kernel') == 1
    assert runs[0] == (0, 16, 1)
    runs.clear()
    threads.run_in_threads(work, 1000, 8, 2, paces, 'kernel')
    assert runs == [(0, 1000, 1)]
    # Where it took long, the next run is divided.
    pause = 1.0
    threads.run_in_threads(work, 1000, 8, 2, paces, 'kernel')
    runs.clear()
    pause = 0.0
    threads.run_in_threads(work, 1000, 8, 2, paces, 'kernel')
    assert runs[0][2] == 2
    # One that was slow for once is not divided for long.
    runs.clear()
    threads.run_in_threads(work, 1000, 8, 2, paces, 'kernel')
    assert runs == [(0, 1000, 1)]


def test_every_share_of_a_batch_is_computed_where_threads_do_not_start(
        robot, monkeypatch):
    expected = robot.inverse_dynamics(*batch(5000))
    monkeypatch.setenv(threads.VARIABLE, '8')
    monkeypatch.setattr(threads, 'THREAD_WORK', 1e-9)
    text = loops.SOURCE.path.with_suffix('.ll').read_text()
    stack = str(loops.SOURCE.constants['STACK'])
    assert stack in text
    # A stack of more than any address space has.
    code = llvm.library('loops', text.replace(stack, str(1 << 60)))
    monkeypatch.setattr(loops, 'loops', lambda: code)
    loops._run_job.cache_clear()
    try:
        assert np.array_equal(robot.inverse_dynamics(*batch(5000)), expected)
    finally:
        loops._run_job.cache_clear()


def test_compile_includes_the_lane_kernels(monkeypatch):
    robot = Robot(random_model(21, 2))
    robot.compile(batches=True)

    def refuse(*_, **__):
        raise AssertionError('compiled in a call')
    monkeypatch.setattr(llvm, 'assemble', refuse)
    monkeypatch.setattr(llvm, 'Code', refuse)
    states = np.ones((3, 4, 2))
    for name, quantity in QUANTITIES.items():
        getattr(robot, name)(*states[:len(quantity.arguments)])


def test_first_batches_of_many_threads_at_once_are_right():
    robot = Robot(random_model(23, 3))
    inputs = batch(100, 3)
    results = []

    def work():
        results.append(robot.inverse_dynamics(*inputs))
    workers = [threading.Thread(target=work) for _ in range(6)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(results) == 6
    close(results[0],
          [robot.inverse_dynamics(*row) for row in inputs.transpose(1, 0, 2)])
    assert all(np.array_equal(result, results[0]) for result in results)
