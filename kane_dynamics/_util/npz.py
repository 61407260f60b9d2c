"""Files of NumPy arrays."""

from collections.abc import Callable
import os
from typing import Any
import zipfile
import zlib

from kane_dynamics.errors import InputError
import numpy as np


def npz_arrays(path: str | os.PathLike[str],
               wanted: Callable[[str], bool] = lambda name: True) -> dict[str, Any]:
    """
    Return the arrays of an npz file whose names are wanted, by name.

    Raises
    ------
    InputError
        It is no npz file, or a damaged one.
    OSError
        It cannot be read.

    """
    try:
        with open(path, 'rb') as stream:  # NumPy leaves that of a damaged file open
            file = np.load(stream, allow_pickle=False)
            if isinstance(file, np.ndarray):
                raise ValueError('a single array')
            return {name: file[name] for name in file.files if wanted(name)}
    except (EOFError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(f'{os.fspath(path)}: {error}; expected an npz file') from None
