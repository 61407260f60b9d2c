"""
Flags over any scalar: 1 or 0, so that a rule needs no branch on a value.

The memory of a rule is a record (NamedTuple) of scalars and arrays.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from kane_dynamics._util.typing import Scalar, Vector
from kane_dynamics.mechanics.algebra.choice import select
import numpy as np

LARGEST = float(np.finfo(np.float64).max)
NUMBER = bool, int, float, np.bool_
Record = TypeVar('Record', bound=NamedTuple)


def flag(condition: Scalar) -> Scalar:
    """Return 1 if a comparison holds, else 0."""
    return select(condition, 1.0, 0.0)


def either(chosen: Scalar, x: Any, y: Any) -> Any:
    """Return x where a flag is 1, else y: numbers, or arrays entry by entry."""
    if isinstance(x, np.ndarray):
        entries = [either(chosen, a, b) for a, b in zip(x, y, strict=True)]
        return np.array(entries)
    return select(chosen > 0.5, x, y)


def branch(chosen: Scalar, x: Record, y: Record) -> Record:
    """Return the record x where a flag is 1, else y."""
    if isinstance(chosen, NUMBER):
        return x if chosen > 0.5 else y
    return x._make([either(chosen, a, b) for a, b in zip(x, y, strict=True)])


def changed_if(chosen: Scalar, record: Record, change: Callable[[Record], Record]
               ) -> Record:
    """
    Return a record after a change where a flag is 1, else the record.

    Where the flag is a number, the change is computed only if it is 1.
    """
    if isinstance(chosen, NUMBER) and not chosen > 0.5:
        return record
    return branch(chosen, change(record), record)


def packed(record: NamedTuple) -> Vector:
    """Return a record as an array: all entries, field by field."""
    return np.concatenate([np.ravel(np.asarray(field)) for field in record])


def finite(numbers: Any) -> Scalar:
    """Return 1 if all numbers are finite, else 0."""
    result: Scalar = 1.0
    for x in numbers:
        result = result * flag(x > -LARGEST) * flag(x < LARGEST)
    return result
