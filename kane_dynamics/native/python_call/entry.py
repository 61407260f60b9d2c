"""
Native entry points of kernels: built-in functions and methods, with a Python fallback.

A function created here is a CPython built-in of `entry.c`, whose table says what its
kernel takes and returns. It accepts contiguous, finite float64 ndarrays of the declared
shapes, which a control loop passes, lists of numbers, and small batches. For any other
argument it calls the Python fallback, which converts it or raises an error. The machine
code reads ndarray fields at their public offsets (numpy's ABI) and the object header of
CPython builds with a GIL. A self-test verifies this on the running interpreter; if it
fails, the fallback serves every call.

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
    A single call holds the GIL throughout, so nothing changes beside it, and so does a
    batch that one thread computes in the time for which others would not be started.
    Larger batches release it (`runtime.loops`); their callers hold kernel and arrays
    until all threads have ended.
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
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
import math
from pathlib import Path
import sys
import sysconfig
from typing import Any

from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.machine_code.c_source import CSource
from kane_dynamics.native.tracing.program import Shape
import numpy as np

SOURCE = CSource(Path(__file__).with_suffix('.c'))
_CONSTANTS = SOURCE.constants
# Kinds of arguments
REQUIRED, OPTIONAL, KEYWORD, NUMBER, FIXED = map(_CONSTANTS.__getitem__, (
    'REQUIRED', 'OPTIONAL', 'KEYWORD', 'NUMBER', 'FIXED'))
READABLE, WRITEABLE, FRESH = map(_CONSTANTS.__getitem__, ('READABLE', 'WRITEABLE', 'FRESH'))
_Array, _Interpreter, _Argument, _Part, Lanes, _Table = map(SOURCE.structures.__getitem__, (
    'array', 'interpreter', 'argument', 'part', 'lanes', 'table'))
# Calls of METH_NOARGS are slower: CPython does not specialize them.
METH_FASTCALL = 0x0080
METH_KEYWORDS = 0x0002
PY_ARRAY_NEW = 93  # slot of PyArray_New in numpy's C API table, fixed since numpy 1.0


class MethodDef(ctypes.Structure):
    """CPython's PyMethodDef."""

    _fields_ = [('ml_name', ctypes.c_char_p), ('ml_meth', ctypes.c_void_p),
                ('ml_flags', ctypes.c_int), ('ml_doc', ctypes.c_char_p)]


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
    kinds : tuple of int
        `REQUIRED`: by position. `OPTIONAL`: by position or keyword. `KEYWORD`: by
        keyword. `NUMBER`: by keyword, a float of at least 0. `FIXED`: no part of a call.
        In this order, but for fixed ones.
    stand_ins : tuple of array, float or None
        In place of an argument that is left out or None; the fallback serves the call
        where this is None. Those of fixed arguments are not checked.

    """

    names: tuple[str, ...]
    kinds: tuple[int, ...]
    stand_ins: tuple[Any, ...]

    def __post_init__(self) -> None:
        """Intern the names, as those of calls are: one name has one address."""
        object.__setattr__(self, 'names', tuple(map(sys.intern, self.names)))


@dataclass(frozen=True)
class ResultPart:
    """An array of a result: `rows` runs of `width` numbers, `stride` numbers apart."""

    shape: Shape
    start: int
    rows: int
    width: int
    stride: int


@dataclass(frozen=True)
class Signature:
    """
    Arguments and result of a kernel: all that its entry points check.

    Attributes
    ----------
    shapes : tuple of tuple of int
        Of the arguments of a call, at least one axis each.
    default_sizes : tuple of int
        Numbers of entries of the default arguments; one block of parameters follows.
    limits : tuple of float
        Largest absolute value allowed in each argument.
    size : int
        Number of entries of the kernel's result.
    parts : tuple of ResultPart
        The arrays that a call returns; without any, it returns a float.
    memory : int, optional
        Number of the argument to which the rest of the kernel's result is written; the
        result is then one row, and so is this argument.
    unread : int
        Number of further arguments with which calls by position may end, and which
        nothing reads.

    """

    shapes: tuple[Shape, ...]
    default_sizes: tuple[int, ...]
    limits: tuple[float, ...]
    size: int
    parts: tuple[ResultPart, ...]
    memory: int | None = None
    unread: int = 0

    @property
    def is_supported(self) -> bool:
        """Return whether there are arguments and none has a length of 0."""
        sizes = [*self.default_sizes, self.size]
        for shape in self.shapes:
            sizes.append(math.prod(shape))
        count = len(sizes) + 1  # and the parameters
        axes = [len(shape) for shape in self.shapes]
        return bool(self.shapes) and 0 not in sizes and (
            count <= _CONSTANTS['POINTERS'] and max(axes) < _CONSTANTS['MOST_AXES'])

    def with_memory(self, memory: int) -> 'Signature':
        """Return the signature of calls that update an argument."""
        size, = self.shapes[memory]
        rest = self.size - size
        return replace(self, parts=(ResultPart((rest,), 0, 1, rest, rest),), memory=memory)


class EntryTable(np.ndarray):
    """
    Table that a native function reads: a `table` of `entry.c`, and a PyMethodDef.

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
    """Return the addresses of types and functions that are equal for all functions."""
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
    return {'ndarray': id(np.ndarray), 'float64': id(np.dtype(np.float64)),
            'real_type': id(float), 'whole_type': id(int), 'number_type': id(np.float64),
            'list_type': id(list), 'tuple_type': id(tuple), 'text_type': id(str),
            'none': id(None), 'new_array': int(numpy_api[PY_ARRAY_NEW] or 0),
            'new_tuple': _symbol('PyTuple_New'), 'new_number': _symbol('PyFloat_FromDouble'),
            'number_of': _symbol('PyLong_AsDouble'), 'error': _symbol('PyErr_Occurred'),
            'clear_error': _symbol('PyErr_Clear'), 'release': _symbol('Py_DecRef'),
            'item': _symbol('PyDict_GetItemWithError'),
            'call': _symbol('PyObject_Vectorcall')}


