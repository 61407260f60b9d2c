"""
Import a module while a large package that it imports is executed at its first use.

`importlib.util.LazyLoader` is no replacement: it executes the package at the first
attribute, and yourdfpy names classes of trimesh in annotations, which the import
evaluates, and imports a submodule of it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec, module_from_spec
import logging  # noqa: F401  # before the hooks below
import os
import sys
import threading
from types import ModuleType
from typing import Any

# A process that is forked during an import inherits locks that no thread of it releases,
# and would wait for them for ever. So a fork waits until the import has ended. Hooks
# `before` a fork run from the last to the first: that of logging, which takes a lock that
# imports need, must come after ours, so logging is imported first.
_IMPORTING = threading.RLock()
os.register_at_fork(before=_IMPORTING.acquire, after_in_parent=_IMPORTING.release,
                    after_in_child=_IMPORTING.release)


@contextmanager
def forks_wait() -> Iterator[None]:
    """Let a fork by another thread wait until the imports of a `with` block have ended."""
    with _IMPORTING:
        yield


class _DeferredPackage(ModuleType):
    """A package whose own code is executed at the first use of a missing attribute."""

    for_annotations = True  # attributes stand in annotations alone
    executed = False

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the package, or Any for an annotation."""
        spec = self.__spec__
        # Searches through `sys.modules`, such as those of `warnings`, execute nothing.
        is_special = name.startswith('__') and name not in ('__all__', '__version__')
        if is_special or spec is None or spec.loader is None:
            raise AttributeError(name)
        with _IMPORTING:  # other threads wait until it is executed
            if self.for_annotations:
                return Any
            if not self.executed:
                self.executed = True  # its own code may look for attributes
                try:
                    spec.loader.exec_module(self)
                except BaseException:
                    self.executed = False  # the next use raises the error again
                    raise
        return super().__getattribute__(name)


def import_deferring(module: str, package: str) -> Any:
    """
    Import a module; a package that it imports is executed at its first use.

    Submodules of the package that the module imports are executed at once. If the
    package is imported already, this is a plain import. Threads wait for one another.

    Parameters
    ----------
    module, package : str
        Names of the module, `package.module`, and of the top-level package that it
        imports.

    """
    with _IMPORTING:
        spec = None
        if package not in sys.modules:
            spec = find_spec(package)
        if spec is None:
            return import_module(module)
        deferred = module_from_spec(spec)
        deferred.__class__ = _DeferredPackage
        sys.modules[package] = deferred
        try:
            return import_module(module)
        finally:
            vars(deferred)['for_annotations'] = False
