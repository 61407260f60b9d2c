"""
Generate LLVM IR of GPU kernels that integrate over time: a thread takes all steps.

The state of a thread is in its local memory, and a step is a subroutine of it. By value,
the kernel receives: the numbers of states and of steps; an address and the strides, as
`gpu_kernel`, of q, u, tau, of the run-time parameters that are arguments, and of the
result; for tau and the result a stride from step to step; then the step length, the time
at the beginning and the block of parameters. A step stride of 0 holds tau, or keeps the
last result.

From where a number is not finite, a position is too large or the margin of a constrained
robot is not positive, the results of a state are NaN.
"""

from collections.abc import Mapping
from dataclasses import dataclass
import math

from kane_dynamics.native.backends.gpu_kernel import (declarations, definition, END,
                                                      entrance, entry_address, GLOBAL,
                                                      row_address)
from kane_dynamics.native.backends.llvm_math import Real, Vector
from kane_dynamics.native.backends.llvm_scalar import Function, with_callees
from kane_dynamics.native.tracing.program import Program

STEP = 'step'


@dataclass(frozen=True)
class StepLayout:
    """
    Places in a step program of the numbers that a roll-out reads and writes.

    Attributes
    ----------
    n_q, n : int
        Numbers of positions and of speeds, the first entries of a state.
    time : tuple of str
        The parameter of the kernel that has the time, where a state continues with it.
    watched : bool
        Whether a state ends with a margin.
    parameters : mapping
        The slices, in the block of parameters, of those that are arguments.

    """

    n_q: int
    n: int
    time: tuple[str, ...]
    watched: bool
    parameters: Mapping[str, slice]


def rollout_text(program: Program, layout: StepLayout, real: Real,
                 host: bool = False) -> str:
    """
    Return the LLVM IR of a roll-out.

    Parameters
    ----------
    program : Program
        One step: state, torques and constants (step length, parameters) to the next
        state.
    layout : StepLayout
        Of that program.
    real : Real
        The type of the numbers.
    host : bool
        Generate it for the processor.

    """
    step = Function(program, STEP, 1, real, abreast=1)
    text = with_callees(step, declarations(host))
    return '\n'.join([text, *_Rollout(program, layout, real, host).lines])


