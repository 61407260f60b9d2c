"""
Lanes: a row of scalars that one operation computes together.

Algorithms of many joints keep the same quantity of `LANES` joints in one `Lanes` and use
it as a scalar, in arrays of dtype object too. `Lanes` evaluates them one by one over any
scalar type; the tracer has a class with the same functions whose operations are SIMD
instructions.
"""

from collections.abc import Callable, Sequence
import operator
from typing import Any

from kane_dynamics._util.typing import Scalar
from kane_dynamics.mechanics.algebra.choice import select
from kane_dynamics.mechanics.algebra.vector import is_zero
import numpy as np

LANES = 8


class Lanes:
    """Row of `LANES` scalars with arithmetic by lane; a scalar stands for equal ones."""

    __slots__ = ('values',)

    def __init__(self, values: Sequence[Scalar]) -> None:
        """Create a row; `pack` folds a row of equal values to a scalar."""
        self.values = tuple(values)

    @staticmethod
    def pack(values: Sequence[Scalar]) -> Any:
        """Return a row of at most `LANES` values, zeros after them."""
        row = [*values, *[0.0] * (LANES - len(values))]
        if all(x is row[0] or _same(x, row[0]) for x in row):
            return row[0]
        return Lanes(row)

    @staticmethod
    def beginning(values: Sequence[Scalar]) -> Any:
        """Return a row of at most `LANES` values, anything after them."""
        # Repeated values take no more operations, and are as good a divisor.
        return Lanes.pack([*values, *[values[-1]] * (LANES - len(values))])

    @staticmethod
    def lane(row: Any, k: int) -> Scalar:
        """Return one value of a row."""
        return row.values[k] if isinstance(row, Lanes) else row

    @staticmethod
    def blend(mask: Sequence[bool], a: Any, b: Any) -> Any:
        """Return a row of values of `a` where the mask is true, else of `b`."""
        values = []
        for k, chosen in enumerate(mask):
            row = a if chosen else b
            values.append(Lanes.lane(row, k))
        return Lanes.pack(values)

    @staticmethod
    def gathered(rows: Sequence[Any], places: Sequence[tuple[int, int] | None]) -> Any:
        """Return a row of values of rows, each from its (row, lane), or 0."""
        values: list[Scalar] = [0.0] * len(places)
        for k, place in enumerate(places):
            if place is not None:
                row, lane = place
                values[k] = Lanes.lane(rows[row], lane)
        return Lanes.pack(values)

    @staticmethod
    def transposed(rows: Sequence[Any]) -> list[Any]:
        """Return the columns of at most `LANES` rows, as rows."""
        columns = []
        for k in range(LANES):
            columns.append(Lanes.pack([Lanes.lane(row, k) for row in rows]))
        return columns

    def _by_lane(self, function: Callable[[Scalar, Scalar], Scalar], other: Any) -> Any:
        """Return a function of this row and another one, lane by lane."""
        if isinstance(other, np.ndarray):
            return NotImplemented
        values = [function(x, Lanes.lane(other, k)) for k, x in enumerate(self.values)]
        return Lanes.pack(values)

    def __add__(self, other: Any) -> Any:
        return self._by_lane(operator.add, other)

    def __sub__(self, other: Any) -> Any:
        return self._by_lane(operator.sub, other)

    def __rsub__(self, other: Any) -> Any:
        return self._by_lane(lambda x, y: y - x, other)

    def __mul__(self, other: Any) -> Any:
        if is_zero(other):
            return 0.0
        return self._by_lane(operator.mul, other)

    def __rtruediv__(self, other: Any) -> Any:
        return self._by_lane(lambda x, y: y / x, other)

    def __lt__(self, other: Any) -> Any:
        return self._by_lane(operator.lt, other)

    def __gt__(self, other: Any) -> Any:
        return self._by_lane(operator.gt, other)

    def select(self, a: Any, b: Any) -> Any:
        """Return `a` in the lanes where this comparison holds, else `b`."""
        values = []
        for k, holds in enumerate(self.values):
            values.append(select(holds, Lanes.lane(a, k), Lanes.lane(b, k)))
        return Lanes.pack(values)

    def __neg__(self) -> Any:
        return Lanes.pack([-x for x in self.values])

    __radd__ = __add__
    __rmul__ = __mul__


def _same(x: Scalar, y: Scalar) -> bool:
    """Return whether two scalars are equal numbers; not for traced values."""
    numbers = (int, float)
    return isinstance(x, numbers) and isinstance(y, numbers) and x == y
