"""Traced programs: inputs, outputs and the live operations between them, in order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
import operator
from typing import Any

from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.native.tracing.expression import Expr, operands, Scalar, Trace
import numpy as np

Shape = tuple[int, ...]
STRUCTURE = ('input', 'output', 'call')  # nodes that are not operations
ROWS = {'wide_mul': 'multiplications', 'wide_add': 'additions', 'wide_sub': 'additions',
        'wide_neg': 'negations'}  # operations on the rows of `wide`
PLACING = ('pack', 'lane', 'blend', 'gather', 'transposed', 'column')  # of scalars in rows
KEPT = frozenset([*STRUCTURE, *ROWS, *PLACING])  # nodes without folding
OPERATORS: dict[str, Any] = {'add': operator.add, 'sub': operator.sub, 'mul': operator.mul,
                             'div': operator.truediv, 'neg': operator.neg}

NUMPY: dict[str, Any] = {'add': np.add, 'sub': np.subtract, 'mul': np.multiply,
                         'div': np.divide, 'neg': np.negative,
                         'less': lambda a, b: np.float64(a < b),
                         'select': lambda chosen, a, b: a if chosen else b}


@dataclass(frozen=True)
class OperationCount:
    """Arithmetic operations of one call; a subtraction counts as an addition."""

    multiplications: int = 0
    additions: int = 0
    divisions: int = 0
    functions: int = 0
    negations: int = 0

    def __add__(self, other: 'OperationCount') -> 'OperationCount':
        """Return the sum of two counts."""
        return OperationCount(*(getattr(self, f) + getattr(other, f)
                                for f in self.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Program:
    """
    Straight-line program.

    Parameters
    ----------
    name : str
        A C identifier.
    inputs : tuple of (str, shape)
        Arguments in order. Entry k of an argument, in C order, is the node ``input(name, k)``.
    outputs : tuple of Expr or float
        Entries of the result, in C order.
    shape : tuple of int
        Shape of the result.

    """

    name: str
    inputs: tuple[tuple[str, Shape], ...]
    outputs: tuple[Scalar, ...]
    shape: Shape

    @property
    def n_outputs(self) -> int:
        """Return the number of scalars in the result."""
        return len(self.outputs)

    def schedule(self) -> list[Expr]:
        """Return the nodes that the outputs depend on, in order of creation."""
        roots = [x for x in self.outputs if isinstance(x, Expr)]
        if not roots:
            return []
        nodes = roots[0].trace.nodes
        needed = bytearray(len(nodes))
        for root in roots:
            needed[root.index] = 1
        for node in reversed(nodes):
            if needed[node.index]:
                for arg in operands(node):
                    needed[arg.index] = 1
        return [node for node in nodes if needed[node.index]]

    def operation_count(self) -> OperationCount:
        """Return the number of operations of one call, including subroutines."""
        counts = dict.fromkeys(OperationCount.__dataclass_fields__, 0)
        kind = {'mul': 'multiplications', 'add': 'additions', 'sub': 'additions',
                'div': 'divisions', 'neg': 'negations'}
        inner = OperationCount()
        for node in self.schedule():
            if node.op == 'call':
                inner = inner + node.args[0].operation_count()
            elif node.op in ROWS:
                counts[ROWS[node.op]] += LANES
            elif node.op not in (*STRUCTURE, *PLACING):
                counts[kind.get(node.op, 'functions')] += 1
        return OperationCount(**counts) + inner

    def instruction_count(self, width: int) -> int:
        """
        Return about how many instructions one call of the machine code takes.

        `width` is the number of doubles in a SIMD register. Moves to and from memory and fused
        operations, which are about as frequent in all programs, do not count.
        """
        registers = LANES // width
        total = 0
        for node in self.schedule():
            if node.op == 'call':
                total += node.args[0].instruction_count(width)
            elif node.op in ROWS or node.op in ('gather', 'blend'):
                total += registers
            elif node.op == 'transposed':
                total += 3 * LANES * registers
            elif node.op == 'pack':
                total += len(set(operands(node)))
            elif node.op not in (*STRUCTURE, *PLACING):
                total += 1
        return total


def trace_program(name: str, function: Callable[..., Any],
                  inputs: Sequence[tuple[str, Shape]]) -> Program:
    """
    Trace `function` and return its program.

    Parameters
    ----------
    name : str
        A C identifier.
    function : callable
        Takes one array per declared input; returns an array or a scalar.
    inputs : sequence of (str, shape)
        Names and shapes of the arguments.

    """
    trace = Trace()
    result = np.asarray(function(*(trace.inputs(key, *shape) for key, shape in inputs)),
                        dtype=object)
    outputs = tuple(x if isinstance(x, Expr) else float(x) for x in result.ravel())
    return factored(Program(name, tuple(inputs), outputs, result.shape))


def factored(program: Program) -> Program:
    """Rewrite ``a*c + b*c`` as ``(a + b)*c`` where both products have no other use."""
    schedule = program.schedule()
    uses: dict[int, int] = {}
    for node in schedule:
        for arg in operands(node):
            uses[arg.index] = uses.get(arg.index, 0) + 1
    for x in program.outputs:
        if isinstance(x, Expr):
            uses[x.index] = uses.get(x.index, 0) + 1
    trace = Trace()
    new: dict[int, Any] = {}

    def of(arg: Any) -> Any:
        return new[arg.index] if isinstance(arg, Expr) else arg

    for node in schedule:
        common = _common_factor(node, uses) if node.op in ('add', 'sub') else None
        if common is not None:
            factor, left, right = (of(x) for x in common)
            new[node.index] = factor * (left + right if node.op == 'add' else left - right)
        else:
            args = [of(arg) for arg in node.args]
            new[node.index] = (trace.node(node.op, *args)
                               if node.op in KEPT else applied(node.op, args))
    outputs = tuple(of(x) for x in program.outputs)
    return Program(program.name, program.inputs, outputs, program.shape)


def _common_factor(node: Expr, uses: dict[int, int]) -> tuple[Any, Any, Any] | None:
    """Return (c, a, b) if the node is a*c +- b*c and both products have no other use."""
    if not all(isinstance(x, Expr) and x.op == 'mul' and uses[x.index] == 1 for x in node.args):
        return None
    (p, q), (r, s) = node.args[0].args, node.args[1].args
    for factor, left in ((p, q), (q, p)):
        for candidate, right in ((r, s), (s, r)):
            if candidate is factor or (not isinstance(factor, Expr) and factor == candidate):
                return factor, left, right
    return None


def applied(op: str, args: list[Any]) -> Any:
    """Return the result of an operation on traced values and floats, with folding."""
    if op == 'less':
        return args[0] < args[1]
    if op == 'select':
        return args[0].select(*args[1:]) if isinstance(args[0], Expr) else args[
            1 if args[0] else 2]
    return OPERATORS[op](*args) if op in OPERATORS else getattr(np, op)(args[0])


def evaluate(program: Program, inputs: Sequence[Any], dtype: Any = np.float64) -> Any:
    """
    Return the result of a program in a numpy type, operation by operation.

    Parameters
    ----------
    program : Program
        The program to evaluate.
    inputs : sequence of arrays
        One per declared input.
    dtype : numpy scalar type
        In which every operation is rounded.

    """
    given = {name: np.ravel(np.asarray(value, dtype=np.float64)).astype(dtype)
             for (name, _), value in zip(program.inputs, inputs, strict=True)}
    known: dict[int, Any] = {}

    def of(x: Any) -> Any:
        return known[x.index] if isinstance(x, Expr) else dtype(x)

    for node in program.schedule():
        if node.op == 'input':
            found = given[node.args[0]][node.args[1]]
        elif node.op == 'call':
            callee, *flat = node.args
            values = iter(flat)
            found = evaluate(callee, [[of(next(values)) for _ in range(size_of(shape))]
                                      for _, shape in callee.inputs], dtype).ravel()
        elif node.op == 'output':
            found = known[node.args[0].index][node.args[1]]
        else:
            function = NUMPY.get(node.op) or getattr(np, node.op)
            found = function(*map(of, node.args))
        known[node.index] = found
    return np.array([of(x) for x in program.outputs], dtype=dtype).reshape(program.shape)


def size_of(shape: Shape) -> int:
    """Return the number of entries of an array of this shape."""
    return math.prod(shape)
