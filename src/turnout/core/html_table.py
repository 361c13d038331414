"""Small tables for notebooks: a heading and rows, escaped, without scripts."""

from collections.abc import Iterable, Sequence
from html import escape

MOST_ROWS = 12
_CELL = "text-align:left;padding:2px 12px 2px 0;vertical-align:top"


def html_table(
    heading: str, rows: Iterable[Sequence[object]], *, columns: Sequence[str] = ()
) -> str:
    """Return a table as HTML.

    Parameters
    ----------
    heading : str
        Above it.
    rows : iterable of sequence
        Texts or numbers; rows after the twelfth are counted, not shown.
    columns : sequence of str
        Headings of the columns, if they have any.

    Examples
    --------
    >>> "<td" in html_table("a < b", [("x", 1.5)]), "a &lt; b" in html_table("a < b", [])
    (True, True)
    """
    given = list(rows)
    lines = [_row("th", columns)] if columns else []
    lines += [_row("td", row) for row in given[:MOST_ROWS]]
    if len(given) > MOST_ROWS:
        lines.append(_row("td", [f"and {len(given) - MOST_ROWS} more"]))
    return (
        f"<div class='turnout'><div><b>{escape(heading)}</b></div>"
        f"<table style='border:none;font-size:90%'>{''.join(lines)}</table></div>"
    )


def _row(tag: str, cells: Sequence[object]) -> str:
    shown = (f"{cell:.5g}" if isinstance(cell, float) else str(cell) for cell in cells)
    inner = "".join(f"<{tag} style='{_CELL}'>{escape(text)}</{tag}>" for text in shown)
    return f"<tr style='background:none'>{inner}</tr>"
