"""The driver layer against a recorder of calls: order, sizes, streams."""

import ctypes
from pathlib import Path
import subprocess

from framework_states import fr3
from host_gpu import HostArray
from kane_dynamics import DeviceError, gpu, InputError, KaneError
from kane_dynamics.gpu import cuda_driver, kernel_call
from kane_dynamics.gpu.device_arrays import DeviceMemory
import numpy as np
import pytest


class At:
    """An array at an address of the recording driver."""

    def __init__(self, address, *shape, dtype='<f8', strides=None, stream=None, **more):
        self.__cuda_array_interface__ = {
            'shape': shape, 'typestr': dtype, 'data': (address, False), 'version': 3,
            'strides': strides, 'stream': stream, **more}


@pytest.fixture(name='library', scope='module')
def _library(tmp_path_factory):
    file = tmp_path_factory.mktemp('fake') / 'libcuda.so'
    source = Path(__file__).with_name('fake_cuda.c')
    subprocess.run(['gcc', '-shared', '-fPIC', '-O1', '-o', str(file), str(source)],
                   check=True, timeout=60)
    return file


class Fake:
    """The recording driver: what is called, and what fails."""

    def __init__(self, library):
        self._own = ctypes.CDLL(str(library))
        self._record = (ctypes.c_char * 65536).in_dll(self._own, 'record')
        self._fails = (ctypes.c_char * 64).in_dll(self._own, 'fails')
        ctypes.c_uint64.in_dll(self._own, 'host_begin').value = 0x2000000
        self.fail('')
        self._record.value = b''

    def fail(self, name):
        self._fails.value = name.encode()

    def calls(self):
        lines = self._record.value.decode().splitlines()
        self._record.value = b''
        return lines


@pytest.fixture(name='fake')
def _fake(library, monkeypatch):
    fake = Fake(library)
    driver = cuda_driver.Driver(str(library))
    monkeypatch.setattr(kernel_call, 'driver', lambda: driver)
    assert 'cuInit 0' in fake.calls()
    fake.driver = driver
    return fake


def dynamics():
    return gpu.function(fr3(), 'inverse_dynamics')


def arrays(count=1000, **more):
    return [At(0x10000 * (k + 1), count, 7, **more) for k in range(4)]


def test_a_call_enters_the_context_loads_launches_and_leaves(fake):
    *inputs, out = arrays()
    assert dynamics()(*inputs, out=out, stream=0x77) is out
    launch = (
        'launch 0x300 grid 8 1 1 block 128 1 1 shared 0 stream 0x77 extra (nil) '
        f'values 1000 {0x10000} 7 1 {0x20000} 7 1 {0x30000} 7 1 {0x40000} 7 1 0 0 -9.81')
    assert fake.calls() == ['retain 0', 'enter 0x100', 'load .version',
                            'function 0x200 kernel', launch, 'leave']
    dynamics()(*inputs, out=out, stream=5)  # the same text is loaded once
    assert [call.split()[0] for call in fake.calls()] == ['enter', 'launch', 'leave']


def test_layout_is_passed_as_strides_and_shared_arguments_have_none(fake):
    q, u, _, out = arrays(300, strides=(8, 2400))
    dynamics()(q, u, At(0x40, 7), out=out, stream=5)
    launch, = (call for call in fake.calls() if call.startswith('launch'))
    assert 'grid 3 1 1' in launch
    assert (f'values 300 {0x10000} 1 300 {0x20000} 1 300 {0x40} 0 1 {0x40000} 1 300'
            in launch)


def test_without_a_stream_the_call_waits_and_with_one_it_does_not(fake):
    *inputs, out = arrays()
    dynamics()(*inputs, out=out)
    assert [call.split()[0] for call in fake.calls()][-3:] == [
        'launch', 'synchronize', 'leave']
    dynamics()(*inputs, out=out, stream=5)
    assert not any(call.startswith('synchronize') for call in fake.calls())
    dynamics()(*inputs, stream=5)  # the result, new memory, says that it is ready
    assert 'synchronize 0x5' in fake.calls()


