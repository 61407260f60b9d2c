"""Format names and values for messages."""

from collections.abc import Iterable, Sequence
from reprlib import Repr

SHORT = Repr()  # bounded: with aliases, a few bytes of YAML can mean gigabytes of text
SHORT.maxlevel, SHORT.maxstring, SHORT.maxother = 3, 60, 60


def listing(names: Iterable[str], most: int = 40) -> str:
    """Return names for an error message; only the first `most` if there are more."""
    found = list(names)
    text = ', '.join(found[:most]) or 'none'
    return text if len(found) <= most else f'{text}, ... and {len(found) - most} more'


def short(names: Sequence[str], most: int = 8) -> str:
    """Return names in one line: all, or the first ones, a number, and the last."""
    if len(names) <= most:
        return ', '.join(names) or 'no coordinates'
    return f'{", ".join(names[:most - 2])}, {len(names) - most + 1} more, {names[-1]}'
