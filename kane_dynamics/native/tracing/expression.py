"""
Traced scalars: numeric code run on `Expr` records its arithmetic as an expression graph.

An `Expr` is a node of a directed acyclic graph. Nodes are hash-consed: the same
operation on the same operands is the same node, which eliminates common subexpressions.
Constants are folded: arithmetic with 0, 1, -1 and between constants creates no node. A
result that does not depend on any input is a plain float. Arrays of dtype object hold
expressions, and numpy's ``@``, ``+``, ``*``, ``sin`` and so on work on them.

The graph is independent of dynamics, differentiation and LLVM.
"""

from collections.abc import Sequence
import math
import numbers
from typing import Any, Union

import numpy as np

Scalar = Union['Expr', float]


class Trace:
    """Nodes of one program under tracing, in order of creation."""

    def __init__(self) -> None:
        """Create an empty graph."""
        self.nodes: list[Expr] = []
        self._table: dict[tuple[Any, ...], Expr] = {}

    def node(self, op: str, *args: Any) -> 'Expr':
        """Return the node that applies `op` to `args`, created if it is missing."""
        key = (op, *args)
        node = self._table.get(key)
        if node is None:
            node = Expr(self, len(self.nodes), op, args)
            self._table[key] = node
            self.nodes.append(node)
        return node

    def close(self) -> list['Expr']:
        """
        Return the nodes and release them; none can be created from here on.

        Nodes refer to their trace. If it referred to them, too, a finished program would be
        freed by the garbage collector alone, which would hold the interpreter for the time
        that it takes to search tens of thousands of nodes.
        """
        nodes = self.nodes
        del self.nodes, self._table
        return nodes

    def has(self, op: str, *args: 'Expr') -> bool:
        """Return whether the node that applies `op` to `args` exists."""
        return (op, *args) in self._table

    def inputs(self, name: str, *shape: int) -> Any:
        """Return an object array of `shape` with the input nodes of argument `name`."""
        size = math.prod(shape)
        flat = np.empty(size, dtype=object)
        for k in range(size):
            flat[k] = self.node('input', name, k)
        return flat.reshape(shape)


class Expr:
    """Traced scalar; its value is known only when the compiled program runs."""

    __slots__ = ('args', 'index', 'op', 'trace')

    def __init__(self, trace: Trace, index: int, op: str, args: tuple[Any, ...]) -> None:
        """Create a node; use `Trace.node` or arithmetic, which fold and share."""
        self.trace = trace
        self.index = index
        self.op = op
        self.args = args

    def __repr__(self) -> str:
        """Return the operation and the node numbers of its operands."""
        shown = [f'%{a.index}' if isinstance(a, Expr) else repr(a) for a in self.args]
        return f'%{self.index}={self.op}({", ".join(shown)})'

    def __bool__(self) -> bool:
        """Raise TypeError: a traced program must not branch on a value."""
        raise TypeError('traced value: used as a bool; expected arithmetic that does '
                        'not branch on values')

    def __float__(self) -> float:
        """Raise TypeError: the value is not known during tracing."""
        raise TypeError('traced value: used as a float; expected arithmetic on the '
                        'expression, whose value is known only when the kernel runs')

    def __neg__(self) -> Scalar:
        # Two negations cancel, and a constant factor takes the sign.
        if self.op == 'neg':
            return self.args[0]  # type: ignore[no-any-return]
        base, factor = _constant_factor(self)
        if factor != 1.0:
            return _product(base, -factor)
        return self.trace.node('neg', self)

    def __pos__(self) -> Scalar:
        return self

    def __add__(self, other: Any) -> Any:
        return _sum(self, other) if isinstance(other, _SCALAR) else NotImplemented

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return _difference(self, other) if isinstance(other, _SCALAR) else NotImplemented

    def __rsub__(self, other: Any) -> Any:
        return _difference(other, self) if isinstance(other, _SCALAR) else NotImplemented

    def __mul__(self, other: Any) -> Any:
        return _product(self, other) if isinstance(other, _SCALAR) else NotImplemented

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        return _quotient(self, other) if isinstance(other, _SCALAR) else NotImplemented

    def __rtruediv__(self, other: Any) -> Any:
        return _quotient(other, self) if isinstance(other, _SCALAR) else NotImplemented

    def __pow__(self, exponent: Any) -> Any:
        if not isinstance(exponent, numbers.Real):
            return NotImplemented
        power = float(exponent)
        if power < 0.0:
            return 1.0 / self ** -power
        if power == 0.5:
            return self.sqrt()
        # NaN of a negative number, as for floats of numpy.
        if not power.is_integer():
            return np.exp(power * self.log())
        return math.prod([self] * int(power), start=1.0)

    def __lt__(self, other: Any) -> Any:
        """Return 1.0 if this is less, else 0.0; a condition for `select`."""
        if not isinstance(other, _SCALAR):
            return NotImplemented
        return self.trace.node('less', self, other)

    def __gt__(self, other: Any) -> Any:
        """Return 1.0 if the other is less, else 0.0."""
        if not isinstance(other, numbers.Real):
            return NotImplemented
        return self.trace.node('less', float(other), self)

    def select(self, x: Scalar, y: Scalar) -> Scalar:
        """Return x if this is not 0, else y; the unselected value may be NaN."""
        if x is y or (not isinstance(x, Expr) and not isinstance(y, Expr) and x == y):
            return x
        if not isinstance(x, Expr):
            x = float(x)
        if not isinstance(y, Expr):
            y = float(y)
        return self.trace.node('select', self, x, y)

    def sin(self) -> Scalar:
        """Return the sine; numpy.sin calls this on object arrays."""
        if self.op == 'neg':
            return -self.trace.node('sin', self.args[0])
        return self.trace.node('sin', self)

    def cos(self) -> Scalar:
        """Return the cosine."""
        if self.op == 'neg':
            return self.trace.node('cos', self.args[0])
        return self.trace.node('cos', self)

    def tanh(self) -> Scalar:
        """Return the hyperbolic tangent."""
        return self.trace.node('tanh', self)

    def sqrt(self) -> Scalar:
        """Return the square root."""
        return self.trace.node('sqrt', self)

    def exp(self) -> Scalar:
        """Return the exponential."""
        return self.trace.node('exp', self)

    def log(self) -> Scalar:
        """Return the natural logarithm."""
        return self.trace.node('log', self)

    def arctan(self) -> Scalar:
        """Return the arctangent, rad."""
        return self.trace.node('arctan', self)

    def __floor__(self) -> Scalar:
        """Return the floor."""
        return self.trace.node('floor', self)


