"""
Native entry points of kernels: built-in functions and methods, with a Python fallback.

A function created here is a CPython built-in, whose machine code all kernels of one
signature share (`Signature.entry_points`). It accepts contiguous, finite float64
ndarrays of the declared shapes, which a control loop passes. For any other argument it
calls the Python fallback, which converts it or raises an error. The machine code reads
ndarray fields at their public offsets (numpy's ABI) and the object header of CPython
builds with a GIL. A self-test verifies this on the running interpreter; if it fails, the
fallback serves every call.

Lifetime
    A function's `self` is its table, which holds its code and the kernel's, the arrays,
    and the fallback (`EntryTable`). A method's object holds the tables of its methods.
    So the code lives as long as its callers. It is unloaded when the last reference is
    gone, after all finalizers of the same garbage (`llvm.Code`). The definitions of
    functions lie in the tables; those of methods are never freed.
Reference counts
    `bound` and methods return the array of the result, with one more reference. `entry`
    returns a new reference; it reuses an array only while it holds the one reference to
    it and nothing refers to it weakly. Before it releases an old array, whose
    finalization may run any code, it has stored the new one and holds its own reference
    to it. Only arrays are counted, which are never immortal. A reference that the
    interpreter borrows (Python 3.14) is of a variable that holds one.
GIL
    A single call holds the GIL throughout, so nothing changes beside it. Batches release
    it (`runtime.loops`); their callers hold kernel and arrays until all threads have
    ended.
Exceptions
    The machine code raises nothing itself. It returns what the fallback returns or
    raises. An object without tables (made by ``object.__new__``) is refused with
    TypeError.
Shutdown
    No code is unloaded once the functions of `atexit` have run, so that finalizers and
    other threads may call until the end. A function that was not called before then may
    be unable to load its code, as modules are gone.
Not supported
    Free-threaded builds and subinterpreters use the fallback. numpy refuses interpreters
    that have a GIL of their own. A pickled function is the method of its pickled robot;
    one of fixed arrays is refused.
"""

from collections.abc import Callable, Mapping, Sequence
import ctypes
from dataclasses import dataclass
from functools import cache
from importlib import import_module
import math
import sys
import sysconfig
from typing import Any
from weakref import WeakValueDictionary

from kane_dynamics._util.fork_safety import lazy_property
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.python_call.entry_ir import (ALL_FINITE, bound_code, DATA,
                                                       DTYPE, entry_code, FLAGS, FRESH,
                                                       ITEMS, LENGTH, method_code, NDIM,
                                                       placeholder_code, SHAPE, TABLE,
                                                       TYPE, WEAKREFS)
from kane_dynamics.native.tracing.program import Shape
import numpy as np

# Calls of METH_NOARGS are slower: CPython does not specialize them.
METH_FASTCALL = 0x0080
METH_KEYWORDS = 0x0002
PY_ARRAY_NEW = 93  # slot of PyArray_New in numpy's C API table, fixed since numpy 1.0