def _symbol(name: str) -> int:
    return int(ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0)


@cache
def _interpreter() -> Any:
    return _Interpreter(**interpreter_words())


def new_table(fallback: Callable[..., Any], words: Mapping[str, int] | None = None,
              owned: tuple[Any, ...] = ()) -> EntryTable:
    """Return a table of these fields, which keeps the objects to which they refer."""
    size = ctypes.sizeof(_Table) + ctypes.sizeof(MethodDef)
    table = np.zeros(size, dtype=np.uint8).view(EntryTable)
    interpreter = _interpreter()
    fields = _Table.from_buffer(table)
    fields.python = ctypes.addressof(interpreter)
    fields.fallback = id(fallback)
    fields.memory = -1
    for name, value in (words or {}).items():
        setattr(fields, name, value)
    table.owned = (SOURCE.code, interpreter, *owned)
    table.fallback = fallback
    table.setflags(write=False)
    return table


def built_in(name: str, doc: str, function: str, table: EntryTable) -> Callable[..., Any]:
    """Create a built-in function of `entry.c` from its table."""
    at = table.ctypes.data + ctypes.sizeof(_Table)
    definition = MethodDef.from_address(at)
    definition.__init__(  # type: ignore[misc]
        name.encode(), SOURCE.code.address(function), METH_FASTCALL | METH_KEYWORDS,
        doc.encode())
    table.owned = (definition, *table.owned)  # keeps the name and doc alive
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype = ctypes.py_object
    make.argtypes = [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    built: Callable[..., Any] = make(at, table, None)
    return built


def kernel_table(kernel: KernelFunction, signature: Signature,
                 blocks: Sequence[np.ndarray], fallback: Callable[..., Any],
                 form: CallForm | None = None, bound: bool = False,
                 lanes: Any = None) -> EntryTable:
    """
    Return the table of a kernel.

    `blocks` are the defaults and the parameters, for a bound function all arguments, the
    parameters and the result. `form` is that of calls with keywords, `lanes` the
    `Lanes` of batches.
    """
    kept: list[Any] = [kernel.code, *blocks, form, lanes]
    # All arguments of a bound function are checked as blocks; else those of a call.
    shapes = list(signature.shapes)
    if bound:
        for size in signature.default_sizes:
            shapes.append((size,))
    arguments = (_Argument * len(shapes))()
    for k, shape in enumerate(shapes):
        lengths = np.array(shape, dtype=np.int64)
        kept.append(lengths)
        limit = min(signature.limits[k], sys.float_info.max)
        flags = READABLE | (WRITEABLE if k == signature.memory else 0)
        arguments[k] = _Argument(REQUIRED, len(shape), math.prod(shape),
                                 lengths.ctypes.data, limit, flags, 0, 0)
        if form is not None:
            arguments[k].kind = form.kinds[k]
            arguments[k].name = id(form.names[k])
            stand_in = form.stand_ins[k]
            arguments[k].stand_in = 0 if stand_in is None else id(stand_in)

    # The pointers of `entry` begin with those of the arguments of a call.
    addresses = [] if bound else [0] * len(shapes)
    for block in blocks:
        addresses.append(block.ctypes.data)
    slots = len(addresses) if bound else len(addresses) + 1
    pointers = np.array(addresses, dtype=np.int64)

    parts = (_Part * max(1, len(signature.parts)))()
    ring = np.array([None] * (2 * len(signature.parts)))  # references to results
    for k, part in enumerate(signature.parts):
        lengths = np.array(part.shape, dtype=np.int64)
        kept.append(lengths)
        parts[k] = _Part(len(part.shape), lengths.ctypes.data, part.start, part.rows,
                         part.width, part.stride)
        if not bound:
            ring[2 * k] = np.empty(part.shape)
            ring[2 * k + 1] = np.empty(part.shape)
    words = {'code': SOURCE.code.address('bound' if bound else 'entry'),
             'kernel': kernel.address, 'count': len(shapes),
             'arguments': ctypes.addressof(arguments), 'by_name': int(form is not None),
             'unread': signature.unread, 'slots': slots, 'pointers': pointers.ctypes.data,
             'parts': len(signature.parts), 'part': ctypes.addressof(parts),
             'size': signature.size, 'ring': ring.ctypes.data}
    kept += [arguments, pointers, parts, ring]
    if bound:
        words['result'] = id(blocks[-1])
    if signature.memory is not None:
        words['memory'] = signature.memory
    if signature.memory is not None or len(signature.parts) > 1:
        scratch = np.empty(signature.size)
        kept.append(scratch)
        words['scratch'] = scratch.ctypes.data
    if lanes is not None:
        words['batches'] = ctypes.addressof(lanes)
    return new_table(fallback, words, tuple(kept))


def unmade_table(make: Callable[[Any], Any]) -> EntryTable:
    """Return a table whose first call asks `make` for the table of an object."""
    return new_table(make, {'code': SOURCE.code.address('unmade')})


@cache
def refusal_table() -> EntryTable:
    """Return the table of all methods of objects that were not initialized."""
    return unmade_table(refuse_uninitialized)


def refuse_uninitialized(owner: Any) -> None:
    """Raise TypeError: the object was not initialized."""
    raise TypeError(f'{type(owner).__name__}: not initialized; expected an object made '
                    'by its class, such as robot.bind()')


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
    head = _Array.from_address(id(probe))
    count_of_one = head.head.count
    another = probe
    readable = (head.head.count == count_of_one + 1 and head.head.type == id(np.ndarray)
                and head.data == probe.ctypes.data and head.axes == 1
                and ctypes.c_int64.from_address(head.lengths).value == 3
                and head.kind == id(np.dtype(np.float64)) and head.bits & FRESH == FRESH
                and not head.weak)
    # Floats, tuples and lists, likewise.
    number, pair = 1.25, ('first', 'second')
    for thing in (number, np.float64(number)):
        readable = (readable and ctypes.c_double.from_address(
            id(thing) + object.__basicsize__).value == number)
    items = list((ctypes.c_uint64 * 3).from_address(id(pair) + object.__basicsize__))
    readable = readable and items == [2, *map(id, pair)]
    items = [*pair]
    length, place = (ctypes.c_uint64 * 2).from_address(id(items) + object.__basicsize__)
    readable = (readable and length == 2 and list((ctypes.c_uint64 * 2).from_address(place))
                == [*map(id, pair)])
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
    code = llvm.Code(llvm.cached(lambda: llvm.assemble(text), 'self-test', text))
    kernel = KernelFunction(code, code.address('twice'))
    signature = Signature(((3,),), (), (math.inf,), 3, (ResultPart((3,), 0, 1, 3, 3),))
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
    table = kernel_table(kernel, signature, blocks, lambda *args: args, bound=True)

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
            and np.array_equal(twice(probe.tolist()), 2.0 * probe)
            and np.array_equal(twice((1, 2.0, np.float64(3))), [2.0, 4.0, 6.0])
            and twice([True, 1, 1])[0][0] == [True, 1, 1]
            and twice(np.full(3, 1e308))[0][0].shape == (3,) and bound(1) == (1,))


