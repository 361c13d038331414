"""Values of a panel in engineers' units, with their origins.

Numbers in engineers' units for the screen; SI stays inside. Every value of a panel with its unit
and where it comes from, as lines or in groups.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from turnout.core.keys import unit_of
from turnout.core.value_text import shown_unit

if TYPE_CHECKING:
    from turnout.panel.load import LoadedPanel


# Lengths of the layout are read in metres, all others in millimetres.
IN_METRES = frozenset({"x", "start", "end", "radius", "curve_radius", "lead", "element_length"})


def shown(value: Any, unit: str, name: str) -> str:
    """Return a value as it is read on the screen.

    Parameters
    ----------
    value : object
        SI number, list of them, text, or mapping of names to numbers.
    unit : str
        Its SI unit; empty if it has none.
    name : str
        Name of the field: positions are shown in metres, other lengths in millimetres.

    Examples
    --------
    >>> shown(0.115, "m", "stroke"), shown(7.5e5, "N/m", "stiffness"), shown([0.0, 0.6], "m", "x")
    ('115 mm', '750 kN/m', '0, 0.6 m')
    """
    if isinstance(value, dict):
        return ", ".join(f"{key}: {shown(item, unit, name)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        if not unit or not value:
            return ", ".join(_number(item) for item in value)
        text, factor = _screen_unit(unit, name)
        if isinstance(value[0], list | tuple):
            reach = [
                f"{min(c) / factor:.4g} ... {max(c) / factor:.4g}" for c in zip(*value, strict=True)
            ]
            return f"{len(value)} points, {' by '.join(reach)} {text}"
        return f"{', '.join(_number(item / factor) for item in value)} {text}"
    if not unit or not isinstance(value, float | int):
        return _number(value)
    text, factor = _screen_unit(unit, name)
    return f"{_number(value / factor)} {text}"


def _screen_unit(unit: str, name: str) -> tuple[str, float]:
    return ("m", 1.0) if unit == "m" and name in IN_METRES else shown_unit(unit)


def _number(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


LONG_LIST = 6
NAME_WIDTH, VALUE_WIDTH = 32, 24
ASSUMED = "assumption"
HEAD = frozenset({"schema_version", "name", "description"})


@dataclass(frozen=True, slots=True)
class Leaf:
    """One value of a panel: its key below the member, text, and origin."""

    below: str
    text: str
    origin: str


def value_groups(panel: "LoadedPanel") -> Iterator[tuple[str, list[Leaf]]]:
    """Yield the values of a panel by family or record, each under its heading.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> groups = dict(value_groups(load_panel("sb1")))
    >>> [leaf.text for leaf in groups["drive (1, 2)"] if leaf.below == "x"]
    ['0.3, 6.9 m']
    """
    for name, field in type(panel).model_fields.items():
        value = getattr(panel, name)
        if name in HEAD or value is None or value == {}:
            continue
        if _is_family(value):
            yield f"{name} ({_listed(list(value))})", list(_family(panel, name, value))
        elif _is_record(value):
            yield name, list(_leaves(panel, (name,), value))
        else:
            yield "", [_leaf(panel, (name,), name, value, field)]


def value_lines(panel: "LoadedPanel") -> Iterator[str]:
    """Yield every value of a panel: its key, its text and its origin."""
    for heading, leaves in value_groups(panel):
        if heading:
            yield heading
        yield from _aligned(leaves, indent="  " if heading else "")


def assumption_lines(panel: "LoadedPanel") -> Iterator[str]:
    """Yield the values that the panel itself calls assumed, each family under its name."""
    heading = ""
    for line in value_lines(panel):
        if not line.startswith(" "):
            heading = line
        if ASSUMED in line:
            if heading and heading != line:
                yield heading
            heading = ""
            yield line


def _family(panel: "LoadedPanel", name: str, members: dict[str, Any]) -> Iterator[Leaf]:
    """Yield a family field by field: the value of most members, then members with another one."""
    fields: dict[str, dict[tuple[str, str], list[str]]] = {}
    for member, record in members.items():
        for leaf in _leaves(panel, (name, member), record):
            groups = fields.setdefault(leaf.below, {})
            groups.setdefault((leaf.text, leaf.origin), []).append(member)
    for below, groups in fields.items():
        if below == "x" and _stand_alike(members, groups):
            yield Leaf(below, _places(members), next(iter(groups))[1])
            continue
        ranked = sorted(groups.items(), key=lambda item: -len(item[1]))
        most = len(ranked[0][1])
        everyone = most == len(members)
        for number, ((text, origin), owners) in enumerate(ranked):
            common = everyone or (number == 0 and most > len(members) / 2)
            label = below if common else f"{below} ({_listed(owners)})"
            yield Leaf(label, text, origin)


def _stand_alike(members: dict[str, Any], groups: dict[tuple[str, str], list[str]]) -> bool:
    """Return True if positions can share a line: one number each, all of the same origin."""
    one_each = all(isinstance(record.x, float) for record in members.values())
    return one_each and len({origin for _, origin in groups}) == 1


def _places(members: dict[str, Any]) -> str:
    places = [record.x for record in members.values()]
    if len(places) <= LONG_LIST:
        return f"{', '.join(f'{place:g}' for place in places)} m"
    return f"{min(places):g} ... {max(places):g} m"


def _listed(names: list[str]) -> str:
    if len(names) <= LONG_LIST:
        return ", ".join(names)
    return f"{len(names)}: {names[0]} ... {names[-1]}"


def _leaves(
    panel: "LoadedPanel", path: tuple[str, ...], record: Any, below: str = ""
) -> Iterator[Leaf]:
    for name, field in type(record).model_fields.items():
        value = getattr(record, name)
        if value is None or value == {}:
            continue
        inner = f"{below}.{name}" if below else name
        if _is_record(value):
            yield from _leaves(panel, (*path, name), value, inner)
        else:
            yield _leaf(panel, (*path, name), inner, value, field)


def _leaf(panel: "LoadedPanel", path: tuple[str, ...], below: str, value: Any, field: Any) -> Leaf:
    key = ".".join(path)
    text = shown(value, unit_of(field), path[-1])
    if isinstance(value, list | tuple) and len(value) > LONG_LIST and not _is_points(value):
        ends = [shown(end, unit_of(field), path[-1]) for end in (value[0], value[-1])]
        text = f"{ends[0]} ... {ends[1]} ({len(value)} values)"
    return Leaf(below, text, _origin(panel, key, value))


def _is_points(value: list[Any] | tuple[Any, ...]) -> bool:
    return isinstance(value[0], list | tuple)


def _origin(panel: "LoadedPanel", key: str, value: Any) -> str:
    origin = panel.origins.get(key)
    if origin is None and isinstance(value, dict):
        found = [panel.origins.get(f"{key}.{name}") for name in value]
        origin = next((item for item in found if item is not None), None)
    if origin is None:
        return "" if isinstance(value, str) else "default"
    return f"{origin.kind}: {origin.text}" if origin.text else origin.kind


def _aligned(leaves: list[Leaf], indent: str = "  ") -> Iterator[str]:
    for leaf in leaves:
        head = f"{indent}{leaf.below}".ljust(NAME_WIDTH)
        yield f"{head} {leaf.text:<{VALUE_WIDTH}} {leaf.origin}".rstrip()


def _is_record(value: Any) -> bool:
    return hasattr(type(value), "model_fields")


def _is_family(value: Any) -> bool:
    return isinstance(value, dict) and all(_is_record(item) for item in value.values())
