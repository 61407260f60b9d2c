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
    lines = list(rows)
    head = ''.join(f'<th>{escape(name)}</th>' for name in header)
    body = []
    for line in lines[:MOST_ROWS]:
        cells = ''.join(f'<td>{escape(_text(cell))}</td>' for cell in line)
        body.append(f'<tr>{cells}</tr>')
    others = len(lines) - MOST_ROWS
    note = f'<p>and {others} more rows</p>' if others > 0 else ''
    return (f'<p>{escape(title)}</p><table><thead><tr>{head}</tr></thead>'
            f'<tbody>{"".join(body)}</tbody></table>{note}')


def _text(cell: Any) -> str:
    """Return a cell as text."""
    return cell if isinstance(cell, str) else f'{cell + 0.0:.6g}'
