"""Words for messages."""

from collections.abc import Iterable


def listing(names: Iterable[str], most: int = 40) -> str:
    """Return names for an error message, cut where there are very many."""
    found = list(names)
    text = ', '.join(found[:most]) or 'none'
    return text if len(found) <= most else f'{text}, ... and {len(found) - most} more'
