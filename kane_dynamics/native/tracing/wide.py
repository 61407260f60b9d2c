"""
Traced lanes: rows of scalars whose operations are SIMD instructions.

`WideLanes` has the functions of `kane_dynamics.mechanics.algebra.lanes.Lanes`. Its nodes
are part of the graph beside those of scalars: 'pack' makes a row of scalars, 'lane'
takes a scalar out of one. Only the LLVM back end for single states generates them.
"""

from collections.abc import Sequence
from typing import Any

from kane_dynamics.mechanics.algebra.lanes import LANES
from kane_dynamics.mechanics.algebra.vector import is_zero
from kane_dynamics.native.tracing.expression import Expr, Trace
import numpy as np


class WideLanes:
    """Rows of `LANES` traced scalars; a plain scalar stands for equal ones."""

    def __init__(self, trace: Trace) -> None:
        """Record in a graph."""
        self.trace = trace

    def pack(self, values: Sequence[Any]) -> Any:
        """Return a row of at most `LANES` values, zeros after them."""
        # Fill the row with zeros; equal values are a scalar.
        row = [x if isinstance(x, Expr) else float(x) for x in (
            *values, *[0.0] * (LANES - len(values)))]
        first = row[0]
        if all(x is first or (isinstance(x, float) and x == first) for x in row):
            return first
        if isinstance(first, Expr) and first.op == 'lane' and all(
                isinstance(x, Expr) and x.op == 'lane' and x.args == (first.args[0], k)
                for k, x in enumerate(row)):
            return Wide(first.args[0])  # the values of one row in their places
        return Wide(self.trace.node('pack', *row))

    def beginning(self, values: Sequence[Any]) -> Any:
        """Return a row of at most `LANES` values, anything after them."""
        first = values[0]
        if isinstance(first, Expr) and first.op == 'lane' and all(
                isinstance(x, Expr) and x.op == 'lane' and x.args == (first.args[0], k)
                for k, x in enumerate(values)):
            return Wide(first.args[0])
        return self.pack(values)

    def lane(self, row: Any, k: int) -> Any:
        """Return one value of a row."""
        if not isinstance(row, Wide):
            return row
        # A packed row has its scalars as operands, so that none is taken out.
        return row.node.args[k] if row.node.op == 'pack' else (
            self.trace.node('lane', row.node, k))

    def blend(self, mask: Sequence[bool], a: Any, b: Any) -> Any:
        """Return a row of `a` where the mask is true, and of `b` elsewhere."""
        if all(mask) or not any(mask):
            return a if all(mask) else b
        return Wide(self.trace.node('blend', row_of(self.trace, a),
                                    row_of(self.trace, b), tuple(mask)))

    def gathered(self, rows: Sequence[Any],
                 places: Sequence[tuple[int, int] | None]) -> Any:
        """Return a row of values of rows, each from its (row, lane), or 0."""
        # One shuffle for each source row; lane LANES stands for 0, and the results are
        # disjoint.
        result: Any = 0.0
        for source in sorted({place[0] for place in places if place is not None}):
            chosen = tuple(LANES if place is None or place[0] != source else place[1]
                           for place in places)
            result = result + Wide(self.trace.node('gather',
                                                   row_of(self.trace, rows[source]),
                                                   chosen))
        return result

    def transposed(self, rows: Sequence[Any]) -> list[Any]:
        """Return the columns of at most `LANES` rows, as rows."""
        rows = [*rows, *[0.0] * (LANES - len(rows))]
        tile = self.trace.node('transposed', *(row_of(self.trace, row) for row in rows))
        return [Wide(self.trace.node('column', tile, k)) for k in range(LANES)]


class Wide:
    """Traced row of scalars, not all equal, with elementwise arithmetic."""

    __slots__ = ('node',)

    def __init__(self, node: Expr) -> None:
        """Wrap a node whose value is a row."""
        self.node = node

    def _with(self, op: str, other: Any, reverse: bool = False) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        pair = self.node, row_of(self.node.trace, other)
        return Wide(self.node.trace.node(f'wide_{op}',
                                         *(pair[::-1] if reverse else pair)))

    def __add__(self, other: Any) -> Any:
        return self if is_zero(other) else self._with('add', other)

    def __radd__(self, other: Any) -> Any:
        return self if is_zero(other) else self._with('add', other, reverse=True)

    def __sub__(self, other: Any) -> Any:
        return self if is_zero(other) else self._with('sub', other)

    def __rsub__(self, other: Any) -> Any:
        return -self if is_zero(other) else self._with('sub', other, reverse=True)

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, (int, float)) and other in (0.0, 1.0):
            return self if other else 0.0
        return self._with('mul', other)

    def __rtruediv__(self, other: Any) -> Any:
        return self._with('div', other, reverse=True)

    def __lt__(self, other: Any) -> Any:
        return self._with('less', other)

    def __gt__(self, other: Any) -> Any:
        return self._with('less', other, reverse=True)

    def select(self, a: Any, b: Any) -> Any:
        """Return `a` in the lanes where this comparison holds, else `b`."""
        trace = self.node.trace
        return Wide(trace.node('wide_select', self.node, row_of(trace, a),
                               row_of(trace, b)))

    def __neg__(self) -> 'Wide':
        return Wide(self.node.trace.node('wide_neg', self.node))

    __rmul__ = __mul__


def row_of(trace: Trace, x: Any) -> Expr:
    """Return the node of a row; a scalar in every lane if `x` is one."""
    if isinstance(x, Wide):
        return x.node
    return trace.node('pack', *[x if isinstance(x, Expr) else float(x)] * LANES)
