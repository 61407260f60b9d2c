"""Interfaces for repeated parts of an algorithm, which may become subroutines or loops."""

from collections.abc import Callable
from typing import Any

from kane_dynamics._util.typing import Vector
import numpy as np

# ``share(name, function, *arrays)`` returns ``function(*arrays)``; it may create a
# subroutine of the function and reuse it for the same name.
Share = Callable[..., Any]
# ``repeat(name, step, carry, *tables)`` is `one_by_one`; it may create a loop.
Repeat = Callable[..., Any]


def directly(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """
    Return ``function(*arguments)`` without a subroutine.

    Parameters
    ----------
    name : str
        Identifies what `function` computes.
    function : callable
        Takes one-dimensional arrays and returns one. It must not use varying data other
        than its arguments.
    *arguments : arrays

    """
    return function(*arguments)


def one_by_one(name: str, step: Callable[..., Vector], carry: Vector, *tables: Any,
               reverse: bool = False) -> Any:
    """
    Return the results of a step for each row of tables, (count, c + r), without a loop.

    Parameters
    ----------
    name : str
        Identifies what `step` computes.
    step : callable
        Takes the carry, (c,), and a row of each table; returns the next carry and r
        further results, (c + r,). It must not use varying data other than its arguments.
    carry : (c,) array
        Of the first step.
    *tables : (count, m) arrays
        Each with m of its own.
    reverse : bool
        From the last row to the first.

    """
    count = len(tables[0])
    places = list(range(count))
    if reverse:
        places.reverse()
    results: list[Any] = [None] * count
    for k in places:
        results[k] = step(carry, *(table[k] for table in tables))
        carry = results[k][:len(carry)]
    return np.array(results)
