"""Arrays in the memory of a GPU: those of other libraries, and results."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
import math
import sys
from typing import Any
from weakref import finalize

from kane_dynamics.errors import InputError
from kane_dynamics.gpu import dlpack
from kane_dynamics.gpu.cuda_driver import Driver

DTYPES = {'<f8': 'float64', '<f4': 'float32'}
ITEM = {'float64': 8, 'float32': 4}  # bytes
LEGACY = 1  # the default stream of a device, in both protocols
JAX = 'jax', 'jaxlib'
LIBRARIES = 'torch', 'cupy', *JAX


@dataclass(frozen=True)
class DeviceArray:
    """
    A view of an array in the memory of a GPU.

    Attributes
    ----------
    name : str
        Of the argument, for messages.
    pointer : int
    shape, strides : tuple of int
        Strides in numbers.
    dtype : str
    device : int
    writeable : bool
    owner : object
        Keeps the memory.

    """

    name: str
    pointer: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    dtype: str
    device: int
    writeable: bool
    owner: Any

    @property
    def ndim(self) -> int:
        """Return the number of axes."""
        return len(self.shape)

    @property
    def extent(self) -> tuple[int, int]:
        """Return the first address and the one after the last."""
        if 0 in self.shape:
            return self.pointer, self.pointer
        # The last entry of an axis lies above the first one, or below: strides may be
        # negative.
        lowest = 0
        highest = 0
        for size, stride in zip(self.shape, self.strides):
            reach = (size - 1) * stride
            lowest += min(reach, 0)
            highest += max(reach, 0)
        item = ITEM[self.dtype]
        return self.pointer + item * lowest, self.pointer + item * (highest + 1)


def device_view(name: str, x: Any, driver: Driver, stream: int) -> DeviceArray:
    """
    Return a view of an array, whose content is ready for work in a stream.

    Raises
    ------
    InputError
        It is not an array of float64 or float32 in the memory of a GPU.

    """
    if hasattr(x, 'block_until_ready'):  # of JAX, which states no stream
        x.block_until_ready()
    if library_of(x) == 'torch' and x.is_neg():  # such as the imaginary part of x.conj()
        raise InputError(f'{name}: a tensor that is negated lazily; expected '
                         'x.resolve_neg()')
    try:
        interface = getattr(x, '__cuda_array_interface__', None)
    except RuntimeError as error:  # PyTorch: the tensor requires a gradient
        raise InputError(f'{name}: {error}; expected an array without gradient, such as '
                         'x.detach()') from None
    if interface is not None:
        return _by_interface(name, x, interface, driver, stream)
    kind, device = None, 0
    if hasattr(x, '__dlpack_device__'):
        kind, device = x.__dlpack_device__()
    if kind not in (dlpack.CUDA, dlpack.MANAGED):
        where = ' in host memory' if kind is not None else ''
        raise InputError(f'{name}: a {type(x).__name__}{where}; expected an array in '
                         'the memory of an NVIDIA GPU (__cuda_array_interface__ or '
                         'DLPack)')
    with driver.on(int(device)):  # the device of the stream
        capsule = x.__dlpack__(stream=stream or LEGACY)
    tensor = dlpack.capsule_content(capsule)
    return DeviceArray(name, tensor.pointer, tensor.shape, tensor.strides,
                       _checked(name, tensor.dtype), int(device), True, (x, capsule))


def _by_interface(name: str, x: Any, interface: Any, driver: Driver,
                  stream: int) -> DeviceArray:
    """Return a view of an array with `__cuda_array_interface__`."""
    kind = interface['typestr']
    pointer, read_only = interface['data']
    dtype = _checked(name, DTYPES.get(kind, kind))
    item = ITEM[dtype]
    shape = tuple(interface['shape'])
    strides = dlpack.contiguous(shape)
    # Strides in bytes become strides in entries; none are those of C order.
    in_bytes = interface.get('strides')
    if in_bytes is not None:
        if any(stride % item for stride in in_bytes):
            raise InputError(f'{name}: strides of {in_bytes} bytes; expected multiples '
                             f'of {item}')
        strides = tuple(stride // item for stride in in_bytes)
    if interface.get('mask') is not None:
        raise InputError(f'{name}: a masked array; expected one without a mask')
    if pointer % item:
        raise InputError(f'{name}: address {pointer:#x}; expected a multiple of {item}')
    device: int | None = 0
    if math.prod(shape):
        device = driver.device_of(pointer)
    if device is None:
        raise InputError(f'{name}: address {pointer:#x}; expected memory of a GPU')
    # The stream that wrote the array is waited for, unless it is ours.
    theirs = interface.get('stream')
    if theirs is None:
        theirs = current_stream(x)  # PyTorch does not state it
    if theirs is not None and not same_stream(theirs, stream):
        with driver.on(device):
            driver.synchronize(theirs)
    return DeviceArray(name, pointer, shape, strides, dtype, device, not read_only, x)


def _checked(name: str, dtype: str) -> str:
    if dtype not in ITEM:
        raise InputError(f'{name}: dtype {dtype}; expected float64 or float32')
    return dtype


class DeviceMemory:
    """
    Memory of a GPU as an array that other libraries take over without a copy.

    `torch.from_dlpack`, `cupy.from_dlpack`, `jax.dlpack.from_dlpack` and
    `numba.cuda.as_cuda_array` accept it. It says that its content is ready: as ``out``
    of a call with a stream of your own, wait for that stream first.
    """

    def __init__(self, driver: Driver, device: int, shape: tuple[int, ...],
                 strides: tuple[int, ...], dtype: str) -> None:
        """Allocate the memory on a device, whose context is the current one."""
        self._driver, self._device = driver, device
        self._read = dlpack.Read(driver.allocate(ITEM[dtype] * math.prod(shape)), shape,
                                 strides, dtype)
        finalize(self, _freed, driver, device, self._read.pointer).atexit = False

    def __repr__(self) -> str:
        """Return type and shape."""
        return f'<DeviceMemory {self._read.dtype} {self.shape} on device {self._device}>'

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self._read.shape

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        """Return the array by the protocol of Numba, version 3; its values are computed."""
        item = ITEM[self._read.dtype]
        return {'shape': self.shape,
                'strides': tuple(item * x for x in self._read.strides),
                'typestr': f'<f{item}', 'data': (self._read.pointer, False),
                'version': 3,
                'stream': None}

    def __dlpack_device__(self) -> tuple[int, int]:
        """Return the kind and number of the device by the protocol of DLPack."""
        return dlpack.CUDA, self._device

    def __dlpack__(self, *, stream: Any = None, max_version: Any = None,
                   dl_device: Any = None, copy: bool | None = None) -> Any:
        """
        Return a capsule by the protocol of DLPack; the content is ready for any stream.

        Raises
        ------
        BufferError
            For a copy, or another device.

        """
        if copy or dl_device not in (None, self.__dlpack_device__()):
            raise BufferError(f'copy={copy}, dl_device={dl_device}; expected this '
                              'memory itself')
        return dlpack.write(self, self._read, self._device)


def _freed(driver: Driver, device: int, pointer: int) -> None:
    with driver.on(device):
        driver.call('cuMemFree_v2', pointer)


def library_of(x: Any) -> str:
    """Return the name of the library of an array, one of LIBRARIES, or an empty text."""
    names = (kind.__module__.partition('.')[0] for kind in type(x).__mro__)
    return next((name for name in names if name in LIBRARIES), '')


def same_stream(a: int, b: int) -> bool:
    """Return whether two handles are of one stream; the default stream has two."""
    return (a or LEGACY) == (b or LEGACY)


def current_stream(x: Any) -> int | None:
    """Return the current stream of the library of an array; None if it has none."""
    library = library_of(x)
    if library == 'torch' and x.is_cuda:
        return int(sys.modules['torch'].cuda.current_stream(x.device).cuda_stream)
    if library == 'cupy':
        with x.device:
            return int(sys.modules['cupy'].cuda.get_current_stream().ptr)
    return None


@contextmanager
def _allocating_on(like: Any, stream: int) -> Iterator[None]:
    """
    Make a stream the current one of PyTorch or CuPy, and the device of an array.

    Their memory pools reuse a block at once for work on the stream that it was allocated
    on.
    """
    library = library_of(like)
    current = current_stream(like)
    cuda: Any = sys.modules[library].cuda
    # The library's own stream needs no change, but the device may.
    same = current is not None and same_stream(current, stream)
    if library == 'torch':
        chosen = None  # the current one
        if not same and same_stream(stream, LEGACY):
            chosen = cuda.default_stream(like.device)
        elif not same:
            chosen = cuda.ExternalStream(stream, device=like.device)
        with cuda.stream(chosen):
            yield
    else:
        with like.device, nullcontext() if same else cuda.ExternalStream(
                0 if stream == LEGACY else stream):
            yield


def empty(like: Any, batch: Sequence[int], shape: Sequence[int], dtype: str,
          coalesced: bool, driver: Driver, device: int, stream: int) -> Any:
    """
    Return a new array of the library of another array, or a `DeviceMemory`.

    Parameters
    ----------
    like : array
        An array of a GPU.
    batch, shape : sequences of int
        Axes of the states, and of the result of each.
    dtype : str
        Of the numbers.
    coalesced : bool
        Numbers of neighboring states are neighbors in memory; else those of one state.
    driver, device : Driver, int
        Whose context is the current one.
    stream : int
        On which the array is written.

    """
    library = library_of(like)
    stored = (*batch, *shape)
    order = list(range(len(stored)))
    if coalesced and library not in JAX:  # which has rows only
        # In memory the axes of the states come last; the array has them first.
        stored = (*shape, *batch)
        order = [*order[len(shape):], *order[:len(shape)]]
    if library == 'torch':
        torch: Any = sys.modules['torch']
        with _allocating_on(like, stream):
            return torch.empty(stored, dtype=getattr(torch, dtype),
                               device=like.device).permute(order)
    if library == 'cupy':
        cupy: Any = sys.modules['cupy']
        with _allocating_on(like, stream):
            return cupy.empty(stored, dtype=dtype).transpose(order)
    strides = dlpack.contiguous(stored)
    return DeviceMemory(driver, device, (*batch, *shape),
                        tuple(strides[k] for k in order), dtype)


def handed_over(like: Any, result: Any) -> Any:
    """Return a result as an array of the library of another array, if that is JAX."""
    if isinstance(result, DeviceMemory) and library_of(like) in JAX:
        return sys.modules['jax'].dlpack.from_dlpack(result)
    return result
