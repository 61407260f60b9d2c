"""Write files atomically: the whole content, or no change to the file."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import os
from pathlib import Path
from typing import Any

FLAGS = os.O_WRONLY | os.O_CREAT | os.O_EXCL


@contextmanager
def whole_file(path: str | os.PathLike[str], *, binary: bool = False) -> Iterator[Any]:
    """
    Yield a stream whose content becomes the file at the end, unless an error occurs.

    It is written beside the file and then takes its name. So a full disk leaves no part
    of a file, and a former file stays. What is no regular file, such as a pipe, is
    written directly.

    Parameters
    ----------
    path : path
        The file; a link stays one.
    binary : bool
        Whether the stream takes bytes instead of text, which is UTF-8.

    Raises
    ------
    OSError
        The file cannot be written; its `filename` is the path.

    """
    options: dict[str, Any] = {'mode': 'w', 'encoding': 'utf-8', 'newline': ''}
    if binary:
        options = {'mode': 'wb'}

    # A pipe or a device is written itself; a file by another one beside it.
    target = Path(os.path.realpath(path))
    special = target.exists() and not target.is_file()
    temporary = target
    if not special:
        temporary = target.with_name(f'.{target.name[:100]}.{os.urandom(4).hex()}')
    try:
        handle = os.open(temporary, os.O_WRONLY if special else FLAGS, 0o666)
        with os.fdopen(handle, **options) as stream:
            yield stream
        if not special:
            os.replace(temporary, target)
    except OSError as error:
        if error.filename not in (None, str(temporary)):
            raise  # of another file
        raise OSError(error.errno, error.strerror, os.fspath(path)) from None
    finally:
        if not special:
            with suppress(OSError):  # it has the name of the file then
                temporary.unlink()
