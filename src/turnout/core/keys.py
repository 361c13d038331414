"""Keys of the records of a file, such as `drive.2.stiffness`: place, unit, bounds, origin, value.

A file is read into one record. Its fields that map names to records are families: a key names a
field of one member, `chair.5.damping`, or of all members of a family, `chair.damping`.
"""

import math
import re
import types
import typing
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from turnout.core.problems import nearest
from turnout.core.quantity import NameIn, Quantity
from turnout.core.toml import Origin, load_toml
from turnout.core.units import SI, Dimension, is_finite

Path = tuple[str, ...]

REQUIRED, NONE = "required", "none"
VERSION = "schema_version"
"""Key that nothing changes."""
_PLAIN = {float: "number", int: "whole number", bool: "true or false", str: "text"}
_UNIT = re.compile(r"\s*\[[^\]]+\]")
_DEFAULT = re.compile(r"(?:[;,] |^)default:? (.+)$")


@dataclass(frozen=True, slots=True, eq=False)
class Key:
    """A key of a file: the field that it names, in one record or in each member of a family.

    Attributes
    ----------
    path : tuple of str
        Parts of the key.
    family, member : str
        Empty for a field of a single record; the member is empty for all members of the family.
    below : tuple of str
        Path from the record or member to the value, without the number of an item.
    field : FieldInfo
        That it names.
    item : int, optional
        Number from 1 of an item of a list, as it is written; None for a whole value.
    """

    path: Path
    family: str
    member: str
    below: Path
    field: FieldInfo
    item: int | None = None

    @property
    def name(self) -> str:
        """The key as it is written."""
        return ".".join(self.path)

    @property
    def whole(self) -> str:
        """The key of the whole list that it names an item of, or itself."""
        return ".".join(self.path if self.item is None else self.path[:-1])

    @property
    def dimension(self) -> Dimension | None:
        """Dimension of the value, or of the items of a list; None for plain numbers and texts."""
        return dimension_of(self.field)

    @property
    def unit(self) -> str:
        """SI unit of the value, or an empty text."""
        dimension = self.dimension
        return dimension.unit if dimension else ""

    @property
    def is_list(self) -> bool:
        """Return True if the field takes several values."""
        return _is_list(self.field)

    @property
    def takes_text(self) -> bool:
        """Return True if the value may be plain text, such as a name."""
        return str in self._forms

    @property
    def kind(self) -> Dimension | type | None:
        """Kind of a single value: its dimension, or float, bool or str; None for tables."""
        forms = {typing.get_origin(form) or form for form in self._forms}
        if (dimension := self.dimension) is not None:
            return dimension
        if forms & {str, typing.Literal} and float not in forms:
            return str
        single = None if self.item is None else float
        return next((kind for kind in (bool, float) if kind in forms), single)

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest value that the record allows, in SI; infinite without a bound."""
        found = _bounds(self.field)
        return (
            max((found[kind] for kind in (Ge, Gt) if kind in found), default=-math.inf),
            min((found[kind] for kind in (Le, Lt) if kind in found), default=math.inf),
        )

    @property
    def meaning(self) -> str:
        """Description of the value without its unit, and without a default that `default` says."""
        return self._said[0]

    @property
    def default(self) -> str:
        """Default as a file would write it; `REQUIRED` or `NONE`."""
        return self._said[1]

    @property
    def _said(self) -> tuple[str, str]:
        meaning = _UNIT.sub("", self.field.description or "").strip()
        default = _default(self.field, self.unit)
        said = _DEFAULT.search(meaning)
        return (
            (meaning[: said.start()], said[1]) if said and default == NONE else (meaning, default)
        )

    @property
    def allowed(self) -> str:
        """Range in SI, or the texts to choose from; an empty text for anything of its kind."""
        names = [m for m in self.field.metadata if isinstance(m, NameIn)]
        choices = [f'"{name}"' for mark in names for name in mark.names] or [
            f'"{item}"' if isinstance(item, str) else str(item)
            for form in self._forms
            if typing.get_origin(form) is typing.Literal
            for item in typing.get_args(form)
        ]
        if choices:
            return ", ".join([*choices, *(["number"] if float in self._forms else [])])
        if bounds := _bounds_text(_bounds(self.field)):
            return bounds
        lists = [form for form in self._forms if typing.get_origin(form) in (list, tuple)]
        if lists:
            return "list of texts" if str in typing.get_args(lists[0]) else "list"
        if is_table(self.field):
            return "table"
        kinds = [text for kind, text in _PLAIN.items() if kind in self._forms]
        return "" if self.unit else " or ".join(kinds)

    @property
    def _forms(self) -> list[Any]:
        return forms_of(self.field.annotation)


def forms_of(annotation: Any) -> list[Any]:
    """List the alternatives of an annotation, without their metadata."""
    origin = typing.get_origin(annotation)
    if origin is typing.Annotated:
        return forms_of(typing.get_args(annotation)[0])
    if origin in (typing.Union, types.UnionType):
        return [form for part in typing.get_args(annotation) for form in forms_of(part)]
    return [annotation]


def records_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Find the records that an annotation allows, alone or in a list."""
    for form in forms_of(annotation):
        if isinstance(form, type) and issubclass(form, BaseModel):
            yield form
        elif typing.get_origin(form) in (list, tuple):
            for part in typing.get_args(form):
                yield from records_in(part)


