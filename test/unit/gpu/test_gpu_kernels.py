"""Kernels of GPUs, compiled for the processor: numbers, layouts, NaN, bounds."""

import copy
import ctypes
import pickle

from framework_states import arm, fr3, states
from host_gpu import host_gpu, HostArray, on_gpu, values_of
from kane_dynamics import gpu, Inertial, Robot, simulate
from kane_dynamics.native.backends.gpu_kernel import kernel_text
from kane_dynamics.native.backends.llvm_math import DOUBLE, FLOAT
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.tracing.program import trace_program
from kinds_of_mechanism import case, KINDS
import numpy as np
import pytest
from same_numbers import assert_same_numbers

TOLERANCE = {'float64': 1e-12, 'float32': 1e-5}  # of the largest entry
DTYPES = tuple(TOLERANCE)
ELEMENTARY = ('sin', 'cos', 'tanh', 'exp', 'log', 'arctan', 'floor', 'sqrt')
QUANTITIES = ('inverse_dynamics', 'forward_dynamics', 'mass_matrix',
              'inverse_mass_matrix', 'bias_force', 'inverse_dynamics_derivatives',
              'forward_dynamics_derivatives', 'frame_pose:fr3_link7', 'kinetic_energy')


@pytest.fixture(name='device', autouse=True)
def _device():
    with host_gpu() as device:
        yield device


def agree(found, expected, dtype):
    assert found.shape == expected.shape and found.dtype == dtype
    assert np.isfinite(expected).all()
    np.testing.assert_allclose(found, expected, rtol=0.0,
                               atol=TOLERANCE[dtype] * np.abs(expected).max())


def rounded(arrays, dtype):
    """Return arrays whose numbers exist in a type."""
    return [np.asarray(x).astype(dtype).astype(np.float64) for x in arrays]


@pytest.mark.parametrize('dtype', DTYPES)
@pytest.mark.parametrize('name', QUANTITIES)
def test_quantities_of_seven_axes_are_the_robots(name, dtype):
    function = gpu.function(fr3(), name, dtype=dtype)
    inputs = rounded(np.random.default_rng(1).normal(size=(len(function.names), 9, 7)),
                     dtype)
    method, _, frame = name.partition(':')
    expected = getattr(fr3(), method)(*([frame] if frame else []), *inputs)
    if isinstance(expected, tuple):  # of derivatives
        expected = np.stack(expected, axis=1)
    agree(values_of(function(*on_gpu(*inputs, dtype=dtype))), expected, dtype)


@pytest.mark.parametrize('dtype', DTYPES)
@pytest.mark.parametrize('name', ['inverse_dynamics', 'forward_dynamics'])
@pytest.mark.parametrize('kind', KINDS)
def test_dynamics_of_every_kind_of_mechanism_are_the_robots(kind, name, dtype):
    function = gpu.function(case(kind).robot, name, dtype=dtype)
    inputs = states(kind, function.names)
    loads = {key: inputs[key] for key in ('wrench', 't') if key in inputs}
    expected = getattr(case(kind).robot, name)(
        *(x for key, x in inputs.items() if key not in loads), **loads)
    agree(values_of(function(*on_gpu(*inputs.values(), dtype=dtype))), expected, dtype)


@pytest.mark.parametrize('dtype', DTYPES)
@pytest.mark.parametrize('kind', KINDS)
def test_rollouts_of_every_kind_of_mechanism_are_simulations(kind, dtype):
    mechanism = case(kind)
    rng = np.random.default_rng(2)
    tau = 0.1 * rng.normal(size=(2, 20, mechanism.robot.n))
    q = np.tile(mechanism.q, (2, 1))
    u = np.array([[1.0], [0.5]]) * mechanism.u
    expected = simulate(mechanism.robot, q, u, 0.02,
                        torque=tau, sample=1e-3, t0=mechanism.time)
    state_after = np.concatenate([expected.q, expected.u], axis=2)[:, 1:]
    result = gpu.rollout(mechanism.robot, dtype=dtype)(*on_gpu(
        q, u, tau, dtype=dtype, coalesced=False), h=1e-3, t=mechanism.time)
    agree(values_of(result), state_after, dtype)


