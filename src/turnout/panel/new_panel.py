"""Every key of a panel file by its table, and the text of a file to edit that says what each means.

That text is another panel's, with the meaning of each key above it.

Values, comments and origins of the panel that it is made from stay as they are. Optional keys that
it lacks stand at their tables as comments, with their defaults; tables that it lacks at the end.
"""

import inspect
import json
import os
import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from turnout.core.keys import NONE, REQUIRED, Key, forms_of, records_in
from turnout.core.library import names_a_file
from turnout.core.toml import TomlLayout, decode, parse_toml, read_bytes, read_layout, with_value
from turnout.panel.load import library_text, load_panel, panel_source
from turnout.panel.model import FAMILIES, PANEL_KEYS, Panel

MARK = "written by `turnout panel new`"
WIDTH = 98
_FILE_KEYS, _LIBRARY_OR_FILE = ("matrices", "table_file"), ("limits",)

KeyPath = tuple[str, ...]


def names_other_file(key: str, value: object) -> bool:
    """Return True if the value of a key is a path, relative to the file that it stands in.

    Examples
    --------
    >>> names_other_file("limits", "own.toml"), names_other_file("limits", "immediate-action")
    (True, False)
    """
    if not isinstance(value, str):
        return False
    return key in _FILE_KEYS or (key in _LIBRARY_OR_FILE and names_a_file(value.strip()))


@dataclass(frozen=True, slots=True)
class TableRows:
    """A table of a panel file, such as `[drive.NAME]`, with its keys.

    Attributes
    ----------
    path : tuple of str
        Of the table; empty for the top of the file. The members of a family are named "NAME".
    meaning : str
        Comment above it in a new panel file.
    keys : tuple of Key
        Those that take a value; tables within it follow as tables of their own.
    """

    path: tuple[str, ...]
    meaning: str
    keys: tuple[Key, ...]

    @property
    def header(self) -> str:
        """The table as TOML writes it."""
        return f"[{'.'.join(self.path)}]"


def key_tables() -> list[TableRows]:
    """List all tables of a panel file and their keys, in the order of the records.

    Examples
    --------
    >>> [key.name for key in key_tables()[0].keys][:2]
    ['schema_version', 'name']
    """
    single = {n: list(records_in(i.annotation)) for n, i in Panel.model_fields.items()}
    top = [n for n, records in single.items() if n not in FAMILIES and not records]
    found = [TableRows((), "What holds for the whole panel.", _keys((), top))]
    for name, records in single.items():
        if name in FAMILIES:
            found += _tables((name, "NAME"), FAMILIES[name])
        for record in records:
            found += _tables((name,), record)
    return found


def _keys(path: tuple[str, ...], names: list[str]) -> tuple[Key, ...]:
    found = [PANEL_KEYS.find(".".join((*path, name))) for name in names]
    return tuple(key for key in found if key is not None)


def _tables(path: tuple[str, ...], record: type[BaseModel]) -> Iterator[TableRows]:
    """Yield a table, then those within it."""
    fields = record.model_fields.items()
    meaning = " ".join((inspect.getdoc(record) or "").split("\n\n")[0].split())
    yield TableRows(path, meaning, _keys(path, [n for n, i in fields if not _only_table(i)]))
    for name, info in fields:
        for inner in records_in(info.annotation):
            yield from _tables((*path, name), inner)


def _only_table(info: FieldInfo) -> bool:
    """Return True if a key takes a table and nothing else."""
    forms = {form for form in forms_of(info.annotation) if form is not type(None)}
    return bool(forms) and all(
        isinstance(form, type) and issubclass(form, BaseModel) for form in forms
    )


def new_panel_text(source: str | FilePath, *, target: FilePath) -> str:
    """Return the text of a panel file that starts from another panel.

    Parameters
    ----------
    source : str or Path
        Library panel or panel file; must be valid.
    target : Path
        File to be written: its stem becomes the name of the panel, and paths in the text are made
        relative to its folder.

    Returns
    -------
    str
        TOML. But for its name and description it is the same panel as `source`.

    Raises
    ------
    FileError, PanelError
        When the source cannot be read, or is not a valid panel.

    Examples
    --------
    >>> text = new_panel_text("sb1", target=FilePath("mine.toml"))
    >>> "# bushing below saturation [N/m]" in text
    True
    """
    panel = load_panel(source)
    found = panel_source(source)
    if isinstance(found, FilePath):
        text = decode(read_bytes(found), source=str(found))
        text = _moved(text, found.resolve().parent, target.resolve().parent)
    else:
        text = library_text(found)
    text = with_value(text, ("name",), json.dumps(target.stem, ensure_ascii=False))
    if MARK in text:
        return text
    if ("description",) in read_layout(text).values:
        made = f"Made from {panel.name}: say what switch it is, and where its numbers are from."
        text = with_value(text, ("description",), json.dumps(made, ensure_ascii=False))
    head = f"""\
# A panel {MARK} from {panel.name}.
# Change what differs on your switch, then run `turnout panel check {target.name}`.
# A dimensional value is text with its unit. The comment behind a value says where it comes from:
# "source: ...", "paper: ...", "computed: ..." or "assumption: ..."; change it with the value.
# A line "# key = value" is an optional key with its default. All keys: docs/use/panel-file.md

"""
    return head + _with_notes(text, read_layout(text)) + "".join(_missing_tables(text))


