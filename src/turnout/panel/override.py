"""Change a panel by keys such as `chair.friction_coefficient` or `drive.2.stiffness`.

A key that names a field of a family sets it for all members, also for those with an own value; a
key that names a member sets it for that one. Within one set of overrides the broader keys go first.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

from turnout.core.keys import Path, put, records_in
from turnout.core.problems import Problem, nearest, show_value
from turnout.core.toml import Origin
from turnout.panel.document import Document
from turnout.panel.model import FAMILIES, PANEL_KEYS, Panel

MOST_OVERRIDES = 1000
"""Values set at once; each is compared with the others that it may cover."""


# To find what a wrong key is near to takes a hundredth of a second.
MOST_NEAREST = 20


def apply_overrides(
    document: Document, overrides: Mapping[str, object]
) -> tuple[Document, list[Problem], dict[str, object]]:
    """Set values in a document.

    Parameters
    ----------
    document : Document
        The expanded document.
    overrides : mapping of str to object
        Value by key; numbers that stand for SI quantities are marked by `mark_si`.

    Returns
    -------
    document : Document
        A new document; the old one is not changed.
    problems : list of Problem
        Keys that match nothing.
    applied : dict
        Value by leaf key, broad keys first.
    """
    tree = dict(document.tree)
    shared, given = set(document.shared), dict[str, object]()
    problems: list[Problem] = []
    leaves: list[tuple[int, str, object]] = []
    for key, value in overrides.items():
        found = _leaves(tuple(key.split(".")), value)
        leaves += [(_breadth(leaf), ".".join(leaf), item) for leaf, item in found]
    if len(leaves) > MOST_OVERRIDES:
        text = f"{len(leaves)} values are set at once, at most {MOST_OVERRIDES}; change the panel"
        return document, [Problem((), text)], {}
    leaves.sort(key=lambda leaf: leaf[0])
    applied: dict[str, object] = {}
    above: set[str] = set()  # of what is given
    own: set[Path] = set()
    for _, key, value in leaves:
        targets = PANEL_KEYS.places(tree, key)
        if not targets:
            near = _nearest_key(tree, key) if len(problems) < MOST_NEAREST else ""
            text = f": matches nothing in this panel{near}"
            unknown = key.startswith("machine.") and "'machine." not in near
            if unknown and not tree.get("machine"):
                text = (
                    ": matches nothing in this panel, whose drives have no machine before these "
                    "overrides; beside one that names a machine write machine.NAME.TABLE.KEY"
                )
            problems.append(Problem((key,), text))
            continue
        applied[key] = value
        many = _breadth(tuple(key.split("."))) == 0 and len(targets) > 1
        for target in targets:
            put(tree, target, value, own)
            place = ".".join(target)
            if place in above:
                for below in [name for name in given if name.startswith(f"{place}.")]:
                    del given[below]
            given[place] = value
            above |= _above(target)
            if many:
                shared.add(target[:3])
            else:
                shared.discard(target[:3])
    given = {
        key: value for key, value in document.given.items() if not is_given(key, given)
    } | given
    changed = replace(document, tree=tree, shared=frozenset(shared), given=given)
    return changed, problems, applied


def key_places(document: Document, keys: Iterable[str]) -> dict[str, list[Path]] | None:
    """Return the places in a document that each key sets, broad keys first; None for too many."""
    ordered = sorted(keys, key=lambda key: _breadth(tuple(key.split("."))))
    if len(ordered) > MOST_OVERRIDES:
        return None
    return {key: PANEL_KEYS.places(document.tree, key) for key in ordered}


def supersede(before: Mapping[str, object], applied: Mapping[str, object]) -> dict[str, object]:
    """Join earlier and later overrides; a later broad key removes the earlier ones it covers."""
    if not before:
        return dict(applied)
    kept = {
        key: value
        for key, value in before.items()
        if not any(covers(later, key) for later in applied)
    }
    return kept | dict(applied)


def covers(broad: str, key: str) -> bool:
    """Return True if a key sets all that another one does."""
    wide, parts = tuple(broad.split(".")), tuple(key.split("."))
    if wide == parts or (len(wide) < len(parts) and parts[: len(wide)] == wide):
        return True
    return _breadth(wide) == 0 and parts[0] == wide[0] and parts[2 : 1 + len(wide)] == wide[1:]


@lru_cache(maxsize=1024)
def _breadth(path: Path) -> int:
    """Give 0 for a key that sets a whole family, else 1."""
    family = FAMILIES.get(path[0])
    return 0 if family and len(path) > 1 and path[1] in family.model_fields else 1


def _leaves(path: Path, value: object) -> list[tuple[Path, object]]:
    """Break a table given for a member or record up into its fields."""
    if isinstance(value, Mapping) and value and _holds_records(path):
        return [leaf for key, item in value.items() for leaf in _leaves((*path, str(key)), item)]
    return [(path, value)]


def _holds_records(path: Path) -> bool:
    if path[0] in FAMILIES:
        fields = FAMILIES[path[0]].model_fields
        return len(path) == 1 or (len(path) == 2 and path[1] not in fields)
    info = Panel.model_fields.get(path[0])
    return len(path) == 1 and info is not None and any(records_in(info.annotation))


@lru_cache(maxsize=4096)
def _above(place: Path) -> frozenset[str]:
    """Return the keys of all tables around a value."""
    return frozenset(".".join(place[:depth]) for depth in range(1, len(place)))


def restated(document: Document) -> dict[str, Origin]:
    """Return the origins of values after those of some keys, and all below them, were given."""
    given = document.given
    kept = {name: origin for name, origin in document.origins.items() if not is_given(name, given)}
    return kept | {key: Origin("override", show_value(value)) for key, value in given.items()}


def is_given(name: str, given: Mapping[str, object]) -> bool:
    """Return True if a key or one above it is among those given."""
    while name:
        if name in given:
            return True
        name = name.rpartition(".")[0]
    return False


def _nearest_key(tree: Mapping[str, Any], key: str) -> str:
    return nearest(key, PANEL_KEYS.names(_with_named(tree, tuple(key.split(".")))))


def _with_named(tree: Mapping[str, Any], path: Path) -> Mapping[str, Any]:
    """Return the tree with the member that a key names, if an override may bring it along."""
    family = FAMILIES.get(path[0])
    if family is None or path[0] not in PANEL_KEYS.growing or len(path) < 3:
        return tree
    names = list(family.model_fields)
    if path[1] in names or not (path[2] in names or nearest(path[2], names)):
        return tree
    return {**tree, path[0]: {**tree.get(path[0], {}), path[1]: {}}}
