"""Texts that tell apart the functions that trace programs, for caches."""

from collections.abc import Callable
from functools import partial
from types import CodeType
from typing import Any

PLAIN = (str, int, float, bool, type(None))


def origin(program: Callable[..., Any]) -> str:
    """
    Return a text of the code of a function and of the plain values that it is bound to.

    These are the values of `functools.partial` and of enclosing functions that are functions,
    texts, numbers or tuples of these. Other objects do not count: a key names what they are. The
    text is the same in each process.
    """
    parts: list[str] = []
    _describe(program, parts, set())
    return ' '.join(parts)


def _describe(value: Any, parts: list[str], seen: set[int]) -> None:
    """Append the description of a value."""
    if isinstance(value, PLAIN):
        parts.append(repr(value))
    elif isinstance(value, tuple):
        parts.append('(')
        for x in value:
            _describe(x, parts, seen)
        parts.append(')')
    elif isinstance(value, partial):
        for x in (value.func, *value.args, *value.keywords.values()):
            _describe(x, parts, seen)
    else:
        function = getattr(value, '__func__', value)  # of a method
        code = getattr(function, '__code__', None)
        if isinstance(code, CodeType) and id(function) not in seen:
            seen.add(id(function))
            parts.append(f'{function.__module__}.{function.__qualname__}:{code.co_firstlineno}')
            for cell in function.__closure__ or ():
                try:
                    content = cell.cell_contents
                except ValueError:  # not assigned yet
                    continue
                _describe(content, parts, seen)
