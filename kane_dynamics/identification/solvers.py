"""The libraries of the extra `identify`, imported when they are first needed."""

from importlib import import_module
from typing import Any

from kane_dynamics.errors import InputError


def scientific(module: str) -> Any:
    """Return a module of SciPy or CVXPY; InputError names the extra if it is not installed."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(f"identification needs '{error.name}', which is not installed; pip "
                         "install 'kane_dynamics[identify]'") from None
