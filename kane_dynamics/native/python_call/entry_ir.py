"""
LLVM IR of the native entry points, generated for one signature of kernels.

There are two C functions. `entry` takes arrays as positional arguments, checks them,
allocates the result, and calls the kernel; `bound` takes no argument and calls the
kernel on fixed memory. Both find the kernel in their table, so that all kernels of one
signature share them, and call the Python fallback for calls that they do not support.

CPython calls a method faster than a function stored as an attribute. The methods of all
kernels share one code, which forwards a call to the `bound` of the object's kernel.

`entry` reuses result arrays: it owns its last two results and returns one again once it
holds the only reference, as CPython's `zip` does with its tuples. Two are needed because
in ``tau = f(...)`` the old result exists until the new one is assigned.

The code reads CPython and numpy objects at fixed offsets. `entry.supported` must verify
every assumption about them on the running interpreter.
"""

from collections.abc import Sequence
import math

from kane_dynamics.native.backends.llvm_math import literal, overflow_scale
from kane_dynamics.native.tracing.program import Shape

# 64-bit words of the table that a function receives as `self`, in order. Pointers
# follow: for `entry`, those of the default arguments; for `bound`, those of all
# arguments and of the result. Behind the defaults of a `CallForm` follow its objects and
# names. KERNEL is the address of the kernel, ``void
# kernel(double **pointers)``; CODE is the function to which a method forwards its call.
TABLE = ('KERNEL', 'CODE', 'FALLBACK', 'VECTORCALL', 'NDARRAY', 'FLOAT64', 'NEW_ARRAY',
         'NEW_FLOAT', 'RELEASE', 'RESULT_SHAPE', 'RING', 'RESULT', 'FLOAT', 'NONE')

# Byte offsets of the fields of a CPython object and of an ndarray.
COUNT, TYPE, DATA, NDIM, SHAPE, DTYPE, FLAGS, WEAKREFS = 0, 8, 16, 24, 32, 56, 64, 72
SLOT = 16  # the first slot of a Python object
READABLE = 0x101  # C_CONTIGUOUS, ALIGNED
WRITEABLE = 0x400
FRESH = READABLE | WRITEABLE | 0x4  # OWNDATA
TABLE_OF_SELF = (f'  %table.at = getelementptr i8, ptr %self, i64 {DATA}',
                 '  %table = load ptr, ptr %table.at')
LENGTH, ITEMS = 16, 24  # of a tuple
# Kinds of the arguments of a call; see `entry.CallForm`.
REQUIRED, OPTIONAL, KEYWORD, NUMBER, FIXED = (
    'required', 'optional', 'keyword', 'number', 'fixed')
LOOP_SIZE = 256  # entries above which a block is checked by a loop
ALL_FINITE = """
; Return whether `size` entries, 8 or more, are finite after multiplication by the scale.
define internal i1 @all_finite(ptr %x, i64 %size, double %scale) {
start:
  %last = sub i64 %size, 8  ; the last block may overlap the one before
  %one = insertelement <8 x double> poison, double %scale, i32 0
  %scales = shufflevector <8 x double> %one, <8 x double> poison, <8 x i32> zeroinitializer
  br label %next
next:
  %k = phi i64 [0, %start], [%k.next, %next]
  %total = phi <8 x double> [zeroinitializer, %start], [%total.next, %next]
  %within = icmp ult i64 %k, %last
  %place = select i1 %within, i64 %k, i64 %last
  %at = getelementptr double, ptr %x, i64 %place
  %value = load <8 x double>, ptr %at, align 8
  %scaled = fmul <8 x double> %value, %scales
  %zero = fsub <8 x double> %scaled, %scaled
  %total.next = fadd <8 x double> %total, %zero
  %k.next = add i64 %k, 8
  br i1 %within, label %next, label %done
done:
  %odd = fcmp uno <8 x double> %total.next, zeroinitializer
  %bits = bitcast <8 x i1> %odd to i8
  %good = icmp eq i8 %bits, 0
  ret i1 %good
}
"""
FLOAT64 = 12  # numpy's type number


