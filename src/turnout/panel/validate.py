"""From the tree of a document to records, collecting every problem instead of the first."""

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, field
from functools import cache
from types import FunctionType
from typing import Any, TypeVar

from pydantic import BaseModel, TypeAdapter, ValidationError, create_model

from turnout.core.keys import Path, records_in
from turnout.core.problems import Problem, choices, describe_error, meant, nearest, show_value
from turnout.panel.document import Document
from turnout.panel.model import FAMILIES, PANEL_KEYS, Panel

MOST_PROBLEMS = 50
"""Problems that are reported of one table; finding the nearest names takes long."""

_VARIANT_TAGS = ("length", "profile")


AnyRecord = TypeVar("AnyRecord", bound=BaseModel)


class Unknown(Exception):
    """A check needed a value that is wrong itself; there is nothing more to say about it."""


class Partial:
    """A record of which some values are wrong: asking for one of those raises `Unknown`."""

    def __init__(
        self, record: BaseModel | None = None, wrong: frozenset[str] = frozenset()
    ) -> None:
        self._record = record
        self._wrong = wrong

    def __getattr__(self, name: str) -> Any:
        """Give a value that is right."""
        if self._record is None or name in self._wrong:
            raise Unknown(name)
        # What is derived may rest on any value, so on a wrong one too.
        if self._wrong and isinstance(getattr(type(self._record), name, None), property):
            raise Unknown(name)
        return getattr(self._record, name)


def until_unknown(problems: Iterator[Problem]) -> Iterator[Problem]:
    """Pass on the problems that a check finds until it needs a value that is wrong itself."""
    with suppress(Unknown):
        yield from problems


Field = tuple[str, str]
"""A family and a field of its members; the second is empty for a value that is no family's."""


class NotedRecord:
    """A record in place of which it notes the fields that are read."""

    def __init__(self, record: BaseModel, family: str, read: set[Field]) -> None:
        self._record, self._family, self._read = record, family, read

    def __getattr__(self, name: str) -> Any:
        """Return a value; what is derived from others is found from these."""
        of_class = getattr(type(self._record), name, None)
        if isinstance(of_class, property) and of_class.fget is not None:
            return of_class.fget(self)
        if isinstance(of_class, FunctionType):
            return of_class.__get__(self)
        fields = type(self._record).model_fields
        self._read.update((self._family, each) for each in ([name] if name in fields else fields))
        return getattr(self._record, name)


class NotedRecords(dict[str, Any]):
    """Values by field name of a valid `Panel` that note which of them, and which fields, are read.

    Attributes
    ----------
    read : set of (str, str)
        What has been read.
    """

    def __init__(self, records: Mapping[str, Any]) -> None:
        self.read: set[Field] = set()
        super().__init__(records)
        for family in FAMILIES:
            members = records[family].items()
            self[family] = {n: NotedRecord(record, family, self.read) for n, record in members}

    def __getitem__(self, name: str) -> Any:
        """Return a value, which is noted unless it is a family."""
        if name not in FAMILIES:
            self.read.add((name, ""))
        return super().__getitem__(name)


@dataclass(slots=True)
class Draft:
    """The records that could be made so far.

    Parameters
    ----------
    records : dict
        Value by field name of `Panel`; a record with problems is a `Partial`, and so is a
        missing one.
    names : dict
        Names of all members by family, valid or not, in the order of the file.
    problems : list of Problem
        Faults of the rest.
    shared : frozenset of key paths
        Values (family, member, field) that come from the family, not from the member.
    given : mapping of str to object
        Values set by overrides, by dotted place.
    """

    records: dict[str, Any] = field(default_factory=dict)
    names: dict[str, tuple[str, ...]] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    shared: frozenset[Path] = frozenset()
    given: Mapping[str, object] = field(default_factory=dict)