def test_held_torque_last_states_and_the_implicit_integrator_are_those_of_simulations():
    robot = case('tree').robot
    rng = np.random.default_rng(3)
    q, u, tau = rng.normal(size=(3, 5, robot.n))
    for integrator in ('rk4', 'implicit'):
        expected = simulate(robot, q, u, 0.03,
                            torque=np.repeat(tau[:, None], 30, axis=1),
                            sample=0.03, integrator=integrator)
        motion = gpu.rollout(robot, integrator=integrator)
        state_after = np.concatenate([expected.q, expected.u], axis=2)
        inputs = on_gpu(q, u, tau)
        agree(values_of(motion(*inputs, h=1e-3, steps=30, every_step=False)),
              state_after[:, -1], 'float64')
        every = values_of(motion(*inputs, h=1e-3, steps=30))
        assert every.shape == (5, 30, 2 * robot.n)
        agree(every[:, -1], state_after[:, -1], 'float64')


@pytest.mark.parametrize('dtype', DTYPES)
def test_gravity_and_payload_are_of_each_state_or_of_the_batch(dtype):
    robot = arm()
    rng = np.random.default_rng(4)
    function = gpu.function(robot, 'inverse_dynamics', parameters=['gravity', 'payload'],
                            dtype=dtype)
    motion = gpu.rollout(Robot(robot.model, payload_frame='tip'),
                         parameters=['gravity', 'payload'], dtype=dtype)
    loads = [Inertial(m, (0.1 * m, 0.0, 0.2), 0.01 * np.eye(3)) for m in (0.5, 1.0, 2.0)]
    gravity = rng.normal(size=(3, 3))
    q, u, udot = rng.normal(size=(3, 3, 2))
    wrench = rng.normal(size=(3, 1, 6))
    blocks = []
    torques = []
    ends = []
    for k, load in enumerate(loads):
        same_robot = robot.copy()
        free = Robot(robot.model, payload_frame='tip')
        for one_robot in (same_robot, free):
            one_robot.parameters.payload = load
            one_robot.parameters.gravity = gravity[k]
        blocks.append(same_robot.parameters.block[3:13])
        torques.append(
            same_robot.inverse_dynamics(q[k], u[k], udot[k], wrench=wrench[k]))
        run_after = simulate(free, q[k], u[k], 0.01, torque=udot[k])
        ends.append(np.concatenate([run_after.q[-1], run_after.u[-1]]))
    inputs = on_gpu(q, u, udot, wrench, gravity, blocks, dtype=dtype)
    agree(values_of(function(*inputs)), np.array(torques), dtype)
    states_ = [*inputs[:3], *inputs[4:]]
    agree(values_of(motion(*states_, h=1e-3, steps=10, every_step=False)),
          np.array(ends), dtype)
    shared = [*inputs[:4], *on_gpu(gravity[1], blocks[1], dtype=dtype)]
    agree(values_of(function(*shared))[1], torques[1], dtype)
    both = on_gpu(gravity[2], blocks[2:], dtype=dtype)  # (3,) and (1, 10)
    agree(values_of(motion(*inputs[:3], *both, h=1e-3, steps=10))[2, -1], ends[2], dtype)


def test_any_layout_gives_the_same_numbers_and_the_result_follows_the_first():
    function = gpu.function(fr3(), 'inverse_dynamics')
    x = np.random.default_rng(5).normal(size=(3, 6, 7))
    rows = on_gpu(*x, coalesced=False)
    coalesced = on_gpu(*x)
    # Calls of single states, whose functions are those of the GPU; batches take fewer
    # operations.
    expected = np.array(
        [fr3().inverse_dynamics(*state) for state in x.transpose(1, 0, 2)])
    # q, u and udot in one row, every second row used
    together = np.concatenate(x, axis=1)
    spaced = np.repeat(together, 2, axis=0)[::2]
    parts = [HostArray(spaced[:, 7 * k:7 * k + 7]) for k in range(3)]
    reverse = [HostArray(a[::-1, ::-1].copy()[::-1, ::-1]) for a in x]
    for arguments in (rows, coalesced, parts, reverse,
                      [rows[0], coalesced[1], parts[2]]):
        result = function(*arguments)
        np.testing.assert_array_equal(values_of(result), expected)
        first = arguments is coalesced
        strides = result.__cuda_array_interface__['strides']
        assert strides == ((8, 48) if first else (56, 8))
    nested = [HostArray(a.reshape(2, 3, 7)) for a in x]
    assert values_of(function(*nested)).shape == (2, 3, 7)
    single = [HostArray(a[0]) for a in x]
    np.testing.assert_array_equal(values_of(function(*single)), expected[0])


