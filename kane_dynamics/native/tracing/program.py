"""Traced programs: inputs, outputs and the live operations between them, in order."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
import hashlib
from itertools import compress
import math
import operator
from types import FunctionType, MethodType
from typing import Any

from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.native.tracing.expression import Expr, operands, Scalar, Trace
import numpy as np

Shape = tuple[int, ...]
STRUCTURE = ('input', 'output', 'call')  # nodes that are not operations
ROWS = {'wide_mul': 'multiplications', 'wide_add': 'additions', 'wide_sub': 'additions',
        'wide_div': 'divisions', 'wide_less': 'functions', 'wide_select': 'functions',
        'wide_neg': 'negations'}  # operations on the rows of `wide`
# Nodes that place scalars in rows.
PLACING = ('pack', 'lane', 'blend', 'gather', 'transposed', 'column')
KEPT = frozenset([*STRUCTURE, *ROWS, *PLACING])  # nodes without folding
OPERATORS: dict[str, Any] = {'add': operator.add, 'sub': operator.sub,
                             'mul': operator.mul,
                             'div': operator.truediv, 'neg': operator.neg}

# Values that `origin` describes by their text.
PLAIN = (str, int, float, bool, type(None), slice, np.generic)
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
        return OperationCount(self.multiplications + other.multiplications,
                              self.additions + other.additions,
                              self.divisions + other.divisions,
                              self.functions + other.functions,
                              self.negations + other.negations)


@dataclass(frozen=True, eq=False)
class Program:
    """
    Straight-line program.

    Parameters
    ----------
    name : str
        A C identifier.
    inputs : tuple of (str, shape)
        Arguments in order. Entry k of an argument, in C order, is the node
        ``input(name, k)``.
    outputs : tuple of Expr or float
        Entries of the result, in C order.
    shape : tuple of int
        Shape of the result.
    nodes : list of Expr, optional
        All nodes of a finished trace, in order of creation; by default those of the trace
        of the outputs, which is still open.

    """

    name: str
    inputs: tuple[tuple[str, Shape], ...]
    outputs: tuple[Scalar, ...]
    shape: Shape
    nodes: list[Expr] | None = field(default=None, kw_only=True)

    def schedule(self) -> list[Expr]:
        """Return the nodes that the outputs depend on, in order of creation."""
        nodes: list[Expr] = []
        needed = bytearray()
        for x in self.outputs:
            if isinstance(x, Expr):
                if not nodes:
                    nodes = x.trace.nodes if self.nodes is None else self.nodes
                    needed = bytearray(len(nodes))
                needed[x.index] = 1

        # Backwards from the outputs: nodes are created after their operands, so one pass
        # marks everything that is needed.
        for node in reversed(nodes):
            if needed[node.index]:
                for operand in operands(node):
                    needed[operand.index] = 1
        return list(compress(nodes, needed))

    def operation_count(self) -> OperationCount:
        """Return the number of operations of one call, including subroutines."""
        # Structure and placing cause no arithmetic; subroutines count as often as called.
        counts = dict.fromkeys(OperationCount.__dataclass_fields__, 0)
        kind = {'mul': 'multiplications', 'add': 'additions', 'sub': 'additions',
                'div': 'divisions', 'neg': 'negations'}
        inner = OperationCount()
        for node in self.schedule():
            if node.op == 'call':
                inner = inner + node.args[0].operation_count()
            elif node.op in ROWS:
                # An operation on a row counts once for each lane.
                counts[ROWS[node.op]] += LANES
            elif node.op not in (*STRUCTURE, *PLACING):
                counts[kind.get(node.op, 'functions')] += 1
        return OperationCount(**counts) + inner

    def instruction_count(self, width: int) -> int:
        """
        Return about how many instructions one call of the machine code takes.

        `width` is the number of doubles in a SIMD register. Moves to and from memory and
        fused operations, which are about as frequent in all programs, do not count.
        """
        registers = LANES // width
        total = 0
        for node in self.schedule():
            if node.op == 'call':
                total += node.args[0].instruction_count(width)
            # Rows take as many instructions as registers; a transpose has three stages
            # of exchanges.
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
    arguments = []
    # One traced value for each entry; what the function does with them is recorded.
    for key, shape in inputs:
        arguments.append(trace.inputs(key, *shape))
    result = np.asarray(function(*arguments), dtype=object)
    outputs = []
    for x in result.ravel():
        outputs.append(x if isinstance(x, Expr) else float(x))
    # Shared factors are found in the whole program, after the trace.
    program = factored(Program(name, tuple(inputs), tuple(outputs), result.shape))
    trace.close()
    return program


def origin(program: Callable[..., Any]) -> str:
    """
    Return a text of the code of a function and of the plain values that it is bound to.

    These are the values of `functools.partial` and of enclosing functions that are
    functions, texts, numbers, arrays of numbers, slices, or tuples, lists and dicts of
    these. Of other objects only the class counts: a key names their values. The text is
    the same in each process.
    """
    parts: list[str] = []
    _describe(program, parts, set())
    return ' '.join(parts)


def _describe(value: Any, parts: list[str], seen: set[int]) -> None:
    """Append the description of a value."""
    # Plain values by their text; functions by their place in the source and what they
    # enclose.
    if isinstance(value, PLAIN):
        parts.append(repr(value))
    elif isinstance(value, (tuple, list)):
        parts.append('(')
        for x in value:
            _describe(x, parts, seen)
        parts.append(')')
    elif isinstance(value, dict):
        _describe(list(value.items()), parts, seen)
    elif isinstance(value, np.ndarray) and value.dtype == object:
        parts.append(f'{value.shape}')
        _describe(value.ravel().tolist(), parts, seen)
    elif isinstance(value, np.ndarray):
        digest = hashlib.sha256(value.tobytes()).hexdigest()
        parts.append(f'{value.dtype}{value.shape}{digest}')
    elif isinstance(value, partial):
        for x in (value.func, *value.args, *value.keywords.values()):
            _describe(x, parts, seen)
    elif isinstance(value, MethodType):
        _describe(value.__self__, parts, seen)
        _describe(value.__func__, parts, seen)
    elif not isinstance(value, FunctionType):
        kind = type(value)
        parts.append(f'{kind.__module__}.{kind.__qualname__}')
    elif id(value) not in seen:
        seen.add(id(value))
        name = f'{value.__module__}.{value.__qualname__}'
        parts.append(f'{name}:{value.__code__.co_firstlineno}')
        for content in _enclosed(value):
            _describe(content, parts, seen)


def _enclosed(function: FunctionType) -> Iterator[Any]:
    """Yield the values of the variables that a function encloses."""
    for cell in function.__closure__ or ():
        with suppress(ValueError):  # not assigned yet
            yield cell.cell_contents


def factored(program: Program) -> Program:
    """Rewrite ``a*c + b*c`` as ``(a + b)*c`` where both products have no other use."""
    nodes = program.schedule()
    uses = _number_of_uses([*map(operands, nodes), program.outputs])
    trace = Trace()
    rewritten: dict[int, Any] = {}

    def value_of(arg: Any) -> Any:
        return rewritten[arg.index] if isinstance(arg, Expr) else arg

    # In order of creation, so that the operands of a node are rewritten before it.
    for node in nodes:
        args = list(map(value_of, node.args))
        common = _common_factor(node, uses) if node.op in ('add', 'sub') else None
        if common is not None:
            # a*c +- b*c = c*(a +- b); the two products are in no output any more.
            factor, left, right = map(value_of, common)
            combined = applied(node.op, [left, right])
            rewritten[node.index] = factor * combined
        elif node.op in KEPT:
            rewritten[node.index] = trace.node(node.op, *args)
        else:
            rewritten[node.index] = applied(node.op, args)
    outputs = tuple(map(value_of, program.outputs))
    return Program(program.name, program.inputs, outputs, program.shape,
                   nodes=trace.close())


def _number_of_uses(users: Sequence[Sequence[Any]]) -> dict[int, int]:
    """Return how often each node is used by an operation or as an output, by its index."""
    uses: dict[int, int] = {}
    for values in users:
        for x in values:
            if isinstance(x, Expr):
                uses[x.index] = uses.get(x.index, 0) + 1
    return uses


def _common_factor(node: Expr, uses: dict[int, int]) -> tuple[Any, Any, Any] | None:
    """Return (c, a, b) if the node is a*c +- b*c and both products have no other use."""
    for product in node.args:
        is_product = isinstance(product, Expr) and product.op == 'mul'
        if not (is_product and uses[product.index] == 1):
            return None
    # p q +- r s.
    p, q = node.args[0].args
    r, s = node.args[1].args
    # A factor is common as the same node or as an equal constant, on either side.
    for factor, left in ((p, q), (q, p)):
        for candidate, right in ((r, s), (s, r)):
            equal_constants = not isinstance(factor, Expr) and factor == candidate
            if candidate is factor or equal_constants:
                return factor, left, right
    return None


def applied(op: str, args: list[Any]) -> Any:
    """Return the result of an operation on traced values and floats, with folding."""
    # Comparisons and selections of floats are decided now, those of traced values
    # recorded.
    if op == 'less':
        return args[0] < args[1]
    if op == 'select':
        condition, if_true, if_false = args
        if isinstance(condition, Expr):
            return condition.select(if_true, if_false)
        return if_true if condition else if_false
    if op in OPERATORS:
        return OPERATORS[op](*args)
    return getattr(np, op)(args[0])


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
    # Every entry in the numpy type, rounded from float64.
    entries: dict[str, Any] = {}
    for (name, _), value in zip(program.inputs, inputs, strict=True):
        entries[name] = np.ravel(np.asarray(value, dtype=np.float64)).astype(dtype)
    values: dict[int, Any] = {}

    def value_of(x: Any) -> Any:
        return values[x.index] if isinstance(x, Expr) else dtype(x)

    # Operands are evaluated before the nodes that use them.
    for node in program.schedule():
        if node.op == 'input':
            name, k = node.args
            values[node.index] = entries[name][k]
        elif node.op == 'call':
            callee, *arguments = node.args
            flat = np.array([value_of(x) for x in arguments])
            # A subroutine gets its arguments as the program does: a flat part each.
            ends = np.cumsum([math.prod(shape) for _, shape in callee.inputs])
            values[node.index] = evaluate(callee, np.split(flat, ends[:-1]),
                                          dtype).ravel()
        elif node.op == 'output':
            results, k = node.args
            values[node.index] = values[results.index][k]
        else:
            function = NUMPY.get(node.op) or getattr(np, node.op)
            values[node.index] = function(*map(value_of, node.args))
    outputs = np.array([value_of(x) for x in program.outputs], dtype=dtype)
    return outputs.reshape(program.shape)
