"""
Table of a sweep: a folder of parquet files, one per chunk, written atomically.

Parquet readers read the folder as one table with rows in any order; `read_table` returns
them in order. The folder also holds the description of the sweep and the lock of the
writing process. Readers skip both because of the leading underscore.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import fcntl
from functools import partial
import json
import os
from pathlib import Path
from typing import Any

from kane_dynamics._util.optional_imports import extra
from kane_dynamics.errors import InputError, SweepError
from kane_dynamics.sweep.description import Sweep
from kane_dynamics.sweep.simulator import Columns
import numpy as np

DESCRIPTION, LOCK = '_sweep.json', '_lock'
KEY = b'kane_dynamics.sweep'  # metadata key that identifies a part's sweep and chunk
SHOWN = 12  # digits of a digest in names and messages
needed = partial(extra, name='sweep', what='a sweep')


class SweepTable:
    """
    Folder with the rows of one sweep.

    Parameters
    ----------
    sweep : Sweep
    folder : path

    """

    def __init__(self, sweep: Sweep, folder: str | os.PathLike[str]) -> None:
        """Create the table object without accessing the folder."""
        self.sweep, self.folder, self.digest = sweep, Path(folder), sweep.digest
        self._arrow, self._parquet = needed('pyarrow'), needed('pyarrow.parquet')

    @contextmanager
    def opened(self) -> Iterator[set[int]]:
        """
        Lock the folder in a `with` block; yield the chunks that it holds already.

        Raises
        ------
        InputError
            If the folder has other content; for another sweep, the message names the
            differing entries.
        SweepError
            If another process writes to the folder.

        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with open(self.folder / LOCK, 'ab') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise SweepError(f'{self.folder}: another process is writing this '
                                 'sweep; expected one writer') from None
            self._claim()
            yield self._finished()

    def write(self, chunk: int, columns: Columns) -> None:
        """Write the rows of a chunk atomically."""
        arrow, failed = self._arrow, ~columns['ok']
        arrays = {}
        of_outcome = False  # columns after `error`, which are null in failed trials
        for name, column in columns.items():
            if isinstance(column, np.ndarray):
                mask = failed if of_outcome else None
                arrays[name] = arrow.array(column, mask=mask)
            else:
                texts = list(column)
                if of_outcome:
                    for k in np.flatnonzero(failed).tolist():
                        texts[k] = None
                arrays[name] = arrow.array(texts, type=arrow.string())
            of_outcome = of_outcome or name == 'error'
        metadata = {KEY: self._metadata(chunk)}
        rows = arrow.table(arrays).replace_schema_metadata(metadata)

        # A reader never sees a part of a file: it is written beside, then renamed.
        def content(file: Any) -> None:
            self._parquet.write_table(rows, file, write_page_checksum=True)
        _write(self.folder / self._name(chunk), content)

    def _name(self, chunk: int) -> str:
        """Return the name of the file of a chunk."""
        return f'part-{self.digest[:SHOWN]}-{chunk:07d}.parquet'

    def _metadata(self, chunk: int) -> bytes:
        """Return the metadata that identifies a part."""
        return f'{self.digest} {chunk}'.encode()

    def _claim(self) -> None:
        """Check that the folder belongs to this sweep; create the description if it is empty."""
        path = self.folder / DESCRIPTION
        # Hidden files and the lock do not count.
        content = [entry.name for entry in sorted(self.folder.iterdir())
                   if entry.name != LOCK and not entry.name.startswith('.')]
        if path.name in content:
            self._compare(path)
        elif content:
            raise InputError(f"{self.folder}: holds '{content[0]}' and no sweep; "
                             'expected an empty or a new folder')
        else:
            text = json.dumps({'digest': self.digest, **self.sweep.description},
                              indent=1)
            _write(path, lambda file: file.write(text.encode()))

    def _compare(self, path: Path) -> None:
        """Raise InputError if the folder's description differs from this sweep's."""
        stored = _described(path)
        if stored.get('digest') == self.digest:
            return
        # As read from a file: lists for tuples, numbers as JSON writes them.
        described = json.loads(json.dumps(self.sweep.description))
        differing = [key for key in described if stored.get(key) != described[key]]
        # Of the values, those that differ.
        if differing == ['values']:
            stored_values = stored['values']
            if not isinstance(stored_values, dict):
                stored_values = {}
            values = described['values']
            differing = [name for name in {**values, **stored_values}
                         if values.get(name) != stored_values.get(name)]
        raise InputError(
            f'{self.folder}: holds sweep {str(stored.get("digest"))[:SHOWN]}, not '
            f'{self.digest[:SHOWN]}; they differ in {", ".join(differing)}; expected '
            'another folder')

    def _finished(self) -> set[int]:
        """Return the complete chunks; remove damaged files, which are computed again."""
        # Files that a stopped sweep had not finished.
        for partial_file in self.folder.glob('.*.partial'):
            partial_file.unlink()
        finished = set()
        for chunk in range(self.sweep.chunks):
            path = self.folder / self._name(chunk)
            if path.exists():
                if self._whole(path, chunk):
                    finished.add(chunk)
                else:
                    path.unlink()
        return finished

    def _whole(self, path: Path, chunk: int) -> bool:
        """Return whether a part is undamaged, by its page checksums."""
        try:
            rows = self._parquet.read_table(path, page_checksum_verification=True)
        except (OSError, ValueError):  # Arrow's errors derive from these
            return False
        metadata = rows.schema.metadata or {}
        return bool(metadata.get(KEY) == self._metadata(chunk)
                    and rows['index'].to_pylist() == list(self.sweep.rows(chunk)))


def read_table(folder: str | os.PathLike[str]) -> Any:
    """
    Return the rows of a folder, in order, as a ``pyarrow.Table``.

    Raises
    ------
    InputError
        If it is not the folder of a sweep, has no rows or is damaged.

    """
    arrow = needed('pyarrow')
    parquet = needed('pyarrow.parquet')
    path = Path(folder)
    # Parts of another description may lie in the folder: the digest is in their names.
    digest = str(_described(path / DESCRIPTION).get('digest'))
    parts = sorted(path.glob(f'part-{digest[:SHOWN]}-*.parquet'))
    if not parts:
        raise InputError(f'{path}: no rows; expected at least one finished chunk')
    try:
        tables = [parquet.read_table(part,
                                     page_checksum_verification=True) for part in parts]
    except (OSError, ValueError) as error:
        raise InputError(f'{path}: {error}; expected undamaged files: run the sweep '
                         'again') from None
    return arrow.concat_tables(tables).replace_schema_metadata(None)


def _described(path: Path) -> dict[str, Any]:
    """Return the description stored in a sweep's folder."""
    try:
        description = json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f'{path}: {reason}; expected the folder of a sweep') from None
    if not isinstance(description, dict):
        raise InputError(f'{path}: description: a {type(description).__name__}; '
                         'expected the folder of a sweep')
    return description


def _write(path: Path, content: Any) -> None:
    """Write a file atomically."""
    # A file is complete or absent, also after a loss of power: data first, then its
    # name, then the folder.
    temporary = path.with_name(f'.{path.name}.partial')
    try:
        with open(temporary, 'wb') as file:
            content(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with suppress(FileNotFoundError):
            temporary.unlink()
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
