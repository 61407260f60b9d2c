"""Import optional libraries: the extras of the package."""

from importlib import import_module
from typing import Any

from kane_dynamics.errors import InputError


def extra(module: str, name: str, what: str) -> Any:
    """
    Import and return a module that requires an extra of the package.

    Parameters
    ----------
    module : str
        A library, or a module of this package that imports it.
    name : str
        The extra that installs the library.
    what : str
        The feature that needs it, for the message.

    Raises
    ------
    InputError
        If the library is not installed; the message names the command that installs it.

    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(f"{what}: '{error.name}' is not installed; expected pip "
                         f"install 'kane_dynamics[{name}]'") from None
