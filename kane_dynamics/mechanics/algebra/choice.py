"""Choices by a comparison, over any scalar: select, magnitude, largest, smallest."""

from collections.abc import Sequence

from kane_dynamics._util.typing import Scalar
from kane_dynamics.mechanics.algebra.jet import Jet, jet, series_of
import numpy as np


def select(condition: Scalar, x: Scalar, y: Scalar) -> Scalar:
    """Return x if a comparison (`a < b`, over any scalar) holds, else y."""
    if isinstance(condition, bool | int | float | np.bool_):
        return x if condition else y
    if isinstance(x, Jet) or isinstance(y, Jet):
        # All coefficients are of the same branch.
        length = max(len(z.c) for z in (x, y) if isinstance(z, Jet))
        coefficients = []
        for a, b in zip(series_of(x, length), series_of(y, length)):
            coefficients.append(select(condition, a, b))
        return jet(coefficients)
    if isinstance(condition, np.ndarray):  # of many numbers
        return np.where(condition, x, y)
    return condition.select(x, y)


def magnitude(x: Scalar) -> Scalar:
    """Return the magnitude of a number, over any scalar."""
    return select(x < 0.0, -x, x)


def largest(values: Sequence[Scalar]) -> Scalar:
    """Return the largest of several numbers, over any scalar."""
    if len(values) == 1:
        return values[0]
    a = largest(values[::2])
    b = largest(values[1::2])
    return select(a < b, b, a)


def smallest(values: Sequence[Scalar]) -> Scalar:
    """Return the smallest of several numbers, over any scalar."""
    if len(values) == 1:
        return values[0]
    # In pairs, so that the comparisons do not wait for each other.
    a = smallest(values[::2])
    b = smallest(values[1::2])
    return select(b < a, b, a)
