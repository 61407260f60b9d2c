"""
The table of a sweep: a folder of parquet files, one a chunk, each there whole or not at all.

Any reader of parquet takes the folder for one table, in any order of its rows; `read_table`
returns them in order. Besides, the folder holds the description that its rows are of, and the
lock of the process that writes it; readers skip both for their first letter.
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
KEY = b'kane_dynamics.sweep'  # of a part's own description, in its metadata
SHOWN = 12  # digits of a digest in names and messages
needed = partial(extra, name='sweep', what='a sweep')


class SweepTable:
    """
    The folder of one sweep's rows.

    Parameters
    ----------
    sweep : Sweep
    folder : path

    """

    def __init__(self, sweep: Sweep, folder: str | os.PathLike[str]) -> None:
        """Touch nothing yet."""
        self.sweep, self.folder, self.digest = sweep, Path(folder), sweep.digest
        self._arrow, self._parquet = needed('pyarrow'), needed('pyarrow.parquet')

    @contextmanager
    def opened(self) -> Iterator[set[int]]:
        """
        Hold the folder while the block runs; yield the chunks that are in it already.

        Raises
        ------
        InputError
            The folder holds something else: another sweep, whose differing entries are named.
        SweepError
            Another process is writing it.

        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with open(self.folder / LOCK, 'ab') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise SweepError(f'{self.folder}: another process is writing this sweep; wait '
                                 'for it, or end it') from None
            self._claim()
            yield self._finished()

    def write(self, chunk: int, columns: Columns) -> None:
        """Write the rows of a chunk: complete on the disk before they have their name."""
        arrow, failed = self._arrow, ~columns['ok']
        outcome, arrays = False, {}
        for name, column in columns.items():
            given = {'mask': failed} if outcome and isinstance(column, np.ndarray) else {}
            if outcome and not given:
                column = [None if lost else x for lost, x in zip(failed.tolist(), column)]
            kind = None if isinstance(column, np.ndarray) else arrow.string()
            arrays[name] = arrow.array(column, type=kind, **given)
            outcome = outcome or name == 'error'  # what follows is not known of a failed trial
        rows = arrow.table(arrays).replace_schema_metadata({KEY: self._own(chunk)})

        def content(file: Any) -> None:
            self._parquet.write_table(rows, file, write_page_checksum=True)
        _write(self.folder / self._name(chunk), content)

    def _name(self, chunk: int) -> str:
        return f'part-{self.digest[:SHOWN]}-{chunk:07d}.parquet'

    def _own(self, chunk: int) -> bytes:
        """Return what a part says of itself."""
        return f'{self.digest} {chunk}'.encode()

    def _claim(self) -> None:
        """Check that the folder is of this sweep, or make it so if it is empty."""
        path = self.folder / DESCRIPTION
        other = [entry.name for entry in sorted(self.folder.iterdir())
                 if entry.name != LOCK and not entry.name.startswith('.')]
        if path.name in other:
            self._compare(path)
        elif other:
            raise InputError(f"{self.folder} holds '{other[0]}' and no sweep; expected an empty "
                             'or a new folder')
        else:
            text = json.dumps({'digest': self.digest, **self.sweep.description}, indent=1)
            _write(path, lambda file: file.write(text.encode()))

    def _compare(self, path: Path) -> None:
        """Raise InputError unless the folder's description is this sweep's."""
        found = _described(path)
        if found.get('digest') == self.digest:
            return
        ours = json.loads(json.dumps(self.sweep.description))
        differing = [key for key in ours if found.get(key) != ours[key]]
        if differing == ['values']:
            theirs = found['values'] if isinstance(found['values'], dict) else {}
            differing = [name for name in {**ours['values'], **theirs}
                         if ours['values'].get(name) != theirs.get(name)]
        raise InputError(
            f'{self.folder} holds sweep {str(found.get("digest"))[:SHOWN]}, which is not '
            f'{self.digest[:SHOWN]}: they differ in {", ".join(differing)}; choose another folder')

    def _finished(self) -> set[int]:
        """Return the chunks that are there; remove what is torn, so that it is made again."""
        for left in self.folder.glob('.*.partial'):
            left.unlink()
        found = set()
        for chunk in range(self.sweep.chunks):
            path = self.folder / self._name(chunk)
            if path.exists():
                if self._whole(path, chunk):
                    found.add(chunk)
                else:
                    path.unlink()
        return found

    def _whole(self, path: Path, chunk: int) -> bool:
        """Tell whether a part is what was written: its pages carry checksums."""
        try:
            rows = self._parquet.read_table(path, page_checksum_verification=True)
        except (OSError, ValueError):  # of which Arrow's errors are
            return False
        metadata = rows.schema.metadata or {}
        return bool(metadata.get(KEY) == self._own(chunk)
                    and rows['index'].to_pylist() == list(self.sweep.rows(chunk)))


def read_table(folder: str | os.PathLike[str]) -> Any:
    """
    Return the rows that a folder holds, in order, as a ``pyarrow.SweepTable``.

    Raises
    ------
    InputError
        It is no folder of a sweep.

    """
    arrow, parquet, path = needed('pyarrow'), needed('pyarrow.parquet'), Path(folder)
    digest = str(_described(path / DESCRIPTION).get('digest'))
    parts = sorted(path.glob(f'part-{digest[:SHOWN]}-*.parquet'))
    if not parts:
        raise InputError(f'{path} holds no rows yet')
    try:
        tables = [parquet.read_table(part, page_checksum_verification=True) for part in parts]
    except (OSError, ValueError) as error:
        raise InputError(f'{path}: {error}; run the sweep again to make it anew') from None
    return arrow.concat_tables(tables).replace_schema_metadata(None)


def _described(path: Path) -> dict[str, Any]:
    """Return the description in a sweep's folder."""
    try:
        found = json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f'{path}: {reason}; expected the folder of a sweep') from None
    if not isinstance(found, dict):
        raise InputError(f'{path} holds a {type(found).__name__}; expected the folder of a sweep')
    return found


def _write(path: Path, content: Any) -> None:
    """Write a file whole or not at all, whatever ends this process or this machine."""
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
