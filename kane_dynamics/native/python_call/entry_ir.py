"""
The machine code between Python and one kernel, written for that kernel's very signature.

Two C functions go into the kernel's own module. `entry` takes arrays as positional arguments,
checks them, finds memory for the result, and calls the kernel; `bound` takes no argument and calls
the kernel on memory that was settled before. What they do not take goes to the Python fallback.

An object's method is called faster than a function that is its attribute. Methods of all kernels
are one piece of code, which forwards a call to the `bound` of the object's own kernel.

Memory for a result is kept from call to call: an entry owns its last two results, and one that
nobody else refers to any more is given out again, as CPython's `zip` does with its tuples. Two,
because in ``tau = f(...)`` the old result lives until the new one is there.
"""

from collections.abc import Sequence
import math

from kane_dynamics.native.python_call.object_layout import (Assembly, COUNT, DATA, DTYPE, FRESH,
                                                            NDIM, READABLE, SHAPE, SLOT, TABLE,
                                                            TABLE_OF_SELF, TYPE, WEAKREFS)
from kane_dynamics.native.tracing.program import Shape

FLOAT64 = 12  # numpy's type number


def _take(a: Assembly, place: str, shape: Shape, otherwise: str) -> None:
    """Go to `run` with the array in a slot of the ring, or on where it is in use or altered."""
    slot = a.new(f'getelementptr ptr, ptr {a.word("RING")}, i64 {0 if place == "first" else 1}')
    array = a.load('ptr', slot)
    a.branch([a.equal('i32', a.load('i32', array, COUNT), 1),
              a.equal('ptr', a.load('ptr', array, WEAKREFS), 'null'),
              a.equal('ptr', a.load('ptr', array, DTYPE), a.word('FLOAT64')),
              a.equal('i32', a.load('i32', array, NDIM), len(shape)), a.flags(array, FRESH)],
             f'{place}.free', otherwise)
    a.put(f'{place}.free:')
    lengths = a.load('ptr', array, SHAPE)
    a.branch([a.equal('i64', a.load('i64', lengths, 8 * k), length)
              for k, length in enumerate(shape)], f'{place}.taken', otherwise)
    a.put(f'{place}.taken:')
    a.add_to_count(array)
    a.put(f'  %{place}.array = getelementptr i8, ptr {array}, i64 0', '  br label %run')


def _make(a: Assembly, shape: Shape) -> None:
    """Make an array, and let it push the older one out of the ring."""
    a.put('make:')
    ring, made = a.word('RING'), '%made.array'
    a.put(f'  {made} = call ptr {a.word("NEW_ARRAY")}(ptr {a.word("NDARRAY")}, i32 {len(shape)}, '
          f'ptr {a.word("RESULT_SHAPE")}, i32 {FLOAT64}, ptr null, ptr null, i32 0, i32 0, '
          'ptr null)',
          f'  %failed = icmp eq ptr {made}, null',
          '  br i1 %failed, label %failure, label %keep', 'failure:', '  ret ptr null', 'keep:')
    a.add_to_count(made)
    second = a.new(f'getelementptr ptr, ptr {ring}, i64 1')
    oldest, newer = a.load('ptr', ring), a.load('ptr', second)
    a.put(f'  store ptr {newer}, ptr {ring}', f'  store ptr {made}, ptr {second}',
          f'  call void {a.word("RELEASE")}(ptr {oldest})', '  br label %run')


def _give_float(a: Assembly, number_at: str) -> None:
    a.branch(a.finite([(number_at, 1, math.inf)]), 'good', 'slow')
    a.put('good:')
    new_float, number = a.word('NEW_FLOAT'), a.load('double', number_at)
    a.put('  ret ptr ' + a.new(f'call ptr {new_float}(double {number})'))


