"""Arrays of GPUs: refusals, DLPack both ways, results in the same library."""

import gc
from itertools import pairwise

from framework_states import arm, fr3
from host_gpu import host_gpu, HostArray, on_gpu, values_of
from kane_dynamics import gpu, InputError
from kane_dynamics.gpu import dlpack
from kane_dynamics.gpu.kernel_call import collapsed
from kinds_of_mechanism import case
import numpy as np
import pytest
from same_numbers import assert_same_numbers


@pytest.fixture(name='device', autouse=True)
def _device():
    with host_gpu() as device:
        yield device


def dynamics(**options):
    return gpu.function(fr3(), 'inverse_dynamics', **options)


def good(count=3, **options):
    return on_gpu(*np.random.default_rng(0).normal(size=(3, count, 7)), **options)


class Capsule:
    """A NumPy array as one of a GPU, by DLPack alone."""

    def __init__(self, array, kind=dlpack.CUDA):
        self.array = array
        self.kind = kind
        self.streams = []

    def __dlpack_device__(self):
        return self.kind, 0

    def __dlpack__(self, stream=None):
        self.streams.append(stream)
        return self.array.__dlpack__()


@pytest.mark.parametrize('bad, message', [
    (np.zeros((3, 7)), 'u: a ndarray in host memory; expected an array in the memory'),
    ([[0.0] * 7] * 3, 'u: a list; expected an array in the memory'),
    (None, 'u: a NoneType; expected an array'),
    (HostArray(np.zeros((3, 6))),
     r'u: shape \(3, 6\); expected \(7,\), with batch axes'),
    (HostArray(np.zeros(())), r'u: shape \(\); expected \(7,\)'),
    (HostArray(np.zeros((3, 7), dtype='float32')),
     'u: float32; expected float64, of which'),
    (HostArray(np.zeros((3, 7), dtype='int64')),
     'u: dtype <i8; expected float64 or float32'),
    (HostArray(np.zeros((3, 7), dtype='>f8')),
     'u: dtype >f8; expected float64 or float32'),
    (HostArray(np.zeros((2, 7))),
     r'arguments q \(3, 7\), u \(2, 7\), udot \(3, 7\); expec'),
    (HostArray(np.zeros((1, 3, 7))), 'expected the same batch axes'),
    (HostArray(np.zeros(176, dtype=np.uint8)[1:169].view('f8').reshape(3, 7)),
     r'u: address 0x\w+; expected a multiple of 8'),
    (Capsule(np.zeros((3, 7), dtype='int32')), 'u: dtype type code 0; expected float64'),
    (Capsule(np.zeros((3, 7)), kind=10), 'u: a Capsule in host memory; expected'),
])
def test_an_argument_that_is_not_valid_is_named(bad, message):
    q, _, udot = good()
    with pytest.raises(InputError, match=message):
        dynamics()(q, bad, udot)


def test_states_at_unequal_distances_are_refused():
    x = np.zeros((3, 4, 7))[:, :3]
    with pytest.raises(InputError,
                       match=r'q: strides \(28, 7, 1\) of shape \(3, 3, 7\); expected '
                       'states at equal distances'):
        dynamics()(*[HostArray(x)] * 3)
    wrench = np.zeros((2, 6, 1)).transpose(0, 2, 1)
    state = [HostArray(np.zeros((2, 2)))] * 3
    function = gpu.function(arm(), 'inverse_dynamics')
    assert values_of(function(*state, HostArray(wrench))).shape == (2, 2)


@pytest.mark.parametrize('out, message', [
    (np.zeros((3, 7)), 'out: a ndarray in host memory'),
    (HostArray(np.zeros((3, 6))), r'out: shape \(3, 6\); expected \(3, 7\)'),
    (HostArray(np.zeros((3, 7), dtype='float32')), 'out: float32; expected float64'),
    (HostArray(np.zeros((3, 7)), read_only=True),
     'out: an array that cannot be written'),
    (HostArray(np.broadcast_to(np.zeros(7), (3, 7))), r'out: strides \(0, 1\) of shape'),
    (HostArray(np.lib.stride_tricks.as_strided(np.zeros(20), (3, 7), (48, 8))),
     'expected entries that do not overlap'),
])
def test_a_result_that_cannot_be_written_is_refused(out, message):
    with pytest.raises(InputError, match=message):
        dynamics()(*good(), out=out)


