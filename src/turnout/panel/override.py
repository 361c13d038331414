"""Change a panel by keys such as `chair.friction_coefficient` or `drive.2.stiffness`.

A key that names a field of a family sets it for all members, also for those with an own value; a
key that names a member sets it for that one. Within one set of overrides the broader keys go first.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from turnout.core.keys import Path, put, records_in
from turnout.core.lru_cache import LRUCache
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
    values = overrides.values()  # numbers first: to find that one is no mapping takes longer
    plain = all(isinstance(value, float) or not isinstance(value, Mapping) for value in values)
    names = (id(document), *overrides)
    known = known_plan(document, overrides) if plain else None
    if known is not None:
        return known.apply(overrides)
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
    given = {key: value for key, value in document.given.items() if not _given(key, given)} | given
    changed = replace(document, tree=tree, shared=frozenset(shared), given=given)
    if plain and not problems:
        places = {key: PANEL_KEYS.places(document.tree, key) for key in applied}
        plan = _plan(document, changed, places)
        if plan is not None:
            _plans.put(names, plan)
    return changed, problems, applied


@dataclass(frozen=True, slots=True)
class OverridePlan:
    """Plan of changing a document by values for certain keys, all of them fields of members.

    Attributes
    ----------
    document : Document
        Document to change; it is known by its identity.
    targets : dict
        Places of each key, broad keys first.
    members : dict
        Whose tables become copies, by family.
    shared : frozenset of key paths
        As of the changed document.
    given : dict
        The former values that nothing covers.
    places : list of (key path, str)
        Every place that is set, and the key that does it last, in the order of the values given.
    """

    document: Document
    targets: dict[str, list[Path]]
    members: dict[str, list[str]]
    shared: frozenset[Path]
    given: dict[str, object]
    places: list[tuple[Path, str]]

    def apply(
        self, overrides: Mapping[str, object]
    ) -> tuple[Document, list[Problem], dict[str, object]]:
        """Return the result of `apply_overrides` for other values of the same keys."""
        tree = dict(self.document.tree)
        for family, names in self.members.items():
            members = tree[family] = dict(tree[family])
            for name in names:
                members[name] = dict(members[name])
        for key, targets in self.targets.items():
            value = overrides[key]
            for family, name, field in targets:
                tree[family][name][field] = value
        given = self.given | {".".join(place): overrides[key] for place, key in self.places}
        changed = replace(self.document, tree=tree, shared=self.shared, given=given)
        return changed, [], {key: overrides[key] for key in self.targets}


_plans = LRUCache[OverridePlan](16)


def known_plan(document: Document, overrides: Mapping[str, object]) -> OverridePlan | None:
    """Return the plan by which the keys of overrides changed a document before, or None."""
    return _plans.get((id(document), *overrides))


def _plan(
    document: Document, changed: Document, targets: dict[str, list[Path]]
) -> OverridePlan | None:
    """Return the plan for changing a document by the same keys; None if a table comes or goes."""
    last: dict[Path, str] = {}
    members: dict[str, dict[str, None]] = {}
    for key, found in targets.items():
        for place in found:
            if len(place) != len(("family", "member", "field")):
                return None
            family, name, field = place
            member = document.tree.get(family, {}).get(name)
            if not isinstance(member, dict) or isinstance(member.get(field), dict):
                return None
            last[place] = key
            members.setdefault(family, {})[name] = None
    set_here = {".".join(place) for place in last}
    kept = {name: value for name, value in changed.given.items() if name not in set_here}
    of_families = {family: list(names) for family, names in members.items()}
    return OverridePlan(document, targets, of_families, changed.shared, kept, list(last.items()))


def supersede(before: Mapping[str, object], applied: Mapping[str, object]) -> dict[str, object]:
    """Join earlier and later overrides; a later broad key removes the earlier ones it covers."""
    if not before:
        return dict(applied)
    kept = {
        key: value
        for key, value in before.items()
        if not any(_covers(later, key) for later in applied)
    }
    return kept | dict(applied)


def _covers(broad: str, key: str) -> bool:
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
    kept = {name: origin for name, origin in document.origins.items() if not _given(name, given)}
    return kept | {key: Origin("override", show_value(value)) for key, value in given.items()}


def _given(name: str, given: Mapping[str, object]) -> bool:
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
