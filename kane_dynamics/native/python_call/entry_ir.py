"""
LLVM IR of the native entry points, generated for one kernel's signature.

Two C functions are added to the kernel's module. `entry` takes arrays as positional arguments,
checks them, allocates the result, and calls the kernel; `bound` takes no argument and calls the
kernel on fixed memory. Both call the Python fallback for calls that they do not support.

CPython calls a method faster than a function stored as an attribute. The methods of all kernels
share one code, which forwards a call to the `bound` of the object's kernel.

`entry` reuses result arrays: it owns its last two results and returns one again once it holds the
only reference, as CPython's `zip` does with its tuples. Two are needed because in ``tau = f(...)``
the old result exists until the new one is assigned.
"""

from collections.abc import Sequence
import math

from kane_dynamics.native.python_call.object_layout import (Assembly, COUNT, DATA, DTYPE, FRESH,
                                                            NDIM, READABLE, SHAPE, SLOT, TABLE,
                                                            TABLE_OF_SELF, TYPE, WEAKREFS)
from kane_dynamics.native.tracing.program import Shape

FLOAT64 = 12  # numpy's type number


def _reuse_result(a: Assembly, place: str, shape: Shape, otherwise: str) -> None:
    """Branch to `run` with the array of a ring slot; to `otherwise` if it is in use."""
    number = 0 if place == 'first' else 1
    slot = a.new(f'getelementptr ptr, ptr {a.word("RING")}, i64 {number}')
    array = a.load('ptr', slot)
    a.branch([a.equal('i32', a.load('i32', array, COUNT), 1),
              a.equal('ptr', a.load('ptr', array, WEAKREFS), 'null'),
              a.equal('ptr', a.load('ptr', array, DTYPE), a.word('FLOAT64')),
              a.equal('i32', a.load('i32', array, NDIM), len(shape)),
              a.flags(array, FRESH)], f'{place}.free', otherwise)
    # The user may have given the array another shape.
    a.put(f'{place}.free:')
    lengths = a.load('ptr', array, SHAPE)
    conditions = []
    for k, length in enumerate(shape):
        actual = a.load('i64', lengths, 8 * k)
        conditions.append(a.equal('i64', actual, length))
    a.branch(conditions, f'{place}.taken', otherwise)
    a.put(f'{place}.taken:')
    a.add_to_count(array)
    a.put(f'  %{place}.array = getelementptr i8, ptr {array}, i64 0', '  br label %run')


def _new_result(a: Assembly, shape: Shape) -> None:
    """Allocate a result array and replace the oldest array of the ring by it."""
    a.put('make:')
    ring = a.word('RING')
    array = '%made.array'
    a.put(f'  {array} = call ptr {a.word("NEW_ARRAY")}(ptr {a.word("NDARRAY")}, '
          f'i32 {len(shape)}, ptr {a.word("RESULT_SHAPE")}, i32 {FLOAT64}, ptr null, '
          'ptr null, i32 0, i32 0, ptr null)',
          f'  %failed = icmp eq ptr {array}, null',
          '  br i1 %failed, label %failure, label %keep',
          'failure:', '  ret ptr null', 'keep:')
    # The ring moves on before the oldest array is released, whose finalization may run any code.
    a.add_to_count(array)
    second = a.new(f'getelementptr ptr, ptr {ring}, i64 1')
    oldest = a.load('ptr', ring)
    newer = a.load('ptr', second)
    a.put(f'  store ptr {newer}, ptr {ring}', f'  store ptr {array}, ptr {second}',
          f'  call void {a.word("RELEASE")}(ptr {oldest})', '  br label %run')


def _return_float(a: Assembly, number_at: str) -> None:
    a.branch(a.finite([(number_at, 1, math.inf)]), 'good', 'slow')
    a.put('good:')
    new_float = a.word('NEW_FLOAT')
    number = a.load('double', number_at)
    result = a.new(f'call ptr {new_float}(double {number})')
    a.put(f'  ret ptr {result}')