def test_one_state_serves_for_all_and_an_empty_batch_has_an_empty_result(device):
    function = gpu.function(fr3(), 'inverse_dynamics')
    x = np.random.default_rng(6).normal(size=(3, 4, 7))
    inputs = [*on_gpu(*x[:2]), HostArray(x[2, 0])]
    assert_same_numbers(values_of(function(*inputs)), fr3().inverse_dynamics(
        x[0], x[1], np.tile(x[2, 0], (4, 1))))
    count_before = len(device.launches)
    assert values_of(function(*on_gpu(*x[:, :0]))).shape == (0, 7)
    assert len(device.launches) == count_before


def test_out_is_written_in_place_also_over_an_argument_and_nothing_beyond_it(device):
    function = gpu.function(fr3(), 'forward_dynamics')
    x = np.random.default_rng(7).normal(size=(3, 5, 7))
    expected = fr3().forward_dynamics(*x)
    block = np.full((9, 9), 8.0)
    out = HostArray(block[2:7, 1:8])
    assert function(*on_gpu(*x), out=out) is out
    assert_same_numbers(out.array, expected)
    block[2:7, 1:8] = 8.0
    assert (block == 8.0).all()
    inputs = on_gpu(*x)
    function(*inputs, out=inputs[0])
    assert_same_numbers(inputs[0].array, expected)


def test_results_are_freed_with_the_last_reference(device):
    function = gpu.function(fr3(), 'gravity_force')
    result = function(*on_gpu(np.zeros((3, 7))))
    assert len(device.memory) == 1
    del result
    assert device.memory == {}


@pytest.mark.parametrize('dtype', DTYPES)
def test_a_state_that_is_not_valid_has_nan_and_no_other(dtype):
    name = 'inverse_dynamics_derivatives'
    function = gpu.function(fr3(), name, dtype=dtype)
    x = np.random.default_rng(8).normal(size=(3, 6, 7))
    good = values_of(function(*on_gpu(*x, dtype=dtype)))
    limit = (DOUBLE if dtype == 'float64' else FLOAT).position_limit
    x[0, 1, 0] = np.nan
    x[1, 2, 6] = np.inf
    x[2, 3, 3] = -np.inf
    x[0, 4, 2] = 1.001 * limit
    values = values_of(function(*on_gpu(*x, dtype=dtype)))
    assert np.isnan(values[1:5]).all()
    np.testing.assert_array_equal(values[[0, 5]], good[[0, 5]])
    x[0, 4, 2] = 0.999 * limit
    assert np.isfinite(values_of(function(*on_gpu(*x, dtype=dtype)))[4]).all()


@pytest.mark.parametrize('dtype', DTYPES)
def test_open_loops_have_nan(dtype):
    mechanism = case('closed loop')
    q = np.tile(mechanism.q, (3, 1))
    q[1] += [0.0, 0.1, 0.0]
    zeros = np.zeros((3, mechanism.robot.n))
    result = gpu.function(mechanism.robot, 'inverse_dynamics', dtype=dtype)(
        *on_gpu(q, zeros, zeros, np.zeros((3, 1, 6)), dtype=dtype))
    np.testing.assert_array_equal(np.isnan(values_of(result)).all(axis=1),
                                  [False, True, False])
    np.testing.assert_array_equal(np.isnan(values_of(result)).any(axis=1),
                                  [False, True, False])


def test_rollouts_are_nan_from_where_they_are_not_valid():
    robot = fr3()
    q, u, tau = np.zeros((3, 3, 7))
    tau = np.zeros((3, 6, 7))
    tau[1, 3, 2] = np.nan
    q[2, 6] = np.inf
    values = values_of(gpu.rollout(robot)(*on_gpu(q, u, tau, coalesced=False), h=1e-3))
    bad = np.isnan(values)
    assert not bad[0].any()
    assert not bad[1, :3].any()
    assert bad[1, 3:].all()
    assert bad[2].all()
    loop = case('closed loop')  # a speed at which a step opens it
    fast = np.array([[0.0], [1e4]]) * np.ones((2, loop.robot.n))
    values = values_of(gpu.rollout(loop.robot)(
        *on_gpu(np.tile(loop.q, (2, 1)), fast, 0.0 * fast), h=1e-2, steps=3))
    assert np.isfinite(values[0]).all() and np.isnan(values[1, -1]).all()
    q = np.array([[0.0], [0.01]]) * [0.0, 1.0, 0.0] + loop.q  # open from the beginning
    still = np.zeros((2, loop.robot.n))
    values = values_of(
        gpu.rollout(loop.robot)(*on_gpu(q, still, still), h=1e-4, steps=2))
    assert np.isfinite(values[0]).all() and np.isnan(values[1]).all()