def _is_list(field: FieldInfo) -> bool:
    return any(typing.get_origin(form) in (list, tuple) for form in forms_of(field.annotation))


def is_table(field: FieldInfo) -> bool:
    """Return True if a field maps names to values."""
    return any(typing.get_origin(form) is dict for form in forms_of(field.annotation))


def dimension_of(field: FieldInfo) -> Dimension | None:
    """Return the dimension of a field, or of the items of a list; None for plain numbers, texts.

    Examples
    --------
    >>> from turnout.panel.records import Chair
    >>> dimension_of(Chair.model_fields["damping"]).unit
    'N s/m'
    """
    for mark in (*field.metadata, *_metadata(field.annotation, items=True)):
        if isinstance(mark, Quantity):
            return mark.dimension
    return None


def unit_of(field: FieldInfo) -> str:
    """Return the SI unit of a field; empty if it has none."""
    dimension = dimension_of(field)
    return dimension.unit if dimension else ""


def _metadata(annotation: Any, *, items: bool) -> Iterator[Any]:
    """Yield the metadata of an annotation, within unions, and also of items of lists."""
    yield from getattr(annotation, "__metadata__", ())
    inside = typing.get_origin(annotation) in (typing.Union, types.UnionType, typing.Annotated)
    for part in typing.get_args(annotation) if inside or items else ():
        if not isinstance(part, str):
            yield from _metadata(part, items=items)


def _bounds(field: FieldInfo) -> dict[type, float]:
    """Return the bounds of a single value, or of the number of items, by their kind."""
    found: dict[type, float] = {}
    for mark in (*field.metadata, *_metadata(field.annotation, items=False)):
        for kind, name in _BOUNDS.items():
            if isinstance(mark, kind):
                value = getattr(mark, name)
                found[kind] = min(found.get(kind, value), value)
    return found


_BOUNDS: dict[Any, str] = {
    **{Ge: "ge", Gt: "gt", Le: "le", Lt: "lt"},
    **{MinLen: "min_length", MaxLen: "max_length"},
}


def _bounds_text(found: Mapping[type, float]) -> str:
    words = {Gt: "more than", Ge: "at least", Lt: "less than", Le: "at most"}
    parts = [f"{text} {found[kind]:g}" for kind, text in words.items() if kind in found]
    if MinLen in found and MaxLen in found:
        fewest, most = found[MinLen], found[MaxLen]
        parts.append(f"{fewest} to {most} of them" if fewest != most else f"{fewest} of them")
    return ", ".join(parts)


def _default(field: FieldInfo, unit: str) -> str:
    if field.is_required():
        return REQUIRED
    value = field.get_default()
    if field.default_factory is not None or value is None or value in ({}, "", []):
        return NONE
    values = value if isinstance(value, tuple) else (value,)
    return ", ".join(_written(item, unit) for item in values)