def validate_document(document: Document) -> Draft:
    """Make every record that can be made and describe the problems of the others.

    Parameters
    ----------
    document : Document
        The expanded document.
    """
    draft = Draft(problems=list(document.problems), shared=document.shared, given=document.given)
    tree, fields = document.tree, Panel.model_fields
    unknown = [name for name in tree if name not in fields]
    for name in unknown[:MOST_PROBLEMS]:
        text = f": unknown key{nearest(name, fields)}; allowed are " + choices(fields, most=40)
        draft.problems.append(Problem((name,), text))
    draft.problems += _rest((), len(unknown))
    for name in fields:
        if name in FAMILIES:
            _family(name, document, draft)
        else:
            _plain(name, tree, draft)
    return draft


def field_reader(name: str) -> Callable[[object], Any]:
    """Return the validator of a plain field of the panel."""
    reader: Callable[[object], Any] = _adapter(name).validate_python
    return reader


@cache
def _adapter(name: str) -> TypeAdapter[Any]:
    """Give the validator of one plain field of the panel, with the panel's strictness."""
    info = Panel.model_fields[name]
    annotation: Any = info.annotation
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return TypeAdapter(annotation)
    config: Any = Panel.model_config
    return TypeAdapter(info.rebuild_annotation(), config=config)


@cache
def _lenient(record: type[BaseModel]) -> type[BaseModel]:
    """Make a twin of a record in which every field may be left out."""
    fields: dict[str, Any] = {}
    for name, info in record.model_fields.items():
        if info.is_required():
            optional = copy(info)
            optional.default = None
            fields[name] = (info.annotation, optional)
    return create_model(f"Lenient{record.__name__}", __base__=record, **fields)


def _partial(record: type[BaseModel], values: object, errors: list[Any]) -> Partial:
    """Keep the valid values of a record with problems."""
    if not isinstance(values, dict) or record.__pydantic_decorators__.model_validators:
        return Partial()  # such as a machine, which is judged as a whole
    wrong = frozenset(str(error["loc"][0]) for error in errors if error["loc"])
    right = {name: value for name, value in values.items() if name not in wrong}
    return Partial(_lenient(record).model_validate(right), wrong)


def _plain(name: str, tree: dict[str, Any], draft: Draft) -> None:
    info = Panel.model_fields[name]
    if name not in tree:
        if info.is_required():
            draft.problems.append(Problem((name,), ": is missing"))
            draft.records[name] = Partial()
        else:
            draft.records[name] = info.get_default()
        return
    try:
        draft.records[name] = _adapter(name).validate_python(tree[name])
    except ValidationError as error:
        errors = _errors(error)
        shown = _without_misspelt(errors, (name,))
        draft.problems += [_problem((name,), item) for item in shown[:MOST_PROBLEMS]]
        draft.problems += _rest((name,), len(shown))
        records = list(records_in(info.annotation))
        draft.records[name] = _partial(records[0], tree[name], errors) if records else Partial()


def _family(name: str, document: Document, draft: Draft) -> None:
    info, record = Panel.model_fields[name], FAMILIES[name]
    members = document.tree.get(name, {})
    broken = any(problem.path[0] == name for problem in document.problems)
    if not isinstance(members, dict):
        draft.problems.append(
            Problem((name,), f" = {show_value(members)}: must be a table of members")
        )
        members, broken = {}, True
    meant_elsewhere = {item.meant for item in document.problems if item.path[0] == name}
    records: dict[str, BaseModel | Partial] = {}
    found: dict[Problem, list[str]] = {}
    for member, values in members.items():
        try:
            records[member] = record.model_validate(values)
        except ValidationError as error:
            errors = _errors(error)
            records[member] = _partial(record, values, errors)
            errors = _without_misspelt(errors, (name,), meant_elsewhere)
            shown = MOST_PROBLEMS if len(found) < 10 * MOST_PROBLEMS else 1
            draft.problems += _rest((name, member), len(errors), shown)
            for item in errors[:shown]:
                place = (name, member, *_path(item))
                shared = place[:3] in document.shared or item["type"] == "missing"
                problem = _problem((name, *place[2:]) if shared else place, item, strip=True)
                found.setdefault(problem, []).append(member)
    draft.records[name] = records
    draft.names[name] = tuple(members)
    draft.problems += _merged(name, found, document)
    _check_count(name, info.metadata, len(members), broken, draft)


