"""Flags over any scalar: 1 or 0, so that a rule needs no branch on a value."""

from typing import Any

from kane_dynamics._util.typing import Scalar
from kane_dynamics.mechanics.algebra.dual import select
import numpy as np

LARGEST = float(np.finfo(np.float64).max)


def flag(condition: Scalar) -> Scalar:
    """Return 1 if a comparison holds, else 0."""
    return select(condition, 1.0, 0.0)


def either(chosen: Scalar, x: Any, y: Any) -> Any:
    """Return x where a flag is 1, else y: numbers, or arrays entry by entry."""
    if isinstance(x, np.ndarray):
        entries = [either(chosen, a, b) for a, b in zip(x, y, strict=True)]
        return np.array(entries)
    return select(chosen > 0.5, x, y)


def finite(numbers: Any) -> Scalar:
    """Return 1 if all numbers are finite, else 0."""
    result: Scalar = 1.0
    for x in numbers:
        result = result * flag(x > -LARGEST) * flag(x < LARGEST)
    return result