class MethodDef(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = [('ml_name', ctypes.c_char_p), ('ml_meth', ctypes.c_void_p),
                ('ml_flags', ctypes.c_int), ('ml_doc', ctypes.c_char_p)]


DEFINITION = ctypes.sizeof(MethodDef) // 8  # words of a definition


@dataclass(frozen=True)
class KernelFunction:
    """The function ``void kernel(double **pointers)`` and the code that it lies in."""

    code: llvm.Code
    address: llvm.Address


@dataclass(frozen=True, eq=False)
class CallForm:
    """
    Names, kinds and stand-ins of a kernel's arguments, for calls with keywords.

    Attributes
    ----------
    names : tuple of str
        Of the arguments, in the order of the kernel.
    kinds : tuple of str
        `REQUIRED`: by position. `OPTIONAL`: by position or keyword. `KEYWORD`: by
        keyword. `NUMBER`: by keyword, a float of at least 0. `FIXED`: no part of a call.
        In this order, but for fixed ones.
    stand_ins : tuple of array, float or None
        In place of an argument that is left out or None; the fallback serves the call
        where this is None. Those of fixed arguments are not checked.

    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    stand_ins: tuple[Any, ...]

    def __post_init__(self) -> None:
        """Intern the names, as those of calls are: one name has one address."""
        object.__setattr__(self, 'names', tuple(map(sys.intern, self.names)))

    @property
    def words(self) -> tuple[int, ...]:
        """Return the addresses of the stand-ins, 0 for None, and of the names."""
        addresses = []
        for thing in self.stand_ins:
            addresses.append(0 if thing is None else id(thing))
        return (*addresses, *map(id, self.names))


@dataclass(frozen=True)
class Signature:
    """
    Arguments and result of a kernel: all that its entry points depend on.

    Attributes
    ----------
    shapes : tuple of tuple of int
        Of the arguments of a call, at least one axis each.
    default_sizes : tuple of int
        Numbers of entries of the default arguments; one block of parameters follows.
    limits : tuple of float
        Largest absolute value allowed in each argument.
    shape : tuple of int
        Of the result of a call.
    memory : int, optional
        Number of the argument to which the rest of the kernel's result is written.
    kinds : tuple of str
        Of the arguments of a `CallForm`; empty: all by position.
    unread : int
        Number of further arguments with which calls by position may end, and which
        nothing reads.

    """

    shapes: tuple[Shape, ...]
    default_sizes: tuple[int, ...]
    limits: tuple[float, ...]
    shape: Shape
    memory: int | None = None
    kinds: tuple[str, ...] = ()
    unread: int = 0

    @property
    def is_supported(self) -> bool:
        """Return whether there are arguments and none has a length of 0."""
        if not self.shapes or 0 in self.default_sizes:
            return False
        return not any(0 in lengths for lengths in (*self.shapes, self.shape))

    @lazy_property
    def entry_points(self) -> llvm.Code:
        """Machine code of `entry` and `bound`; of a memory, of `entry` alone."""
        # The code depends on what the key states alone: robots with the same share it.
        key = (self.shapes, self.default_sizes, self.limits, self.shape, self.memory,
               self.kinds, self.unread)
        shared = _entry_points.get(key)
        if shared is not None:
            return shared
        # The text for these shapes; methods of workspaces have no kinds or memory.
        sizes = [math.prod(lengths) for lengths in self.shapes]
        text = entry_code(self.shapes, self.limits, len(self.default_sizes) + 1,
                          self.shape, self.memory, self.kinds, self.unread)
        if self.memory is None and not self.kinds:
            text += '\n' + bound_code([*sizes, *self.default_sizes], self.limits, 1,
                                      self.shape)
        if '@all_finite' in text:
            text = f'{ALL_FINITE}\n{text}'
        code = llvm.Code(llvm.cached(lambda: llvm.assemble(text), 'entry', text))
        _entry_points[key] = code
        return code


# The kernels keep them; they are unloaded with the last kernel of a signature. The keys
# are the values of signatures: a signature would keep its own code.
_entry_points: WeakValueDictionary[tuple[Any, ...], llvm.Code] = WeakValueDictionary()


class EntryTable(np.ndarray):
    """
    Table of 64-bit words that a native function reads.

    `owned` and `fallback` keep the objects to which the words refer.
    The function's PyMethodDef is stored at the end of the table. CPython reads it when
    it frees the function, possibly after the garbage collector has cleared `owned`, so
    it must share the memory of the table.
    """

    owned: tuple[Any, ...]
    fallback: Callable[..., Any]

    def __reduce_ex__(self, protocol: Any) -> Any:
        """
        Pickle the object whose method the function replaces.

        Addresses, which the words are, belong to one process.

        Raises
        ------
        TypeError
            The function is of fixed arrays.

        """
        owner = getattr(self.fallback, '__self__', None)
        if owner is None:
            raise TypeError('compiled function of fixed arrays: cannot be pickled; '
                            'expected a method of the robot, or robot.bind() in the '
                            'other process')
        return _itself, (owner,)


def _itself(owner: Any) -> Any:
    return owner


@cache
def interpreter_words() -> dict[str, int]:
    """Return the table words that are equal for all functions."""
    # Functions of NumPy's C interface are at fixed places of a table in a capsule.
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
            'NEW_FLOAT': _symbol('PyFloat_FromDouble'), 'RELEASE': _symbol('Py_DecRef'),
            'FLOAT': id(float), 'NONE': id(None)}


def _symbol(name: str) -> int:
    return int(ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0)


def new_table(words: Mapping[str, int], fallback: Callable[..., Any], code: llvm.Code,
              blocks: Sequence[np.ndarray] = (),
              owned: tuple[Any, ...] = (), form: CallForm | None = None) -> EntryTable:
    """Return a table of these words and addresses of the fallback and the blocks."""
    # Words of the table in the order of the code, then the addresses of the blocks.
    words = {**interpreter_words(), 'FALLBACK': id(fallback), **words}
    numbers = []
    for word in TABLE:
        numbers.append(words.get(word, 0))
    for block in blocks:
        numbers.append(block.ctypes.data)
    if form is not None:
        numbers += form.words
        owned = (form, *owned)
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
    definition.__init__(  # type: ignore[misc]
        name.encode(), address, flags, doc.encode())
    table.owned = (definition, *table.owned)  # keeps the name and doc alive
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype = ctypes.py_object
    make.argtypes = [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    function: Callable[..., Any] = make(at, table, None)
    return function


def bound_table(kernel: KernelFunction, signature: Signature,
                blocks: Sequence[np.ndarray], fallback: Callable[..., Any]) -> EntryTable:
    """Return the table of a method of an object that keeps it alive; see `bound`."""
    if any(block.size == 0 for block in blocks):
        code = assembled('stand-ins', placeholder_code())
        return new_table({'CODE': code.address('refer')}, fallback, code)
    code = signature.entry_points
    words = {'KERNEL': kernel.address, 'CODE': code.address('bound'),
             'RESULT': id(blocks[-1])}
    return new_table(words, fallback, code, blocks, (kernel.code,))


def unmade_table(make: Callable[[Any], Any]) -> EntryTable:
    """Return a table whose first call asks `make` for the table of an object."""
    code = assembled('stand-ins', placeholder_code())
    return new_table({'CODE': code.address('unmade')}, make, code)


@cache
def refusal_table() -> EntryTable:
    """Return the table of all methods of objects that were not initialized."""
    return unmade_table(refuse_uninitialized)


def refuse_uninitialized(owner: Any) -> None:
    """Raise TypeError: the object was not initialized."""
    raise TypeError(f'{type(owner).__name__}: not initialized; expected an object made '
                    'by its class, such as robot.bind()')


@cache
def assembled(name: str, text: str) -> llvm.Code:
    """Return the machine code of LLVM IR."""
    return llvm.Code(llvm.cached(lambda: llvm.assemble(text), name, text))


def _entry(name: str, doc: str, kernel: KernelFunction, signature: Signature,
           defaults: Sequence[np.ndarray], fallback: Callable[..., Any],
           form: CallForm | None = None) -> Callable[..., Any]:
    code = signature.entry_points
    shape = signature.shape
    lengths = np.array(shape, dtype=np.int64)
    ring = np.array([None, None])  # holds references to the results
    ring[:] = [np.empty(shape), np.empty(shape)] if shape else None
    words = {'KERNEL': kernel.address, 'RESULT_SHAPE': lengths.ctypes.data,
             'RING': ring.ctypes.data}
    table = new_table(words, fallback, code, defaults, (kernel.code, lengths, ring), form)
    return built_in(name, doc, code.address('entry'), METH_FASTCALL | METH_KEYWORDS,
                    table)


def _bound(name: str, doc: str, kernel: KernelFunction, signature: Signature,
           blocks: Sequence[np.ndarray],
           fallback: Callable[..., Any]) -> Callable[..., Any]:
    table = bound_table(kernel, signature, blocks, fallback)
    return built_in(name, doc, signature.entry_points.address('bound'), METH_FASTCALL,
                    table)


class NativeMethods:
    """Base class of objects with native methods; its first slot holds their tables."""

    __slots__ = ('_tables',)
    _tables: np.ndarray


@cache
def supported() -> bool:
    """Return whether native entry points work: check the object layout, then a call."""
    # Object layouts are known for CPython with the GIL.
    if (sys.implementation.name != 'cpython' or sys.byteorder != 'little'
            or sysconfig.get_config_var('Py_GIL_DISABLED')
            or not _in_main_interpreter()):
        return False
    try:
        interpreter_words()
    except AttributeError:  # an interpreter or numpy without these symbols
        return False
    # The head of an array must have every field where machine code reads it.
    probe = np.array([1.25, -2.5, 3.75])
    head = (ctypes.c_uint64 * 10).from_address(id(probe))
    count = ctypes.c_uint32.from_address(id(probe))
    count_of_one = count.value
    another = probe
    readable = (count.value == count_of_one + 1 and head[TYPE // 8] == id(np.ndarray)
                and head[DATA // 8] == probe.ctypes.data
                and head[NDIM // 8] & 0xFFFFFFFF == 1
                and ctypes.c_int64.from_address(head[SHAPE // 8]).value == 3
                and head[DTYPE // 8] == id(np.dtype(np.float64))
                and head[FLAGS // 8] & FRESH == FRESH and head[WEAKREFS // 8] == 0)
    # Floats and tuples, likewise.
    number, pair = 1.25, ('first', 'second')
    items = (ctypes.c_uint64 * 2).from_address(id(pair) + ITEMS)
    readable = (readable and ctypes.c_double.from_address(id(number) + DATA).value == 1.25
                and ctypes.c_int64.from_address(id(pair) + LENGTH).value == 2
                and list(items) == [id(word) for word in pair])
    return readable and _self_test(another)


def _in_main_interpreter() -> bool:
    """Return whether this is the main interpreter; others may have another GIL."""
    current, main = (getattr(ctypes.pythonapi, f'PyInterpreterState_{name}')
                     for name in ('Get', 'Main'))
    current.restype = main.restype = ctypes.c_void_p
    return bool(current() == main())


def _self_test(probe: np.ndarray) -> bool:
    """Return whether a test kernel works through each entry point and its fallback."""
    text = '\n'.join(['define void @twice(ptr %args) {', '  %x = load ptr, ptr %args',
                      '  %slot = getelementptr ptr, ptr %args, i64 2',
                      '  %y = load ptr, ptr %slot',
                      '  %a = load <3 x double>, ptr %x, align 8',
                      '  %b = fadd <3 x double> %a, %a',
                      '  store <3 x double> %b, ptr %y, align 8', '  ret void', '}'])
    # The test kernel doubles three numbers.
    code = assembled('self-test', text)
    kernel = KernelFunction(code, code.address('twice'))
    signature = Signature(((3,),), (), (math.inf,), (3,))
    parameters = np.zeros(1)
    twice = _entry('twice', '', kernel, signature, [parameters],
                   lambda *args, **keywords: (args, keywords))
    bad = np.array([1.0, np.nan, 0.0])
    first = twice(probe)
    second = twice(probe)
    third = twice(probe)
    source = probe.copy()
    result = np.empty(3)
    blocks = [source, parameters, result]
    bound = _bound('twice', '', kernel, signature, blocks, lambda *args: args)
    kind: Any = type('Probe', (NativeMethods,), {'__slots__': ()})
    owner = kind()
    # A method of an object makes its function at the first call.
    table = bound_table(kernel, signature, blocks, lambda *args: args)

    def make(owner: Any, name: str) -> EntryTable:
        owner._tables[1] = id(table)
        return table
    owner._tables = methods(kind, {'once': '', 'twice': ''}, make)
    counts = sys.getrefcount(first), sys.getrefcount(result)
    # Results are right and not shared, also by the methods; bad, missing or converted
    # arguments reach the fallback.
    return (all(np.array_equal(x, 2.0 * probe) for x in (first, second, third, bound()))
            and len({x.ctypes.data for x in (first, second, third)}) == 3
            and bound() is result and owner.twice() is result and owner.twice() is result
            and owner.twice(1) == (1,)
            and (sys.getrefcount(first), sys.getrefcount(result)) == counts
            and twice(bad)[0][0] is bad
            and twice() == ((), {}) and twice(probe, out=1)[1] == {'out': 1}
            and twice(probe[::2])[0][0].shape == (2,) and twice(1.0) == ((1.0,), {})
            and twice(np.full(3, 1e308))[0][0].shape == (3,) and bound(1) == (1,))


def entry(name: str, doc: str, kernel: KernelFunction, signature: Signature,
          defaults: Sequence[np.ndarray], fallback: Callable[..., Any],
          form: CallForm | None = None) -> Callable[..., Any]:
    """
    Return a built-in function that calls a kernel with minimal overhead.

    Parameters
    ----------
    name, doc : str
        Name and docstring of the function.
    kernel : KernelFunction
        The kernel.
    signature : Signature
        Of the kernel.
    defaults : sequence of array
        Arrays passed after the arguments; read at each call.
    fallback : callable
        Called with the same arguments when they do not match exactly.
    form : CallForm, optional
        Of calls with keywords and optional arguments; its kinds are the signature's.

    """
    if not signature.is_supported or not supported():
        return fallback
    return _entry(name, doc, kernel, signature, defaults, fallback, form)


def bound(name: str, doc: str, kernel: KernelFunction, signature: Signature,
          blocks: Sequence[np.ndarray], fallback: Callable[[], Any]) -> Callable[[], Any]:
    """
    Return a built-in function without arguments that calls a kernel on fixed arrays.

    Parameters
    ----------
    name, doc : str
        Name and docstring of the function.
    kernel : KernelFunction
        The kernel.
    signature : Signature
        Of the kernel.
    blocks : sequence of array
        The kernel's arguments, its parameters, its result, all C-contiguous. The
        function returns the last one (as a float if it has no dimension).
    fallback : callable
        Called when an argument or the result is not finite.

    """
    if any(block.size == 0 for block in blocks) or not supported():
        return fallback
    return _bound(name, doc, kernel, signature, blocks, fallback)


def methods(cls: type[NativeMethods], docs: Mapping[str, str],
            make: Callable[[Any, str], EntryTable]) -> np.ndarray:
    """
    Add native methods to a class and return the initial `_tables` of its objects.

    Parameters
    ----------
    cls : subclass of NativeMethods
        The class must never be freed; each object has a copy of the result.
    docs : mapping
        Method name to docstring.
    make : callable
        Called with the object and the method name at the first use. Creates the table
        with `bound_table`, stores its `id` in the object's `_tables`, keeps and returns
        it.

    """
    # A bound method reads its definition even after the class is freed: keep one
    # reference.
    definitions = (MethodDef * len(docs))()
    # CPython keeps the addresses of the definitions, which must never be freed.
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(definitions))
    code = assembled('methods', method_code(len(docs)))
    refusing = code.function('refuse_by', ctypes.PYFUNCTYPE(None, ctypes.c_void_p))
    refusing(id(refusal_table()))
    new = ctypes.pythonapi.PyDescr_NewMethod
    new.restype = ctypes.py_object
    new.argtypes = [ctypes.py_object, ctypes.c_void_p]
    unmade = []
    for place, (name, doc) in enumerate(docs.items()):
        definitions[place] = MethodDef(name.encode(), code.address(f'method{place}'),
                                       METH_FASTCALL, doc.encode())
        setattr(cls, name, new(cls, ctypes.addressof(definitions[place])))

        # The first call of a method makes its kernel.
        def first(owner: Any, name: str = name) -> EntryTable:
            return make(owner, name)
        unmade.append(unmade_table(first))
    tables = np.array([id(table) for table in unmade], dtype=np.uint64).view(EntryTable)
    tables.owned = (unmade, code)
    return tables
