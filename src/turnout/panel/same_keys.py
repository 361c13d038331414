"""Panels that differ in the numbers of the same keys, such as those of the scenarios of a study.

Which records the keys reach and which checks read them is found with the first panel that is made
with them. Another one takes over all records but these, and makes again the checks that read what
has changed. It is only ever accepted here: whatever is wrong is left to the reading of the whole
document, which says what it is.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel, ValidationError

from turnout.core.lru_cache import LRUCache
from turnout.panel.check import check
from turnout.panel.document import Document
from turnout.panel.matrices import check_matrices
from turnout.panel.model import FAMILIES, Panel
from turnout.panel.override import OverridePlan, known_plan
from turnout.panel.records import RailMatrices
from turnout.panel.validate import Draft, Known, field_check, read_by, with_values


@dataclass(frozen=True, slots=True, eq=False)
class PendingDocument:
    """The document of a panel whose tables have not been needed yet."""

    way: OverridePlan
    overrides: Mapping[str, object]

    @property
    def matrices(self) -> dict[str, RailMatrices]:
        """Matrices that tables name, none of which is a number."""
        return self.way.document.matrices

    def made(self) -> Document:
        """Return the document."""
        return self.way.apply(self.overrides)[0]


@dataclass(frozen=True, slots=True, eq=False)
class DerivedPanel:
    """Parts of a panel with other numbers.

    Attributes
    ----------
    first : Panel
        The panel whose keys it shares.
    fields : frozenset of (str, str)
        Families and fields in which it may differ from that one.
    records : dict of str to object
        Value by field name of `Panel`, valid.
    document : PendingDocument
        Its tables.
    asked : mapping of str to frozenset of str
        Inputs of each check, by its name.
    applied : dict of str to object
        Value by key, broad keys first.
    """

    first: Panel
    fields: frozenset[tuple[str, str]]
    records: dict[str, Any]
    document: PendingDocument
    asked: Mapping[str, frozenset[str]]
    applied: dict[str, object]


Reader = Callable[[object], Any]
_Members = dict[str, list[tuple[str, BaseModel, tuple[tuple[str, int], ...]]]]


@dataclass(frozen=True, slots=True, eq=False)
class _SameKeys:
    """Targets of the keys in the first panel that was made with them.

    `panel` is what was changed, kept since it is known by its identity. `numbers` are the values
    that are set, with the key that does it and what validates its value; `members` are the records
    that have any, by family, with the number of the value of each field. Of families in which all
    members have the same fields changed `columns` are these numbers by field.
    """

    panel: Panel
    way: OverridePlan
    known: Known
    fields: frozenset[tuple[str, str]]
    changed: set[str]
    given: Mapping[str, object]
    names: Mapping[str, tuple[str, ...]]
    numbers: tuple[tuple[str, Reader], ...]
    members: _Members

    def records(self, overrides: Mapping[str, object]) -> dict[str, Any]:
        """Return the records with other values.

        Raises
        ------
        ValidationError
            Where a value is not valid.
        """
        values = [read(overrides[key]) for key, read in self.numbers]
        found = dict(self.known.panel.__dict__)
        for family, members in self.members.items():
            records = found[family] = dict(found[family])
            for name, first, fields in members:
                new = {field: values[number] for field, number in fields}
                records[name] = with_values(first, first.__dict__ | new)
        return found


_first = LRUCache[_SameKeys](16)


def derive_panel(
    panel: Panel, document: Document, overrides: Mapping[str, object]
) -> DerivedPanel | None:
    """Return the parts of a valid panel with other numbers for keys that changed it before.

    Parameters
    ----------
    panel : Panel
        Panel to change.
    document : Document
        Its tables.
    overrides : mapping of str to object
        Value by key, as `apply_overrides` takes them.

    Returns
    -------
    DerivedPanel or None
        None where anything is wrong, something is no number, or the keys are new.
    """
    same = _first.get((id(panel), *overrides))
    way = known_plan(document, overrides)
    if same is None or same.way is not way or not _are_numbers(overrides):
        return None
    try:
        records = same.records(overrides)
    except ValidationError:
        return None
    draft = Draft(given=same.given, changed=same.changed)
    draft.records.update(records)
    draft.names.update(same.names)
    if check(draft, known=same.known) or any(check_matrices(draft.records, document.matrices)):
        return None
    applied = {key: overrides[key] for key in way.targets}
    return DerivedPanel(
        first=same.known.panel,
        fields=same.fields,
        records=records,
        document=PendingDocument(way, overrides),
        asked=draft.asked,
        applied=applied,
    )


def note_keys(
    panel: Panel, document: Document, overrides: Mapping[str, object], made: Known
) -> None:
    """Remember the first panel that a valid one has become by numbers for some keys.

    Parameters
    ----------
    panel, document, overrides
        As of `derive_panel`.
    made : Known
        The first panel, with what its checks read.
    """
    way = known_plan(document, overrides)
    if way is None or not _are_numbers(overrides):
        return
    numbers: dict[tuple[str, str, str], tuple[int, tuple[str, Reader]]] = {}
    fields: dict[tuple[str, str], list[tuple[str, int]]] = {}
    changed: set[str] = set()
    for (family, name, field), key in way.places:
        reader = _reader(FAMILIES[family], field)
        if reader is None:
            return
        number, _ = numbers.setdefault((family, field, key), (len(numbers), (key, reader)))
        fields.setdefault((family, name), []).append((field, number))
        changed |= read_by(family, [field])
    members: _Members = {}
    for (family, name), of_member in fields.items():
        first = getattr(made.panel, family)[name]
        members.setdefault(family, []).append((name, first, tuple(of_member)))
    given = dict.fromkeys((*way.given, *(".".join(place) for place, _ in way.places)))
    found = _SameKeys(
        panel=panel,
        way=way,
        known=replace(made, given=given),
        fields=frozenset((family, field) for (family, _, field), _ in way.places),
        changed=changed,
        given=given,
        names={name: tuple(getattr(made.panel, name)) for name in FAMILIES},
        numbers=tuple(item for _, item in numbers.values()),
        members=members,
    )
    _first.put((id(panel), *overrides), found)


def _reader(record: type[BaseModel], field: str) -> Reader | None:
    """Return the validator of a field, or None if the record is validated only as a whole."""
    whole = record.__pydantic_decorators__.model_validators
    return None if whole else field_check(record, field)


def _are_numbers(overrides: Mapping[str, object]) -> bool:
    return all(isinstance(value, float) for value in overrides.values())
