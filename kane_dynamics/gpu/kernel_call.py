"""Calls of kernels: checks of arrays, their addresses and strides, results, streams."""

from collections.abc import Callable, Sequence
from ctypes import c_double, c_float, c_int64, c_uint64
from functools import partial
import math
from typing import Any

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import InputError
from kane_dynamics.gpu.cuda_driver import Driver, driver
from kane_dynamics.gpu.device_arrays import (current_stream, device_view, DeviceArray,
                                             DeviceMemory, empty, handed_over, ITEM)
from kane_dynamics.native.backends.gpu_kernel import KERNEL
from kane_dynamics.native.backends.llvm_math import DOUBLE, FLOAT, Real
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.tracing.program import Shape

REALS: dict[str, Real] = {'float64': DOUBLE, 'float32': FLOAT}
IN_C: dict[str, Any] = {'float64': c_double, 'float32': c_float}


def require_dtype(dtype: Any) -> str:
    """Return the name of a type of numbers; InputError unless kernels have it."""
    if dtype not in ITEM:
        raise InputError(f'dtype: {dtype!r}; expected {" or ".join(map(repr, ITEM))}')
    return str(dtype)


def ptx_text(name: str, key: str | None, dtype: str, text: Callable[[], str]) -> str:
    """Return the PTX of a kernel; without a cache key, its LLVM IR is the key."""
    if key is None:
        key = text()
        text = partial(str, key)

    def compiled() -> bytes:
        return llvm.ptx(text()).encode()
    return llvm.cached(compiled, 'ptx', name, key, dtype).decode()


