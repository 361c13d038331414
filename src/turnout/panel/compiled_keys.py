"""Panels that differ in the values of the same keys, such as those of the scenarios of a study.

Keys are compiled once for a panel: which fields of which records they set, how a value of each is
read, and which checks read what they change. Another panel with values for them takes over all
other records and makes these checks alone. It is only ever accepted here: whatever is wrong is left
to the reading of the whole document, which says what it is.
"""

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from turnout.core.keys import Path, put
from turnout.panel.check import check
from turnout.panel.document import Document
from turnout.panel.matrices import check_matrices
from turnout.panel.model import FAMILIES, Panel
from turnout.panel.override import covers, is_given, key_places
from turnout.panel.validate import Draft, field_check, field_reader, with_values

Reader = Callable[[object], Any]
NUMBERS = (float, int, list, tuple)
"""Values that may be compiled: texts can name other files, and tables members."""


@dataclass(frozen=True, slots=True)
class _Value:
    """A value that is set: the key that does it last, and its place below a table."""

    key: str
    below: Path


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """A field of records, with the values that are set in it.

    Attributes
    ----------
    name : str
        Of the field.
    table : object
        Its value in the document, None where it is set as a whole.
    values : tuple of _Value
        That are set.
    read : callable
        Validates its value.
    """

    name: str
    table: Any
    values: tuple[_Value, ...]
    read: Reader

    def value(self, overrides: Mapping[str, object]) -> Any:
        """Return its value, valid."""
        given: Any = self.table
        for item in self.values:
            new = overrides[item.key]
            if not item.below:
                given = new
                continue
            holder = {self.name: given}
            put(holder, (self.name, *item.below), new, set())
            given = holder[self.name]
        return self.read(given)


@dataclass(frozen=True, slots=True, eq=False)
class DerivedPanel:
    """Parts of a panel with other values.

    Attributes
    ----------
    records : dict of str to object
        Value by field name of `Panel`, valid.
    overrides : dict of str to object
        Value by key of all that was set, broad keys first.
    """

    records: dict[str, Any]
    overrides: dict[str, object]


@dataclass(frozen=True, slots=True, eq=False)
class CompiledKeys:
    """Keys of a panel, compiled.

    Attributes
    ----------
    records : mapping of str to object
        Of the panel, by field name of `Panel`.
    document : Document
        Its tables.
    overrides : dict of str to object
        Its own overrides that no key covers.
    keys : tuple of str
        Broad ones first.
    fields : frozenset of (str, str)
        Families and fields that the keys change; the second is empty for what is no family.
    plain : tuple of _Field
        Fields of the panel itself.
    members : dict
        Fields of the members that have any, by family and member. Fields of several members that
        have the same value in the document are the same.
    checks : tuple of str
        Checks that read what changes.
    given : mapping of str to object
        What overrides have set, by dotted place.
    names : mapping of str to tuple of str
        Members of each family.
    """

    records: Mapping[str, Any]
    document: Document
    overrides: dict[str, object]
    keys: tuple[str, ...]
    fields: frozenset[tuple[str, str]]
    plain: tuple[_Field, ...]
    members: dict[str, dict[str, tuple[_Field, ...]]]
    checks: tuple[str, ...]
    given: Mapping[str, object]
    names: Mapping[str, tuple[str, ...]]

    def derive(self, overrides: Mapping[str, object]) -> DerivedPanel | None:
        """Return the parts of the panel with values for the keys; None where anything is wrong."""
        if not all(isinstance(value, NUMBERS) for value in overrides.values()):
            return None
        try:
            records = self._records(overrides)
        except ValidationError:
            return None
        draft = Draft(records=records, names=dict(self.names), given=self.given)
        matrices = self.document.matrices
        if check(draft, only=self.checks) or any(check_matrices(draft.records, matrices)):
            return None
        applied = {key: overrides[key] for key in self.keys}
        return DerivedPanel(records, self.overrides | applied)

    def _records(self, overrides: Mapping[str, object]) -> dict[str, Any]:
        found = dict(self.records)
        for field in self.plain:
            found[field.name] = field.value(overrides)
        read: dict[int, Any] = {}
        for family, members in self.members.items():
            records = found[family] = dict(found[family])
            for name, fields in members.items():
                first = records[name]
                if fields[0].name == WHOLE:
                    records[name] = fields[0].value(overrides)
                    continue
                new = dict(first.__dict__)
                for field in fields:
                    if id(field) not in read:
                        read[id(field)] = field.value(overrides)
                    new[field.name] = read[id(field)]
                records[name] = with_values(first, new)
        return found


