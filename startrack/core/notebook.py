"""Names and values -> a short text, and a table of HTML for notebooks."""

from __future__ import annotations

import html
from collections.abc import Iterable

Rows = Iterable[tuple[str, ...]]


def short_text(kind: str, rows: Rows) -> str:
    """Name of a class and its values on one line, each with its name.

    >>> short_text("Frame", [("size", "512 x 512"), ("exposure", "80 ms")])
    'Frame(size: 512 x 512, exposure: 80 ms)'
    """
    return f"{kind}({', '.join(f'{row[0]}: {row[1]}' for row in rows)})"


def html_table(title: str, rows: Rows, head: tuple[str, ...] = ()) -> str:
    """A table of HTML; all texts are escaped.

    >>> html_table("<Frame>", [("size", "512 x 512")])
    '<table><caption>&lt;Frame&gt;</caption><tr><td>size</td><td>512 x 512</td></tr></table>'
    """
    lines = [_row("th", head)] if head else []
    lines += [_row("td", row) for row in rows]
    return f"<table><caption>{html.escape(title)}</caption>{''.join(lines)}</table>"


def _row(cell: str, texts: tuple[str, ...]) -> str:
    inner = "".join(f"<{cell}>{html.escape(text)}</{cell}>" for text in texts)
    return f"<tr>{inner}</tr>"
