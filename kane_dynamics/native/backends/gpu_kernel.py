"""
Generate LLVM IR of GPU kernels: one thread evaluates a program for one state of a batch.

A kernel receives, by value: the number of states; for each argument and for the result
an address and two strides in numbers, from state to state and from entry to entry; the
entries of the program's last input. A state stride of 0 shares an argument. Memory
accesses of neighboring threads coalesce where the state stride is 1.

A state with an argument or a result that is not finite, or a position that is too large,
has NaN in all of its result.

The same kernel can be generated for the processor, where the number of the state is the
first argument of each call; tests evaluate it there.
"""

from collections.abc import Sequence
import math

from kane_dynamics.native.backends.llvm_math import Real, Vector
from kane_dynamics.native.backends.llvm_scalar import Function, with_callees
from kane_dynamics.native.tracing.expression import Expr
from kane_dynamics.native.tracing.program import Program

KERNEL = 'kernel'  # name of the kernel in its module
GLOBAL = 'ptr addrspace(1)'
# Numbers of the block, of the threads of a block, of the thread in its block.
REGISTERS = ('ctaid', 'ntid', 'tid')

PLACE = """\
  %block = call i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
  %threads = call i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
  %thread = call i32 @llvm.nvvm.read.ptx.sreg.tid.x()
  %block.wide = zext i32 %block to i64
  %threads.wide = zext i32 %threads to i64
  %thread.wide = zext i32 %thread to i64
  %first = mul i64 %block.wide, %threads.wide
  %i = add i64 %first, %thread.wide
""".splitlines()
INSIDE = """\
  %inside = icmp slt i64 %i, %count
  br i1 %inside, label %state, label %end
state:
""".splitlines()
END = ['  br label %end', 'end:', '  ret void', '}']


def definition(parameters: Sequence[str], host: bool) -> str:
    """Return the first line of a kernel: the number of states, then parameters."""
    if host:  # the number of the state is the first argument
        arguments = ', '.join(['i64 %i', 'i64 %count', *parameters])
        return f'define void @{KERNEL}({arguments}) {{'
    arguments = ', '.join(['i64 %count', *parameters])
    return f'define ptx_kernel void @{KERNEL}({arguments}) {{'


def entrance(host: bool) -> list[str]:
    """Return the lines up to the work for state `%i`, which ends with `END`."""
    return INSIDE if host else [*PLACE, *INSIDE]


def hoisted(lines: list[str]) -> list[str]:
    """Return the lines of a function that allocates its memory at its beginning."""
    local = [line for line in lines if ' = alloca ' in line]
    others = [line for line in lines[1:] if ' = alloca ' not in line]
    return [lines[0], *local, *others]


def declarations(host: bool) -> list[str]:
    """Return the declarations of what `entrance` uses."""
    return [] if host else [f'declare i32 @llvm.nvvm.read.ptx.sreg.{name}.x()'
                            for name in REGISTERS]


def row_address(v: Vector, name: str, step: str = '') -> str:
    """Return the address of a state's row of an argument or of the result, at a step."""
    # base + state * stride, and + step * its distance.
    row = f'%{name}.base'
    moves = [('%i', 'stride')]
    if step:
        moves.append((step, 'step'))
    for index, stride in moves:
        offset = v.new(f'mul i64 {index}, %{name}.{stride}')
        row = v.new(f'getelementptr {v.type}, {GLOBAL} {row}, i64 {offset}')
    return row


def entry_address(v: Vector, name: str, row: str, k: int) -> str:
    """Return the address of an entry of a row."""
    offset = v.new(f'mul i64 %{name}.pitch, {k}')
    return v.new(f'getelementptr {v.type}, {GLOBAL} {row}, i64 {offset}')


class GpuKernel(Function):
    """
    LLVM IR of the kernel of a program.

    Parameters
    ----------
    program : Program
        Its last input holds the parameters that all states share.
    real : Real
        The type of the numbers.
    host : bool
        Generate it for the processor.

    """

    in_place = ('output',)

    def __init__(self, program: Program, real: Real, host: bool = False) -> None:
        """Generate the kernel; `lines` holds the IR."""
        self._host = host
        super().__init__(program, KERNEL, 1, real, abreast=1)
        self.lines[0] = self._definition()
        self.lines = hoisted(self.lines)

    def _definition(self) -> str:
        """Return the head of the kernel."""
        # Each array with its distances from state to state and from step to step; the
        # block of parameters, which all states share, by value.
        *arguments, (block, shape) = self.program.inputs
        parameters = []
        for name in (*(key for key, _ in arguments), 'result'):
            parameters.append(f'{GLOBAL} %{name}.base, i64 %{name}.stride, '
                              f'i64 %{name}.pitch')
        for k in range(math.prod(shape)):
            parameters.append(f'{self.type} %{block}.{k}')
        return definition(parameters, self._host)

    def _load_inputs(self, schedule: list[Expr]) -> None:
        """Load all arguments first: the result may overlap them in memory."""
        self.lines += entrance(self._host)
        self._vector = v = Vector(self.lines, 'row', 1, self.real)
        self._bad = '0'  # bits that are set where a number is not finite
        used = {node.args: node.index for node in schedule if node.op == 'input'}
        *arguments, (block, _) = self.program.inputs
        for name, shape in arguments:
            row = row_address(v, name)
            for k in range(math.prod(shape)):
                x = v.new(f'load {self.type}, {GLOBAL} {entry_address(v, name, row, k)}')
                self._flag(x, self.real.size_limit(name))
                if (name, k) in used:
                    self.names[used[name, k]] = x
        for (name, k), index in used.items():
            if name == block:
                self.names[index] = f'%{block}.{k}'
        self._result = row_address(v, 'result')
        self._places: dict[int, list[int]] = {}  # of results that are not stored yet
        for k, result in enumerate(self.program.outputs):
            if isinstance(result, Expr):
                self._places.setdefault(result.index, []).append(k)

    def _flag(self, x: str, most: float = math.inf) -> None:
        """Remember whether a number is not finite, or larger than `most`."""
        v = self._vector
        self._bad = v.new(f'or {v.integer} {self._bad}, {v.nonfinite_bits(x, most)}')

    def _operation(self, node: Expr) -> None:
        """Store a result as soon as it is known: it needs no register any longer."""
        super()._operation(node)
        self._store_result(node)

    def _store_result(self, node: Expr) -> None:
        """Store a result in all its places, unless that is done."""
        places = self._places.pop(node.index, [])
        for k in places:
            self._store(k, self.value(node))
        if places:
            self._flag(self.value(node))

    def _store(self, k: int, value: str) -> None:
        at = entry_address(self._vector, 'result', self._result, k)
        self.lines.append(f'  store {self.type} {value}, {GLOBAL} {at}')

    def _store_outputs(self) -> None:
        for k, result in enumerate(self.program.outputs):
            if isinstance(result, Expr):
                self._store_result(result)
            else:
                self._store(k, self.value(result))
        # Results of states that are not valid are overwritten by NaN.
        bad = self._vector.new(f'icmp ne {self._vector.integer} {self._bad}, 0')
        self.lines += [f'  br i1 {bad}, label %nothing, label %end', 'nothing:']
        for k in range(len(self.program.outputs)):
            self._store(k, self.real.literal(math.nan))
        self.lines += END


def kernel_text(program: Program, real: Real, host: bool = False) -> str:
    """Return the LLVM IR of the kernel of a program, with its subroutines."""
    return with_callees(GpuKernel(program, real, host), declarations(host))
