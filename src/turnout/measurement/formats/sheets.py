"""Workbooks (.xlsx, .xls, .ods) and HTML tables: their cells as a text table."""

import datetime
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

from turnout.core.errors import FileError
from turnout.measurement.formats.extent import Declared
from turnout.measurement.formats.file_table import Table
from turnout.measurement.formats.text_dialect import encoding_of
from turnout.measurement.formats.text_table import text_table

Rows = Iterable[Sequence[object]]


def read_workbook(path: Path) -> list[Table | FileError]:
    """Read the sheets of a workbook that hold numbers.

    Parameters
    ----------
    path : Path
        Workbook of Excel or LibreOffice.

    Raises
    ------
    FileError
        When all sheets are empty.
    """
    import python_calamine

    declared = Declared(path)
    sheets: dict[str, Rows] = {}
    with python_calamine.CalamineWorkbook.from_path(str(path)) as book:
        for name in book.sheet_names:
            sheet = book.get_sheet_by_name(name)
            declared.add(sheet.total_height * sheet.total_width)
            sheets[name] = sheet.to_python(skip_empty_area=False)
    return _tables(path, sheets)


def read_html(path: Path) -> list[Table | FileError]:
    """Read the tables of an HTML file, as monitoring servers write them under the name .xls.

    Parameters
    ----------
    path : Path
        HTML file.

    Raises
    ------
    FileError
        When all tables are empty.
    """
    content = path.read_bytes()
    parser = _Tables()
    parser.feed(content.decode(encoding_of(content), errors="replace"))
    sheets = {f"table {n}": rows for n, rows in enumerate(parser.tables, start=1)}
    return _tables(path, sheets)


class _Tables(HTMLParser):
    """Cells of the tables of an HTML text."""

    def __init__(self) -> None:
        super().__init__()
        self.tables: list[list[list[str]]] = []
        self._cells: list[str] | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self.tables.append([])
        elif tag == "tr" and self.tables:
            self.tables[-1].append([])
        elif tag in ("td", "th") and self.tables and self.tables[-1]:
            self._cells = self.tables[-1][-1]
            self._cells.append("")

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th"):
            self._cells = None

    def handle_data(self, data: str) -> None:
        if self._cells:
            self._cells[-1] += data


def _tables(path: Path, sheets: Mapping[str, Rows]) -> list[Table | FileError]:
    """Return the table of each sheet that is not empty, or why it holds none."""
    found: list[Table | FileError] = []
    for name, rows in sheets.items():
        content = _text(rows).encode()
        if not content.strip():
            continue
        try:
            table = text_table(content, source=f"{path}, sheet '{name}'")
            found.append(replace(table, title=name))
        except FileError as error:
            found.append(error)
    if not found:
        message = f"{path}: its sheets are empty"
        raise FileError(message)
    return found


def _text(rows: Rows) -> str:
    """Return rows as lines with tabs; the last empty columns and rows are left out."""
    lines = ["\t".join(_cell(cell) for cell in row) for row in rows]
    width = max((len(line.rstrip("\t").split("\t")) for line in lines), default=0)
    text = "".join("\t".join(line.split("\t")[:width]) + "\n" for line in lines)
    return text.rstrip("\t\n") + "\n"


def _cell(cell: object) -> str:
    if isinstance(cell, datetime.datetime):
        return cell.isoformat(sep=" ")
    if isinstance(cell, datetime.timedelta):
        hours, rest = divmod(cell.total_seconds(), 3600.0)
        return f"{hours:02.0f}:{rest // 60:02.0f}:{rest % 60:09.6f}"
    if isinstance(cell, float):
        return repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    text = "" if cell is None else str(cell)
    return f'"{text}"' if "\t" in text else " ".join(text.replace('"', "").split())
