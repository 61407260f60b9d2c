"""
Several states at once: the assembly of a program whose scalars are vectors, a state in each lane.

A batch lies in memory state after state. A lane kernel, ``void kernel(double *rows[][W], void
*bad)``, is given the address of every lane's row of every argument and of the result. It loads
rows and makes of them, by transposition in registers, a vector for each entry; results go back
the same way. `bad` collects bits that are set where an argument, or a result, is not finite.
"""

from functools import cache
import math

from kane_dynamics.native.backends.llvm_math import largest, scale, Vector, vector_type
from kane_dynamics.native.backends.llvm_scalar import Function, with_callees
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.program import Program, size_of

AHEAD = 4096  # bytes between what is worked on and what is asked of memory: DRAM is far away
LONG_ROW = 64  # entries of a row so long that the processor itself sees where it leads
LINE = 8  # doubles that memory delivers together


@cache
def width() -> int:
    """Return how many doubles this processor takes at once."""
    features = llvm.features()
    return 8 if features.get('avx512f') else 4 if features.get('avx2') else 2


def transposed(v: Vector, rows: list[str]) -> list[str]:
    """Return the columns of a square tile; ever smaller blocks of it change places."""
    return exchanged(v, rows, v.width // 2)


def exchanged(v: Vector, rows: list[str], distance: int) -> list[str]:
    """Let blocks of this size, and then ever smaller ones, change places across the diagonal."""
    while distance:
        kept = [lane for lane in range(v.width) if not lane & distance]
        low = sorted([*kept, *(lane + v.width for lane in kept)], key=lambda k: (
            k % v.width + (distance if k >= v.width else 0)))
        high = [place + distance for place in low]
        rows = [v.shuffle(rows[i], rows[i | distance], low) if not i & distance
                else v.shuffle(rows[i ^ distance], rows[i], high) for i in range(v.width)]
        distance //= 2
    return rows


class RowFunction(Function):
    """
    The assembly of a program over rows of a batch.

    Parameters
    ----------
    program : Program
    symbol : str
        Name of the function.
    lanes : int
    shared : str
        The argument that all states have in common.

    """

    in_place = ('output',)

    def __init__(self, program: Program, symbol: str, lanes: int, shared: str) -> None:
        """Write it; `lines` is the result."""
        self.shared = shared
        super().__init__(program, symbol, lanes)

    def _head(self, symbol: str) -> str:
        return f'define void @{symbol}(ptr %args, ptr %bad) {{'

    def _load_inputs(self, schedule: list[Expr]) -> None:
        """Read every input before anything is written: results may overlay arguments."""
        self._vector = Vector(self.lines, 'row', self.lanes)
        used = {node.args: node.index for node in schedule if node.op == 'input'}
        bits: list[str] = []
        for slot, (name, shape) in enumerate(self.program.inputs):
            rows, size = self._rows(slot), size_of(shape)
            needed = [k for k in range(size) if (name, k) in used]
            if name == self.shared:
                columns = {k: self._splat(rows[0], k) for k in needed}
            else:
                columns = dict(enumerate(self._columns(rows, size, largest(name), bits)))
            self.names |= {used[name, k]: columns[k] for k in needed}
        self._note(0, bits)

    def _store_outputs(self) -> None:
        v, outputs = self._vector, self.program.outputs
        rows = self._rows(len(self.program.inputs))
        computed = {x.index: x for x in outputs if isinstance(x, Expr)}
        self._note(1, [self._oddity(self.value(x)) for x in computed.values()])
        self._ask(rows, len(outputs), writing=True)
        for c in range(0, len(outputs), v.width):
            tile = [self.value(x) for x in outputs[c:c + v.width]]
            mask = _mask(v.width, len(tile))
            tile += ['zeroinitializer'] * (v.width - len(tile))
            for row, vector in zip(rows, transposed(v, tile)):
                at = v.new(f'getelementptr double, ptr {row}, i64 {c}')
                v.lines.append(
                    f'  call void @llvm.masked.store.v{v.width}f64.p0({v.type} {vector}, '
                    f'ptr {at}, i32 8, {mask})')
        self.lines += ['  ret void', '}']

    def _rows(self, slot: int) -> list[str]:
        """Load the addresses of the lanes' rows of an argument or of the result."""
        v, rows = self._vector, []
        for lane in range(v.width):
            at = v.new(f'getelementptr ptr, ptr %args, i64 {slot * v.width + lane}')
            rows.append(v.new(f'load ptr, ptr {at}'))
        return rows

    def _splat(self, row: str, k: int) -> str:
        """Load one entry of what all states share into every lane."""
        v = self._vector
        at = v.new(f'getelementptr double, ptr {row}, i64 {k}')
        one = v.new(f'insertelement {v.type} poison, double '
                    + v.new(f'load double, ptr {at}') + ', i32 0')
        return v.shuffle(one, 'poison', [0] * v.width)

    def _columns(self, rows: list[str], size: int, most: float, bits: list[str]) -> list[str]:
        """Load rows of `size` entries; return a vector for each entry, add the rows' oddities."""
        v, columns = self._vector, []
        self._ask(rows, size, writing=False)
        half = v.width // 2
        for c in range(0, size, v.width):  # the largest blocks change places while they load
            tile = [self._joined(rows[i], rows[i + half], place, size)
                    for place in (c, c + half) for i in range(half)]
            bits += [self._oddity(row, most) for row in tile if row != 'zeroinitializer']
            columns += exchanged(v, tile, half // 2)
        return columns[:size]

    def _joined(self, first: str, second: str, place: int, size: int) -> str:
        """Load half a vector from each of two rows, from a place on; zeros past their end."""
        v, half = self._vector, self.lanes // 2
        if place >= size:
            return 'zeroinitializer'
        kind, halves = vector_type(half), []
        for row in (first, second):
            at = v.new(f'getelementptr double, ptr {row}, i64 {place}')
            halves.append(v.new(
                f'load {kind}, ptr {at}, align 8' if half <= size - place else
                f'call {kind} @llvm.masked.load.v{half}f64.p0(ptr {at}, i32 8, '
                f'{_mask(half, size - place)}, {kind} zeroinitializer)'))
        if half == 1:
            one = v.new(f'insertelement {v.type} poison, double {halves[0]}, i32 0')
            return v.new(f'insertelement {v.type} {one}, double {halves[1]}, i32 1')
        places = ', '.join(f'i32 {k}' for k in range(self.lanes))
        return v.new(f'shufflevector {kind} {halves[0]}, {kind} {halves[1]}, '
                     f'<{self.lanes} x i32> <{places}>')

    def _oddity(self, x: str, most: float = math.inf) -> str:
        """Return the bits of x - x: none where x is finite, not a number where it is not."""
        if math.isfinite(most):  # what is larger overflows
            x = self._vector.op('fmul', x, self._vector.const(scale(most)))
        return self._vector.bits(self._vector.op('fsub', x, x))

    def _note(self, place: int, bits: list[str]) -> None:
        """Add bits to those of the arguments (place 0) or of the result (1)."""
        v = self._vector
        at = v.new(f'getelementptr {v.integer}, ptr %bad, i64 {place}')
        bits = [*bits, v.new(f'load {v.integer}, ptr {at}')]
        while len(bits) > 1:  # in pairs: a chain would be as long as the whole kernel
            bits = [v.new(f'or {v.integer} {a}, {b}') for a, b in zip(bits[::2], bits[1::2])] + (
                bits[-1:] if len(bits) % 2 else [])
        v.lines.append(f'  store {v.integer} {bits[0]}, ptr {at}')

    def _ask(self, rows: list[str], size: int, writing: bool) -> None:
        """Ask memory for the rows of a block that comes later."""
        v = self._vector
        if size > LONG_ROW:
            return
        block = v.width * size
        distance = -(-AHEAD // (8 * block)) * block
        for row in rows:
            for k in range(0, size, LINE):
                at = v.new(f'getelementptr double, ptr {row}, i64 {distance + k}')
                v.lines.append(f'  call void @llvm.prefetch.p0(ptr {at}, i32 {int(writing)}, '
                               'i32 3, i32 1)')


def _mask(lanes: int, live: int) -> str:
    """Return the first `live` lanes, for a masked instruction."""
    bits = ', '.join(f'i1 {int(lane < live)}' for lane in range(lanes))
    return f'<{lanes} x i1> <{bits}>'


def lane_text(program: Program, symbol: str, lanes: int) -> str:
    """Return the assembly of a lane kernel; all states share the program's last argument."""
    main = RowFunction(program, symbol, lanes, program.inputs[-1][0])
    half = max(lanes // 2, 2)
    v, part = vector_type(lanes), vector_type(half)
    return with_callees(main, [
        'declare void @llvm.prefetch.p0(ptr, i32, i32, i32)',
        f'declare {part} @llvm.masked.load.v{half}f64.p0(ptr, i32, <{half} x i1>, {part})',
        f'declare void @llvm.masked.store.v{lanes}f64.p0({v}, ptr, i32, <{lanes} x i1>)'])