def test_a_stream_that_an_array_states_is_waited_for_unless_it_is_that_of_the_call(fake):
    *inputs, out = arrays(stream=9)
    dynamics()(*inputs, out=out, stream=9)
    assert not any(call.startswith('synchronize') for call in fake.calls())
    dynamics()(*inputs, out=out, stream=8)
    calls = fake.calls()
    assert calls[:3] == ['enter 0x100', 'synchronize 0x9', 'leave']
    assert sum(call == 'synchronize 0x9' for call in calls) == 4
    # On the default stream of the second device.
    inputs[0] = At(0x1000000, 1000, 7, stream=1)
    with pytest.raises(InputError, match='u: on device 0; expected device 1'):
        dynamics()(*inputs, stream=8)
    assert fake.calls()[1:4] == ['enter 0x101', 'synchronize 0x1', 'leave']


def test_results_are_allocated_on_the_device_and_freed(fake):
    result = dynamics()(*arrays()[:3])
    assert isinstance(result, DeviceMemory) and result.shape == (1000, 7)
    assert 'allocate 56000' in fake.calls()
    assert result.__cuda_array_interface__['data'] == (0x900000, False)
    assert result.__dlpack_device__() == (2, 0)
    del result
    assert fake.calls() == ['enter 0x100', 'free 0x900000', 'leave']


def test_arrays_of_the_second_device_run_there(fake):
    *inputs, out = (At(0x1000000 + 0x10000 * k, 10, 7) for k in range(4))
    dynamics()(*inputs, out=out)
    assert 'enter 0x101' in fake.calls()
    with pytest.raises(InputError,
                       match="u: on device 0; expected device 1, that of 'q'"):
        dynamics()(inputs[0], At(0x1000, 10, 7), inputs[2])
    with pytest.raises(InputError, match='out: on device 0; expected device 1'):
        dynamics()(*inputs, out=At(0x1000, 10, 7))


@pytest.mark.parametrize('name',
                         ['cuDevicePrimaryCtxRetain', 'cuModuleLoadDataEx',
                          'cuModuleGetFunction', 'cuLaunchKernel', 'cuMemAlloc_v2',
                          'cuStreamSynchronize', 'cuPointerGetAttribute'])
def test_an_error_of_the_driver_is_named_and_explained(fake, name):
    fake.fail(name)
    with pytest.raises(DeviceError,
                       match=f'{name}: error 719, CUDA_ERROR_LAUNCH_FAILED, '
                       'unspecified launch failure; expected success') as error:
        dynamics()(*arrays()[:3])
    assert isinstance(error.value, KaneError)
    assert ('ptxas fatal: line 7' in str(error.value)) == (name == 'cuModuleLoadDataEx')
    calls = [call.split()[0] for call in fake.calls()]
    assert calls.count('enter') == calls.count('leave')
    fake.fail('')
    dynamics()(*arrays()[:3])  # a failure leaves nothing half made


def test_devices_are_listed(fake):
    assert fake.driver.devices == ('Fake 0', 'Fake 1')


def test_memory_of_the_host_is_refused(fake):
    *inputs, out = arrays()
    with pytest.raises(InputError,
                       match=r'u: address 0x[0-9a-f]+; expected memory of a GPU'):
        dynamics()(inputs[0], HostArray(np.zeros((1000, 7))), inputs[2], out=out)


def test_without_driver_or_device_the_error_says_so(library, fake, monkeypatch):
    with pytest.raises(DeviceError,
                       match=r'driver: no_such_library.so: .*; expected a machine '
                       'with an NVIDIA GPU'):
        cuda_driver.Driver('no_such_library.so')
    with pytest.raises(DeviceError,
                       match=r'driver: .*cuInit.*; expected a machine with an'):
        cuda_driver.Driver('libm.so.6')
    fake.fail('cuInit')
    with pytest.raises(DeviceError, match='cuInit: error 719'):
        cuda_driver.Driver(str(library))


def test_a_module_is_imported_and_a_function_made_without_driver(monkeypatch):
    monkeypatch.setattr(kernel_call, 'driver',
                        lambda: pytest.fail('the driver was loaded'))
    assert dynamics().ptx.startswith('//')
    assert gpu.rollout(fr3(), dtype='float32').dtype == 'float32'
