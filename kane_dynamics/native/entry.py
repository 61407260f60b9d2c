"""
The way into a kernel: a C function for the common call, a checked Python road for all others.

The fast entry is a built-in function made of machine code that this module emits. It accepts
what a control loop passes (exact float64 ndarrays, contiguous, of the declared lengths, finite),
makes the result array, and calls the kernel; for anything else it calls the Python fallback,
which converts or explains. It reads ndarray fields at their public offsets (numpy's ABI) and the
object head of CPython builds with a GIL; a self-test proves that on the running interpreter, and
where it fails the fallback serves every call.
"""

from collections.abc import Callable, Sequence
import ctypes
from functools import cache
import sys
import sysconfig
from typing import Any

from kane_dynamics.errors import CompileError
from kane_dynamics.native import cache as object_cache, llvm
from kane_dynamics.native.support import POINTER_SLOTS, support, TABLE
import numpy as np


class _MethodDef(ctypes.Structure):
    _fields_ = [('ml_name', ctypes.c_char_p), ('ml_meth', ctypes.c_void_p),
                ('ml_flags', ctypes.c_int), ('ml_doc', ctypes.c_char_p)]


class _Table(np.ndarray):
    """The words that an entry reads; its attributes keep alive what they point to."""

    owned: tuple[Any, ...]


METH_FASTCALL_KEYWORDS = 0x0080 | 0x0002
PY_ARRAY_NEW = 93  # slot of PyArray_New in numpy's C API table, fixed since numpy 1.0


@cache
def _numpy_function(slot: int) -> int:
    """Return the address of a function of numpy's public C API."""
    capsule = np._core.multiarray._ARRAY_API  # type: ignore[attr-defined]
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    table = ctypes.cast(pointer(capsule, None), ctypes.POINTER(ctypes.c_void_p))
    return int(table[slot] or 0)


def _symbol(name: str) -> int:
    return int(ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0)


def _build(name: str, doc: str, kernel: llvm.Address, lengths: Sequence[int],
           defaults: Sequence[np.ndarray], shape: Sequence[int],
           fallback: Callable[..., Any], owner: Any) -> Callable[..., Any]:
    """Make the built-in function, without asking whether this interpreter is fit for it."""
    length_words = np.array(lengths, dtype=np.int64)
    shape_words = np.array(shape, dtype=np.int64)
    default_words = np.array([block.ctypes.data for block in defaults], dtype=np.uint64)
    words = {'KERNEL': kernel, 'NDARRAY': id(np.ndarray), 'FLOAT64': id(np.dtype(np.float64)),
             'FALLBACK': id(fallback), 'VECTORCALL': _symbol('PyObject_Vectorcall'),
             'NEW_ARRAY': _numpy_function(PY_ARRAY_NEW),
             'NEW_FLOAT': _symbol('PyFloat_FromDouble'), 'N_ARGUMENTS': len(lengths),
             'LENGTHS': length_words.ctypes.data, 'N_DEFAULTS': len(defaults),
             'DEFAULTS': default_words.ctypes.data, 'RESULT_NDIM': len(shape),
             'RESULT_SHAPE': shape_words.ctypes.data, 'RESULT_SIZE': int(np.prod(shape)),
             'RELEASE': _symbol('Py_DecRef')}
    table = np.array([words[name] for name in TABLE], dtype=np.uint64).view(_Table)
    method = _MethodDef(name.encode(), support().address('entry'), METH_FASTCALL_KEYWORDS,
                        doc.encode())
    table.owned = (length_words, shape_words, default_words, tuple(defaults), fallback, method,
                   owner, support())
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype = ctypes.py_object
    make.argtypes = [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    function: Callable[..., Any] = make(ctypes.addressof(method), table, None)
    return function


@cache
def supported() -> bool:
    """Tell whether the fast entry works on this interpreter: lay-out read first, then a call."""
    if sys.implementation.name != 'cpython' or sysconfig.get_config_var('Py_GIL_DISABLED'):
        return False
    probe = np.array([1.25, -2.5, 3.75])
    head = (ctypes.c_uint64 * 9).from_address(id(probe))
    flags = ctypes.c_int.from_address(id(probe) + 64).value
    readable = (head[1] == id(np.ndarray) and head[2] == probe.ctypes.data
                and head[3] & 0xFFFFFFFF == 1 and head[7] == id(np.dtype(np.float64))
                and ctypes.c_int64.from_address(head[4]).value == 3 and flags & 257 == 257)
    return readable and _self_test(probe)


def _self_test(probe: np.ndarray) -> bool:
    """Double an array through a fast entry and see that bad calls reach the fallback."""
    text = '\n'.join(['define void @twice(ptr %args) {', '  %x = load ptr, ptr %args',
                      '  %slot = getelementptr ptr, ptr %args, i64 1',
                      '  %y = load ptr, ptr %slot',
                      *[f'  %x{k} = getelementptr double, ptr %x, i64 {k}\n'
                        f'  %a{k} = load double, ptr %x{k}\n'
                        f'  %b{k} = fadd double %a{k}, %a{k}\n'
                        f'  %y{k} = getelementptr double, ptr %y, i64 {k}\n'
                        f'  store double %b{k}, ptr %y{k}' for k in range(3)],
                      '  ret void', '}'])
    code = llvm.Code(object_cache.fetch(object_cache.key('self-test', text),
                                        lambda: llvm.assemble(text)))
    twice = _build('twice', '', code.address('twice'), [3], [], [3],
                   lambda *args, **keywords: (args, keywords), code)
    bad = np.array([1.0, np.nan, 0.0])
    return (np.array_equal(twice(probe), 2.0 * probe) and twice(bad)[0][0] is bad
            and twice() == ((), {}) and twice(probe, out=1)[1] == {'out': 1}
            and twice(probe[::2])[0][0].shape == (2,) and twice(1.0) == ((1.0,), {})
            and twice(np.full(3, 1e308))[0][0].shape == (3,))


def fast_entry(name: str, doc: str, kernel: llvm.Address, lengths: Sequence[int],
               defaults: Sequence[np.ndarray], shape: Sequence[int],
               fallback: Callable[..., Any], owner: Any) -> Callable[..., Any]:
    """
    Return a function that calls a kernel with as little as possible in between.

    Parameters
    ----------
    name, doc : str
        What the function is called and says of itself.
    kernel : address
        ``void kernel(double **pointers)``: arguments, defaults, result.
    lengths : sequence of int
        Length of each positional argument, all of one dimension.
    defaults : sequence of array
        Memory whose addresses follow the arguments; read at each call.
    shape : sequence of int
        Shape of the result; () returns a float.
    fallback : callable
        Called with whatever the fast road does not take.
    owner : object
        Kept alive as long as the function.

    """
    if len(lengths) + len(defaults) + 1 > POINTER_SLOTS:
        raise CompileError(f'{name} takes {len(lengths)} arguments; at most {POINTER_SLOTS - 2}')
    if not lengths or 0 in (*lengths, *shape) or not supported():
        return fallback
    return _build(name, doc, kernel, lengths, defaults, shape, fallback, owner)
