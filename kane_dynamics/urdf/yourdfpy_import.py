"""
Import yourdfpy without the mesh libraries that it needs for scenes only.

`import yourdfpy` imports trimesh and with it scipy and networkx, for more than a second of
processor time. Reading a URDF without meshes uses one module of trimesh, its transformations,
which needs NumPy alone. So yourdfpy is imported with a stand-in for trimesh, which imports the
real one at the first use of anything else: yourdfpy's scenes still work.
"""

from functools import cache
from importlib import import_module
from importlib.util import find_spec
import sys
from types import ModuleType
from typing import Any


class _DeferredTrimesh(ModuleType):
    """Stand-in that forwards attributes to trimesh, once `ready` is set."""

    ready = False

    def __getattr__(self, name: str) -> Any:
        if name.startswith('__'):
            raise AttributeError(name)
        return getattr(import_module('trimesh'), name) if self.ready else Any  # an annotation


@cache
def yourdfpy() -> Any:
    """Return the module yourdfpy; import it without trimesh where that is possible."""
    spec = find_spec('trimesh')
    if {'trimesh', 'yourdfpy'} & set(sys.modules) or spec is None:
        return import_module('yourdfpy')
    stand_in = _DeferredTrimesh('trimesh')
    stand_in.__path__ = spec.submodule_search_locations or []
    sys.modules['trimesh'] = stand_in
    try:
        return import_module('yourdfpy')
    except Exception:  # another version, which needs more of trimesh: import all of it below
        _forget('yourdfpy')
    finally:
        _forget('trimesh')
        stand_in.ready = True
    return import_module('yourdfpy')


def _forget(package: str) -> None:
    """Remove a package and its modules from those imported."""
    for name in [name for name in sys.modules if name.partition('.')[0] == package]:
        del sys.modules[name]
