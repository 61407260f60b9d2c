"""The interface for repeated parts of an algorithm, which may become subroutines."""

from collections.abc import Callable
from typing import Any

# ``share(name, function, *arrays)`` returns ``function(*arrays)``; it may create a
# subroutine of the function and reuse it for the same name.
Share = Callable[..., Any]


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