def test_functions_and_rollouts_can_be_copied_and_pickled():
    x = np.random.default_rng(9).normal(size=(3, 2, 7))
    function = gpu.function(fr3(), 'inverse_dynamics')
    motion = gpu.rollout(fr3())
    for copied in (copy.deepcopy(function), pickle.loads(pickle.dumps(function))):
        assert_same_numbers(values_of(copied(*on_gpu(*x))), fr3().inverse_dynamics(*x))
    again = pickle.loads(pickle.dumps(motion))
    np.testing.assert_array_equal(*(values_of(f(*on_gpu(*x), h=1e-3, steps=2))
                                    for f in (motion, again)))
    assert 'inverse_dynamics' in repr(function) and 'tau' in repr(motion)


def elementary(device, name, x):
    """Return an elementary function of numbers, computed in their type by a kernel."""
    program = trace_program('f', lambda x, none: [getattr(np, name)(x[0])],
                            [('x', (1,)), ('none', (0,))])
    real = DOUBLE if x.dtype == np.float64 else FLOAT
    out = np.empty_like(x)
    values = [ctypes.c_int64(len(x))]
    for array in (x, out):
        values += [ctypes.c_uint64(array.ctypes.data), ctypes.c_int64(1),
                   ctypes.c_int64(0)]
    kernel = device.kernel(0, kernel_text(program, real, host=True), 'kernel')
    device.launch(kernel, len(x), values, 0)
    return out


@pytest.mark.parametrize('name', ELEMENTARY)
def test_elementary_functions_of_floats_err_by_two_ulp(name, device):
    """Sine and cosine of angles of many turns: by 2e-7 at most."""
    sizes = np.array([1e-30, 1e-3, 0.5, 3.0, 80.0, 1e4])
    x = (sizes[:, None] * np.random.default_rng(10).uniform(-1.0, 1.0,
                                                            (6, 2000))).ravel().astype(
                                                                np.float32)
    with np.errstate(all='ignore'):
        exact = getattr(np, name)(x.astype(np.float64))
    values = elementary(device, name, x)
    fine = (np.abs(exact) < FLOAT.largest) & (np.abs(exact) > FLOAT.smallest)
    ulp = np.spacing(np.abs(exact[fine]).astype(np.float32))
    largest = 2.0 * ulp if name not in ('sin', 'cos') else np.where(
        np.abs(x[fine]) < 4.0, np.maximum(2.0 * ulp, 1e-7), 2e-7)
    assert (np.abs(values - exact)[fine] <= largest).all()
    tiny = np.abs(exact) <= FLOAT.smallest
    assert (np.abs(values)[tiny] <= 2.0 * FLOAT.smallest).all()
    np.testing.assert_array_equal(np.isnan(values), ~(fine | tiny))


@pytest.mark.parametrize('name', ELEMENTARY)
def test_elementary_functions_of_doubles_are_numpys(name, device):
    sizes = np.array([1e-8, 0.5, 3.0, 100.0, 1e6])
    x = (sizes[:, None] * np.random.default_rng(11).uniform(-1.0, 1.0,
                                                            (5, 2000))).ravel()
    with np.errstate(all='ignore'):
        exact = getattr(np, name)(x)
    fine = np.isfinite(exact)
    values = elementary(device, name, x)
    np.testing.assert_allclose(values[fine], exact[fine], rtol=1e-15,
                               atol=2e-16 if name in ('sin', 'cos') else 0.0)
    np.testing.assert_array_equal(np.isnan(values), ~fine)


@pytest.mark.parametrize('dtype', DTYPES)
@pytest.mark.parametrize('name', ELEMENTARY)
def test_numbers_that_are_not_finite_have_no_plausible_result(name, dtype, device):
    x = np.array([np.nan, np.inf, -np.inf], dtype=dtype)
    assert np.isnan(elementary(device, name, x)).all()  # of the whole state


def test_text_for_a_gpu_needs_no_library():
    for kind in KINDS:
        robot = case(kind).robot
        for name in ('inverse_dynamics', 'forward_dynamics'):
            for real in (DOUBLE, FLOAT):
                text = llvm.ptx(kernel_text(robot.kernels.program(name), real))
                assert '.entry kernel(' in text and '.extern' not in text
