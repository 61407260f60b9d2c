"""The driver of NVIDIA GPUs, `libcuda`, by ctypes: memory, streams, PTX kernels."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import ctypes
from ctypes import (byref, c_char_p, c_float, c_int, c_size_t, c_uint, c_uint64,
                    c_void_p, POINTER)
from functools import cache
from typing import Any

from kane_dynamics._util.fork_safety import ForkSafeLock
from kane_dynamics.errors import DeviceError

LIBRARY = 'libcuda.so.1'
BLOCK = 128  # threads; with all 255 registers each, half of those of a multiprocessor
DEVICE_OF_POINTER = 9  # CU_POINTER_ATTRIBUTE_DEVICE_ORDINAL
INVALID_VALUE = 1  # CUDA_ERROR_INVALID_VALUE: an address that the driver does not know
# CU_JIT_ERROR_LOG_BUFFER and its size
ERROR_LOG, ERROR_LOG_BYTES = 5, 6
MOST_LOG = 4096
HANDLE = POINTER(c_void_p)
SIGNATURES: dict[str, tuple[Any, ...]] = {
    'cuInit': (c_uint,),
    'cuGetErrorName': (c_int, POINTER(c_char_p)),
    'cuGetErrorString': (c_int, POINTER(c_char_p)),
    'cuDeviceGetCount': (POINTER(c_int),),
    'cuDeviceGet': (POINTER(c_int), c_int),
    'cuDeviceGetName': (c_char_p, c_int, c_int),
    'cuDevicePrimaryCtxRetain': (HANDLE, c_int),
    'cuCtxPushCurrent_v2': (c_void_p,),
    'cuCtxPopCurrent_v2': (HANDLE,),
    'cuPointerGetAttribute': (c_void_p, c_int, c_uint64),
    'cuMemAlloc_v2': (POINTER(c_uint64), c_size_t),
    'cuMemFree_v2': (c_uint64,),
    'cuMemcpyHtoD_v2': (c_uint64, c_void_p, c_size_t),
    'cuMemcpyDtoH_v2': (c_void_p, c_uint64, c_size_t),
    'cuModuleLoadDataEx': (HANDLE, c_char_p, c_uint, POINTER(c_int), HANDLE),
    'cuModuleGetFunction': (HANDLE, c_void_p, c_char_p),
    'cuLaunchKernel': (c_void_p, *[c_uint] * 7, c_void_p, HANDLE, HANDLE),
    'cuStreamSynchronize': (c_void_p,),
    'cuEventCreate': (HANDLE, c_uint),
    'cuEventRecord': (c_void_p, c_void_p),
    'cuEventSynchronize': (c_void_p,),
    'cuEventElapsedTime': (POINTER(c_float), c_void_p, c_void_p),
    'cuEventDestroy_v2': (c_void_p,),
}


class Driver:
    """
    The driver.

    Parameters
    ----------
    library : str
        Name of its shared library.

    Raises
    ------
    DeviceError
        There is no driver, or no device.

    """

    def __init__(self, library: str = LIBRARY) -> None:
        """Load and initialize the driver."""
        try:
            self._library = ctypes.CDLL(library)
            for name, signature in SIGNATURES.items():
                getattr(self._library, name).argtypes = signature
        except (AttributeError, OSError) as error:
            raise DeviceError(f'driver: {error}; expected a machine with an NVIDIA GPU '
                              'and its driver') from None
        self.call('cuInit', 0)
        self._contexts: dict[int, c_void_p] = {}
        self._kernels: dict[tuple[int, str], c_void_p] = {}  # by device and text
        self._lock = ForkSafeLock()

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function of the driver; raise DeviceError if it fails."""
        self._require(name, getattr(self._library, name)(*arguments))

    def _require(self, name: str, status: int) -> None:
        if status:
            raise DeviceError(f'{name}: {self._explained(status)}; expected success')

    def _explained(self, status: int) -> str:
        words = []
        for function in ('cuGetErrorName', 'cuGetErrorString'):
            text = c_char_p()
            if not getattr(self._library, function)(status, byref(text)) and text.value:
                words.append(text.value.decode(errors='replace'))
        return ', '.join([f'error {status}', *words])

    @property
    def devices(self) -> tuple[str, ...]:
        """Names of the devices."""
        count = c_int()
        self.call('cuDeviceGetCount', byref(count))
        return tuple(self._name(k) for k in range(count.value))

    def _name(self, device: int) -> str:
        text = ctypes.create_string_buffer(256)
        self.call('cuDeviceGetName', text, len(text), self._handle(device))
        return text.value.decode(errors='replace')

    def _handle(self, device: int) -> int:
        handle = c_int()
        self.call('cuDeviceGet', byref(handle), device)
        return handle.value

    @contextmanager
    def on(self, device: int) -> Iterator[None]:
        """Make the context of a device, which all libraries share, the current one."""
        with self._lock.held():
            context = self._contexts.get(device)
            if context is None:
                # The primary context is that of PyTorch, JAX and CuPy, so that their
                # memory is valid.
                context = c_void_p()
                self.call('cuDevicePrimaryCtxRetain', byref(context),
                          self._handle(device))
                self._contexts[device] = context
        self.call('cuCtxPushCurrent_v2', context)
        try:
            yield
        finally:
            self.call('cuCtxPopCurrent_v2', byref(c_void_p()))

    def device_of(self, pointer: int) -> int | None:
        """Return the device of an address, or None if it is not memory of a device."""
        device = c_int(-1)
        status = self._library.cuPointerGetAttribute(byref(device), DEVICE_OF_POINTER,
                                                     pointer)
        # The driver fails, such as after a kernel failed, or in a forked child.
        if status != INVALID_VALUE:
            self._require('cuPointerGetAttribute', status)
        return None if status or device.value < 0 else device.value

    def allocate(self, size: int) -> int:
        """Return the address of new memory of the current device; `size` in bytes."""
        address = c_uint64()
        self.call('cuMemAlloc_v2', byref(address), max(size, 1))
        return address.value

    def kernel(self, device: int, ptx: str, name: str) -> c_void_p:
        """Return a kernel of a text, loaded into the current context of a device."""
        with self._lock.held():
            found = self._kernels.get((device, ptx))
            if found is None:
                module, found = c_void_p(), c_void_p()
                self._load(module, ptx)
                self.call('cuModuleGetFunction', byref(found), module, name.encode())
                self._kernels[device, ptx] = found
            return found

    def _load(self, module: c_void_p, ptx: str) -> None:
        """Load a module; on failure, DeviceError with the message of the assembler."""
        log = ctypes.create_string_buffer(MOST_LOG)
        options = (c_int * 2)(ERROR_LOG, ERROR_LOG_BYTES)
        values = (c_void_p * 2)(ctypes.addressof(log), MOST_LOG)
        try:
            self.call('cuModuleLoadDataEx', byref(module), ptx.encode(), 2, options,
                      values)
        except DeviceError as error:
            details = log.value.decode(errors='replace')
            raise DeviceError(f'{error}\n{details}'.strip()) from None

    def launch(self, kernel: c_void_p, count: int, values: Sequence[Any],
               stream: int) -> None:
        """
        Run a kernel with one thread for each of `count` states.

        It begins after the earlier work of the stream. `values` are the ctypes objects
        that it receives.
        """
        pointers = (c_void_p * len(values))(*(ctypes.addressof(x) for x in values))
        self.call('cuLaunchKernel', kernel, -(-count // BLOCK), 1, 1, BLOCK, 1, 1, 0,
                  stream, pointers, None)

    def synchronize(self, stream: int) -> None:
        """Wait until everything in a stream is done."""
        self.call('cuStreamSynchronize', stream)


@cache
def driver() -> Driver:
    """Return the driver of this machine, loaded at the first use."""
    return Driver()
