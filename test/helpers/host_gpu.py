"""A GPU that is the processor: the same kernels, compiled for it, state by state."""

from contextlib import contextmanager, nullcontext
import ctypes
from functools import partial

from kane_dynamics.gpu import device_function, device_rollout, kernel_call
from kane_dynamics.native.machine_code import llvm
import numpy as np
import pytest


class HostArray:
    """A NumPy array as one of a GPU, by `__cuda_array_interface__`."""

    def __init__(self, array, stream=None, read_only=False):
        self.array = array
        self.stream = stream
        self.read_only = read_only

    @property
    def __cuda_array_interface__(self):
        x = self.array
        return {'shape': x.shape, 'strides': x.strides, 'typestr': x.dtype.str,
                'data': (x.ctypes.data, self.read_only), 'version': 3,
                'stream': self.stream}


class HostDriver:
    """The members of `Driver` that calls need."""

    def __init__(self):
        self.launches = []
        self.waited = []
        self.memory = {}
        self.made = {}
        self.devices = ('Processor',)

    def device_of(self, pointer):
        return 0

    def on(self, device):
        return nullcontext()

    def synchronize(self, stream):
        self.waited.append(stream)

    def allocate(self, size):
        block = np.full(max(size, 1), 255, dtype=np.uint8)
        self.memory[block.ctypes.data] = block
        return block.ctypes.data

    def call(self, name, *arguments):
        if name == 'cuMemFree_v2':
            del self.memory[arguments[0]]
        elif name.startswith('cuMemcpy'):
            ctypes.memmove(*arguments)
        elif name == 'cuEventElapsedTime':
            arguments[0]._obj.value = 1.0  # ms
        else:
            assert name.startswith('cuEvent')

    def kernel(self, device, text, name):
        if text not in self.made:
            self.made[text] = llvm.Code(llvm.assemble(text))
        return self.made[text].address(name)

    def launch(self, kernel, count, values, stream):
        self.launches.append((count, stream))
        run = ctypes.CFUNCTYPE(None, ctypes.c_int64, *map(type, values))(kernel)
        for i in range(count + 3):  # and as many threads too much
            run(i, *values)


@contextmanager
def host_gpu():
    """Use the processor as the GPU; yield its driver."""
    driver = HostDriver()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel_call, 'driver', lambda: driver)
        for module, name in ((device_function, 'kernel_text'),
                             (device_rollout, 'rollout_text')):
            patch.setattr(module, name, partial(getattr(module, name), host=True))
            patch.setattr(module, 'ptx_text', lambda name, key, dtype, text: text())
        yield driver


def on_gpu(*arrays, dtype='float64', coalesced=True):
    """Return copies of arrays, with states as neighbors in memory or row by row."""
    return [HostArray(np.array(x, dtype=dtype, order='F' if coalesced else 'C'))
            for x in arrays]


def values_of(result):
    """Return the numbers of a result."""
    if isinstance(result, HostArray):
        return result.array
    interface = result.__cuda_array_interface__
    count = int(np.prod(interface['shape']))
    item = int(interface['typestr'][-1])
    flat = (ctypes.c_char * max(count * item, 1)).from_address(interface['data'][0])
    return np.lib.stride_tricks.as_strided(
        np.frombuffer(flat, dtype=interface['typestr'], count=count), interface['shape'],
        interface['strides']).copy()
