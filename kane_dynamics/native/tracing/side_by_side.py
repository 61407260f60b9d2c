"""
Several states side by side within the program of one state, as one SIMD program.

A step of an integrator evaluates the same program at several states, one after the other,
where each state depends on the result before. A part of the program may need less: what
depends on the configuration alone is known for two stages at once. `divided` separates
that part of a program, and `call_side_by_side` computes it for several states, each in a
lane of SIMD registers. Only the LLVM back end for single states generates such calls.
"""

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
import math
from typing import Any

from kane_dynamics.native.tracing.expression import Expr, operands, Trace
from kane_dynamics.native.tracing.program import CALLS, OperationCount, Program, Shape
import numpy as np

KNOWN = 'known'  # input of the second part: the results of the first


@dataclass(frozen=True, eq=False)
class SideBySide:
    """
    A program for several states at once.

    Every entry of its inputs and results is a row in memory, with a number of each state.

    Attributes
    ----------
    program : Program
        That of one state.
    states : int
        Their number, that of lanes.

    """

    program: Program
    states: int

    @property
    def name(self) -> str:
        """Return the name of the function."""
        return f'{self.program.name}_of_{self.states}'

    @property
    def inputs(self) -> tuple[tuple[str, Shape], ...]:
        """Return names and shapes of the inputs, all states included."""
        inputs = []
        for name, shape in self.program.inputs:
            inputs.append((name, (math.prod(shape) * self.states,)))
        return tuple(inputs)

    @property
    def outputs(self) -> tuple[Any, ...]:
        """Return the entries of the results, each once for every state."""
        outputs = []
        for x in self.program.outputs:
            outputs += [x] * self.states
        return tuple(outputs)

    def operation_count(self) -> OperationCount:
        """Return the number of operations of one call, for all states."""
        return self.program.operation_count().times(self.states)


def divided(program: Program, early: Container[str],
            states: int) -> tuple[SideBySide, Program]:
    """
    Return the part of a program that depends on some inputs alone, and the rest.

    Calls of subroutines are part of the rest.

    Parameters
    ----------
    program : Program
        A finished program.
    early : container of str
        Names of the inputs of the first part.
    states : int
        Number of states that the first part computes at once.

    Returns
    -------
    first : SideBySide
        Its inputs are the `early` ones.
    second : Program
        Its inputs are the results of the first part for one state, then the others.

    """
    nodes = program.schedule()
    is_early: dict[int, bool] = {}
    for node in nodes:
        if node.op == 'input':
            is_early[node.index] = node.args[0] in early
        elif node.op in CALLS:
            # The called function computes one state; a module has no second one of its
            # name.
            is_early[node.index] = False
        else:
            is_early[node.index] = all(is_early[x.index] for x in operands(node))

    # Results of the first part are those of its values that the second part reads.
    read: dict[int, Expr] = {}
    users = [operands(node) for node in nodes if not is_early[node.index]]
    users.append([x for x in program.outputs if isinstance(x, Expr)])
    for values in users:
        for x in values:
            if is_early[x.index]:
                read[x.index] = x
    results = tuple(read[index] for index in sorted(read))
    early_inputs: list[tuple[str, Shape]] = []
    late_inputs: list[tuple[str, Shape]] = [(KNOWN, (len(results),))]
    for name, shape in program.inputs:
        inputs = early_inputs if name in early else late_inputs
        inputs.append((name, shape))
    first = Program(f'{program.name}_early', tuple(early_inputs), results,
                    (len(results),), nodes=program.nodes)

    # The second part again, with an input in place of each of these results.
    trace = Trace()
    replaced: dict[int, Expr] = {}
    for k, x in enumerate(results):
        replaced[x.index] = trace.node('input', KNOWN, k)

    def value_of(x: Any) -> Any:
        return replaced[x.index] if isinstance(x, Expr) else x

    for node in nodes:
        if is_early[node.index]:
            continue
        op = node.op
        args = list(map(value_of, node.args))
        # Twice a number as a sum: products are what bounds the time of the second part.
        if op == 'mul' and args[1] == 2.0:
            op = 'add'
            args[1] = args[0]
        replaced[node.index] = trace.node(op, *args)
    outputs = tuple(map(value_of, program.outputs))
    second = Program(f'{program.name}_late', tuple(late_inputs), outputs, program.shape,
                     nodes=trace.close(), stride=states)
    return SideBySide(first, states), second


def call_side_by_side(program: SideBySide,
                      states: Sequence[Sequence[Iterable[Any]]]) -> list[list[Expr]]:
    """
    Return the results of a program for each of several states.

    Parameters
    ----------
    program : SideBySide
        It becomes a separate function of the compiled module.
    states : sequence of sequences of iterables of scalars
        Of each state, the entries of each of the program's inputs, in order.

    """
    # The rows of one input after those of the other: entry by entry, a number of each
    # state.
    entries: list[Any] = []
    for of_states in zip(*states, strict=True):
        flat = [np.ravel(np.asarray(values)) for values in of_states]
        entries += np.stack(flat, axis=1).ravel().tolist()
    trace = next(x.trace for x in entries if isinstance(x, Expr))
    node = trace.node('side_by_side', program, *entries)
    outputs = [trace.node('output', node, k) for k in range(len(program.outputs))]
    results = []
    for lane in range(program.states):
        results.append(outputs[lane::program.states])
    return results