class _Rollout:
    """Kernel that loads a state, calls the step repeatedly and stores the results."""

    def __init__(self, program: Program, layout: StepLayout, real: Real,
                 host: bool) -> None:
        self._layout = layout
        self._type = real.name
        self._sizes = [math.prod(shape) for _, shape in program.inputs]
        parameters = ['i64 %steps']
        # Base, stride of trajectories and of entries of every array; of torques and
        # results that of steps, too.
        for name in ('q', 'u', 'tau', *layout.parameters, 'result'):
            parameters.append(f'{GLOBAL} %{name}.base, i64 %{name}.stride, i64 '
                              f'%{name}.pitch')
            if name in ('tau', 'result'):  # one row for each step
                parameters.append(f'i64 %{name}.step')
        parameters += [f'{real.name} %h', f'{real.name} %time']
        parameters += [f'{real.name} %p{k}' for k in range(self._sizes[2] - 1)]
        self.lines = [definition(parameters, host), *self._memory(), *entrance(host)]
        self._v = Vector(self.lines, 'v', 1, real)
        self._load()
        self._loop()
        self.lines += END

    def _memory(self) -> list[str]:
        """Return the allocation of state, torques and constants, and their addresses."""
        lines = [f'  %{name} = alloca [{size} x {self._type}]'
                 for name, size in zip(('x', 'f', 'c'), self._sizes)]
        lines.append('  %args = alloca [4 x ptr]')
        for k, name in enumerate(('x', 'f', 'c', 'x')):  # the step overwrites its state
            lines += [f'  %slot.{k} = getelementptr ptr, ptr %args, i64 {k}',
                      f'  store ptr %{name}, ptr %slot.{k}']
        return lines

    def _at(self, memory: str, k: int) -> str:
        return self._v.new(f'getelementptr {self._type}, ptr {memory}, i64 {k}')

    def _put(self, value: str, memory: str, k: int) -> None:
        self.lines.append(f'  store {self._type} {value}, ptr {self._at(memory, k)}')

    def _copy(self, name: str, count: int, memory: str, begin: int,
              step: str = '') -> None:
        """Copy a row of an argument to local memory."""
        row = row_address(self._v, name, step)
        for k in range(count):
            x = self._v.new(f'load {self._type}, {GLOBAL} '
                            f'{entry_address(self._v, name, row, k)}')
            self._put(x, memory, begin + k)

    def _load(self) -> None:
        """Fill state and constants, and mark a position that is too large."""
        layout = self._layout
        v = self._v
        # The constants of a step: its length, numbers, and parameters of the trajectory.
        self._put('%h', '%c', 0)
        for k in range(self._sizes[2] - 1):
            self._put(f'%p{k}', '%c', 1 + k)
        for name, part in layout.parameters.items():
            self._copy(name, part.stop - part.start, '%c', 1 + part.start)
        # The state: q, u and, if needed, time and a margin that is accepted.
        self._copy('q', layout.n_q, '%x', 0)
        self._copy('u', layout.n, '%x', layout.n_q)
        for value in layout.time:
            self._put(value, '%x', layout.n_q + layout.n)
        if layout.watched:
            self._put(v.const(1.0), '%x', self._sizes[0] - 1)
        flags = self._flags()
        self.lines.append(f'  %bad.first = or {v.integer} {flags}, 0')

    def _flags(self) -> str:
        """Return bits that are set where the state is not valid."""
        layout = self._layout
        v = self._v
        bits = '0'
        # Bits of numbers that are not finite or beyond their limit.
        for k in range(layout.n_q + layout.n):
            x = v.new(f'load {self._type}, ptr {self._at("%x", k)}')
            limit = v.real.size_limit('q' if k < layout.n_q else 'u')
            bits = v.new(f'or {v.integer} {bits}, {v.nonfinite_bits(x, limit)}')
        if layout.watched:
            # A margin that is not positive: a singular state, or an open loop.
            margin = v.new(f'load {self._type}, ptr '
                           f'{self._at("%x", self._sizes[0] - 1)}')
            inside = v.new(f'fcmp ogt {self._type} {margin}, {v.const(0.0)}')
            left = v.new(f'select i1 {inside}, {v.integer} 0, {v.integer} 1')
            bits = v.new(f'or {v.integer} {bits}, {left}')
        return bits

    def _loop(self) -> None:
        layout = self._layout
        v = self._v
        # Once a state is not valid, all later results of the trajectory are NaN.
        incoming = '[%bad.first, %state], [%bad.next, %loop]'
        self.lines += ['  br label %loop', 'loop:',
                       '  %s = phi i64 [0, %state], [%next, %loop]',
                       f'  %bad = phi {v.integer} {incoming}']
        # One step: torques in, the program, and the state as its own next argument.
        self._copy('tau', layout.n, '%f', 0, '%s')
        self.lines.append(f'  call void @{STEP}(ptr %args)')
        flags = self._flags()
        self.lines.append(f'  %bad.next = or {v.integer} %bad, {flags}')
        invalid = v.new(f'icmp ne {v.integer} %bad.next, 0')
        # The row of this step; a state that is not valid is written as NaN.
        row = row_address(v, 'result', '%s')
        for k in range(layout.n_q + layout.n):
            x = v.new(f'load {self._type}, ptr {self._at("%x", k)}')
            x = v.select(invalid, v.const(math.nan), x)
            at = entry_address(v, 'result', row, k)
            self.lines.append(f'  store {self._type} {x}, {GLOBAL} {at}')
        self.lines += ['  %next = add i64 %s, 1', '  %more = icmp slt i64 %next, %steps',
                       '  br i1 %more, label %loop, label %done', 'done:']