# Slots of a record of pydantic; to set them by name takes twice as long.
_put_values = vars(BaseModel)["__dict__"].__set__
_put_fields_set = vars(BaseModel)["__pydantic_fields_set__"].__set__
_put_extra = vars(BaseModel)["__pydantic_extra__"].__set__
_put_private = vars(BaseModel)["__pydantic_private__"].__set__


def with_values(made: AnyRecord, values: dict[str, Any]) -> AnyRecord:
    """Return a record like another one with all its values given: `copy` takes far longer.

    Records do not change, so that two can share what says which of their fields were set.
    """
    again = object.__new__(made.__class__)
    _put_values(again, values)
    _put_fields_set(again, made.__pydantic_fields_set__)
    extra, private = made.__pydantic_extra__, made.__pydantic_private__
    _put_extra(again, None if extra is None else dict(extra))
    _put_private(again, None if private is None else dict(private))
    return again


@cache
def field_check(record: type[BaseModel], name: str) -> Callable[[object], Any] | None:
    """Return the validator of one field with the record's strictness, or None for no field."""
    if name not in record.model_fields:
        return None
    config: Any = record.model_config
    check = TypeAdapter(record.model_fields[name].rebuild_annotation(), config=config)
    return check.validator.validate_python


def _merged(family: str, found: dict[Problem, list[str]], document: Document) -> list[Problem]:
    """Report a value that all members lack or share once; a lack of some member by member."""
    members = document.tree[family] if found else {}
    result = []
    for problem, names in found.items():
        missing = problem.text == ": is missing"
        if missing and len(names) < max(len(members), 2):
            result += [Problem((family, name, *problem.path[1:]), problem.text) for name in names]
        elif missing:
            result.append(Problem(problem.path, f": is missing (in every {family})"))
        else:
            result.append(problem)
    return result


def _check_count(name: str, metadata: list[Any], count: int, broken: bool, draft: Draft) -> None:
    least = max((getattr(item, "min_length", None) or 0 for item in metadata), default=0)
    most = min(
        (item.max_length for item in metadata if getattr(item, "max_length", None)), default=count
    )
    if count < least and not broken:
        draft.problems.append(Problem((name,), f": needs at least {least}, has {count}"))
    if count > most:
        draft.problems.append(Problem((name,), f": at most {most} are allowed, has {count}"))


def _rest(path: Path, count: int, shown: int = MOST_PROBLEMS) -> list[Problem]:
    """Return the number of problems left out of a table, as one more problem."""
    return [Problem(path, f": and {count - shown} more problems")] if count > shown else []


def _errors(error: ValidationError) -> list[Any]:
    return list(error.errors(include_url=False))


def _without_misspelt(errors: list[Any], table: Path, elsewhere: Collection[str] = ()) -> list[Any]:
    """Leave out each missing key of a table that a misspelt key stands for."""
    misspelt = {
        (error["loc"][:-1], meant(str(error["loc"][-1]), _allowed((*table, *_path(error)))))
        for error in errors
        if error["type"] == "extra_forbidden"
    } | {((), name) for name in elsewhere}
    return [
        error
        for error in errors
        if error["type"] != "missing" or (error["loc"][:-1], error["loc"][-1]) not in misspelt
    ]


def _path(error: Any) -> Path:
    """Give the key path inside a record without the tags of the forms that a value may have."""
    parts = [str(part) for part in error["loc"]]
    return tuple(
        part
        for before, part in zip(["", *parts], parts, strict=False)
        if not (before in ("stock_rail_gap", "fit_gap") and part in _VARIANT_TAGS)
    )


def _problem(prefix: Path, error: Any, *, strip: bool = False) -> Problem:
    path = prefix if strip else (*prefix, *_path(error))
    return Problem(path, describe_error(error, allowed=_allowed(path)))


def _allowed(path: Path) -> list[str]:
    """List the keys that exist beside the last part of a path."""
    return PANEL_KEYS.field_names(path[:-1])
