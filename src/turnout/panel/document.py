"""From the TOML document as written, with families and their defaults, to one tree of records.

A family is a table of members: `[chair.5]` is the chair named "5". The table `[chair]` itself may
hold defaults (`friction_coefficient = 0.4`), which every member takes that has no own value, and
the generator `x = {start, step, count}` or `x = [...]` with optional `names`, which makes members.
A single `x` is a generator too where the family has no member of its own.
A member's own value replaces a default as a whole.
"""

from dataclasses import dataclass, field
from typing import Any

from turnout.core.keys import Path
from turnout.core.problems import Problem, meant, nearest, show_value
from turnout.core.toml import Origin, TomlFile
from turnout.core.units import LENGTH, SI, parse_quantities
from turnout.panel.model import FAMILIES
from turnout.panel.records import Placed, RailMatrices

MOST_MEMBERS = 500
"""Members of one family; the longest switches stand on some 200 sleepers."""

MOST_SHARED = 1_000_000
"""Values that all members of a family take from it together."""


@dataclass(frozen=True, slots=True)
class Document:
    """A panel document with its families spread out into members.

    Parameters
    ----------
    tree : dict
        Nested values as in the file; every member of a family is complete.
    shared : frozenset of key paths
        Values (family, member, field) that a member took from its family.
    origins : dict
        Origin by dotted key of the value in the tree, before anything was given in its place.
    problems : tuple of Problem
        Faults of the families themselves.
    tables : dict
        Time [s] and fraction columns of the schedule files read so far, by their name.
    matrices : dict
        Matrices of rails read so far, by the name of their file.
    given : dict
        Values that were set later by their dotted keys; see `turnout.panel.override.restated`.
    """

    tree: dict[str, Any]
    shared: frozenset[Path] = frozenset()
    origins: dict[str, Origin] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()
    tables: dict[str, tuple[list[float], list[float]]] = field(default_factory=dict)
    matrices: dict[str, RailMatrices] = field(default_factory=dict)
    given: dict[str, object] = field(default_factory=dict)


def is_generated(family: str) -> bool:
    """Return True if the family's members can be made by a generator of positions."""
    return issubclass(FAMILIES[family], Placed)


def expand(file: TomlFile) -> Document:
    """Spread the families of a document out into complete members.

    Parameters
    ----------
    file : TomlFile
        The document as read.

    Returns
    -------
    Document
        The tree that the records are validated from; nothing is validated yet except what the
        generators need.
    """
    tree: dict[str, Any] = {}
    shared: set[Path] = set()
    problems: list[Problem] = []
    origins: dict[str, Origin] = {}
    for key, value in file.data.items():
        if key in FAMILIES and isinstance(value, dict):
            spread = _Spread(key, value, file.origins)
            tree[key] = spread.members
            shared |= spread.shared
            problems += spread.problems
            origins |= spread.origins
        else:
            tree[key] = value
            _collect((key,), (key,), value, file.origins, origins)
    return Document(tree, frozenset(shared), origins, tuple(problems))


class _Spread:
    """One family on its way from defaults and members to complete members."""

    def __init__(self, family: str, table: dict[str, Any], comments: dict[Path, Origin]) -> None:
        self.family = family
        self.comments = comments
        self.members: dict[str, dict[str, Any]] = {}
        self.shared: set[Path] = set()
        self.problems: list[Problem] = []
        self.origins: dict[str, Origin] = {}
        record = FAMILIES[family]
        own: dict[str, Any] = {}
        defaults: dict[str, Any] = {}
        for key, value in table.items():
            target = defaults if key in record.model_fields or key == "names" else own
            target[key] = value
        positions = self._generate(defaults, alone=not own) if is_generated(family) else {}
        names = (*positions, *(name for name in own if name not in positions))
        if fault := _too_much(len(names), defaults):
            self.problems.append(Problem((self.family,), fault))
            return
        for name in names:
            self._member(name, own.get(name, {}), defaults, positions)

    def _generate(self, defaults: dict[str, Any], *, alone: bool) -> dict[str, SI]:
        """Return the positions of members; an `x` that is no list makes one only if `alone`."""
        names = defaults.pop("names", None)
        given = defaults.get("x")
        if not isinstance(given, dict | list) and not (alone and given is not None):
            if names is not None:
                text = ": needs a generator `x = [...]` or `x = {start, step, count}` beside it"
                self.problems.append(Problem((self.family, "names"), text))
            return {}
        del defaults["x"]
        try:
            positions = parse_quantities(given, LENGTH)
        except ValueError as error:
            text = f" = {show_value(given)}: {error}"
            self.problems.append(Problem((self.family, "x"), text))
            return {}
        if names is None:
            names = [str(number) for number in range(1, len(positions) + 1)]
        fault = _names_fault(names, len(positions))
        if fault:
            self.problems.append(
                Problem((self.family, "names"), f" = {show_value(names)}: {fault}")
            )
            return {}
        return {name: SI(x) for name, x in zip(names, positions, strict=True)}

    def _member(
        self, name: str, own: Any, defaults: dict[str, Any], positions: dict[str, SI]
    ) -> None:
        if not isinstance(own, dict):
            known = FAMILIES[self.family].model_fields
            text = (
                f" = {show_value(own)}: unknown key{nearest(name, known)}; "
                f"a member is a table, defaults are {', '.join(known)}"
            )
            self.problems.append(Problem((self.family, name), text, meant(name, known)))
            return
        if "." in name or not name.strip():
            text = ": a name may not be empty or contain a dot"
            self.problems.append(Problem((self.family, name), text))
        generated = {"x": positions[name]} if name in positions else {}
        member = defaults | generated | own
        self.members[name] = member
        for key, value in member.items():
            place = (self.family, name, key)
            source: Path = place
            if key not in own:
                source = (self.family, key)
                if key not in generated:
                    self.shared.add(place)
            _collect(place, source, value, self.comments, self.origins)


def _too_much(members: int, defaults: dict[str, Any]) -> str:
    """Return the fault of a family that a short file makes too large; empty if none."""
    if members > MOST_MEMBERS:
        return f": makes {members} members, at most {MOST_MEMBERS}; give fewer, or a smaller count"
    for key, value in defaults.items():
        values = value.get("values") if isinstance(value, dict) else value
        if isinstance(values, list) and len(values) * members > MOST_SHARED:
            return (
                f".{key}: {len(values)} values for {members} members, at most {MOST_SHARED} "
                "together; give fewer values"
            )
    return ""


def _names_fault(names: Any, count: int) -> str:
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return "must be a list of texts"
    if len(names) != count:
        return f"{len(names)} names for {count} positions"
    if len(set(names)) != count:
        return "the same name twice"
    return ""


def _collect(
    place: Path,
    source: Path,
    value: Any,
    comments: dict[Path, Origin],
    origins: dict[str, Origin],
) -> None:
    """Find the origin of a value, key by key for tables: its own comment, or the nearest above."""
    if isinstance(value, dict) and value and not _is_quantity(value):
        for key, item in value.items():
            _collect((*place, key), (*source, key), item, comments, origins)
        return
    for length in range(len(source), 0, -1):
        origin = comments.get(source[:length])
        if origin:
            origins[".".join(place)] = origin
            break
    if isinstance(value, list):
        for number in range(len(value)):
            origin = comments.get((*source, str(number)))
            if origin:
                origins[".".join((*place, str(number)))] = origin


def _is_quantity(value: dict[str, Any]) -> bool:
    return set(value) in ({"unit", "values"}, {"start", "step", "count"})