def entry_code(symbol: str, lengths: Sequence[int], limits: Sequence[float], n_defaults: int,
               shape: Shape) -> str:
    """
    Return the LLVM IR of `entry`.

    Parameters
    ----------
    symbol : str
        The kernel function, ``void symbol(double **pointers)``: arguments, defaults, result.
    lengths : sequence of int
        Length of each positional argument, all one-dimensional; none may be 0.
    limits : sequence of float
        Largest absolute value allowed in each argument.
    n_defaults : int
        Number of arguments whose addresses are in the table.
    shape : tuple of int
        Shape of the result; no length may be 0. () returns a float.

    """
    a = Assembly()
    slots = len(lengths) + n_defaults + 1
    a.put('define ptr @entry(ptr %self, ptr %args, i64 %nargs, ptr %kwnames) {',
          f'  %pointers = alloca [{slots} x ptr]', '  %scalar = alloca double',
          *TABLE_OF_SELF)
    a.branch([a.equal('ptr', '%kwnames', 'null'), a.equal('i64', '%nargs', len(lengths))],
             'types', 'slow')
    a.put('types:')
    arrays = [a.load('ptr', '%args', 8 * k) for k in range(len(lengths))]
    ndarray = a.word('NDARRAY')
    float64 = a.word('FLOAT64')
    # Only an ndarray has the fields that are read next.
    a.branch([a.equal('ptr', a.load('ptr', array, TYPE), ndarray) for array in arrays],
             'layout', 'slow')
    a.put('layout:')
    conditions = []
    for array in arrays:
        conditions += [a.equal('i32', a.load('i32', array, NDIM), 1),
                       a.equal('ptr', a.load('ptr', array, DTYPE), float64),
                       a.flags(array, READABLE)]
    a.branch(conditions, 'lengths', 'slow')
    # Only an array of one axis has a length.
    a.put('lengths:')
    conditions = []
    for array, length in zip(arrays, lengths):
        actual = a.load('i64', a.load('ptr', array, SHAPE))
        conditions.append(a.equal('i64', actual, length))
    a.branch(conditions, 'values', 'slow')
    a.put('values:')
    data = [a.load('ptr', array, DATA) for array in arrays]
    a.branch(a.finite(list(zip(data, lengths, limits))), 'ready', 'slow')
    a.put('ready:')
    data += [a.load('ptr', '%table', 8 * (len(TABLE) + k)) for k in range(n_defaults)]
    for k, pointer in enumerate(data):
        slot = a.new(f'getelementptr ptr, ptr %pointers, i64 {k}')
        a.put(f'  store ptr {pointer}, ptr {slot}')
    result = a.new(f'getelementptr ptr, ptr %pointers, i64 {slots - 1}')
    if not shape:
        a.put(f'  store ptr %scalar, ptr {result}', f'  call void @{symbol}(ptr %pointers)')
        _return_float(a, '%scalar')
        a.slow('%kwnames')
        return '\n'.join(a.lines)
    _reuse_result(a, 'first', shape, 'second')
    a.put('second:')
    _reuse_result(a, 'second', shape, 'make')
    _new_result(a, shape)
    a.put('run:', '  %out = phi ptr [%first.array, %first.taken], [%second.array, %second.taken], '
          '[%made.array, %keep]')
    memory = a.load('ptr', '%out', DATA)
    a.put(f'  store ptr {memory}, ptr {result}', f'  call void @{symbol}(ptr %pointers)')
    a.branch(a.finite([(memory, math.prod(shape), math.inf)]), 'good', 'discard')
    a.put('good:', '  ret ptr %out', 'discard:')  # the fallback explains the error
    a.put(f'  call void {a.word("RELEASE")}(ptr %out)', '  br label %slow')
    a.slow('%kwnames')
    return '\n'.join(a.lines)