class KernelCall:
    """
    The arguments of one call.

    Parameters
    ----------
    name : str
        Of the function, for messages.
    arguments : sequence of (str, Shape)
        Names, and shapes for one state.
    arrays : sequence of arrays
        One for each argument.
    dtype : str
        Of all of them.
    stream : int or None
        Handle of a CUDA stream; None: the current one of the library of the arrays.

    Raises
    ------
    InputError
        An array that is not in the memory of a GPU, of a wrong type, or on another
        device.
    DeviceError
        There is no device or no driver.

    """

    def __init__(self, name: str, arguments: Sequence[tuple[str, Shape]],
                 arrays: Sequence[Any], dtype: str, stream: Any) -> None:
        """Check the arrays."""
        if not (stream is None or (isinstance(stream, int) and stream >= 0)):
            raise InputError(f'stream: {stream!r}; expected the handle of a CUDA stream '
                             '(int) or None')
        self._driver: Driver = driver()
        self.name = name
        self.dtype = dtype
        self._first = arrays[0]
        # The caller's stream, else the first one of the arrays' libraries.
        self._chosen = stream is not None
        streams = [stream]
        if not self._chosen:
            streams = list(map(current_stream, arrays))
        self._stream = next((x for x in streams if x is not None), 0)
        self._waits = None in streams  # for libraries that do not know of the kernel
        self.views: list[DeviceArray] = []
        for (key, _), x in zip(arguments, arrays, strict=True):
            self.views.append(self._view(key, x))
        # An array without entries has no memory, hence no device.
        self.device = 0
        for array in self.views:
            if 0 not in array.shape:
                self.device = array.device
                break

    def _view(self, name: str, x: Any) -> DeviceArray:
        """Return a view of an array of the type of the kernel."""
        array = device_view(name, x, self._driver, self._stream)
        if array.dtype != self.dtype:
            raise InputError(f'{name}: {array.dtype}; expected {self.dtype}, of which '
                             'this function is (dtype=)')
        return array

    def batch(self, batches: Sequence[Shape]) -> Shape:
        """
        Return the batch axes of the result for those of the arguments; check devices.

        The layout of the result is that of the first argument that has them.
        """
        for x in self.views:
            if x.device != self.device and 0 not in x.shape:
                raise InputError(f'{x.name}: on device {x.device}; expected device '
                                 f"{self.device}, that of '{self.views[0].name}'")
        # Batches of one state fit all others; of the others there may be one shape.
        several = {axes for axes in batches if math.prod(axes) != 1}
        if len(several) > 1:
            shapes = ', '.join(f'{x.name} {x.shape}' for x in self.views)
            raise InputError(f'{self.name}: arguments {shapes}; expected the same batch '
                             'axes, or one state for all')
        batch = max(batches, key=len)
        if several:
            batch = several.pop()
        self._like = self.views[list(batches).index(batch)]
        return batch

    def result(self, out: Any, batch: Shape, shape: Shape) -> tuple[DeviceArray, Any]:
        """Return a view of the result and the array that the caller receives."""
        result = out
        if out is None:
            # A new array has the layout of the argument with the batch.
            like = self._like
            stride = collapsed(like.shape[:len(batch)], like.strides[:len(batch)])
            result = empty(self._first, batch, shape, self.dtype, stride == 1,
                           self._driver, self.device, self._stream)
            # The call returns when the content of a new `DeviceMemory` is there.
            self._waits |= isinstance(result, DeviceMemory)
        written = self._view('out', result)
        if written.shape != (*batch, *shape):
            raise InputError(f'out: shape {written.shape}; expected {(*batch, *shape)}')
        if not written.writeable:
            raise InputError(
                'out: an array that cannot be written; expected one that can')
        if written.device != self.device and 0 not in written.shape:
            raise InputError(f'out: on device {written.device}; expected device '
                             f'{self.device}')
        if out is not None:
            self._require_apart(written)
            self._waits |= not self._chosen and current_stream(out) is None
        return written, result

    def _require_apart(self, out: DeviceArray) -> None:
        """Raise InputError if threads could overwrite what others read or write."""
        axes = []
        for stride, size in zip(out.strides, out.shape):
            if size > 1:
                axes.append((abs(stride), size))
        # From the axis of the smallest stride on, each must step over all inside it.
        extent = 1  # numbers of the axes with smaller strides
        for stride, size in sorted(axes):
            if stride < extent:
                raise InputError(f'out: strides {out.strides} of shape {out.shape}; '
                                 'expected entries that do not overlap')
            extent = stride * size
        begin, end = out.extent
        for x in self.views:
            memory = (x.pointer, x.shape, x.strides)
            same = memory == (out.pointer, out.shape, out.strides)
            if x.extent[0] < end and begin < x.extent[1] and not same:
                raise InputError(f"out: memory between that of '{x.name}'; expected "
                                 'memory of its own, or the same array')

    def run(self, ptx: str, values: Sequence[Any], count: int, result: Any) -> Any:
        """Launch the kernel for `count` states and return the array of the result."""
        if count:
            kernel = self._driver.kernel(self.device, ptx, KERNEL)
            self._driver.launch(kernel, count, values, self._stream)
            if self._waits:
                self._driver.synchronize(self._stream)
        return handed_over(self._first, result)

    def on_device(self) -> Any:
        """Return a context manager that makes the context of the device current."""
        return self._driver.on(self.device)

    def numbers(self, values: Array | Sequence[float]) -> list[Any]:
        """Return numbers as the kernel receives them."""
        return [IN_C[self.dtype](float(x)) for x in values]


def array_layout(x: DeviceArray, shape: Shape, batch: Shape,
                 steps: bool = False) -> list[Any]:
    """
    Return address, stride from state to state, from entry to entry and, last, to step.

    Raises
    ------
    InputError
        The strides of several axes are not those of one.

    """
    # The axes are those of the batch, of the steps if there are any, and of one state.
    entries = x.ndim - len(shape)
    axes = entries - steps
    batch_of_x = x.shape[:axes]
    # An array of one state serves all: its stride is 0.
    stride: int | None = 0
    if math.prod(batch_of_x) > 1:
        stride = collapsed(batch_of_x, x.strides[:axes])
    pitch = collapsed(x.shape[entries:], x.strides[entries:])
    if stride is None or pitch is None:
        raise InputError(f'{x.name}: strides {x.strides} of shape {x.shape}; expected '
                         'states at equal distances, and so their entries: a contiguous '
                         'copy')
    return [c_uint64(x.pointer), c_int64(stride), c_int64(pitch),
            *([c_int64(x.strides[axes])] if steps else [])]


def collapsed(shape: Sequence[int], strides: Sequence[int]) -> int | None:
    """Return the stride of several axes as one; None if they have no common one."""
    found = 0
    expected = None
    if 0 in shape:
        return found
    # From the last axis: each must begin where the one after it ends.
    for size, stride in reversed(list(zip(shape, strides))):
        if size == 1:
            continue
        if expected is None:
            found = stride
        elif stride != expected:
            return None
        expected = stride * size
    return found
