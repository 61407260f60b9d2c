"""
Assembly that reads objects of CPython and numpy, and the table that a function carries.

Whoever changes what stands here sees to it that `entry.supported` proves it on the interpreter.
"""

from collections.abc import Sequence
import math

from kane_dynamics.native.backends.llvm_math import literal, scale

# 64-bit words of the table that a function carries as its `self`, in order; pointers follow: for
# an entry those of the kernel's arguments that no call passes, for a bound call those of all
# arguments and of the result. CODE is for methods: the function that a call is forwarded to.
TABLE = ('CODE', 'FALLBACK', 'VECTORCALL', 'NDARRAY', 'FLOAT64', 'NEW_ARRAY', 'NEW_FLOAT',
         'RELEASE', 'RESULT_SHAPE', 'RING', 'RESULT')

# Where CPython and numpy keep things: byte offsets in an object and in an ndarray.
COUNT, TYPE, DATA, NDIM, SHAPE, DTYPE, FLAGS, WEAKREFS = 0, 8, 16, 24, 32, 56, 64, 72
SLOT = 16  # the first slot of an object of Python
READABLE = 0x101  # C_CONTIGUOUS, ALIGNED
FRESH = READABLE | 0x404  # OWNDATA, WRITEABLE
TABLE_OF_SELF = (f'  %table.at = getelementptr i8, ptr %self, i64 {DATA}',
                 '  %table = load ptr, ptr %table.at')
LONG = 256  # entries from which on a block is looked through by a loop
ALL_FINITE = """
; Whether size entries, 8 or more, are finite when they are multiplied by the scale.
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
    """Writes instructions with fresh names; a block's label is the caller's."""

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
        """Return what stands `offset` bytes past a pointer."""
        at = self.new(f'getelementptr i8, ptr {base}, i64 {offset}')
        return self.new(f'load {kind}, ptr {at}, align {4 if kind == "i32" else 8}')

    def word(self, name: str) -> str:
        """Return a word of the table."""
        return self.load('ptr', '%table', 8 * TABLE.index(name))

    def equal(self, kind: str, a: str, b: str | int) -> str:
        """Return whether two are the same."""
        return self.new(f'icmp eq {kind} {a}, {b}')

    def flags(self, array: str, wanted: int) -> str:
        """Return whether an array has all these flags."""
        flags = self.load('i32', array, FLAGS)
        return self.equal('i32', self.new(f'and i32 {flags}, {wanted}'), wanted)

    def branch(self, conditions: Sequence[str], then: str, otherwise: str) -> None:
        """Go to `then` where all conditions hold."""
        both = conditions[0]
        for condition in conditions[1:]:
            both = self.new(f'and i1 {both}, {condition}')
        self.put(f'  br i1 {both}, label %{then}, label %{otherwise}')

    def add_to_count(self, thing: str) -> None:
        """Take a reference: 32 bits, since newer CPythons keep flags in the other half."""
        count = self.load('i32', thing, COUNT)
        self.put(f'  store i32 {self.new(f"add i32 {count}, 1")}, ptr {thing}, align 8')

    def finite(self, blocks: Sequence[tuple[str, int, float]]) -> list[str]:
        """
        Return conditions that together say that blocks are finite.

        A block is (pointer, size, most): none of its entries may be larger than `most` either.
        """
        totals: dict[int, str] = {}  # by width, of x - x, which is NaN for NaN and infinity
        looped = [self.new(f'call i1 @all_finite(ptr {pointer}, i64 {size}, double '
                           f'{literal(scale(most))})')
                  for pointer, size, most in blocks if size > LONG]
        for pointer, size, most in blocks:
            if size > LONG:
                continue
            width = next(w for w in (8, 4, 2, 1) if w <= size)
            vector = f'<{width} x double>'
            for place in [*range(0, size - width, width), size - width]:  # the last may overlap
                x = self.load(vector, pointer, 8 * place)
                if math.isfinite(most):
                    x = self.new(f'fmul {vector} {x}, splat (double {literal(scale(most))})')
                zero = self.new(f'fsub {vector} {x}, {x}')
                totals[width] = (self.new(f'fadd {vector} {totals[width]}, {zero}')
                                 if width in totals else zero)
        return looped + [self._all_ordered(total, width) for width, total in totals.items()]

    def _all_ordered(self, total: str, width: int) -> str:
        lanes = self.new(f'fcmp uno <{width} x double> {total}, zeroinitializer')
        return self.equal(f'i{width}', self.new(f'bitcast <{width} x i1> {lanes} to i{width}'), 0)

    def slow(self, keywords: str) -> None:
        """Write the road to the fallback, and the end of the function."""
        self.put('slow:')
        answer = self.new(f'call ptr {self.word("VECTORCALL")}(ptr {self.word("FALLBACK")}, '
                          f'ptr %args, i64 %nargs, ptr {keywords})')
        self.put(f'  ret ptr {answer}', '}')
