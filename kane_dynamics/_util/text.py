"""Words for messages."""

from collections.abc import Iterable, Sequence


def listing(names: Iterable[str], most: int = 40) -> str:
    """Return names for an error message, cut where there are very many."""
    found = list(names)
    text = ', '.join(found[:most]) or 'none'
    return text if len(found) <= most else f'{text}, ... and {len(found) - most} more'


def short(names: Sequence[str], most: int = 8) -> str:
    """Return names in one line: all, or of many the first, how many more, and the last."""
    if len(names) <= most:
        return ', '.join(names) or 'no coordinates'
    return f'{", ".join(names[:most - 2])}, {len(names) - most + 1} more, {names[-1]}'
