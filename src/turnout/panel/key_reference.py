"""Every key of a panel file with unit, meaning, default and range, read off the records."""

import inspect
import re
import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from turnout.core.quantity import unit_of
from turnout.panel.document import FAMILIES
from turnout.panel.keys import records_in
from turnout.panel.model import Panel
from turnout.panel.records import StressFree

REQUIRED, NONE = "required", "none"
_NUMBERS = {float: "number", int: "whole number", bool: "true or false", str: "text"}
_UNIT = re.compile(r"\s*\[[^\]]+\]")
_DEFAULT = re.compile(r"(?:[;,] |^)default:? (.+)$")


@dataclass(frozen=True, slots=True)
class KeyRow:
    """A key of a panel file: unit, meaning, default and range.

    Attributes
    ----------
    path : tuple of str
        From the top of the file; the members of a family are named "NAME".
    unit : str
        SI unit; empty for numbers without one and texts.
    meaning : str
        Without the unit.
    default : str
        What is taken where the key is left out; "required" where the file must give it.
    allowed : str
        Range in SI, or the texts to choose from; empty where anything of its kind is.
    """

    path: tuple[str, ...]
    unit: str
    meaning: str
    default: str
    allowed: str


@dataclass(frozen=True, slots=True)
class TableRows:
    """A table of a panel file, such as `[drive.NAME]`, with its keys.

    Attributes
    ----------
    path : tuple of str
        Of the table; empty for the top of the file.
    meaning : str
        What it describes.
    keys : tuple of KeyRow
        Those that take a value; tables within it follow as tables of their own.
    """

    path: tuple[str, ...]
    meaning: str
    keys: tuple[KeyRow, ...]

    @property
    def header(self) -> str:
        """The table as TOML writes it."""
        return f"[{'.'.join(self.path)}]"


def key_tables() -> list[TableRows]:
    """List all tables of a panel file and their keys, in the order of the records.

    Examples
    --------
    >>> [row.path for row in key_tables()[0].keys][:2]
    [('schema_version',), ('name',)]
    """
    top = [
        (name, info)
        for name, info in Panel.model_fields.items()
        if name not in FAMILIES and not _own_records(info)
    ]
    found = [
        TableRows(
            (), "What holds for the whole panel.", tuple(_row((name,), info) for name, info in top)
        )
    ]
    for name, info in Panel.model_fields.items():
        if name in FAMILIES:
            found += _tables((name, "NAME"), FAMILIES[name])
        for record in () if name in FAMILIES else _own_records(info):
            found += _tables((name,), record)
    return found


def _own_records(info: FieldInfo) -> list[type[BaseModel]]:
    return list(dict.fromkeys(records_in(info.annotation)))


def _tables(path: tuple[str, ...], record: type[BaseModel]) -> Iterator[TableRows]:
    """Yield a table, then those within it."""
    fields = record.model_fields.items()
    rows = tuple(_row((*path, name), info) for name, info in fields if not _only_table(info))
    meaning = " ".join((inspect.getdoc(record) or "").split("\n\n")[0].split())
    yield TableRows(path, meaning, rows)
    for name, info in fields:
        for inner in _own_records(info):
            yield from _tables((*path, name), inner)


def _only_table(info: FieldInfo) -> bool:
    """Return True if a key takes a table and nothing else."""
    forms = {form for form in _forms(info.annotation) if form is not type(None)}
    return bool(forms) and all(
        isinstance(form, type) and issubclass(form, BaseModel) for form in forms
    )


def _row(path: tuple[str, ...], info: FieldInfo) -> KeyRow:
    """Read a key off its field; a default that only its description gives goes to its column."""
    meaning = _UNIT.sub("", info.description or "").strip()
    unit, default = unit_of(info) or "", _default(info, unit_of(info) or "")
    said = _DEFAULT.search(meaning)
    if said and default == NONE:
        meaning, default = meaning[: said.start()], said[1]
    return KeyRow(path, unit, meaning, default, _allowed(info))


def _default(info: FieldInfo, unit: str) -> str:
    if info.is_required():
        return REQUIRED
    value = info.get_default()
    if info.default_factory is not None or value is None or value in ({}, "", []):
        return NONE
    if isinstance(value, tuple):
        return ", ".join(_written(item, unit) for item in value)
    return _written(value, unit)


def _written(value: object, unit: str) -> str:
    """Write a default as the file would."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float | int):
        return f'"{value:g} {unit}"' if unit else f"{value:g}"
    return f'"{value}"'


def _allowed(info: FieldInfo) -> str:
    """Return range, choices or kind of a value."""
    if info.annotation == StressFree or "fraction" in _choices(info.annotation):
        return '"closed", "open", or 0 to 1'
    choices = _choices(info.annotation)
    if choices:
        return ", ".join(choices)
    bounds = _bounds([*info.metadata, *_metadata(info.annotation)])
    if bounds:
        return bounds
    forms = _forms(info.annotation)
    kinds = [text for kind, text in _NUMBERS.items() if kind in forms]
    lists = [typing.get_args(form) for form in forms if typing.get_origin(form) in (list, tuple)]
    if lists:
        return "list of texts" if str in lists[0] else "list"
    if any(typing.get_origin(form) is dict for form in forms):
        return "table"
    return "" if unit_of(info) else " or ".join(kinds)


def _choices(annotation: Any) -> list[str]:
    """Return the texts or numbers to choose from, as the file writes them."""
    found = []
    for form in _forms(annotation):
        if typing.get_origin(form) is typing.Literal:
            found += [
                f'"{item}"' if isinstance(item, str) else str(item)
                for item in typing.get_args(form)
            ]
    return found


def _forms(annotation: Any) -> list[Any]:
    """Return the alternatives of an annotation, without their metadata."""
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        return _forms(typing.get_args(annotation)[0])
    if origin in (typing.Union, types.UnionType):
        return [form for part in typing.get_args(annotation) for form in _forms(part)]
    return [annotation]


def _metadata(annotation: Any) -> Iterator[Any]:
    """Yield the bounds of a single value, also within unions, not those of its items."""
    yield from getattr(annotation, "__metadata__", ())
    if typing.get_origin(annotation) in (typing.Union, types.UnionType, typing.Annotated):
        for part in typing.get_args(annotation):
            if not isinstance(part, str):
                yield from _metadata(part)


def _bounds(metadata: list[Any]) -> str:
    """Return the bounds of numbers, of the number of members, or of both."""
    least = next((f"at least {m.ge:g}" for m in metadata if isinstance(m, Ge)), "")
    least = next((f"more than {m.gt:g}" for m in metadata if isinstance(m, Gt)), least)
    most = min((m.le for m in metadata if isinstance(m, Le)), default=None)  # type: ignore[type-var]
    under = next((f"less than {m.lt:g}" for m in metadata if isinstance(m, Lt)), "")
    parts = [least, under or (f"at most {most:g}" if most is not None else "")]
    fewest = next((m.min_length for m in metadata if isinstance(m, MinLen)), None)
    largest = next((m.max_length for m in metadata if isinstance(m, MaxLen)), None)
    if fewest is not None and largest is not None:
        parts.append(f"{fewest} to {largest} of them" if fewest != largest else f"{fewest} of them")
    return ", ".join(part for part in parts if part)
