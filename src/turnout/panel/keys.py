"""Keys of a panel: the fields and records at a path such as `drive.2.stiffness`."""

import typing
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from turnout.panel.document import FAMILIES, Path
from turnout.panel.model import Panel


def records_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Find the records that an annotation allows, through unions and Annotated."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif typing.get_origin(annotation) is not dict:
        for part in typing.get_args(annotation):
            yield from records_in(part)


def _is_mapping(annotation: Any) -> bool:
    return typing.get_origin(annotation) is dict


def fields_at(path: Path) -> list[str]:
    """List the field names that may follow a key path; a family's own fields for a family.

    Examples
    --------
    >>> fields_at(("lock",))
    ['rule', 'gap_limit']
    """
    record = _record_at(path)
    return list(record.model_fields) if record else []


def _record_at(path: Path) -> type[BaseModel] | None:
    """Find the record whose fields may follow a key path."""
    record: type[BaseModel] = Panel
    parts = list(path)
    if parts and parts[0] in FAMILIES:
        record = FAMILIES[parts[0]]
        parts = parts[1:]
        if parts and parts[0] not in record.model_fields:
            parts = parts[1:]
    for part in parts:
        info = record.model_fields.get(part)
        inner = list(records_in(info.annotation)) if info else []
        if not inner:
            return None
        record = inner[0]
    return record


def field_at(path: Path) -> FieldInfo | None:
    """Return the field that a key path leads to, or None.

    Examples
    --------
    >>> field_at(("drive", "2", "stiffness")).description
    'bushing below saturation [N/m]'
    """
    record = _record_at(path[:-1])
    if record is not None:
        return record.model_fields.get(path[-1])
    outer = _record_at(path[:-2])
    info = outer.model_fields.get(path[-2]) if outer and len(path) > 1 else None
    return info if info is not None and _is_mapping(info.annotation) else None


def takes_text(path: Path) -> bool:
    """Return True if a key takes plain text, such as a name."""
    record = _record_at(path[:-1])
    info = record.model_fields.get(path[-1]) if record else None
    return info is not None and (info.annotation is str or str in typing.get_args(info.annotation))


@lru_cache(maxsize=4096)
def is_field(record: type[BaseModel], path: Path) -> bool:
    """Return True if a key path leads to a field of a record, or an entry of a table."""
    if not path:
        return False
    info = record.model_fields.get(path[0])
    if info is None:
        return False
    if len(path) == 1:
        return True
    if _is_mapping(info.annotation):
        return len(path) == 2
    return any(is_field(inner, path[1:]) for inner in records_in(info.annotation))


def known_keys(tree: Mapping[str, Any]) -> Iterable[str]:
    """List the keys that an override of this panel may use, families first, then members."""
    for name, info in Panel.model_fields.items():
        if name in FAMILIES:
            members = tree.get(name, {})
            fields = list(_field_keys(FAMILIES[name]))
            yield from (f"{name}.{key}" for key in fields if members)
            yield from (f"{name}.{member}.{key}" for member in members for key in fields)
        elif name != "schema_version":
            inner = list(records_in(info.annotation))
            yield from (f"{name}.{key}" for record in inner for key in _field_keys(record))
            if not inner:
                yield name


def _field_keys(record: type[BaseModel]) -> Iterator[str]:
    for name, info in record.model_fields.items():
        yield name
        for inner in records_in(info.annotation):
            yield from (f"{name}.{key}" for key in _field_keys(inner))
