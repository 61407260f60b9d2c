"""Libraries that only some uses need: the extras of the package."""

from importlib import import_module
from typing import Any

from kane_dynamics.errors import InputError


def extra(module: str, name: str, what: str = 'this') -> Any:
    """
    Return an imported module that needs more than the library itself does.

    Parameters
    ----------
    module : str
        A library's, or one of ours that imports it.
    name : str
        The extra of this package that brings the library.
    what : str
        Needs it, for the message.

    Raises
    ------
    InputError
        It is not installed; says what to install.

    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(f"{what} needs '{error.name}', which is not installed; pip install "
                         f"'kane_dynamics[{name}]'") from None
