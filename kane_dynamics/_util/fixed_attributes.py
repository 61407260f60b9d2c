"""Classes whose attributes are not assigned where that would have no effect."""

from collections.abc import Callable, Iterable
import difflib
from functools import wraps
from inspect import signature
from typing import Any, TypeVar

Class = TypeVar('Class', bound=type)


def guarded_class(cls: Class) -> Class:
    """
    Decorate a class: after `__init__`, assigning an unknown attribute is an error.

    Attributes that `__init__` made can be replaced later.
    """
    return _guarded(cls, lambda self, name: name not in self.__dict__)


def fixed(cls: Class) -> Class:
    """Decorate a class: after `__init__`, no public attribute can be assigned."""
    return _guarded(cls, lambda self, name: True)


def _guarded(cls: Class, refuses: Callable[[Any, str], bool]) -> Class:
    """Give a class the methods of the decorators."""
    construct = vars(cls)['__init__']

    @wraps(construct)
    def make(self: Any, *values: Any, **named: Any) -> None:
        construct(self, *values, **named)
        if type(self) is cls:  # a subclass goes on
            self.__dict__['_made'] = True

    def assign(self: Any, name: str, value: Any) -> None:
        if name[0] != '_' and '_made' in self.__dict__ and refuses(self, name):
            settable = getattr(type(self), name, None)
            if not (isinstance(settable, property) and settable.fset):
                raise AttributeError(refused(self, name))
        object.__setattr__(self, name, value)
    setattr(cls, '__init__', make)  # noqa: B010
    setattr(cls, '__setattr__', assign)  # noqa: B010
    return cls


def refused(owner: object, name: str, options: tuple[str, ...] = ()) -> str:
    """Return the message for an attribute that must not be assigned."""
    why = 'no such attribute'
    # The argument of the constructor or of a method that changes it, or the closest name.
    if name in options:
        why = (f'it is fixed at construction; expected {type(owner).__name__}'
               f'(..., {name}=...)')
    elif hasattr(type(owner), name) or name in getattr(owner, '__dict__', ()):
        why = 'it is not to be replaced'
    meant = closest(name, [known for known in dir(owner) if known[0] != '_'])
    if why == 'no such attribute' and meant is not None:
        why += f'; expected {meant}'
    for method in ('update', 'tune'):
        function = getattr(type(owner), method, None)
        if function is not None and name in signature(function).parameters:
            why += f'; expected {method}({name}=...)'
    return f"'{type(owner).__name__}' attribute '{name}' cannot be assigned: {why}"


def closest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that a misspelt one probably means, or None."""
    return next(iter(difflib.get_close_matches(name, list(known), 1)), None)
