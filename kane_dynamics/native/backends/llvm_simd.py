"""
Generate SIMD LLVM IR that evaluates a program for several states, one per lane.

A batch is stored row by row, one state per row. A lane kernel, ``void kernel(double
*rows[][W], void *bad)``, receives the address of each lane's row of every argument and
of the result. It loads the rows, transposes them in registers to one vector per entry,
and stores the results the same way. `bad` accumulates bits that are set where an
argument or a result is not finite: those of a sum that is +0 or NaN.
"""

from functools import cache
import math

from kane_dynamics.native.backends.llvm_math import (DECLARED_PERMUTE, overflow_scale,
                                                     size_limit, transpose, Vector,
                                                     vector_type)
from kane_dynamics.native.backends.llvm_scalar import (ELEMENTARY, Function, with_callees)
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.program import Program

# Distance between the processed rows and the prefetched ones, of arguments and results.
READ_AHEAD, WRITE_AHEAD = 2048, 4096  # bytes
MAX_PREFETCHED_ROW = 64  # entries; the hardware prefetcher handles longer rows
CACHE_LINE = 8  # doubles
AVX512 = 8  # lanes


@cache
def width() -> int:
    """Return the number of doubles in this processor's widest SIMD register."""
    features = llvm.features()
    if features.get('avx512f'):
        return AVX512
    return 4 if features.get('avx2') else 2


