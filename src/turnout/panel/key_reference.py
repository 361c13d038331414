"""Every key of a panel file by its table, read off the records."""

import inspect
from collections.abc import Iterator
from dataclasses import dataclass

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from turnout.core.keys import Key, forms_of, records_in
from turnout.panel.model import FAMILIES, PANEL_KEYS, Panel


@dataclass(frozen=True, slots=True)
class TableRows:
    """A table of a panel file, such as `[drive.NAME]`, with its keys.

    Attributes
    ----------
    path : tuple of str
        Of the table; empty for the top of the file. The members of a family are named "NAME".
    meaning : str
        What it describes.
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
