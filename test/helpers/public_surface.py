"""All calls of the public interface, found by introspection so that none is missed."""

from enum import Enum
from importlib import import_module
import inspect
from types import FunctionType

import kane_dynamics

PREFIX = 'kane_dynamics.'


def public_objects():
    """Return the public functions and classes by name, each once."""
    objects = {name: getattr(kane_dynamics, name) for name in kane_dynamics.__all__}
    for package in kane_dynamics._PACKAGES:
        module = import_module(PREFIX + package)
        for name in getattr(module, '__all__', ()):
            value = getattr(module, name)
            if callable(value) and value not in objects.values():
                objects[f'{package}.{name}'] = value
    return objects


def public_functions():
    """Return the public functions by name."""
    return {name: value for name, value in public_objects().items()
            if isinstance(value, FunctionType)}


def public_classes():
    """Return the public classes that users construct: no errors, no results."""
    results = BaseException, Enum, tuple
    return {name: value for name, value in public_objects().items()
            if inspect.isclass(value) and not issubclass(value, results)}


def public_methods(cls):
    """Return the names of the public methods of a class, properties left out."""
    names = []
    for name in dir(cls):
        value = inspect.getattr_static(cls, name)
        if name[0] != '_' and not isinstance(value, property) and callable(
                getattr(cls, name)):
            names.append(name)
    return names
