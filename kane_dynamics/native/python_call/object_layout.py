"""
Memory layout of CPython and numpy objects, and LLVM IR that reads it.

`entry.supported` must verify every assumption of this module on the running interpreter.
"""

from collections.abc import Sequence
import math

from kane_dynamics.native.backends.real_types import constant_vector, literal, overflow_scale

# 64-bit words of the table that a function receives as `self`, in order. Pointers follow: for
# `entry`, those of the default arguments; for `bound`, those of all arguments and of the result.
# CODE is the function to which a method forwards its call.
TABLE = ('CODE', 'FALLBACK', 'VECTORCALL', 'NDARRAY', 'FLOAT64', 'NEW_ARRAY', 'NEW_FLOAT',
         'RELEASE', 'RESULT_SHAPE', 'RING', 'RESULT')

# Byte offsets of the fields of a CPython object and of an ndarray.
COUNT, TYPE, DATA, NDIM, SHAPE, DTYPE, FLAGS, WEAKREFS = 0, 8, 16, 24, 32, 56, 64, 72
SLOT = 16  # the first slot of a Python object
READABLE = 0x101  # C_CONTIGUOUS, ALIGNED
FRESH = READABLE | 0x404  # OWNDATA, WRITEABLE
TABLE_OF_SELF = (f'  %table.at = getelementptr i8, ptr %self, i64 {DATA}',
                 '  %table = load ptr, ptr %table.at')
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
        """Increment a reference count: 32 bits, since newer CPythons use the rest for flags."""
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
                conditions.append(self.new(f'call i1 @all_finite(ptr {pointer}, i64 {size}, '
                                           f'double {scale})'))

        # Short blocks: sums by width of x - x, which is NaN for NaN and infinity. Numbers beyond
        # a limit become infinite by a factor.
        totals: dict[int, str] = {}
        for pointer, size, limit in blocks:
            if size > LOOP_SIZE:
                continue
            width = next(w for w in (8, 4, 2, 1) if w <= size)
            vector = f'<{width} x double>'
            for place in [*range(0, size - width, width), size - width]:  # the last may overlap
                x = self.load(vector, pointer, 8 * place)
                if math.isfinite(limit):
                    scale = literal(overflow_scale(limit))
                    factor = constant_vector('double', scale, width)
                    x = self.new(f'fmul {vector} {x}, {factor}')
                zero = self.new(f'fsub {vector} {x}, {x}')
                if width in totals:
                    zero = self.new(f'fadd {vector} {totals[width]}, {zero}')
                totals[width] = zero
        conditions += [self._all_ordered(total, width) for width, total in totals.items()]
        return conditions

    def _all_ordered(self, total: str, width: int) -> str:
        lanes = self.new(f'fcmp uno <{width} x double> {total}, zeroinitializer')
        return self.equal(f'i{width}', self.new(f'bitcast <{width} x i1> {lanes} to i{width}'), 0)

    def slow(self, keywords: str) -> None:
        """Emit the call of the fallback and the end of the function."""
        self.put('slow:')
        answer = self.new(f'call ptr {self.word("VECTORCALL")}(ptr {self.word("FALLBACK")}, '
                          f'ptr %args, i64 %nargs, ptr {keywords})')
        self.put(f'  ret ptr {answer}', '}')
