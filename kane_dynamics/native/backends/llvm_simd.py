"""
Generate SIMD LLVM IR that evaluates a program for several states, one per lane.

A batch is stored row by row, one state per row. A lane kernel, ``void kernel(double
*rows[][W], void *bad)``, receives the address of each lane's row of every argument and
of the result. It loads the rows, transposes them in registers to one vector per entry,
and stores the results the same way. `bad` accumulates bits that are set where an
argument or a result is not finite.
"""

from functools import cache

from kane_dynamics.native.backends.llvm_math import (exchange_blocks, size_limit,
                                                     transpose, Vector, vector_type)
from kane_dynamics.native.backends.llvm_scalar import Function, with_callees
from kane_dynamics.native.machine_code import llvm
from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.program import Program, size_of

PREFETCH_BYTES = 4096  # distance between the processed rows and the prefetched ones
MAX_PREFETCHED_ROW = 64  # entries; the hardware prefetcher handles longer rows
CACHE_LINE = 8  # doubles


@cache
def width() -> int:
    """Return the number of doubles in this processor's widest SIMD register."""
    features = llvm.features()
    if features.get('avx512f'):
        return 8
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

    def __init__(self, program: Program, symbol: str, lanes: int, shared: str) -> None:
        """Generate the function; `lines` holds the IR."""
        self.shared = shared
        super().__init__(program, symbol, lanes)

    def _head(self, symbol: str) -> str:
        return f'define void @{symbol}(ptr %args, ptr %bad) {{'

    def _load_inputs(self, schedule: list[Expr]) -> None:
        """Load all inputs first: results may overlap arguments in memory."""
        self._vector = Vector(self.lines, 'row', self.lanes)
        # An argument's rows are loaded for all of its entries; only entries that the
        # program reads get a name.
        used = {}  # indices of the nodes of entries that the program needs
        for node in schedule:
            if node.op == 'input':
                used[node.args] = node.index
        bits: list[str] = []
        for slot, (name, shape) in enumerate(self.program.inputs):
            rows = self._rows(slot)
            size = size_of(shape)
            is_shared = name == self.shared
            # The shared argument is one row for all states, so that each entry is copied
            # to all lanes.
            columns = []
            if not is_shared:
                columns = self._columns(rows, size, size_limit(name), bits)
            for k in range(size):
                if (name, k) in used:
                    entry = self._splat(rows[0], k) if is_shared else columns[k]
                    self.names[used[name, k]] = entry
        self._add_flags(0, bits)

    def _store_outputs(self) -> None:
        v = self._vector
        outputs = self.program.outputs
        rows = self._rows(len(self.program.inputs))
        computed: dict[int, str] = {}  # bits of each node that is a result
        for x in outputs:
            if isinstance(x, Expr) and x.index not in computed:
                computed[x.index] = v.nonfinite_bits(self.value(x))
        self._add_flags(1, list(computed.values()))
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

    def _splat(self, row: str, k: int) -> str:
        """Load one entry of the shared argument into every lane."""
        v = self._vector
        at = v.new(f'getelementptr double, ptr {row}, i64 {k}')
        entry = v.new(f'load double, ptr {at}')
        one = v.new(f'insertelement {v.type} poison, double {entry}, i32 0')
        return v.shuffle(one, 'poison', [0] * v.width)

    def _columns(self, rows: list[str], size: int, most: float,
                 bits: list[str]) -> list[str]:
        """Load rows of `size` entries as a vector per entry; extend the flag bits."""
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
            for row in tile:
                if row != 'zeroinitializer':
                    bits.append(v.nonfinite_bits(row, most))
            columns += exchange_blocks(v, tile, half // 2)
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
        places = ', '.join(map('i32 {}'.format, range(self.lanes)))
        return v.new(f'shufflevector {kind} {halves[0]}, {kind} {halves[1]}, '
                     f'<{self.lanes} x i32> <{places}>')

    def _add_flags(self, place: int, bits: list[str]) -> None:
        """Combine bits with the flags of arguments (place 0) or of the result (1)."""
        v = self._vector
        at = v.new(f'getelementptr {v.integer}, ptr %bad, i64 {place}')
        bits = [*bits, v.new(f'load {v.integer}, ptr {at}')]
        while len(bits) > 1:  # pairwise: keeps the dependency chain short
            combined = []
            for a, b in zip(bits[::2], bits[1::2]):
                combined.append(v.new(f'or {v.integer} {a}, {b}'))
            if len(bits) % 2:
                combined.append(bits[-1])
            bits = combined
        v.lines.append(f'  store {v.integer} {bits[0]}, ptr {at}')

    def _prefetch(self, rows: list[str], size: int, writing: bool) -> None:
        """Prefetch the rows of a later block."""
        v = self._vector
        if size > MAX_PREFETCHED_ROW or not size:
            return
        block = v.width * size
        # As many blocks ahead as PREFETCH_BYTES.
        distance = -(-PREFETCH_BYTES // (8 * block)) * block
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
    v = vector_type(lanes)
    part = vector_type(half)
    half_mask = f'<{half} x i1>'
    mask = f'<{lanes} x i1>'
    return with_callees(main, [
        'declare void @llvm.prefetch.p0(ptr, i32, i32, i32)',
        f'declare {part} @llvm.masked.load.v{half}f64.p0(ptr, i32, {half_mask}, {part})',
        f'declare void @llvm.masked.store.v{lanes}f64.p0({v}, ptr, i32, {mask})'])
