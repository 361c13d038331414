"""From the tree of a document to records, collecting every problem instead of the first."""

from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel, TypeAdapter, ValidationError

from turnout.files.problems import Problem, choices, describe_error, nearest, show_value
from turnout.panel.document import FAMILIES, Document, Path
from turnout.panel.model import Panel

_VARIANT_TAGS = ("length", "profile")


@dataclass(slots=True)
class Draft:
    """The records that could be made so far; what failed is absent from `records`.

    Parameters
    ----------
    records : dict
        Validated value by field name of `Panel`; a family holds only its valid members.
    names : dict
        Names of all members by family, valid or not, in the order of the file.
    problems : list of Problem
        What was wrong with the rest.
    """

    records: dict[str, Any] = field(default_factory=dict)
    names: dict[str, tuple[str, ...]] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)


def validate(document: Document) -> Draft:
    """Make every record that can be made and describe what is wrong with the others."""
    draft = Draft()
    draft.problems += document.problems
    tree = document.tree
    for name in tree:
        if name not in Panel.model_fields:
            text = f": unknown key{nearest(name, Panel.model_fields)}; allowed are " + choices(
                Panel.model_fields, most=40
            )
            draft.problems.append(Problem((name,), text))
    for name in Panel.model_fields:
        if name in FAMILIES:
            _family(name, document, draft)
        else:
            _plain(name, tree, draft)
    return draft


_ADAPTERS: dict[str, TypeAdapter[Any]] = {}


def _adapter(name: str) -> TypeAdapter[Any]:
    """Give the validator of one plain field of the panel, with the panel's strictness."""
    if name not in _ADAPTERS:
        info = Panel.model_fields[name]
        annotation: Any = info.annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            _ADAPTERS[name] = TypeAdapter(annotation)
        else:
            config: Any = Panel.model_config
            _ADAPTERS[name] = TypeAdapter(info.rebuild_annotation(), config=config)
    return _ADAPTERS[name]


def _plain(name: str, tree: dict[str, Any], draft: Draft) -> None:
    info = Panel.model_fields[name]
    if name not in tree:
        if info.is_required():
            draft.problems.append(Problem((name,), ": is missing"))
        else:
            draft.records[name] = info.get_default()
        return
    try:
        draft.records[name] = _adapter(name).validate_python(tree[name])
    except ValidationError as error:
        draft.problems += [_problem((name,), item) for item in _errors(error)]


def _family(name: str, document: Document, draft: Draft) -> None:
    info, record = Panel.model_fields[name], FAMILIES[name]
    members = document.tree.get(name, {})
    broken = any(problem.path[0] == name for problem in document.problems)
    if not isinstance(members, dict):
        draft.problems.append(
            Problem((name,), f" = {show_value(members)}: must be a table of members")
        )
        members, broken = {}, True
    valid: dict[str, BaseModel] = {}
    found: dict[Problem, list[str]] = {}
    for member, values in members.items():
        try:
            valid[member] = record.model_validate(values)
        except ValidationError as error:
            for item in _errors(error):
                place = (name, member, *_path(item))
                shared = place[:3] in document.shared or item["type"] == "missing"
                problem = _problem((name, *place[2:]) if shared else place, item, strip=True)
                found.setdefault(problem, []).append(member)
    draft.records[name] = valid
    draft.names[name] = tuple(members)
    draft.problems += _merged(name, found, document)
    _check_count(name, info.metadata, len(members), broken, draft)


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


def _errors(error: ValidationError) -> list[Any]:
    return list(error.errors(include_url=False))


def _path(error: Any) -> Path:
    """Give the key path inside a record without the tags of the forms that a value may have."""
    parts = [str(part) for part in error["loc"]]
    return tuple(
        part
        for before, part in zip(["", *parts], parts, strict=False)
        if not (before == "stock_rail_gap" and part in _VARIANT_TAGS)
    )


def _problem(prefix: Path, error: Any, *, strip: bool = False) -> Problem:
    path = prefix if strip else (*prefix, *_path(error))
    return Problem(path, describe_error(error, allowed=_allowed(path)))


def _allowed(path: Path) -> list[str]:
    """List the keys that exist beside the last part of a path."""
    from turnout.panel.override import fields_at

    return fields_at(path[:-1])
