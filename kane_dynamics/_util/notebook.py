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
        """Return a row, whose cells are of the tag td or th."""
        html = ''
        for cell in cells:
            text = escape(_text(cell))
            html += f'<{tag}>{text}</{tag}>'
        return f'<tr>{html}</tr>'
    # A notebook that shows thousands of rows is slow.
    lines = list(rows)
    body = ''.join(row('td', line) for line in lines[:MOST_ROWS])
    head = row('th', header)
    table = f'<table><thead>{head}</thead><tbody>{body}</tbody></table>'
    others = len(lines) - MOST_ROWS
    if others > 0:
        table += f'<p>and {others} more rows</p>'
    return f'<p>{escape(title)}</p>{table}'


def _text(cell: Any) -> str:
    """Return a cell as text."""
    return cell if isinstance(cell, str) else f'{cell + 0.0:.6g}'
