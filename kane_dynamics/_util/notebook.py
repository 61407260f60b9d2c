"""Tables for notebooks: HTML of the objects that users look at."""

from collections.abc import Iterable, Sequence
from typing import Any

MOST_ROWS = 60


def html_table(title: str, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """
    Return a title and a table as HTML; numbers have six digits.

    Of more than `MOST_ROWS` rows the first are shown, and the number of the others.
    """
    from html import escape  # only notebooks need it

    def row(tag: str, cells: Sequence[Any]) -> str:
        return ''.join(f'<{tag}>{escape(_text(cell))}</{tag}>' for cell in cells)
    lines = list(rows)
    body = ''.join(f'<tr>{row("td", line)}</tr>' for line in lines[:MOST_ROWS])
    table = (f'<table><thead><tr>{row("th", header)}</tr></thead>'
             f'<tbody>{body}</tbody></table>')
    others = len(lines) - MOST_ROWS
    if others > 0:
        table += f'<p>and {others} more rows</p>'
    return f'<p>{escape(title)}</p>{table}'


def _text(cell: Any) -> str:
    """Return a cell as text."""
    return cell if isinstance(cell, str) else f'{cell + 0.0:.6g}'