def test_a_result_between_the_arguments_is_refused():
    block = np.zeros((4, 7))
    q = HostArray(block[:3])
    remainder = good()[1:]
    with pytest.raises(InputError,
                       match="out: memory between that of 'q'; expected memory of"):
        dynamics()(q, *remainder, out=HostArray(block[1:]))
    one = HostArray(block[:1])
    with pytest.raises(InputError, match="out: memory between that of 'q'"):
        # Other threads read it, too.
        dynamics()(one, *remainder, out=HostArray(block[:3]))


def test_names_counts_and_options_are_checked():
    inputs = good()
    for call, message in [
            (lambda: dynamics()(*inputs[:2]),
             'arguments 2 by position; expected q, u, udot'),
            (lambda: dynamics()(*inputs, u=inputs[1]),
             'arguments 3 by position, u; expected'),
            (lambda: dynamics()(*inputs, stream='x'),
             "stream: 'x'; expected the handle"),
            (lambda: dynamics(dtype='float16'),
             "dtype: 'float16'; expected 'float64' or"),
            (lambda: dynamics(parameters='mass'),
             "parameters: 'mass'; expected for inverse_dyn"),
            (lambda: gpu.function(fr3(), 'torque'), "no kernel 'torque' for this robot"),
            (lambda: gpu.function(fr3(), 3),
             'name: a int; expected the name of a quantity'),
            (lambda: gpu.rollout(fr3(), parameters='payload'),
             "parameters: 'payload'; expected"),
            (lambda: gpu.rollout(fr3(), integrator='euler'),
             "integrator: 'euler'; expected")]:
        with pytest.raises(InputError, match=message):
            call()


@pytest.mark.parametrize('options, message', [
    ({}, 'steps: missing; expected their number'),
    ({'steps': 0}, 'steps: 0; expected an integer'),
    ({'steps': 2.5}, 'steps: 2.5; expected an integer'),
    ({'steps': 3, 'h': 0.0}, 'h: 0 s; expected a positive, finite time'),
    ({'steps': 3, 'h': np.nan}, 'h: nan s; expected a positive, finite time'),
    ({'steps': 3, 't': np.inf}, r't \(s\): inf; expected'),
    ({'steps': 3, 'out': HostArray(np.zeros((3, 2, 14)))},
     r'out: shape .*; expected \(3, 3, 14'),
])
def test_options_of_rollouts_are_checked(options, message):
    with pytest.raises(InputError, match=message):
        gpu.rollout(fr3())(*good(), **{'h': 1e-3, **options})


def test_torques_of_rollouts_state_the_steps_or_agree_with_them():
    q, u, _ = good()
    motion = gpu.rollout(fr3())
    tau = HostArray(np.zeros((3, 5, 7)))
    assert values_of(motion(q, u, tau, h=1e-3)).shape == (3, 5, 14)
    assert values_of(motion(q, u, HostArray(np.zeros((1, 5, 7))),
                            h=1e-3)).shape == (3, 5, 14)
    with pytest.raises(InputError,
                       match='steps: 4; expected 5, the number of torques in tau'):
        motion(q, u, tau, h=1e-3, steps=4)
    with pytest.raises(InputError, match='rollout: 1 parameters; expected none'):
        motion(q, u, tau, q, h=1e-3)


def test_dlpack_arrays_are_read_in_any_layout_on_the_stream_of_the_call():
    x = np.random.default_rng(1).normal(size=(3, 4, 7))
    expected = fr3().inverse_dynamics(*x)
    inputs = [Capsule(x[0]), Capsule(np.asfortranarray(x[1])),
              Capsule(x[2][:, ::-1][:, ::-1])]
    assert_same_numbers(values_of(dynamics()(*inputs)), expected)
    dynamics()(*inputs, stream=77)
    assert [a.streams for a in inputs] == [[1, 77]] * 3