def bound_code(symbol: str, sizes: Sequence[int], limits: Sequence[float], n_parameters: int,
               shape: Shape) -> str:
    """
    Return the LLVM IR of `bound`.

    Parameters
    ----------
    symbol : str
        The kernel function, ``void symbol(double **pointers)``: arguments, parameters, result.
    sizes : sequence of int
        Number of entries of each argument; none may be 0.
    limits : sequence of float
        Largest absolute value allowed in each argument.
    n_parameters : int
        Number of unchecked blocks after the arguments.
    shape : tuple of int
        Shape of the result; () returns a float.

    """
    a = Assembly()
    a.put('define ptr @bound(ptr %self, ptr %args, i64 %nargs) {', *TABLE_OF_SELF)
    a.put(f'  %pointers = getelementptr ptr, ptr %table, i64 {len(TABLE)}')
    data = [a.load('ptr', '%pointers', 8 * k) for k in range(len(sizes))]
    no_arguments = a.equal('i64', '%nargs', 0)
    a.branch([no_arguments, *a.finite(list(zip(data, sizes, limits)))], 'run', 'slow')
    a.put('run:', f'  call void @{symbol}(ptr %pointers)')
    memory = a.load('ptr', '%pointers', 8 * (len(sizes) + n_parameters))
    if shape:
        a.branch(a.finite([(memory, math.prod(shape), math.inf)]), 'good', 'slow')
        a.put('good:')
        result = a.word('RESULT')
        a.add_to_count(result)
        a.put(f'  ret ptr {result}')
    else:
        _return_float(a, memory)
    a.slow('null')
    return '\n'.join(a.lines)


def method_code(count: int) -> str:
    """
    Return the LLVM IR of `method0`, `method1`, ...

    The first slot of a method's `self` holds an array of table addresses. Method k calls the
    function that table k names and passes it the table and the object. An object without tables
    was not initialized; the table given to `refuse_by` serves it.
    """
    a = Assembly()
    a.put('@refusal = internal global ptr null', 'define void @refuse_by(ptr %table) {',
          '  store ptr %table, ptr @refusal', '  ret void', '}')
    for place in range(count):
        a.put(f'define ptr @method{place}(ptr %self, ptr %args, i64 %nargs) {{')
        tables = a.load('ptr', '%self', SLOT)
        initialized = a.new(f'icmp ne ptr {tables}, null')
        a.put(f'  br i1 {initialized}, label %made, label %unmade', 'unmade:',
              '  %refused = load ptr, ptr @refusal', '  br label %go', 'made:')
        of_object = a.load('ptr', a.load('ptr', tables, DATA), 8 * place)
        a.put('  br label %go', 'go:')
        table = a.new(f'phi ptr [%refused, %unmade], [{of_object}, %made]')
        answer = a.new(f'tail call ptr {_code_word(a, table)}(ptr {table}, ptr %args, '
                       'i64 %nargs, ptr %self)')
        a.put(f'  ret ptr {answer}', '}')
    return '\n'.join(a.lines)


def placeholder_code() -> str:
    """
    Return the LLVM IR of two placeholders for `bound` in a table: `refer` and `unmade`.

    `refer` calls the fallback, for kernels without entry points. `unmade` serves the first call
    of a method: its fallback takes the object and returns the table to use.
    """
    a = Assembly()
    a.put('define ptr @refer(ptr %self, ptr %args, i64 %nargs) {', *TABLE_OF_SELF,
          '  br label %slow')
    a.slow('null')
    a.put('define ptr @unmade(ptr %self, ptr %args, i64 %nargs, ptr %owner) {', *TABLE_OF_SELF,
          '  %given = alloca ptr', '  store ptr %owner, ptr %given')
    a.put(f'  %made = call ptr {a.word("VECTORCALL")}(ptr {a.word("FALLBACK")}, ptr %given, '
          'i64 1, ptr null)', '  %failed = icmp eq ptr %made, null',
          '  br i1 %failed, label %failure, label %go', 'failure:', '  ret ptr null', 'go:')
    answer = a.new(f'call ptr {_code_word(a, "%made")}(ptr %made, ptr %args, i64 %nargs, '
                   'ptr %owner)')
    a.put(f'  call void {a.word("RELEASE")}(ptr %made)', f'  ret ptr {answer}', '}')
    return '\n'.join(a.lines)


def _code_word(a: Assembly, table: str) -> str:
    """Load the function address of a table."""
    return a.load('ptr', a.load('ptr', table, DATA), 8 * TABLE.index('CODE'))