class RowFunction(Function):
    """
    LLVM IR function of a program over the rows of a batch.

    Parameters
    ----------
    program : Program
    symbol : str
        Name of the function.
    lanes : int
    shared : str
        Name of the argument that all states share.

    """

    in_place = ('output',)
    pointers = 'ptr %args, ptr %bad'

    def __init__(self, program: Program, symbol: str, lanes: int, shared: str) -> None:
        """Generate the function; `lines` holds the IR."""
        self.shared = shared
        self.permutes = lanes == AVX512 and llvm.features().get('avx512f', False)
        super().__init__(program, symbol, lanes, abreast=1)

    def _load_inputs(self, schedule: list[Expr]) -> None:
        """Load all inputs first: results may overlap arguments in memory."""
        self._vector = v = Vector(self.lines, 'row', self.lanes)
        # An argument's rows are loaded for all of its entries; only entries that the
        # program reads get a name.
        used = {}  # indices of the nodes of entries that the program needs
        for node in schedule:
            if node.op == 'input':
                used[node.args] = node.index
        totals: list[str] = []
        for slot, (name, shape) in enumerate(self.program.inputs):
            rows = self._rows(slot)
            size = math.prod(shape)
            is_shared = name == self.shared
            # The shared argument is one row for all states, so that each entry is copied
            # to all lanes.
            columns = []
            entries = set()
            if not is_shared:
                columns = self._columns(rows, size)
                totals += self._totals(columns, size_limit(name))
            for k in range(size):
                if (name, k) not in used:
                    continue
                index = used[name, k]
                entries.add(index)
                if is_shared:
                    at = v.new(f'getelementptr double, ptr {rows[0]}, i64 {k}')
                    entry = v.new(f'load double, ptr {at}')
                    one = v.new(f'insertelement {v.type} poison, double {entry}, i32 0')
                    self.names[index] = v.shuffle(one, 'poison', [0] * v.width)
                else:
                    self.names[index] = columns[k]
            # Sines and cosines of positions, before the columns of speeds need registers.
            self._functions([node for node in schedule if node.op in ELEMENTARY
                             and node.args[0].index in entries])
        self._add_flags(0, totals)

    def _store_outputs(self) -> None:
        v = self._vector
        outputs = self.program.outputs
        rows = self._rows(len(self.program.inputs))
        computed: dict[int, str] = {}  # values of each node that is a result
        for x in outputs:
            if isinstance(x, Expr):
                computed[x.index] = self.value(x)
        # In order of creation, so that the sum waits only for the last one.
        results = [computed[index] for index in sorted(computed)]
        self._add_flags(1, self._totals(results, math.inf))
        self._prefetch(rows, len(outputs), writing=True)
        # Tiles of as many entries as lanes: their transpose holds a part of each lane's
        # row.
        for c in range(0, len(outputs), v.width):
            tile = list(map(self.value, outputs[c:c + v.width]))
            mask = _mask(v.width, len(tile))
            tile += ['zeroinitializer'] * (v.width - len(tile))
            for row, vector in zip(rows, transpose(v, tile)):
                at = v.new(f'getelementptr double, ptr {row}, i64 {c}')
                v.lines.append(
                    f'  call void @llvm.masked.store.v{v.width}f64.p0({v.type} '
                    f'{vector}, ptr {at}, i32 8, {mask})')
        self.lines += ['  ret void', '}']

    def _rows(self, slot: int) -> list[str]:
        """Load the addresses of all lanes' rows of an argument or of the result."""
        v = self._vector
        rows = []
        for lane in range(v.width):
            at = v.new(f'getelementptr ptr, ptr %args, i64 {slot * v.width + lane}')
            rows.append(v.new(f'load ptr, ptr {at}'))
        return rows

    def _columns(self, rows: list[str], size: int) -> list[str]:
        """Load rows of `size` entries as a vector per entry."""
        v = self._vector
        columns: list[str] = []
        self._prefetch(rows, size, writing=False)
        half = v.width // 2
        for c in range(0, size, v.width):
            # Loading half rows exchanges the largest blocks of the transpose already.
            # A tile of `width` rows: half a row of two states in each vector.
            tile = []
            for place in (c, c + half):
                for i in range(half):
                    tile.append(self._load_halves(rows[i], rows[i + half], place, size))
            columns += transpose(v, tile, half // 2)
        return columns[:size]

    def _load_halves(self, first: str, second: str, place: int, size: int) -> str:
        """Load half a vector from either of two rows; zeros past their end."""
        v = self._vector
        half = self.lanes // 2
        remaining = size - place
        if remaining <= 0:
            return 'zeroinitializer'
        kind = vector_type(half)
        halves = []
        for row in (first, second):
            at = v.new(f'getelementptr double, ptr {row}, i64 {place}')
            if half <= remaining:
                load = f'load {kind}, ptr {at}, align 8'
            else:
                # The end of the row, without reading past it.
                load = (f'call {kind} @llvm.masked.load.v{half}f64.p0(ptr {at}, i32 8, '
                        f'{_mask(half, remaining)}, {kind} zeroinitializer)')
            halves.append(v.new(load))
        if half == 1:
            one = v.new(f'insertelement {v.type} poison, double {halves[0]}, i32 0')
            return v.new(f'insertelement {v.type} {one}, double {halves[1]}, i32 1')
        # Both halves in one vector.
        places = ', '.join(map('i32 {}'.format, range(self.lanes)))
        return v.new(f'shufflevector {kind} {halves[0]}, {kind} {halves[1]}, '
                     f'<{self.lanes} x i32> <{places}>')

    def _totals(self, values: list[str], most: float) -> list[str]:
        """
        Return vectors that are not finite where a value is not, or is larger than `most`.

        One instruction a value, an addition, of which these programs have fewer than
        products: a sum of finite numbers is finite, but for numbers near the largest one.
        Squares of values with a limit are added instead, and overflow where they reach its
        square, so that several values near the limit may be flagged, too.
        """
        v = self._vector
        if not values:
            return []
        if math.isfinite(most):
            square = v.const(0.0)
            for x in values:
                square = v.fma(x, x, square)
            return [v.op('fmul', square, v.const(overflow_scale(most * most)))]
        # Two sums, which the processor adds at the same time.
        sums = values[:2]
        for k, x in enumerate(values[2:]):
            sums[k % 2] = v.op('fadd', sums[k % 2], x)
        return sums

    def _add_flags(self, place: int, totals: list[str]) -> None:
        """
        Make flags NaN where one of the vectors is not finite; else they stay 0.

        The flags of arguments are at place 0, those of the result at 1.
        """
        if not totals:
            return
        v = self._vector
        total = totals[0]
        for x in totals[1:]:
            total = v.op('fadd', total, x)
        # 0 s + f is +0 for flags f = +0 and a finite s, else NaN.
        at = v.new(f'getelementptr {v.type}, ptr %bad, i64 {place}')
        flags = v.fma(total, v.const(0.0), v.new(f'load {v.type}, ptr {at}'))
        v.lines.append(f'  store {v.type} {flags}, ptr {at}')

    def _prefetch(self, rows: list[str], size: int, writing: bool) -> None:
        """Prefetch the rows of a later block."""
        v = self._vector
        if size > MAX_PREFETCHED_ROW or not size:
            return
        block = v.width * size
        # As many whole blocks ahead.
        ahead = WRITE_AHEAD if writing else READ_AHEAD
        distance = -(-ahead // (8 * block)) * block
        for row in rows:
            for k in range(0, size, CACHE_LINE):
                at = v.new(f'getelementptr double, ptr {row}, i64 {distance + k}')
                v.lines.append(f'  call void @llvm.prefetch.p0(ptr {at}, i32 '
                               f'{int(writing)}, i32 3, i32 1)')


def _mask(lanes: int, live: int) -> str:
    """Return a mask that enables the first `live` lanes."""
    bits = ['i1 1'] * live + ['i1 0'] * (lanes - live)
    return f'<{lanes} x i1> <{", ".join(bits)}>'


def lane_text(program: Program, symbol: str, lanes: int) -> str:
    """Return the LLVM IR of a lane kernel; all states share the last argument."""
    main = RowFunction(program, symbol, lanes, program.inputs[-1][0])
    half = max(lanes // 2, 2)
    # Rows are loaded in halves, and stored whole.
    v = vector_type(lanes)
    part = vector_type(half)
    half_mask = f'<{half} x i1>'
    mask = f'<{lanes} x i1>'
    return with_callees(main, [
        'declare void @llvm.prefetch.p0(ptr, i32, i32, i32)', DECLARED_PERMUTE,
        f'declare {part} @llvm.masked.load.v{half}f64.p0(ptr, i32, {half_mask}, {part})',
        f'declare void @llvm.masked.store.v{lanes}f64.p0({v}, ptr, i32, {mask})'])