def test_results_go_to_other_libraries_by_dlpack_and_live_as_long_as_they_are_used(
        device, monkeypatch):
    """Read by NumPy: the memory is of the host, and for this test it says so."""
    monkeypatch.setattr(dlpack, 'CUDA', 1)
    x = np.random.default_rng(2).normal(size=(3, 4, 7))
    for coalesced in (True, False):
        result = dynamics()(*on_gpu(*x, coalesced=coalesced))
        array = np.from_dlpack(result)
        capsule = result.__dlpack__()
        del result, capsule  # that capsule was never taken
        gc.collect()
        assert len(device.memory) == 1
        assert_same_numbers(array, fr3().inverse_dynamics(*x))
        del array
        gc.collect()
        assert device.memory == {}


def test_capsules_are_released_while_an_error_propagates(device, monkeypatch):
    monkeypatch.setattr(dlpack, 'CUDA', 1)
    result = dynamics()(*good())
    with pytest.raises(ZeroDivisionError):
        [result.__dlpack__(), 1 / 0]
    with pytest.raises(ZeroDivisionError):
        [np.from_dlpack(result), 1 / 0]
    del result
    gc.collect()
    assert device.memory == {}


def test_a_copy_and_another_device_are_no_capsules(monkeypatch):
    monkeypatch.setattr(dlpack, 'CUDA', 1)
    result = dynamics()(*good())
    assert result.__dlpack__(stream=-1, max_version=(1, 0), dl_device=(1, 0), copy=False)
    for options in ({'copy': True}, {'dl_device': (2, 1)}):
        with pytest.raises(BufferError, match='expected this memory itself'):
            result.__dlpack__(**options)


def test_torch_reads_the_capsule_too(monkeypatch):
    torch = pytest.importorskip('torch')
    monkeypatch.setattr(dlpack, 'CUDA', 1)
    result = dynamics()(*good())
    array = torch.from_dlpack(result)
    assert array.shape == (3, 7) and array.dtype == torch.float64
    np.testing.assert_array_equal(array.numpy(), values_of(result))


def test_a_result_with_an_axis_of_one_state_or_of_many_has_the_shape_of_the_method():
    tree = case('tree').robot
    q = np.random.default_rng(4).normal(size=(2, 3, tree.n_q))
    energy = gpu.function(tree, 'potential_energy')
    for x in (q, q[0], q[0, 0]):
        result = values_of(energy(HostArray(x)))
        assert result.shape == x.shape[:-1]
        np.testing.assert_allclose(result, tree.potential_energy(
            x.reshape(-1, tree.n_q)).reshape(x.shape[:-1]), rtol=1e-14)


def test_strides_of_several_axes_are_one_where_states_are_at_equal_distances():
    rng = np.random.default_rng(5)
    for _ in range(200):
        shape = tuple(rng.integers(1, 4, size=rng.integers(1, 4)))
        x = np.zeros(shape).transpose(rng.permutation(len(shape)))
        strides = tuple(stride // 8 for stride in x.strides)
        addresses = places(x.shape, strides)
        one = len({b - a for a, b in pairwise(addresses)}) <= 1
        stride = collapsed(x.shape, strides)
        assert (stride is not None) == one
        if one and len(addresses) > 1:
            assert stride == addresses[1] - addresses[0]


def test_an_empty_batch_may_have_any_axes():
    # Libraries state strides of any kind for it.
    for shape in ((0, 7), (2, 0, 7), (0, 2, 7)):
        assert values_of(dynamics()(*[HostArray(np.zeros(shape))] * 3)).shape == shape


def places(shape, strides):
    """Return the places of all entries in C order."""
    return [sum(k * s for k, s in zip(index, strides)) for index in np.ndindex(*shape)]
