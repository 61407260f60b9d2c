"""
The ways into a kernel: machine code for the common call, a checked Python road for all others.

A function made here is a CPython built-in whose C code stands in the kernel's own module
(`entry_code`). It accepts what a control loop passes (exact float64 ndarrays, contiguous, of the
declared lengths, finite); for anything else it calls the Python fallback, which converts or
explains. It reads ndarray fields at their public offsets (numpy's ABI) and the object head of
CPython builds with a GIL; a self-test proves that on the running interpreter, and where it fails
the fallback serves every call.
"""

from collections.abc import Callable, Mapping, Sequence
import ctypes
from functools import cache
import math
import sys
import sysconfig
from typing import Any

from kane_dynamics.native.machine_code import llvm, object_cache
from kane_dynamics.native.python_call.entry_ir import (bound_code, entry_code, method_code,
                                                       stand_in_code)
from kane_dynamics.native.python_call.object_layout import (ALL_FINITE, DATA, DTYPE, FLAGS, FRESH,
                                                            NDIM, SHAPE, TABLE, TYPE, WEAKREFS)
from kane_dynamics.native.tracing.program import Shape
import numpy as np


class _MethodDef(ctypes.Structure):
    _fields_ = [('ml_name', ctypes.c_char_p), ('ml_meth', ctypes.c_void_p),
                ('ml_flags', ctypes.c_int), ('ml_doc', ctypes.c_char_p)]


class EntryTable(np.ndarray):
    """
    The words that a function reads; its attributes keep alive what they point to.

    At its end is the definition of the function. A function looks there when it is freed, and the
    garbage collector may have emptied its table before: words are freed with the table alone.
    """

    owned: tuple[Any, ...]


DEFINITION = ctypes.sizeof(_MethodDef) // 8  # words
METH_FASTCALL, METH_KEYWORDS = 0x0080, 0x0002  # METH_NOARGS calls are not specialised: slower
PY_ARRAY_NEW = 93  # slot of PyArray_New in numpy's C API table, fixed since numpy 1.0


@cache
def _interpreter_words() -> dict[str, int]:
    """Return the words of the table that are the same for every function."""
    capsule = np._core.multiarray._ARRAY_API  # type: ignore[attr-defined]
    pointer = ctypes.pythonapi.PyCapsule_GetPointer
    pointer.restype, pointer.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    numpy_api = ctypes.cast(pointer(capsule, None), ctypes.POINTER(ctypes.c_void_p))
    return {'NDARRAY': id(np.ndarray), 'FLOAT64': id(np.dtype(np.float64)),
            'NEW_ARRAY': int(numpy_api[PY_ARRAY_NEW] or 0),
            'VECTORCALL': _symbol('PyObject_Vectorcall'),
            'NEW_FLOAT': _symbol('PyFloat_FromDouble'), 'RELEASE': _symbol('Py_DecRef')}


def _symbol(name: str) -> int:
    return int(ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0)


def _table(words: Mapping[str, int], blocks: Sequence[np.ndarray],
           owned: tuple[Any, ...]) -> EntryTable:
    """Return the table of these words and blocks."""
    words = {**_interpreter_words(), **words}
    table = np.array([*(words.get(word, 0) for word in TABLE),
                      *(block.ctypes.data for block in blocks), *[0] * DEFINITION],
                     dtype=np.uint64).view(EntryTable)
    table.owned = (tuple(blocks), *owned)
    return table