def entry_code(symbol: str, lengths: Sequence[int], most: Sequence[float], n_defaults: int,
               shape: Shape) -> str:
    """
    Return the assembly of `entry`.

    Parameters
    ----------
    symbol : str
        The kernel's, ``void symbol(double **pointers)``: arguments, defaults, result.
    lengths : sequence of int
        Length of each positional argument, all of one dimension; none may be 0.
    most : sequence of float
        Largest size of the entries of each.
    n_defaults : int
        Arguments whose memory the table names.
    shape : tuple of int
        Of the result; none may be 0. () returns a float.

    """
    a = Assembly()
    slots = len(lengths) + n_defaults + 1
    a.put('define ptr @entry(ptr %self, ptr %args, i64 %nargs, ptr %kwnames) {',
          f'  %pointers = alloca [{slots} x ptr]', '  %scalar = alloca double',
          *TABLE_OF_SELF)
    a.branch([a.equal('ptr', '%kwnames', 'null'), a.equal('i64', '%nargs', len(lengths))],
             'types', 'slow')
    a.put('types:')
    given = [a.load('ptr', '%args', 8 * k) for k in range(len(lengths))]
    ndarray, float64 = a.word('NDARRAY'), a.word('FLOAT64')
    a.branch([a.equal('ptr', a.load('ptr', o, TYPE), ndarray) for o in given], 'layout', 'slow')
    a.put('layout:')
    a.branch([condition for o in given for condition in (
        a.equal('i32', a.load('i32', o, NDIM), 1),
        a.equal('ptr', a.load('ptr', o, DTYPE), float64), a.flags(o, READABLE))],
        'lengths', 'slow')
    a.put('lengths:')
    a.branch([a.equal('i64', a.load('i64', a.load('ptr', o, SHAPE)), length)
              for o, length in zip(given, lengths)], 'values', 'slow')
    a.put('values:')
    data = [a.load('ptr', o, DATA) for o in given]
    a.branch(a.finite(list(zip(data, lengths, most))), 'ready', 'slow')
    a.put('ready:')
    data += [a.load('ptr', '%table', 8 * (len(TABLE) + k)) for k in range(n_defaults)]
    for k, pointer in enumerate(data):
        a.put(f'  store ptr {pointer}, ptr '
              + a.new(f'getelementptr ptr, ptr %pointers, i64 {k}'))
    result = a.new(f'getelementptr ptr, ptr %pointers, i64 {slots - 1}')
    if not shape:
        a.put(f'  store ptr %scalar, ptr {result}', f'  call void @{symbol}(ptr %pointers)')
        _give_float(a, '%scalar')
        a.slow('%kwnames')
        return '\n'.join(a.lines)
    _take(a, 'first', shape, 'second')
    a.put('second:')
    _take(a, 'second', shape, 'make')
    _make(a, shape)
    a.put('run:', '  %out = phi ptr [%first.array, %first.taken], [%second.array, %second.taken], '
          '[%made.array, %keep]')
    memory = a.load('ptr', '%out', DATA)
    a.put(f'  store ptr {memory}, ptr {result}', f'  call void @{symbol}(ptr %pointers)')
    a.branch(a.finite([(memory, math.prod(shape), math.inf)]), 'good', 'discard')
    a.put('good:', '  ret ptr %out', 'discard:')  # the fallback computes it again and explains
    a.put(f'  call void {a.word("RELEASE")}(ptr %out)', '  br label %slow')
    a.slow('%kwnames')
    return '\n'.join(a.lines)


def bound_code(symbol: str, sizes: Sequence[int], most: Sequence[float], n_parameters: int,
               shape: Shape) -> str:
    """
    Return the assembly of `bound`.

    Parameters
    ----------
    symbol : str
        The kernel's, ``void symbol(double **pointers)``: arguments, parameters, result.
    sizes : sequence of int
        Number of entries of each argument; none may be 0.
    most : sequence of float
        Largest size of the entries of each.
    n_parameters : int
        Blocks that follow the arguments and are not checked.
    shape : tuple of int
        Of the result; () returns a float.

    """
    a = Assembly()
    a.put('define ptr @bound(ptr %self, ptr %args, i64 %nargs) {', *TABLE_OF_SELF)
    a.put(f'  %pointers = getelementptr ptr, ptr %table, i64 {len(TABLE)}')
    data = [a.load('ptr', '%pointers', 8 * k) for k in range(len(sizes))]
    a.branch([a.equal('i64', '%nargs', 0), *a.finite(list(zip(data, sizes, most)))], 'run', 'slow')
    a.put('run:', f'  call void @{symbol}(ptr %pointers)')
    memory = a.load('ptr', '%pointers', 8 * (len(sizes) + n_parameters))
    if shape:
        a.branch(a.finite([(memory, math.prod(shape), math.inf)]), 'good', 'slow')
        a.put('good:')
        result = a.word('RESULT')
        a.add_to_count(result)
        a.put(f'  ret ptr {result}')
    else:
        _give_float(a, memory)
    a.slow('null')
    return '\n'.join(a.lines)


def method_code(count: int) -> str:
    """
    Return the assembly of `method0`, `method1`, ...

    A method's `self` is an object that begins with a slot: in it an array of tables, of which the
    method takes the one at its own place and goes on as that says, passing the object beside.
    """
    a = Assembly()
    for place in range(count):
        a.put(f'define ptr @method{place}(ptr %self, ptr %args, i64 %nargs) {{')
        tables = a.load('ptr', a.load('ptr', '%self', SLOT), DATA)
        table = a.load('ptr', tables, 8 * place)
        a.put('  ret ptr ' + a.new(f'tail call ptr {_code(a, table)}(ptr {table}, ptr %args, '
                                   'i64 %nargs, ptr %self)'), '}')
    return '\n'.join(a.lines)


def stand_in_code() -> str:
    """
    Return the assembly of what stands in a table for `bound`: `refer` and `unmade`.

    `refer` is for what has no machine code: it calls the fallback. `unmade` is for what nobody
    has used yet: the fallback takes the object and returns its table to be.
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
    answer = a.new(f'call ptr {_code(a, "%made")}(ptr %made, ptr %args, i64 %nargs, ptr %owner)')
    a.put(f'  call void {a.word("RELEASE")}(ptr %made)', f'  ret ptr {answer}', '}')
    return '\n'.join(a.lines)


def _code(a: Assembly, table: str) -> str:
    """Return the function that a table says."""
    return a.load('ptr', a.load('ptr', table, DATA), 8 * TABLE.index('CODE'))
