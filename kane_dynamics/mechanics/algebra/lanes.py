"""
Lanes: a row of scalars that one operation computes together.

Algorithms of many joints keep the same quantity of `LANES` joints in one `Lanes` and use it as a
scalar, in arrays of dtype object too. `Lanes` evaluates them one by one over any scalar type; the
tracer has a class with the same functions whose operations are SIMD instructions.
"""

from collections.abc import Callable, Sequence
import operator
from typing import Any

from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np

LANES = 8


class Lanes:
    """Row of `LANES` scalars with elementwise arithmetic; a plain scalar stands for equal ones."""

    __slots__ = ('values',)

    def __init__(self, values: Sequence[Any]) -> None:
        """Create a row; `pack` folds a row of equal values to a scalar."""
        self.values = tuple(values)

    @staticmethod
    def pack(values: Sequence[Any]) -> Any:
        """Return a row of at most `LANES` values, zeros after them."""
        row = [*values, *[0.0] * (LANES - len(values))]
        return row[0] if all(x is row[0] or _same(x, row[0]) for x in row) else Lanes(row)

    @staticmethod
    def lane(row: Any, k: int) -> Any:
        """Return one value of a row."""
        return row.values[k] if isinstance(row, Lanes) else row

    @staticmethod
    def blend(mask: Sequence[bool], a: Any, b: Any) -> Any:
        """Return a row with the values of `a` where the mask is true, and of `b` elsewhere."""
        return Lanes.pack([Lanes.lane(a if chosen else b, k) for k, chosen in enumerate(mask)])

    @staticmethod
    def gathered(rows: Sequence[Any], places: Sequence[tuple[int, int] | None]) -> Any:
        """Return a row of values of rows, each from its (row, lane), or 0."""
        return Lanes.pack([0.0 if place is None else Lanes.lane(rows[place[0]], place[1])
                           for place in places])

    @staticmethod
    def transposed(rows: Sequence[Any]) -> list[Any]:
        """Return the columns of at most `LANES` rows, as rows."""
        return [Lanes.pack([Lanes.lane(row, k) for row in rows]) for k in range(LANES)]

    def _each(self, function: Callable[[Any, Any], Any], other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        return Lanes.pack([function(x, Lanes.lane(other, k)) for k, x in enumerate(self.values)])

    def __add__(self, other: Any) -> Any:
        return self._each(operator.add, other)

    def __sub__(self, other: Any) -> Any:
        return self._each(operator.sub, other)

    def __rsub__(self, other: Any) -> Any:
        return self._each(lambda x, y: y - x, other)

    def __mul__(self, other: Any) -> Any:
        return 0.0 if is_zero(other) else self._each(operator.mul, other)

    def __neg__(self) -> Any:
        return Lanes.pack([-x for x in self.values])

    __radd__ = __add__
    __rmul__ = __mul__


def _same(x: Any, y: Any) -> bool:
    numbers = (int, float)
    return isinstance(x, numbers) and isinstance(y, numbers) and x == y
