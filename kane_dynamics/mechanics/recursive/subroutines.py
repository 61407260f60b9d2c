"""How parts of an algorithm that many joints have in common may be used again."""

from collections.abc import Callable
from typing import Any

# ``share(name, function, *arrays)`` returns ``function(*arrays)``; it may make a subroutine of
# the function and use that again for the same name.
Share = Callable[..., Any]


def directly(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """
    Return ``function(*arguments)``: share no subroutines.

    Parameters
    ----------
    name : str
        The same wherever `function` computes the same.
    function : callable
        Takes arrays of one dimension and returns one; it may refer to nothing that varies but
        its arguments.
    *arguments : arrays

    """
    return function(*arguments)