def _entry(name: str, doc: str, kernel: KernelFunction, signature: Signature,
           defaults: Sequence[np.ndarray], fallback: Callable[..., Any],
           form: CallForm | None = None, lanes: Any = None) -> Callable[..., Any]:
    table = kernel_table(kernel, signature, defaults, fallback, form, lanes=lanes)
    return built_in(name, doc, 'entry', table)


def _bound(name: str, doc: str, kernel: KernelFunction, signature: Signature,
           blocks: Sequence[np.ndarray],
           fallback: Callable[..., Any]) -> Callable[..., Any]:
    table = kernel_table(kernel, signature, blocks, fallback, bound=True)
    return built_in(name, doc, 'bound', table)


def entry(name: str, doc: str, kernel: KernelFunction, signature: Signature,
          defaults: Sequence[np.ndarray], fallback: Callable[..., Any],
          form: CallForm | None = None, lanes: Any = None) -> Callable[..., Any]:
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
        Of calls with keywords and optional arguments.
    lanes : Lanes, optional
        The kernel's code of batches, null until it is compiled.

    """
    if not signature.is_supported or not supported():
        return fallback
    return _entry(name, doc, kernel, signature, defaults, fallback, form, lanes)


def chooser(name: str, doc: str, choices: dict[Any, Callable[..., Any]],
            fallback: Callable[..., Any]) -> Callable[..., Any]:
    """
    Return a built-in function that calls the function of its first argument.

    Parameters
    ----------
    name, doc : str
        Name and docstring of the function.
    choices : dict
        Functions of the other arguments, by a name or a tuple of names; more may be
        added later.
    fallback : callable
        Called with all arguments where the first one is no key.

    """
    if not supported():
        return fallback
    table = new_table(fallback, {'choices': id(choices)}, (choices,))
    return built_in(name, doc, 'choose', table)


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


def bound_table(kernel: KernelFunction, signature: Signature,
                blocks: Sequence[np.ndarray], fallback: Callable[..., Any]) -> EntryTable:
    """Return the table of a method of an object that keeps it alive; see `bound`."""
    if any(block.size == 0 for block in blocks):
        return new_table(fallback, {'code': SOURCE.code.address('refer')})
    return kernel_table(kernel, signature, blocks, fallback, bound=True)


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
    code = SOURCE.code
    refusing = code.function('refuse_by', ctypes.PYFUNCTYPE(None, ctypes.c_void_p))
    refusing(id(refusal_table()))
    new = ctypes.pythonapi.PyDescr_NewMethod
    new.restype = ctypes.py_object
    new.argtypes = [ctypes.py_object, ctypes.c_void_p]
    unmade = []
    for place, (name, doc) in enumerate(docs.items()):
        definitions[place] = MethodDef(name.encode(), code.address(f'method_{place:02o}'),
                                       METH_FASTCALL, doc.encode())
        setattr(cls, name, new(cls, ctypes.addressof(definitions[place])))

        # The first call of a method makes its kernel.
        def first(owner: Any, name: str = name) -> EntryTable:
            return make(owner, name)
        unmade.append(unmade_table(first))
    tables = np.array([id(table) for table in unmade], dtype=np.uint64).view(EntryTable)
    tables.owned = (unmade, code)
    return tables