def _moved(text: str, folder: FilePath, target: FilePath) -> str:
    """Return a text whose relative paths start at another folder."""
    data = parse_toml(text, source="panel").data
    for path in read_layout(text).values if folder != target else ():
        value: Any = data
        for part in path:
            value = value[part]
        if names_other_file(path[-1], value) and not FilePath(value).is_absolute():
            moved = FilePath(os.path.relpath(folder / value, target)).as_posix()
            text = with_value(text, path, json.dumps(moved, ensure_ascii=False))
    return text


def _with_notes(text: str, layout: TomlLayout) -> str:
    """Put the meaning of each key above its first line, and optional keys behind their table."""
    notes: dict[int, list[str]] = {}
    rows = {row.path: row for table in key_tables() for row in table.keys}
    for path, (start, _) in layout.values.items():
        row = rows.pop(_generic(path), None)
        if row is not None and path[:-1] in (*layout.headers, ()):
            notes[text.rfind("\n", 0, start) + 1] = _meaning(row)
    for at, table in _table_ends(text, layout):
        notes.setdefault(at, []).extend(_optional(table, layout))
    pieces, last = [], 0
    for at in sorted(notes):
        pieces += [text[last:at], *(f"{line}\n" for line in notes[at])]
        last = at
    return "".join([*pieces, text[last:]])


def _generic(path: KeyPath) -> KeyPath:
    """Return a key path with "NAME" for the member of a family, also if it names none."""
    if path[0] not in FAMILIES:
        return path
    fields = FAMILIES[path[0]].model_fields
    rest = path[1:] if len(path) > 1 and path[1] in fields else path[2:]
    return (path[0], "NAME", *rest)


def _meaning(row: Key) -> list[str]:
    unit = f" [{row.unit}]" if row.unit else ""
    return _comment(f"{row.meaning}{unit}")


def _comment(text: str) -> list[str]:
    return textwrap.wrap(
        text, WIDTH, initial_indent="# ", subsequent_indent="# ", break_long_words=False
    )


def _table_ends(text: str, layout: TomlLayout) -> Iterator[tuple[int, TableRows]]:
    """Yield the first table of each kind and the place behind its last value."""
    tables = {table.path: table for table in key_tables()}
    ends = dict(layout.headers)
    for path, (_, end) in layout.values.items():
        header = next(path[:n] for n in range(len(path), -1, -1) if path[:n] in (*ends, ()))
        if header:
            line = text.find("\n", end) + 1 or len(text)
            ends[header] = max(ends[header], line)
    for header, end in ends.items():
        table = tables.pop(_generic(header), None)
        if table is not None:
            yield end, table


def _optional(table: TableRows, layout: TomlLayout) -> list[str]:
    """Return the keys that no table of this kind in the text has, as comments."""
    given = {_generic(path) for path in (*layout.values, *layout.headers)}
    lines = []
    for row in table.keys:
        if row.path in given or row.default == REQUIRED:
            continue
        unit = f" [{row.unit}]" if row.unit else ""
        written = row.default.startswith('"') or row.default in ("true", "false")
        written |= row.default.replace(".", "").isdigit()
        said = "" if written or row.default == NONE else f"; default {row.default}"
        value = row.default if written else "..."
        lines += _comment(f"{row.path[-1]} = {value}  # {row.meaning}{unit}{said}")
    return lines


def _missing_tables(text: str) -> Iterable[str]:
    """Name the tables that the text lacks."""
    headers = {_generic(path)[0] for path in read_layout(text).headers}
    lines = [
        line
        for table in key_tables()
        if table.path and table.path[0] not in headers and len(table.path) <= 2
        for line in _comment(f"{table.header}  {table.meaning}")
    ]
    yield "\n# Tables that this panel does not have; docs/use/panel-file.md lists their keys:\n"
    yield from (f"{line}\n" for line in lines)
