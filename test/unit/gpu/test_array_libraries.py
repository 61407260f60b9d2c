"""Arrays of PyTorch, CuPy and JAX on a GPU: streams, devices, memory of results."""

from contextlib import nullcontext
import sys
from types import ModuleType, SimpleNamespace

from framework_states import fr3
from host_gpu import host_gpu, HostArray, on_gpu, values_of
from kane_dynamics import gpu, InputError, load_urdf, Robot
import numpy as np
import pytest
from same_numbers import assert_same_numbers


@pytest.fixture(name='device', autouse=True)
def _device():
    with host_gpu() as device:
        yield device


def dynamics():
    return gpu.function(fr3(), 'inverse_dynamics')


def good(**options):
    return on_gpu(*np.random.default_rng(0).normal(size=(3, 3, 7)), **options)


def test_a_tensor_that_requires_a_gradient_or_is_on_the_processor_is_refused():
    torch = pytest.importorskip('torch')
    with pytest.raises(InputError, match='q: a Tensor in host memory; expected'):
        dynamics()(*[torch.zeros(3, 7)] * 3)

    class Needy(HostArray):

        @property
        def __cuda_array_interface__(self):
            raise RuntimeError(
                "Can't get __cuda_array_interface__ on Variable that requires grad")
    with pytest.raises(InputError,
                       match=r'q: .*requires grad; expected an array without gradient'
                       r', such as x.detach\(\)'):
        dynamics()(*[Needy(np.zeros((3, 7)))] * 3)


def library(name, monkeypatch, **members):
    """Return a class of arrays of a library of this name, which is a module."""
    module = ModuleType(name)
    vars(module).update(members)
    monkeypatch.setitem(sys.modules, name, module)
    kind = type('Array', (HostArray,), {'__module__': f'{name}.core'})
    kind.is_neg = lambda self: False
    return kind


current = []  # streams and devices


class Chosen:
    """A stream or device that notes while it is the current one."""

    def __init__(self, *values, **_):
        self.values = values

    def __enter__(self):
        current.append(self.values)

    def __exit__(self, *_):
        current.pop()


@pytest.mark.parametrize('coalesced', [True, False])
def test_results_of_cupy_and_torch_are_theirs_on_their_current_stream(
        monkeypatch, device, coalesced):
    asked = []
    places = []

    def allocated(kind, shape, dtype):
        asked.append((shape, dtype))
        places.append(list(current))
        return kind(np.empty(shape, dtype=dtype))
    stream = SimpleNamespace(ptr=0x55, cuda_stream=0x66)
    Cupy = library(
        'cupy', monkeypatch,
        cuda=SimpleNamespace(get_current_stream=lambda: stream, ExternalStream=Chosen),
        empty=lambda shape, dtype: allocated(Cupy, shape, dtype))
    Torch = library('torch', monkeypatch, float64='float64', cuda=SimpleNamespace(
        current_stream=lambda on: stream, stream=lambda x: x or nullcontext(),
        default_stream=lambda on: Chosen('default'), ExternalStream=Chosen),
                    empty=lambda shape, dtype, device: allocated(Torch, shape, dtype))
    Cupy.transpose = Torch.permute = lambda self, order: type(self)(
        self.array.transpose(order))
    Torch.is_cuda, Torch.device, Cupy.device = True, 'cuda:0', Chosen('device')
    x = np.random.default_rng(3).normal(size=(4, 7))
    for kind, handle in ((Cupy, 0x55), (Torch, 0x66)):
        inputs = kind(on_gpu(x, coalesced=coalesced)[0].array)
        result = gpu.function(fr3(), 'mass_matrix')(inputs)
        assert type(result) is kind and device.launches[-1] == (4, handle)
        assert_same_numbers(result.array, fr3().mass_matrix(x))
        assert asked[-1] == ((7, 7, 4) if coalesced else (4, 7, 7), 'float64')
        assert device.waited == []
        extra_calls = [('device',)] if kind is Cupy else []
        assert places[-1] == extra_calls
        # Its memory is of that stream.
        gpu.function(fr3(), 'mass_matrix')(inputs, stream=7)
        assert places[-1] == [*extra_calls, (7,)] and device.launches[-1] == (4, 7)
        assert set(device.waited) == {handle}  # on which the arguments are made
        gpu.function(fr3(), 'mass_matrix')(inputs, stream=1)
        assert places[-1] == [*extra_calls, ('default',) if kind is Torch else (0,)]
        device.waited.clear()


def test_with_arrays_of_several_libraries_the_stream_is_of_those_that_have_one(
        monkeypatch, device):
    stream = SimpleNamespace(cuda_stream=0x66)
    Torch = library('torch', monkeypatch,
                    cuda=SimpleNamespace(current_stream=lambda on: stream))
    Torch.is_cuda = True
    Torch.device = 'cuda:0'
    # A tensor of a class of its own.
    Mine = type('Mine', (Torch,), {'__module__': 'mine'})
    q, u, udot = good()
    out = HostArray(np.zeros((3, 7)))
    for kind in (Torch, Mine):
        dynamics()(q, kind(u.array), udot, out=out)
        assert device.launches[-1] == (3, 0x66) and device.waited == [0x66]
        device.waited.clear()
    inputs = [Torch(x.array) for x in (q, u, udot)]
    dynamics()(*inputs, out=Torch(out.array))
    assert device.waited == []
    dynamics()(*inputs, out=out)  # whose library does not know of the kernel
    assert device.waited == [0x66]


def test_a_tensor_that_is_negated_lazily_is_refused(monkeypatch):
    torch = pytest.importorskip('torch')
    q, _, udot = good()
    with pytest.raises(InputError,
                       match=r'u: .*negated lazily; expected x.resolve_neg\(\)'):
        dynamics()(q, torch.zeros(3, 7, dtype=torch.complex128).conj().imag, udot)


def test_results_for_jax_are_handed_over_and_its_arrays_waited_for(monkeypatch, device):
    taken = []
    waited = []

    def from_dlpack(x):
        taken.append(x)
        return 'of JAX'
    Jax = library('jaxlib', monkeypatch)
    library('jax', monkeypatch, dlpack=SimpleNamespace(from_dlpack=from_dlpack))
    Jax.block_until_ready = lambda self: waited.append(self)
    inputs = [Jax(x.array) for x in good(coalesced=False)]
    assert dynamics()(*inputs) == 'of JAX'
    assert waited == inputs and device.waited == [0]
    assert values_of(taken[0]).shape == (3, 7)
    one = Robot(load_urdf('urdf/fr3.urdf', tip='fr3_link1'))
    pose = gpu.function(one, 'frame_pose:fr3_link1')
    pose(Jax(np.zeros((4, 1))))  # JAX takes over rows only
    assert taken[1].__cuda_array_interface__['strides'] == (128, 32, 8)
