"""The unit and the dimension of a field of a record, read from what describes it."""

import re
import typing
from collections.abc import Iterator
from typing import Any

from turnout.files.units import DIMENSIONS, Dimension


def unit_of(field: Any) -> str | None:
    """Return the SI unit of a field of a record, None where it has none.

    Examples
    --------
    >>> from turnout.panel.support_records import Chair
    >>> unit_of(Chair.model_fields["damping"]), unit_of(Chair.model_fields["friction_coefficient"])
    ('N s/m', None)
    """
    for marker in (*field.metadata, *_markers(field.annotation)):
        description = str((getattr(marker, "json_schema", None) or {}).get("description", ""))
        found = re.search(r"\[([^\]]+)\]$", description)
        if found and found.group(1) != "-":
            return found.group(1)
    return None


def dimension_of(field: Any) -> Dimension | None:
    """Return the dimension of a field of a record, None where it is a plain number or a text.

    Examples
    --------
    >>> from turnout.panel.support_records import Chair
    >>> dimension_of(Chair.model_fields["damping"]).name
    'damping'
    """
    unit = unit_of(field)
    return next((item for item in DIMENSIONS if item.unit == unit), None)


def _markers(annotation: Any) -> Iterator[Any]:
    """Find what is attached to an annotation, also within unions."""
    yield from getattr(annotation, "__metadata__", ())
    for part in typing.get_args(annotation):
        if not isinstance(part, str):
            yield from _markers(part)
