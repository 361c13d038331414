"""Schedules recorded elsewhere: a CSV file with the columns time and fraction."""

import csv
from dataclasses import replace
from pathlib import Path
from typing import Any

from turnout.errors import FileError
from turnout.files.problems import Problem, shortened, show_value
from turnout.files.regular import user_path
from turnout.files.toml import decode, read_bytes
from turnout.files.units import MOST_VALUES, SI
from turnout.panel.document import Document

COLUMNS = ("time", "fraction")

MOST_ROWS = 1_000_000
"""Rows that the movements of a panel take from files, together."""


def read_schedule_files(
    document: Document, *, folder: Path | None
) -> tuple[Document, list[Problem]]:
    """Fill the tables of movements that name a CSV file.

    Parameters
    ----------
    document : Document
        The expanded document.
    folder : Path or None
        Where relative paths start: the folder of the panel file.

    Returns
    -------
    document : Document
        The document with `table_time` and `table_fraction` filled; it keeps what was read, so
        that a panel made from it elsewhere does not need the file.
    problems : list of Problem
        Files that could not be read.
    """
    movements = document.tree.get("movement")
    if not isinstance(movements, dict) or not any(_names_file(item) for item in movements.values()):
        return document, []
    problems: list[Problem] = []
    tables = dict(document.tables)
    filled: dict[str, Any] = {}
    rows = 0
    for name, movement in movements.items():
        filled[name] = movement
        if not _names_file(movement):
            continue
        path = ("movement", name, "table_file")
        given = movement["table_file"]
        if movement.get("table_time") is not None or movement.get("table_fraction") is not None:
            text = f" = {show_value(given)}: give either the file or table_time and table_fraction"
            problems.append(Problem(path, text))
            continue
        try:
            if given not in tables:
                tables[given] = read_schedule_csv((folder or Path()) / user_path(given))
        except FileError as error:
            problems.append(Problem(path, f" = {show_value(given)}: {error}"))
            continue
        time, fraction = tables[given]
        rows += len(time)
        if rows > MOST_ROWS:
            text = f" = {show_value(given)}: the movements have more than {MOST_ROWS} rows together"
            problems.append(Problem(path, f"{text}; give fewer instants"))
            continue
        filled[name] = movement | {
            "table_time": [SI(value) for value in time],
            "table_fraction": fraction,
        }
    tree = document.tree | {"movement": filled}
    return replace(document, tree=tree, tables=tables), problems


def _names_file(movement: object) -> bool:
    return isinstance(movement, dict) and isinstance(movement.get("table_file"), str)


def read_schedule_csv(path: Path) -> tuple[list[float], list[float]]:
    """Read the columns time [s] and fraction [-] of a CSV file.

    Raises
    ------
    FileError
        When the file or a cell cannot be read; the text names the line.
    """
    text = decode(read_bytes(path), source=str(path))
    rows = csv.reader(line for line in text.splitlines() if not line.lstrip().startswith("#"))
    columns: dict[str, list[float]] = {name: [] for name in COLUMNS}
    try:
        header = [cell.strip().lower() for cell in next(rows, [])]
        if sorted(header) != sorted(COLUMNS):
            said = show_value(header)
            message = f"{path}: the first line must name the columns time,fraction; it says {said}"
            raise FileError(message)
        for row in rows:
            if any(cell.strip() for cell in row):
                _add_row(columns, header, row, place=f"{path}: line {rows.line_num}")
    except csv.Error as error:  # such as a cell of more than 131,072 characters
        message = f"{path}: line {rows.line_num}: {error}"
        raise FileError(message) from None
    return columns["time"], columns["fraction"]


def _add_row(
    columns: dict[str, list[float]], header: list[str], row: list[str], *, place: str
) -> None:
    if len(row) != len(header):
        message = f"{place}: {len(row)} cells, must be {len(header)}"
        raise FileError(message)
    if len(columns["time"]) >= MOST_VALUES:
        message = f"{place}: at most {MOST_VALUES} rows are read; give fewer instants"
        raise FileError(message)
    for name, cell in zip(header, row, strict=True):
        try:
            columns[name].append(float(cell))
        except ValueError:
            message = f"{place}: '{shortened(cell.strip())}' is not a number"
            raise FileError(message) from None