WHOLE = ""
"""In place of a field, of records that are valid only as a whole."""


def compile_keys(
    panel: Panel,
    document: Document,
    own: Mapping[str, object],
    keys: tuple[str, ...],
    reads: Mapping[str, Set[tuple[str, str]]],
) -> CompiledKeys | None:
    """Compile keys of a valid panel.

    Parameters
    ----------
    panel : Panel
        The panel.
    document : Document
        Its tables.
    own : mapping of str to object
        Its overrides.
    keys : tuple of str
        In the order in which their values are given.
    reads : mapping of str to set of (str, str)
        Families and fields that each check reads.

    Returns
    -------
    CompiledKeys or None
        None where a key matches nothing or sets a whole table.
    """
    places = key_places(document, keys)
    if places is None or not all(places.values()):
        return None
    ordered = tuple(places)
    last = {place: key for key, found in places.items() for place in found}
    plain: dict[str, list[_Value]] = {}
    of_members: dict[tuple[str, str], dict[str, list[_Value]]] = {}
    for (name, *below), key in last.items():
        if name not in FAMILIES:
            plain.setdefault(name, []).append(_Value(key, tuple(below)))
        elif len(below) > 1 and below[0] in getattr(panel, name):
            member, field, *rest = below
            fields = of_members.setdefault((name, member), {})
            fields.setdefault(field, []).append(_Value(key, tuple(rest)))
        else:
            return None
    members: dict[str, dict[str, tuple[_Field, ...]]] = {}
    shared: dict[tuple[object, ...], _Field] = {}
    for (family, member), fields in of_members.items():
        made = _fields_of(FAMILIES[family], document.tree[family][member], fields, family, shared)
        if made is None:
            return None
        members.setdefault(family, {})[member] = made
    whole = dict.fromkeys(".".join(place) for place in last)
    kept = {name: v for name, v in document.given.items() if not is_given(name, whole)}
    fields_set = {(family, field) for (family, _), fields in of_members.items() for field in fields}
    changed = frozenset(fields_set | {(name, "") for name in plain})
    given = dict.fromkeys((*kept, *whole))
    return CompiledKeys(
        records=panel.__dict__,
        document=document,
        overrides={k: v for k, v in own.items() if not any(covers(key, k) for key in ordered)},
        keys=ordered,
        fields=changed,
        plain=tuple(
            _Field(name, document.tree.get(name), tuple(values), field_reader(name))
            for name, values in plain.items()
        ),
        members=members,
        checks=tuple(name for name, read in reads.items() if not read.isdisjoint(changed)),
        given=given,
        names={name: tuple(getattr(panel, name)) for name in FAMILIES},
    )


def _fields_of(
    record: type[BaseModel],
    table: Mapping[str, Any],
    fields: Mapping[str, list[_Value]],
    family: str,
    shared: dict[tuple[object, ...], _Field],
) -> tuple[_Field, ...] | None:
    """Return the fields of a member that are set, those of other members where they are equal."""
    if record.__pydantic_decorators__.model_validators:
        values = [
            _Value(item.key, (name, *item.below))
            for name, items in fields.items()
            for item in items
        ]
        return (_Field(WHOLE, dict(table), tuple(values), TypeAdapter(record).validate_python),)
    found = []
    for name, values in fields.items():
        reader = field_check(record, name)
        if reader is None:
            return None
        before = table.get(name) if any(value.below for value in values) else None
        key = (family, name, *values, repr(before))
        if key not in shared:
            shared[key] = _Field(name, before, tuple(values), reader)
        found.append(shared[key])
    return tuple(found)
