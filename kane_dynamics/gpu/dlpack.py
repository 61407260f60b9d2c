"""
DLPack, the exchange of arrays between libraries: reading and writing its capsules.

The layout is that of ``dlpack.h``, version 0.8, `DLManagedTensor`.
"""

import ctypes
from ctypes import (c_char_p, c_int32, c_int64, c_uint16, c_uint64, c_uint8, c_void_p,
                    POINTER, py_object)
from types import SimpleNamespace
from typing import Any, NamedTuple

from kane_dynamics.errors import InputError
import numpy as np

CUDA, MANAGED = 2, 13  # kinds of devices: memory of a GPU, or shared with the host
FLOATING = 2  # code of the type
NAME = b'dltensor'  # of a capsule that no library has taken yet


class Tensor(ctypes.Structure):
    """The C structure `DLTensor`: where an array is, and its shape and strides."""

    _fields_ = [('data', c_void_p), ('kind', c_int32), ('device', c_int32),
                ('ndim', c_int32),
                ('code', c_uint8), ('bits', c_uint8), ('lanes', c_uint16),
                ('shape', POINTER(c_int64)), ('strides', POINTER(c_int64)),
                ('offset', c_uint64)]


class Managed(ctypes.Structure):
    """The C structure `DLManagedTensor`: an array, and how its owner frees it."""

    _fields_ = [('tensor', Tensor), ('context', c_void_p), ('deleter', c_void_p)]


class Read(NamedTuple):
    """Content of a capsule; strides are in numbers."""

    pointer: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    dtype: str


_pointer = ctypes.pythonapi.PyCapsule_GetPointer
_pointer.restype, _pointer.argtypes = c_void_p, [py_object, c_char_p]


def capsule_content(capsule: Any) -> Read:
    """
    Return the content of a capsule without taking it.

    The capsule must be kept while the memory is in use.

    Raises
    ------
    InputError
        Its numbers are vectors.

    """
    tensor = Managed.from_address(_pointer(capsule, NAME)).tensor
    if tensor.lanes != 1:
        raise InputError(f'array: numbers of {tensor.lanes} lanes; expected 1')
    shape = tuple(tensor.shape[:tensor.ndim])
    # Without strides the array is contiguous.
    strides = contiguous(shape)
    if tensor.strides:
        strides = tuple(tensor.strides[:tensor.ndim])
    dtype = f'type code {tensor.code}'
    if tensor.code == FLOATING:
        dtype = f'float{tensor.bits}'
    return Read((tensor.data or 0) + tensor.offset, shape, strides, dtype)


def contiguous(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the strides, in numbers, of an array in C order."""
    strides, step = [], 1
    for size in reversed(shape):
        strides.append(step)
        step *= max(size, 1)
    return tuple(reversed(strides))


def write(owner: Any, array: Read, device: int) -> Any:
    """
    Return a capsule of memory of a GPU; `owner` lives as long as it is in use.

    The capsule is one of NumPy, which does not touch the memory. It is released in C:
    consumers release capsules while errors propagate, and at the exit, where no Python
    code can run.
    """
    item = int(array.dtype.removeprefix('float')) // 8
    held = SimpleNamespace(owner=owner, __array_interface__={
        'data': (array.pointer, False), 'shape': array.shape, 'typestr': f'<f{item}',
        'strides': tuple(item * x for x in array.strides), 'version': 3})
    capsule: Any = np.asarray(held).__dlpack__()
    tensor = Managed.from_address(_pointer(capsule, NAME)).tensor
    tensor.kind, tensor.device = CUDA, device
    return capsule