def _written(value: object, unit: str) -> str:
    """Write a default as the file would."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float | int):
        return f'"{value:g} {unit}"' if unit else f"{value:g}"
    return f'"{value}"'


class Keys:
    """All keys of the files that are read into one record.

    Parameters
    ----------
    root : type of record
        Whole file.
    what : str
        Its name in messages.
    example : str
        Setting of a command line, for messages.
    growing : tuple of str
        Families to which a key may add a member.
    implied : str
        Family that a key for all its members need not name.
    """

    def __init__(
        self,
        root: type[BaseModel],
        *,
        what: str,
        example: str,
        growing: tuple[str, ...] = (),
        implied: str = "",
    ) -> None:
        self.root, self.growing, self.implied = root, growing, implied
        self._what, self._example = what, example
        self.families: dict[str, type[BaseModel]] = {}
        for name, info in root.model_fields.items():
            records = typing.get_args(info.annotation)[1:] if is_table(info) else ()
            if records and issubclass(records[0], BaseModel):
                self.families[name] = records[0]
        self.find = lru_cache(maxsize=4096)(self._find)

    def _find(self, name: str) -> Key | None:
        """Return a key by its name; None if no file of this kind can have it."""
        path = tuple(name.split("."))
        family, member, below = self._split(path)
        if "" in path:
            return None
        record, place = self.families.get(family, self.root), below
        item: int | None = None
        info: FieldInfo | None = None
        while place:
            info, place = record.model_fields.get(place[0]), place[1:]
            if info is None or not place:
                break
            inner = next(records_in(info.annotation), None)
            if is_table(info):
                info = info if len(place) == 1 else None
                break
            if place[0].isdigit() and inner is None:
                is_item = len(place) == 1 and _is_list(info)
                info, item = (info, int(place[0])) if is_item else (None, None)
                break
            place = place[1:] if place[0].isdigit() else place
            if inner is None or not place:
                return None
            record = inner
        if info is None:
            return None
        below = below if item is None else below[:-1]
        return Key(path, family, member, below, info, item)

    def _split(self, path: Path) -> tuple[str, str, Path]:
        """Return family, member and the path in the record; both are empty for a single record."""
        if path[0] not in self.families:
            inside = self.implied and path[0] not in self.root.model_fields
            known = inside and path[0] in self.families[self.implied].model_fields
            return (self.implied, "", path) if known else ("", "", path)
        if len(path) == 1 or path[1] in self.families[path[0]].model_fields:
            return path[0], "", path[1:]
        return path[0], path[1], path[2:]

    def field_names(self, path: Path) -> list[str]:
        """List the fields that may follow a key path.

        Examples
        --------
        >>> from turnout.panel.model import PANEL_KEYS
        >>> PANEL_KEYS.field_names(("lock",))
        ['rule', 'gap_limit']
        """
        record: type[BaseModel] | None = self.root
        if path:
            family, _, path = self._split(path)
            record = self.families.get(family, self.root)
        for part in path:
            if record is None or part.isdigit():
                continue
            info = record.model_fields.get(part)
            record = next(records_in(info.annotation), None) if info else None
        return list(record.model_fields) if record else []

    def names(self, members: Mapping[str, Iterable[str]]) -> Iterator[str]:
        """List the keys of a file with these members by family, families first, then members."""
        for name, info in self.root.model_fields.items():
            inside = self.families.get(name) or next(records_in(info.annotation), None)
            fields = list(_field_keys(inside)) if inside else []
            if name in self.families:
                names = list(members.get(name, ()))
                broad = "" if name == self.implied else f"{name}."
                yield from (f"{broad}{key}" for key in fields if names)
                yield from (f"{name}.{member}.{key}" for member in names for key in fields)
            elif name != VERSION:
                yield from (f"{name}.{key}" for key in fields) if fields else (name,)

    def places(self, tree: Mapping[str, Any], name: str) -> list[Path]:
        """Return the places in a tree of tables that a key sets.

        Examples
        --------
        >>> from turnout.panel.model import PANEL_KEYS
        >>> PANEL_KEYS.places({"drive": {"1": {}, "2": {}}}, "drive.stiffness")
        [('drive', '1', 'stiffness'), ('drive', '2', 'stiffness')]
        """
        key = self.find(name)
        if key is None or key.item is not None or key.path == (VERSION,):
            return []
        if not key.family:
            return [key.path]
        members = tree.get(key.family, {})
        if not isinstance(members, dict):
            return []
        if not key.member:
            return [(key.family, member, *key.below) for member in members]
        known = key.member in members or key.family in self.growing
        return [(key.family, key.member, *key.below)] if known else []

    def values(self, records: BaseModel, name: str) -> dict[str, Any]:
        """Return the values of records by full key: one for each member if a key names a family.

        Raises
        ------
        LookupError
            Where there is no such value; the text names the nearest key.

        Examples
        --------
        >>> from turnout.panel.load import load_panel
        >>> from turnout.panel.model import PANEL_KEYS
        >>> PANEL_KEYS.values(load_panel("sb1"), "drive.stiffness")
        {'drive.1.stiffness': 750000.0, 'drive.2.stiffness': 810000.0}
        """
        key = self.find(name)
        if key is None:
            raise LookupError(self.no_match(name, {f: getattr(records, f) for f in self.families}))
        within: dict[str, Any] = {"": records}
        if key.family:
            members = getattr(records, key.family)
            if key.member and key.member not in members:
                known = {family: getattr(records, family) for family in self.families}
                raise LookupError(self.no_match(name, known))
            chosen = [key.member] if key.member else list(members)
            within = {f"{key.family}.{member}.": members[member] for member in chosen}
        path = key.below if key.item is None else (*key.below, str(key.item - 1))
        end = ".".join(key.below if key.item is None else (*key.below, str(key.item)))
        try:
            return {f"{start}{end}": _nested(record, path) for start, record in within.items()}
        except (KeyError, IndexError, AttributeError, ValueError):
            message = f"{name}: has no value in this {self._what}"
            raise LookupError(message) from None

    def no_match(self, name: str, members: Mapping[str, Iterable[str]]) -> str:
        """Say that a key matches nothing, and name the nearest that does."""
        return f"{name}: matches nothing in this {self._what}{nearest(name, self.names(members))}"

    def settings(self, texts: Iterable[str]) -> tuple[dict[str, object], list[str]]:
        """Return values by key from texts "KEY=VALUE", and what is wrong with the others."""
        found: dict[str, object] = {}
        problems = []
        for text in texts:
            try:
                key, value = self.setting(text)
                found[key] = value
            except ValueError as error:
                problems.append(str(error))
        return found, problems

    def setting(self, text: str) -> tuple[str, object]:
        """Split "KEY=VALUE" from a command line; the value is read as TOML if it parses.

        Raises
        ------
        ValueError
            When the text is not of that form.

        Examples
        --------
        >>> from turnout.panel.model import PANEL_KEYS
        >>> PANEL_KEYS.setting("chair.friction_coefficient=0.3")
        ('chair.friction_coefficient', 0.3)
        >>> PANEL_KEYS.setting("drive.2.stiffness = 810 kN/m")
        ('drive.2.stiffness', '810 kN/m')
        >>> PANEL_KEYS.setting("outline_section.stock.outline=60E1")
        ('outline_section.stock.outline', '60E1')
        """
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name:
            message = f'"{text}" is not KEY=VALUE, such as {self._example}'
            raise ValueError(message)
        try:
            read = load_toml(f"value = {value}")["value"]
        except ValueError:
            return name, value
        # A name such as 60E1 would read as a number.
        key = self.find(name) if isinstance(read, int | float) else None
        return name, value if key is not None and key.takes_text else read


def _field_keys(record: type[BaseModel]) -> Iterator[str]:
    for name, info in record.model_fields.items():
        yield name
        for inner in records_in(info.annotation):
            yield from (f"{name}.{key}" for key in _field_keys(inner))


def _nested(record: Any, path: Path) -> Any:
    for part in path:
        if isinstance(record, Mapping):
            record = record[part]
        elif isinstance(record, list | tuple):
            record = record[int(part)]
        else:
            record = getattr(record, part)
    return record


def mark_si(value: object) -> object:
    """Mark the numbers in a Python value as SI; arrays become lists."""
    if type(value) is float:  # nearly all of what a scenario changes
        return SI(value if math.isfinite(value) else math.nan)
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): mark_si(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [mark_si(item) for item in value]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return SI(value if is_finite(value) else math.nan)
    return value


def put(tree: dict[str, Any], place: Path, value: object, own: set[Path]) -> dict[str, Any]:
    """Set a value in copies of the tables around it; all other tables stay the same objects.

    Parameters
    ----------
    tree : dict
        Changed itself.
    place : tuple of str
        Place of the value; parts for lists are numbers from 0.
    value : object
        New value.
    own : set of tuple of str
        Places of tables that are copies already; those that are made are added.

    Returns
    -------
    dict
        The copy of the table that has the value.
    """
    table: Any = tree
    for depth in range(1, len(place)):
        part: Any = int(place[depth - 1]) if isinstance(table, list) else place[depth - 1]
        inner = table[part] if isinstance(table, list) else table.get(part)
        if not (isinstance(inner, dict | list) and place[:depth] in own):
            inner = inner.copy() if isinstance(inner, dict | list) else {}
            table[part] = inner
            own.add(place[:depth])
        table = inner
    # whatever was copied below a value that is replaced is no copy of what is there now
    if len(own) > 1 and isinstance(table.get(place[-1]), dict):
        own.difference_update([other for other in own if other[: len(place)] == place])
    table[place[-1]] = value
    return table  # type: ignore[no-any-return]


def origin_at(origins: Mapping[str, Origin], key: str) -> Origin | None:
    """Return the origin of a value: its own, or that of the nearest table above."""
    while key:
        if key in origins:
            return origins[key]
        key = key.rpartition(".")[0]
    return None