def _built_in(name: str, doc: str, address: llvm.Address, flags: int,
              table: EntryTable) -> Callable[..., Any]:
    """Make a built-in function of machine code that reads a table."""
    at = table.ctypes.data + 8 * (len(table) - DEFINITION)
    definition = _MethodDef.from_address(at)
    definition.__init__(name.encode(), address, flags, doc.encode())  # type: ignore[misc]
    table.owned = (definition, *table.owned)  # which holds the texts
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype = ctypes.py_object
    make.argtypes = [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    function: Callable[..., Any] = make(at, table, None)
    return function


def _entry(name: str, doc: str, code: llvm.Code, defaults: Sequence[np.ndarray], shape: Shape,
           fallback: Callable[..., Any]) -> Callable[..., Any]:
    lengths = np.array(shape, dtype=np.int64)
    ring = np.array([None, None])  # of references, released with it
    ring[:] = [np.empty(shape), np.empty(shape)] if shape else None
    words = {'FALLBACK': id(fallback), 'RESULT_SHAPE': lengths.ctypes.data,
             'RING': ring.ctypes.data}
    return _built_in(name, doc, code.address('entry'), METH_FASTCALL | METH_KEYWORDS,
                     _table(words, defaults, (lengths, ring, fallback, code)))


def _bound(name: str, doc: str, code: llvm.Code, blocks: Sequence[np.ndarray],
           fallback: Callable[..., Any]) -> Callable[..., Any]:
    return _built_in(name, doc, code.address('bound'), METH_FASTCALL,
                     bound_table(code, blocks, fallback))


def bound_table(code: llvm.Code, blocks: Sequence[np.ndarray],
                fallback: Callable[..., Any]) -> EntryTable:
    """Return what a method reads for one object, to stay alive; arguments as `bound` has them."""
    if any(block.size == 0 for block in blocks):
        code = _assembled('stand-ins', stand_in_code())
        return _table({'CODE': code.address('refer'), 'FALLBACK': id(fallback)}, [],
                      (fallback, code))
    return _table({'CODE': code.address('bound'), 'FALLBACK': id(fallback),
                   'RESULT': id(blocks[-1])}, blocks, (fallback, code))


class Tabled:
    """What methods of machine code are for: its first slot holds addresses of their tables."""

    __slots__ = ('_tables',)
    _tables: np.ndarray


@cache
def supported() -> bool:
    """Tell whether built-ins work on this interpreter: lay-out read first, then a call."""
    if (sys.implementation.name != 'cpython' or sys.byteorder != 'little'
            or sysconfig.get_config_var('Py_GIL_DISABLED')):
        return False
    probe = np.array([1.25, -2.5, 3.75])
    head = (ctypes.c_uint64 * 10).from_address(id(probe))
    count = ctypes.c_uint32.from_address(id(probe))
    before = count.value
    another = probe
    readable = (count.value == before + 1 and head[TYPE // 8] == id(np.ndarray)
                and head[DATA // 8] == probe.ctypes.data and head[NDIM // 8] & 0xFFFFFFFF == 1
                and ctypes.c_int64.from_address(head[SHAPE // 8]).value == 3
                and head[DTYPE // 8] == id(np.dtype(np.float64))
                and head[FLAGS // 8] & FRESH == FRESH and head[WEAKREFS // 8] == 0)
    return readable and _self_test(another)


@cache
def _assembled(name: str, text: str) -> llvm.Code:
    return llvm.Code(object_cache.fetch(object_cache.key(name, text),
                                        lambda: llvm.assemble(text)))


def _self_test(probe: np.ndarray) -> bool:
    """Double an array through built-ins and see that bad calls reach the fallback."""
    text = '\n'.join(['define void @twice(ptr %args) {', '  %x = load ptr, ptr %args',
                      '  %slot = getelementptr ptr, ptr %args, i64 1',
                      '  %y = load ptr, ptr %slot', '  %a = load <3 x double>, ptr %x, align 8',
                      '  %b = fadd <3 x double> %a, %a',
                      '  store <3 x double> %b, ptr %y, align 8', '  ret void', '}',
                      entry_code('twice', [3], [math.inf], 0, (3,)),
                      bound_code('twice', [3], [math.inf], 0, (3,))])
    code = _assembled('self-test', text)
    twice = _entry('twice', '', code, [], (3,), lambda *args, **keywords: (args, keywords))
    bad = np.array([1.0, np.nan, 0.0])
    first, second, third = twice(probe), twice(probe), twice(probe)
    source, result = probe.copy(), np.empty(3)
    bound = _bound('twice', '', code, [source, result], lambda *args: args)
    kind: Any = type('Probe', (Tabled,), {'__slots__': ()})
    owner, table = kind(), bound_table(code, [source, result], lambda *args: args)

    def make(owner: Any, name: str) -> EntryTable:
        owner._tables[1] = id(table)
        return table
    owner._tables = methods(kind, {'once': '', 'twice': ''}, make)
    counts = sys.getrefcount(first), sys.getrefcount(result)
    return (all(np.array_equal(x, 2.0 * probe) for x in (first, second, third, bound()))
            and len({x.ctypes.data for x in (first, second, third)}) == 3
            and bound() is result and owner.twice() is result and owner.twice() is result
            and owner.twice(1) == (1,)
            and (sys.getrefcount(first), sys.getrefcount(result)) == counts
            and twice(bad)[0][0] is bad
            and twice() == ((), {}) and twice(probe, out=1)[1] == {'out': 1}
            and twice(probe[::2])[0][0].shape == (2,) and twice(1.0) == ((1.0,), {})
            and twice(np.full(3, 1e308))[0][0].shape == (3,) and bound(1) == (1,))


def entry(name: str, doc: str, code: llvm.Code, lengths: Sequence[int],
          defaults: Sequence[np.ndarray], shape: Shape,
          fallback: Callable[..., Any]) -> Callable[..., Any]:
    """
    Return a function that calls a kernel with as little as possible in between.

    Parameters
    ----------
    name, doc : str
        What the function is called and says of itself.
    code : Code
        Holds what `ways_in` wrote.
    lengths : sequence of int
        Length of each positional argument, all of one dimension.
    defaults : sequence of array
        Memory whose addresses follow the arguments; read at each call.
    shape : tuple of int
        Shape of the result; () returns a float.
    fallback : callable
        Called with whatever the fast road does not take.

    """
    if not lengths or 0 in (*lengths, *shape) or not supported():
        return fallback
    return _entry(name, doc, code, defaults, shape, fallback)


def bound(name: str, doc: str, code: llvm.Code, blocks: Sequence[np.ndarray],
          fallback: Callable[[], Any]) -> Callable[[], Any]:
    """
    Return a function without arguments that calls a kernel on blocks of memory.

    Parameters
    ----------
    name, doc : str
        What the function is called and says of itself.
    code : Code
        Holds what `ways_in` wrote.
    blocks : sequence of array
        The kernel's arguments, its parameters, its result, all C-contiguous; the last is what the
        function returns (a float where it has no dimension).
    fallback : callable
        Called where an argument or the result is not finite.

    """
    if any(block.size == 0 for block in blocks) or not supported():
        return fallback
    return _bound(name, doc, code, blocks, fallback)


def methods(cls: type[Tabled], docs: Mapping[str, str],
            make: Callable[[Any, str], EntryTable]) -> np.ndarray:
    """
    Give a class methods of machine code, and return what its objects begin with as tables.

    Parameters
    ----------
    cls : subclass of Tabled
        Not to be freed; each object has a copy of the result.
    docs : mapping
        What each method says of itself, by name.
    make : callable
        Returns the table of an object's method, `bound_table`, having put its `id` among the
        object's tables, and keeps it: called with the object and the name at the first use.

    """
    # Whoever holds a method of an object reads the definition, even after the class is gone.
    definitions = (_MethodDef * len(docs))()
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(definitions))
    code = _assembled('methods', method_code(len(docs)))
    stand_ins = _assembled('stand-ins', stand_in_code())
    new = ctypes.pythonapi.PyDescr_NewMethod
    new.restype, new.argtypes = ctypes.py_object, [ctypes.py_object, ctypes.c_void_p]
    unmade = []
    for place, (name, doc) in enumerate(docs.items()):
        definitions[place] = _MethodDef(name.encode(), code.address(f'method{place}'),
                                        METH_FASTCALL, doc.encode())
        setattr(cls, name, new(cls, ctypes.addressof(definitions[place])))

        def first(owner: Any, name: str = name) -> EntryTable:
            return make(owner, name)
        unmade.append(_table({'CODE': stand_ins.address('unmade'), 'FALLBACK': id(first)}, [],
                             (first,)))
    tables = np.array([id(table) for table in unmade], dtype=np.uint64).view(EntryTable)
    tables.owned = (unmade, code, stand_ins)
    return tables


def ways_in(symbol: str, lengths: Sequence[int], default_sizes: Sequence[int],
            most: Sequence[float], shape: Shape) -> str:
    """
    Return the assembly that goes into a kernel's module for `entry` and `bound`.

    Parameters
    ----------
    symbol : str
        The kernel's.
    lengths, default_sizes : sequence of int
        Numbers of entries of the arguments that a call passes, and of the others; one block of
        parameters follows.
    most : sequence of float
        Largest size of the entries of every argument.
    shape : tuple of int
        Shape of the result.

    """
    if not lengths or 0 in (*lengths, *default_sizes, *shape):
        return ''
    return '\n'.join([ALL_FINITE, entry_code(symbol, lengths, most, len(default_sizes) + 1, shape),
                      bound_code(symbol, [*lengths, *default_sizes], most, 1, shape)])
