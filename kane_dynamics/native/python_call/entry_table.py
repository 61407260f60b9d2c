"""
Tables of words that native functions read, and built-in functions made of them.

A table holds references to all that its words point at. It is the `self` of its function, or is
held by the object whose method reads it, so it lives as long as either can be called.
"""

from collections.abc import Callable, Mapping, Sequence
import ctypes
from functools import cache
from importlib import import_module
from typing import Any

from kane_dynamics.native.machine_code import llvm, object_cache
from kane_dynamics.native.python_call.entry_ir import placeholder_code
from kane_dynamics.native.python_call.object_layout import TABLE
import numpy as np


class MethodDef(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = [('ml_name', ctypes.c_char_p), ('ml_meth', ctypes.c_void_p),
                ('ml_flags', ctypes.c_int), ('ml_doc', ctypes.c_char_p)]


class EntryTable(np.ndarray):
    """
    Table of 64-bit words that a native function reads; `owned` keeps the referenced objects.

    The function's PyMethodDef is stored at the end of the table. CPython reads it when it frees
    the function, possibly after the garbage collector has cleared `owned`, so it must share the
    memory of the table.
    """

    owned: tuple[Any, ...]
    fallback: Callable[..., Any]

    def __reduce_ex__(self, protocol: Any) -> Any:
        """
        Pickle the object whose method the function replaces, since addresses are of one process.

        Raises
        ------
        TypeError
            The function is of fixed arrays.

        """
        owner = getattr(self.fallback, '__self__', None)
        if owner is None:
            raise TypeError('compiled function of fixed arrays: cannot be pickled; expected a '
                            'method of the robot, or robot.bind() in the other process')
        return _itself, (owner,)


def _itself(owner: Any) -> Any:
    return owner


DEFINITION = ctypes.sizeof(MethodDef) // 8  # words
METH_FASTCALL = 0x0080  # calls of METH_NOARGS are slower: CPython does not specialize them
METH_KEYWORDS = 0x0002
PY_ARRAY_NEW = 93  # slot of PyArray_New in numpy's C API table, fixed since numpy 1.0


@cache
def interpreter_words() -> dict[str, int]:
    """Return the table words that are equal for all functions."""
    try:
        core = import_module('numpy._core.multiarray')
    except ImportError:  # numpy 1
        core = import_module('numpy.core.multiarray')
    capsule = core._ARRAY_API
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype = ctypes.c_void_p
    pointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    numpy_api = ctypes.cast(pointer(capsule, None), ctypes.POINTER(ctypes.c_void_p))
    return {'NDARRAY': id(np.ndarray), 'FLOAT64': id(np.dtype(np.float64)),
            'NEW_ARRAY': int(numpy_api[PY_ARRAY_NEW] or 0),
            'VECTORCALL': _symbol('PyObject_Vectorcall'),
            'NEW_FLOAT': _symbol('PyFloat_FromDouble'), 'RELEASE': _symbol('Py_DecRef')}


def _symbol(name: str) -> int:
    return int(ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0)


def new_table(words: Mapping[str, int], fallback: Callable[..., Any], code: llvm.Code,
              blocks: Sequence[np.ndarray] = (), owned: tuple[Any, ...] = ()) -> EntryTable:
    """Return a table with these words and the addresses of the fallback and of the blocks."""
    words = {**interpreter_words(), 'FALLBACK': id(fallback), **words}
    numbers = [words.get(word, 0) for word in TABLE]
    numbers += [block.ctypes.data for block in blocks]
    numbers += [0] * DEFINITION  # space for the PyMethodDef
    table = np.array(numbers, dtype=np.uint64).view(EntryTable)
    table.owned = (tuple(blocks), code, *owned)
    table.fallback = fallback
    table.setflags(write=False)
    return table


def built_in(name: str, doc: str, address: llvm.Address, flags: int,
             table: EntryTable) -> Callable[..., Any]:
    """Create a built-in function from machine code and its table."""
    at = table.ctypes.data + 8 * (len(table) - DEFINITION)
    definition = MethodDef.from_address(at)
    definition.__init__(name.encode(), address, flags, doc.encode())  # type: ignore[misc]
    table.owned = (definition, *table.owned)  # keeps the name and doc alive
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype = ctypes.py_object
    make.argtypes = [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    function: Callable[..., Any] = make(at, table, None)
    return function


def bound_table(code: llvm.Code, blocks: Sequence[np.ndarray],
                fallback: Callable[..., Any]) -> EntryTable:
    """Return the table of a method for one object, which must keep it alive; see `bound`."""
    if any(block.size == 0 for block in blocks):
        code = assembled('stand-ins', placeholder_code())
        return new_table({'CODE': code.address('refer')}, fallback, code)
    return new_table({'CODE': code.address('bound'), 'RESULT': id(blocks[-1])}, fallback, code,
                     blocks)


def unmade_table(make: Callable[[Any], Any]) -> EntryTable:
    """Return a table whose first call asks `make` for the table of an object."""
    code = assembled('stand-ins', placeholder_code())
    return new_table({'CODE': code.address('unmade')}, make, code)


@cache
def refusal() -> EntryTable:
    """Return the table of all methods of objects that were not initialized."""
    return unmade_table(refuse)


def refuse(owner: Any) -> None:
    """Raise TypeError: the object was not initialized."""
    raise TypeError(f'{type(owner).__name__}: not initialized; expected an object made by its '
                    'class, such as robot.bind()')


@cache
def assembled(name: str, text: str) -> llvm.Code:
    """Return the machine code of LLVM IR."""
    return llvm.Code(object_cache.fetch(object_cache.key(name, text),
                                        lambda: llvm.assemble(text)))
