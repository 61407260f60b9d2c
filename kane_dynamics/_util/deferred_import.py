"""Import a module while one of its dependencies is imported at its first use."""

from functools import cache
from importlib import import_module
from importlib.util import find_spec
import sys
from types import ModuleType
from typing import Any


class _Deferred(ModuleType):
    """Stand-in for a package: forwards attributes to the real one once `ready` is set."""

    ready = False

    def __getattr__(self, name: str) -> Any:
        if name.startswith('__'):
            raise AttributeError(name)
        return getattr(import_module(self.__name__), name) if self.ready else Any  # annotations


@cache
def import_deferring(module: str, package: str) -> Any:
    """
    Return a module; a package that it imports is imported at its first use.

    While the module is imported, a stand-in takes the package's place. Submodules of the package
    that the module imports itself are imported at once. If the module needs more of the package,
    or one of the two is imported already, this is a plain import.

    Parameters
    ----------
    module, package : str
        Names of the module, and of the top-level package that it imports.

    """
    spec = find_spec(package)
    if {module, package} & set(sys.modules) or spec is None:
        return import_module(module)
    stand_in = _Deferred(package)
    stand_in.__path__ = spec.submodule_search_locations or []
    sys.modules[package] = stand_in
    try:
        return import_module(module)
    except Exception:  # it needs more of the package than names in annotations
        _forget(module)
    finally:
        _forget(package)
        stand_in.ready = True
    return import_module(module)


def _forget(package: str) -> None:
    """Remove a package and its modules from those imported."""
    for name in [name for name in sys.modules if name.partition('.')[0] == package]:
        del sys.modules[name]
