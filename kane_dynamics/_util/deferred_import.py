"""
Import a module while a large package that it imports is imported at its first use.

`importlib.util.LazyLoader` is no replacement: it loads the package at the first attribute,
and yourdfpy names classes of trimesh in annotations, which the import evaluates, and
imports a submodule of it.
"""

import builtins
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from importlib.util import find_spec, module_from_spec, spec_from_file_location
import logging  # noqa: F401  # before the hooks below
import os
from pathlib import Path
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
    """Stand-in for a package: forwards attributes to the real one if `ready` is set."""

    ready = False

    def __getattr__(self, name: str) -> Any:
        if name.startswith('__'):
            raise AttributeError(name)
        if self.ready:
            return getattr(import_module(self.__name__), name)
        return Any  # for annotations


class _PrivateCopies:
    """
    Private copies of a module and of the submodules that it imports from a package.

    The copies are not in `sys.modules`: other threads never see them, and later imports
    of module and package are ordinary ones. Import statements of the copies find a
    stand-in for the package.

    Parameters
    ----------
    package : str
        Name of the top-level package.

    """

    def __init__(self, package: str) -> None:
        self.stand_in = _DeferredPackage(package)
        self._copies: dict[str, ModuleType] = {package: self.stand_in}

    def load(self, name: str) -> ModuleType:
        """Execute `package.module` as a private copy; ImportError without its file."""
        # The file beside its package, wherever that is installed.
        package, _, last = name.rpartition('.')
        parent = find_spec(package.partition('.')[0])
        folders = (parent and parent.submodule_search_locations) or ['']
        file = Path(folders[0], *name.split('.')[1:]).with_suffix('.py')
        spec = spec_from_file_location(name, file)
        if spec is None or spec.loader is None or not file.is_file():
            raise ImportError(f'{name}: no file {file}')
        copy = module_from_spec(spec)
        # Imports within the copy go to other copies.
        vars(copy)['__builtins__'] = vars(builtins) | {'__import__': self._import}
        self._copies[name] = copy
        spec.loader.exec_module(copy)
        # As an import does: the module is an attribute of its package.
        if package in self._copies:
            vars(self._copies[package])[last] = copy
        return copy

    def _import(self, name: str, variables: Any = None, local: Any = None,
                names: Any = (), level: int = 0) -> Any:
        """Import as the statement does, with copies of the modules of the package."""
        absolute = name
        if level == 1:
            absolute = '.'.join(filter(None, [variables['__package__'], name]))
        package = self.stand_in.__name__
        if self.stand_in.ready or level > 1 or absolute.partition('.')[0] != package:
            return __import__(name, variables, local, names, level)
        copy = self._copies.get(absolute) or self.load(absolute)
        return copy if names else self.stand_in  # `import a.b` binds a


@cache
def import_deferring(module: str, package: str) -> Any:
    """
    Return a module; a package that it imports is imported at its first use.

    The module is a private copy, and so are the submodules of the package that it
    imports itself. If the module needs more of the package, or one of the two is
    imported already, this is a plain import. Threads wait for one another.

    Parameters
    ----------
    module, package : str
        Names of the module, `package.module`, and of the top-level package that it
        imports.

    """
    with _IMPORTING:
        if not {module, package} & set(sys.modules) and find_spec(package) is not None:
            copies = _PrivateCopies(package)
            # A module that needs more of the package than names in annotations fails.
            with suppress(Exception):
                copy = copies.load(module)
                copies.stand_in.ready = True
                return copy
        return import_module(module)