_SCALAR: Any = (Expr, float, int, numbers.Real)  # the abstract class last: it is slow


def _constant_factor(x: Scalar) -> tuple[Scalar, float]:
    """Split ``y * c`` into (y, c); return (x, 1) for any other expression."""
    if isinstance(x, Expr) and x.op == 'mul' and not isinstance(x.args[1], Expr):
        return x.args[0], x.args[1]
    return x, 1.0


def _sum(x: Scalar, y: Scalar) -> Scalar:
    if not isinstance(x, Expr):
        x, y = y, x
    if not isinstance(x, Expr):
        return float(x) + float(y)

    # With a constant, which stands last and is added to that of x.
    if not isinstance(y, Expr):
        y = float(y)
        if y == 0.0:
            return x
        if x.op == 'add' and not isinstance(x.args[1], Expr):
            return _sum(x.args[0], x.args[1] + y)
        return x.trace.node('add', x, y)

    # Signs become subtractions; equal and opposite terms go.
    if y.op == 'neg':
        return _difference(x, y.args[0])
    if x.op == 'neg':
        return _difference(y, x.args[0])
    if x is y:
        return _product(x, 2.0)
    if _constant_factor(y)[1] < 0.0:
        return _difference(x, -y)
    if _constant_factor(x)[1] < 0.0:
        return _difference(y, -x)
    if x.op == 'sub' and x.args[1] is y:
        return x.args[0]  # type: ignore[no-any-return]
    if y.op == 'sub' and y.args[1] is x:
        return y.args[0]  # type: ignore[no-any-return]
    return _commutative('add', x, y)


def _commutative(op: str, x: Expr, y: Expr) -> Scalar:
    """Return a node with operands in order of creation: x y and y x are one."""
    if x.index > y.index:
        x, y = y, x
    return x.trace.node(op, x, y)


def _difference(x: Scalar, y: Scalar) -> Scalar:
    if not isinstance(y, Expr):
        return _sum(x, -y)
    if not isinstance(x, Expr):
        return -y if x == 0.0 else y.trace.node('sub', float(x), y)
    # Equal terms cancel, and signs make the difference a sum.
    if x is y:
        return 0.0
    if y.op == 'neg':
        return _sum(x, y.args[0])
    if x.op == 'neg':
        return -_sum(x.args[0], y)
    if _constant_factor(y)[1] < 0.0:
        return _sum(x, -y)
    if y.op == 'add' and x in y.args:  # x - (x + z) = -z
        other: Scalar = y.args[1] if y.args[0] is x else y.args[0]
        return -other
    if x.op == 'add' and y in x.args:  # (y + z) - y = z
        return x.args[1] if x.args[0] is y else x.args[0]  # type: ignore[no-any-return]
    if x.op == 'sub' and x.args[0] is y:
        subtracted: Scalar = x.args[1]
        return -subtracted
    if x.trace.has('sub', y, x):  # a negation is cheaper than a second subtraction
        return x.trace.node('neg', x.trace.node('sub', y, x))
    return x.trace.node('sub', x, y)


def _product(x: Scalar, y: Scalar) -> Scalar:
    if not isinstance(x, Expr):
        x, y = y, x
    if not isinstance(x, Expr):
        return float(x) * float(y)
    # A constant factor stands last; 0, 1 and -1 fold, signs and factors merge.
    if not isinstance(y, Expr):
        y = float(y)
        if y == 0.0:
            return 0.0
        if y == 1.0:
            return x
        if y == -1.0:
            return -x
        if x.op == 'neg':
            return _product(x.args[0], -y)
        base, factor = _constant_factor(x)
        if factor != 1.0:
            return _product(base, factor * y)
        return x.trace.node('mul', x, y)
    # Signs move outward, where sums absorb them.
    if x.op == 'neg':
        return -_product(x.args[0], y)
    if y.op == 'neg':
        return -_product(x, y.args[0])
    return _commutative('mul', x, y)


def _quotient(x: Scalar, y: Scalar) -> Scalar:
    # A division by a constant is a multiplication.
    if not isinstance(y, Expr):
        return _product(x, 1.0 / y)
    if not isinstance(x, Expr):
        x = float(x)
        if x == 0.0:
            return 0.0
    return y.trace.node('div', x, y)


def operands(node: Expr) -> Sequence[Any]:
    """Return the arguments of a node that are expressions."""
    expressions = []
    for argument in node.args:
        if type(argument) is Expr:
            expressions.append(argument)
    return expressions
