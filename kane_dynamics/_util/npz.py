"""Read files of NumPy arrays."""

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
    Return the arrays of an npz file by name, those for which `wanted(name)` is true.

    Raises
    ------
    InputError
        If it is not an npz file, or is damaged.
    OSError
        If it cannot be read.

    """
    try:
        with open(path, 'rb') as stream:  # NumPy does not close a damaged file
            file = np.load(stream, allow_pickle=False)
            if isinstance(file, np.ndarray):
                raise ValueError('a single array')
            return {name: file[name] for name in file.files if wanted(name)}
    except (EOFError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        # NumPy takes any other file for a pickle, and advises to load it as one.
        reason = 'another format, or Python objects' if 'pickle' in str(error) else error
        raise InputError(f'{os.fspath(path)}: {reason}; expected an npz file') from None