class Assembly:
    """Emits LLVM IR instructions with fresh names; the caller emits the labels."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._count = 0

    def new(self, code: str) -> str:
        """Append one instruction and return the name of its result."""
        self._count += 1
        self.lines.append(f'  %t{self._count} = {code}')
        return f'%t{self._count}'

    def put(self, *lines: str) -> None:
        """Append lines as they are."""
        self.lines += lines

    def load(self, kind: str, base: str, offset: int = 0) -> str:
        """Return the value `offset` bytes after a pointer."""
        at = self.new(f'getelementptr i8, ptr {base}, i64 {offset}')
        alignment = 4 if kind == 'i32' else 8
        return self.new(f'load {kind}, ptr {at}, align {alignment}')

    def word(self, name: str) -> str:
        """Return a word of the table."""
        return self.load('ptr', '%table', 8 * TABLE.index(name))

    def equal(self, kind: str, a: str, b: str | int) -> str:
        """Return the comparison of two values for equality."""
        return self.new(f'icmp eq {kind} {a}, {b}')

    def flags(self, array: str, required: int) -> str:
        """Return the condition that an array has all these flags."""
        flags = self.load('i32', array, FLAGS)
        return self.equal('i32', self.new(f'and i32 {flags}, {required}'), required)

    def branch(self, conditions: Sequence[str], then: str, otherwise: str) -> None:
        """Branch to `then` if all conditions hold, else to `otherwise`."""
        both = conditions[0]
        for condition in conditions[1:]:
            both = self.new(f'and i1 {both}, {condition}')
        self.put(f'  br i1 {both}, label %{then}, label %{otherwise}')

    def add_to_count(self, thing: str) -> None:
        """Increment a reference count: its 32 bits, beside flags in newer CPythons."""
        count = self.load('i32', thing, COUNT)
        self.put(f'  store i32 {self.new(f"add i32 {count}, 1")}, ptr {thing}, align 8')

    def finite(self, blocks: Sequence[tuple[str, int, float]]) -> list[str]:
        """
        Return conditions that hold if all entries of the blocks are finite.

        A block is (pointer, size, limit) with the largest valid absolute value.
        """
        # Long blocks: by a loop.
        conditions = []
        for pointer, size, limit in blocks:
            if size > LOOP_SIZE:
                scale = literal(overflow_scale(limit))
                conditions.append(self.new(f'call i1 @all_finite(ptr {pointer}, i64 '
                                           f'{size}, double {scale})'))

        # Short blocks: sums by width of x - x, which is NaN for NaN and infinity.
        # Numbers beyond a limit become infinite by a factor.
        totals: dict[int, str] = {}
        for pointer, size, limit in blocks:
            if size > LOOP_SIZE:
                continue
            width = max(filter(size.__ge__, (8, 4, 2, 1)))
            vector = f'<{width} x double>'
            # The last vector may overlap the one before.
            for place in [*range(0, size - width, width), size - width]:
                x = self.load(vector, pointer, 8 * place)
                if math.isfinite(limit):
                    scale = literal(overflow_scale(limit))
                    factors = ', '.join([f'double {scale}'] * width)
                    x = self.new(f'fmul {vector} {x}, <{factors}>')
                zero = self.new(f'fsub {vector} {x}, {x}')
                if width in totals:
                    zero = self.new(f'fadd {vector} {totals[width]}, {zero}')
                totals[width] = zero
        for width, total in totals.items():
            lanes = self.new(f'fcmp uno <{width} x double> {total}, zeroinitializer')
            bits = self.new(f'bitcast <{width} x i1> {lanes} to i{width}')
            conditions.append(self.equal(f'i{width}', bits, 0))
        return conditions

    def slow(self, keywords: str) -> None:
        """Emit the call of the fallback and the end of the function."""
        self.put('slow:')
        answer = self.new(f'call ptr {self.word("VECTORCALL")}(ptr '
                          f'{self.word("FALLBACK")}, ptr %args, i64 %nargs, ptr '
                          f'{keywords})')
        self.put(f'  ret ptr {answer}', '}')


def _reuse_result(a: Assembly, place: str, shape: Shape, otherwise: str) -> None:
    """Branch to `run` with the array of a ring slot; to `otherwise` if it is in use."""
    number = 0 if place == 'first' else 1
    slot = a.new(f'getelementptr ptr, ptr {a.word("RING")}, i64 {number}')
    array = a.load('ptr', slot)
    # Free: no one else refers to it, and it still is a plain array of float64.
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
    # The ring moves on before the oldest array is released, whose finalization may run
    # any code.
    a.add_to_count(array)
    second = a.new(f'getelementptr ptr, ptr {ring}, i64 1')
    oldest = a.load('ptr', ring)
    newer = a.load('ptr', second)
    a.put(f'  store ptr {newer}, ptr {ring}', f'  store ptr {array}, ptr {second}',
          f'  call void {a.word("RELEASE")}(ptr {oldest})', '  br label %run')


def _copy(a: Assembly, source: str, first: int, target: str, count: int) -> None:
    """Copy `count` doubles, from number `first` of the source on."""
    vector = f'<{count} x double>'
    block = a.load(vector, source, 8 * first)
    a.put(f'  store {vector} {block}, ptr {target}, align 8')


def _return_float(a: Assembly, number_at: str) -> None:
    a.branch(a.finite([(number_at, 1, math.inf)]), 'good', 'slow')
    a.put('good:')
    new_float = a.word('NEW_FLOAT')
    number = a.load('double', number_at)
    result = a.new(f'call ptr {new_float}(double {number})')
    a.put(f'  ret ptr {result}')


def entry_code(shapes: Sequence[Shape], limits: Sequence[float], n_defaults: int,
               shape: Shape, memory: int | None = None,
               kinds: Sequence[str] = (), unread: int = 0) -> str:
    """
    Return the LLVM IR of `entry`.

    The kernel gets pointers to the arguments, the defaults and the result. With a memory,
    the kernel's result goes to the stack: its first part becomes the result of the call,
    the rest overwrites the argument that is the memory.

    Parameters
    ----------
    shapes : sequence of tuple of int
        Of the positional arguments, at least one axis each; no length may be 0.
    limits : sequence of float
        Largest absolute value allowed in each argument.
    n_defaults : int
        Number of arguments whose addresses are in the table.
    shape : tuple of int
        Shape of the result; no length may be 0. () returns a float.
    memory : int, optional
        Number of the argument to which the rest of the kernel's result is written; the
        result is then one row, and so is this argument.
    kinds : sequence of str, optional
        Of the arguments, in calls with keywords and optional arguments; see
        `entry.CallForm`.
    unread : int
        Number of further arguments with which calls by position may end. They are not
        read.

    """
    # Anything that is not the plain case goes to `slow`, the checked call in Python.
    a = Assembly()
    count = len(shapes)
    slots = count + n_defaults + 1
    size = math.prod(shape)
    total = size
    if memory is not None:
        total += math.prod(shapes[memory])
    a.put('define ptr @entry(ptr %self, ptr %args, i64 %nargs, ptr %kwnames) {',
          f'  %pointers = alloca [{slots} x ptr]', '  %scalar = alloca double',
          f'  %given = alloca [{count} x ptr]',
          f'  %numbers = alloca [{total} x double], align 64', *TABLE_OF_SELF)
    if kinds:
        _sort_arguments(a, kinds, 8 * (len(TABLE) + n_defaults))
        arguments = '%given'
    else:
        # From `count` to `count + unread` arguments, by one comparison without sign.
        further = a.new(f'sub i64 %nargs, {count}')
        a.branch([a.equal('ptr', '%kwnames', 'null'),
                  a.new(f'icmp ule i64 {further}, {unread}')],
                 'types', 'slow')
        arguments = '%args'
    a.put('types:')
    objects = []
    for k in range(count):
        objects.append(a.load('ptr', arguments, 8 * k))
    _check_arrays(a, objects, shapes, memory, kinds)
    a.put('values:')
    data = []
    conditions = []
    blocks = []
    for k, thing in enumerate(objects):
        kind = kinds[k] if kinds else REQUIRED
        # The number of a float lies where an array has the address of its numbers.
        if kind == NUMBER:
            data.append(a.new(f'getelementptr i8, ptr {thing}, i64 {DATA}'))
            number = a.load('double', thing, DATA)
            conditions.append(a.new(f'fcmp oge double {number}, 0.0'))
        else:
            data.append(a.load('ptr', thing, DATA))
        if kind != FIXED:
            blocks.append((data[k], math.prod(shapes[k]), limits[k]))
    a.branch([*conditions, *a.finite(blocks)], 'ready', 'slow')
    a.put('ready:')
    # The kernel's pointers: arguments, defaults of the table, result.
    for k in range(n_defaults):
        data.append(a.load('ptr', '%table', 8 * (len(TABLE) + k)))
    for k, pointer in enumerate(data):
        slot = a.new(f'getelementptr ptr, ptr %pointers, i64 {k}')
        a.put(f'  store ptr {pointer}, ptr {slot}')
    result = a.new(f'getelementptr ptr, ptr %pointers, i64 {slots - 1}')
    if not shape:
        a.put(f'  store ptr %scalar, ptr {result}',
              f'  call void {a.word("KERNEL")}(ptr %pointers)')
        _return_float(a, '%scalar')
        a.slow('%kwnames')
        return '\n'.join(a.lines)
    # Of two results in turn, one that the caller has dropped; else a new array.
    _reuse_result(a, 'first', shape, 'second')
    a.put('second:')
    _reuse_result(a, 'second', shape, 'make')
    _new_result(a, shape)
    a.put('run:',
          '  %out = phi ptr [%first.array, %first.taken], [%second.array, '
          '%second.taken], [%made.array, %keep]')
    returned = a.load('ptr', '%out', DATA)
    numbers = returned if memory is None else '%numbers'
    a.put(f'  store ptr {numbers}, ptr {result}',
          f'  call void {a.word("KERNEL")}(ptr %pointers)')
    a.branch(a.finite([(numbers, total, math.inf)]), 'good', 'discard')
    a.put('good:')
    if memory is not None:
        _copy(a, numbers, 0, returned, size)
        _copy(a, numbers, size, data[memory], total - size)
    a.put('  ret ptr %out', 'discard:')  # the fallback explains the error
    a.put(f'  call void {a.word("RELEASE")}(ptr %out)', '  br label %slow')
    a.slow('%kwnames')
    return '\n'.join(a.lines)


def _check_arrays(a: Assembly, objects: Sequence[str], shapes: Sequence[Shape],
                  memory: int | None, kinds: Sequence[str]) -> None:
    """Branch to `values` if the arguments are what is expected, else to `slow`."""
    arrays = []
    floats = []
    for k, thing in enumerate(objects):
        kind = kinds[k] if kinds else REQUIRED
        if kind == NUMBER:
            floats.append(thing)
        elif kind != FIXED:
            arrays.append((k, thing))
    ndarray = a.word('NDARRAY')
    float64 = a.word('FLOAT64')
    # Only an ndarray has the fields that are read next.
    conditions = []
    for _, array in arrays:
        conditions.append(a.equal('ptr', a.load('ptr', array, TYPE), ndarray))
    for number in floats:
        conditions.append(a.equal('ptr', a.load('ptr', number, TYPE), a.word('FLOAT')))
    a.branch(conditions, 'layout', 'slow')
    a.put('layout:')
    conditions = []
    for k, array in arrays:
        flags = READABLE | WRITEABLE if k == memory else READABLE
        conditions += [a.equal('i32', a.load('i32', array, NDIM), len(shapes[k])),
                       a.equal('ptr', a.load('ptr', array, DTYPE), float64),
                       a.flags(array, flags)]
    a.branch(conditions, 'lengths', 'slow')
    # Only an array with as many axes has these lengths.
    a.put('lengths:')
    conditions = []
    for k, array in arrays:
        actual_lengths = a.load('ptr', array, SHAPE)
        for axis, length in enumerate(shapes[k]):
            actual = a.load('i64', actual_lengths, 8 * axis)
            conditions.append(a.equal('i64', actual, length))
    a.branch(conditions, 'values', 'slow')


def _sort_arguments(a: Assembly, kinds: Sequence[str], place: int) -> None:
    """
    Store the arguments of a call in the order of the kernel, in `given`.

    From the byte `place` on the table has the objects that stand for arguments which are
    left out, and then the names of the arguments.
    """
    count = len(kinds)
    required = kinds.count(REQUIRED)
    positional = required + kinds.count(OPTIONAL)
    few = a.new(f'icmp uge i64 %nargs, {required}')
    many = a.new(f'icmp ule i64 %nargs, {positional}')
    a.branch([few, many], 'positions', 'slow')
    a.put('positions:')
    none = a.word('NONE')
    for k in range(count):
        value = a.load('ptr', '%table', place + 8 * k)
        if k < positional:
            is_given = a.new(f'icmp ugt i64 %nargs, {k}')
            at = a.new(f'select i1 {is_given}, i64 {k}, i64 0')
            argument = a.load('ptr', a.new(f'getelementptr ptr, ptr %args, i64 {at}'))
            stated = a.new(f'icmp ne ptr {argument}, {none}')
            used = a.new(f'and i1 {is_given}, {stated}')
            if k < required:
                used = is_given
            value = a.new(f'select i1 {used}, ptr {argument}, ptr {value}')
        slot = a.new(f'getelementptr ptr, ptr %given, i64 {k}')
        a.put(f'  store ptr {value}, ptr {slot}')
    named = a.new('icmp ne ptr %kwnames, null')
    a.put(f'  br i1 {named}, label %names, label %sorted')

    # Keywords, one after the other: names are interned, so that their addresses differ.
    a.put('names:')
    total = a.load('i64', '%kwnames', LENGTH)
    without = a.equal('i64', total, 0)
    a.put(f'  br i1 {without}, label %sorted, label %name', 'name:',
          '  %i = phi i64 [0, %names], [%i.next, %named]')
    items = a.new(f'getelementptr i8, ptr %kwnames, i64 {ITEMS}')
    name = a.load('ptr', a.new(f'getelementptr ptr, ptr {items}, i64 %i'))
    behind = a.new('add i64 %nargs, %i')
    argument = a.load('ptr', a.new(f'getelementptr ptr, ptr %args, i64 {behind}'))
    number = '-1'
    for k in range(required, count):
        if kinds[k] != FIXED:
            known = a.load('ptr', '%table', place + 8 * (count + k))
            same = a.equal('ptr', name, known)
            number = a.new(f'select i1 {same}, i64 {k}, i64 {number}')
    # An argument without this name, or one that a position has, too.
    a.branch([a.new(f'icmp sge i64 {number}, %nargs')], 'known', 'slow')
    a.put('known:')
    slot = a.new(f'getelementptr ptr, ptr %given, i64 {number}')
    left_out = a.equal('ptr', argument, none)
    kept = a.load('ptr', slot)
    value = a.new(f'select i1 {left_out}, ptr {kept}, ptr {argument}')
    a.put(f'  store ptr {value}, ptr {slot}', '  br label %named', 'named:',
          '  %i.next = add i64 %i, 1')
    ended = a.equal('i64', '%i.next', total)
    a.put(f'  br i1 {ended}, label %sorted, label %name', 'sorted:')
    # An argument that the call needs and lacks, or whose default is not an object.
    conditions = []
    for k in range(count):
        value = a.load('ptr', a.new(f'getelementptr ptr, ptr %given, i64 {k}'))
        conditions.append(a.new(f'icmp ne ptr {value}, null'))
    a.branch(conditions, 'types', 'slow')


def bound_code(sizes: Sequence[int], limits: Sequence[float], n_parameters: int,
               shape: Shape) -> str:
    """
    Return the LLVM IR of `bound`.

    The kernel gets pointers to the arguments, the parameters and the result.

    Parameters
    ----------
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
    data = []
    for k in range(len(sizes)):
        data.append(a.load('ptr', '%pointers', 8 * k))
    # Only the values can be wrong: the arrays are those of the table.
    no_arguments = a.equal('i64', '%nargs', 0)
    a.branch([no_arguments, *a.finite(list(zip(data, sizes, limits)))], 'run', 'slow')
    a.put('run:')
    a.put(f'  call void {a.word("KERNEL")}(ptr %pointers)')
    # The result stands last, behind the parameters.
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

    The first slot of a method's `self` holds an array of table addresses. Method k calls
    the function that table k names and passes it the table and the object. An object
    without tables was not initialized; the table given to `refuse_by` serves it.
    """
    a = Assembly()
    a.put('@refusal = internal global ptr null', 'define void @refuse_by(ptr %table) {',
          '  store ptr %table, ptr @refusal', '  ret void', '}')
    for place in range(count):
        a.put(f'define ptr @method{place}(ptr %self, ptr %args, i64 %nargs) {{')
        # A method's code jumps to that of the object's table, or of the refusal before
        # it exists.
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

    `refer` calls the fallback, for kernels without entry points. `unmade` serves the
    first call of a method: its fallback takes the object and returns the table to use.
    """
    # A method that was not used yet: the table's entry asks Python for the compiled
    # one.
    a = Assembly()
    a.put('define ptr @refer(ptr %self, ptr %args, i64 %nargs) {', *TABLE_OF_SELF,
          '  br label %slow')
    a.slow('null')
    a.put('define ptr @unmade(ptr %self, ptr %args, i64 %nargs, ptr %owner) {',
          *TABLE_OF_SELF,
          '  %given = alloca ptr', '  store ptr %owner, ptr %given')
    a.put(f'  %made = call ptr {a.word("VECTORCALL")}(ptr {a.word("FALLBACK")}, ptr '
          '%given, i64 1, ptr null)', '  %failed = icmp eq ptr %made, null',
          '  br i1 %failed, label %failure, label %go', 'failure:', '  ret ptr null',
          'go:')
    answer = a.new(f'call ptr {_code_word(a, "%made")}(ptr %made, ptr %args, i64 '
                   '%nargs, ptr %owner)')
    a.put(f'  call void {a.word("RELEASE")}(ptr %made)', f'  ret ptr {answer}', '}')
    return '\n'.join(a.lines)


def _code_word(a: Assembly, table: str) -> str:
    """Load the function address of a table."""
    return a.load('ptr', a.load('ptr', table, DATA), 8 * TABLE.index('CODE'))
