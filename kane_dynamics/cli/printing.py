"""Print tables, JSON, and warnings with short lists of names."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
import json
import math
import re
import sys
from typing import Any, TextIO
import warnings

from kane_dynamics._util.typing import Array
from kane_dynamics.errors import ModelWarning, UnusedWarning
import numpy as np

LONGEST = 180  # characters of a warning
LIST = 4  # entries of a list of names that is shortened
# A name, with a number or a remark in brackets behind it: "joint_1 45.2 rad (limits -1
# to 1)".
_NAME = r'(?:joint |link )?[^\s,;()]+(?: -?\d[\d.e+-]*(?: rad| m)?)?(?: \([^()]*\))?'
ENTRY = re.compile(_NAME)
NAMES = re.compile(rf'(?<=: ){_NAME}(?:, {_NAME}){{{LIST - 1},}}')
ROUNDING = 1e-13  # relative to the largest number of a table


def warn(text: str) -> None:
    """Print a warning."""
    print(f'kane-dynamics: warning: {text}', file=sys.stderr)


@contextmanager
def model_warnings(collected: list[str] | None = None, *, verbose: bool = False
                   ) -> Iterator[None]:
    """
    Collect model warnings in a list, or print them to stderr, also if an error follows.

    Each is printed on one line with long lists of names shortened; warnings of unused
    URDF elements are not printed. `verbose` prints everything.
    """
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter('always', ModelWarning)
        try:
            yield
        finally:
            # Collected for JSON, or printed; long lists are shortened by default.
            for record in records:
                text = str(record.message)
                if collected is not None:
                    collected.append(text)
                elif verbose:
                    warn(text)
                elif not issubclass(record.category, UnusedWarning):
                    warn(brief(text))


@contextmanager
def printed_warnings(*, verbose: bool = False) -> Iterator[None]:
    """
    Print model warnings as `model_warnings` does, as they come.

    For what no other block collects: a user sees no line of the source code.
    """
    def show(message: Warning | str, category: type[Warning], filename: str, lineno: int,
             file: TextIO | None = None, line: str | None = None) -> None:
        if not issubclass(category, ModelWarning):
            former(message, category, filename, lineno, file, line)
        elif verbose:
            warn(str(message))
        elif not issubclass(category, UnusedWarning):
            warn(brief(str(message)))

    # Warnings of other libraries are shown as before.
    with warnings.catch_warnings():
        former = warnings.showwarning
        warnings.showwarning = show
        warnings.simplefilter('always', ModelWarning)
        yield


def brief(text: str) -> str:
    """
    Return a message whose long lists of names are shortened; its sentences stay whole.

    A list follows a colon and has at least `LIST` entries. The last list is shortened
    first, until the message has at most `LONGEST` characters.
    """
    # From the end, so that the places of earlier lists stay valid.
    for names in reversed(list(NAMES.finditer(text))):
        if len(text) <= LONGEST:
            break
        entries = ENTRY.findall(names[0])
        room = len(names[0]) - (len(text) - LONGEST)
        # As many names as fit; a list that lacks one name only stays whole.
        count = 1
        while count < len(entries) and len(', '.join(entries[:count + 1])) <= room:
            count += 1
        left_out = len(entries) - count
        if left_out < 2:
            continue
        shorter = f'{", ".join(entries[:count])} and {left_out} more (--verbose names all)'
        text = text[:names.start()] + shorter + text[names.end():]
    return text


def print_table(header: Sequence[str], rows: Iterable[Iterable[Any]]) -> None:
    """Print a table: texts aligned left, numbers right, with six digits."""
    lines = [list(header)]
    for row in rows:
        lines.append(list(map(_cell, row)))

    # Each column as wide as its longest cell.
    padded = []
    for column in zip(*lines, strict=True):
        width = max(map(len, column))
        is_numeric = all(map(_is_number, column[1:]))
        align = str.rjust if is_numeric else str.ljust
        padded.append([align(cell, width) for cell in column])
    for line in zip(*padded, strict=True):
        print('  '.join(line).rstrip())


def print_section(title: str, header: Sequence[str],
                  rows: Sequence[Sequence[Any]]) -> None:
    """Print an empty line, a title and a table; nothing if the table has no rows."""
    if rows:
        print(f'\n{title}')
        print_table(header, rows)


def _cell(value: Any) -> str:
    """Return a text as it is, and a number with six digits; -0.0 is 0."""
    return value if isinstance(value, str) else f'{value + 0.0:.6g}'


def print_json(value: Any) -> None:
    """Print JSON on one line."""
    print(as_json(value))


def as_json(value: Any) -> str:
    """Return JSON on one line; infinite and missing numbers become null."""
    return json.dumps(plain(value), allow_nan=False)


def plain(value: Any) -> Any:
    """Return plain data for arrays, and for lists and mappings of arrays."""
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def print_files(paths: Iterable[str]) -> None:
    """Print the names of files that were written."""
    for path in paths:
        print(f'wrote {path}')


def without_rounding(values: Array, size: float = 0.0) -> Array:
    """Return numbers with 0 in place of rounding errors of the largest, or of a larger size."""
    largest = max(size, float(np.abs(values).max(initial=0.0)))
    return np.where(np.abs(values) < ROUNDING * largest, 0.0, values)


def _is_number(text: str) -> bool:
    """Return whether a cell of a table is a number, or says that there is none."""
    try:
        float(text)
    except ValueError:
        return text == 'none'
    return True
