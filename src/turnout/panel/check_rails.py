"""Checks of sections, of flexible stock rails, and of tabulated data.

Checks of sections drawn as outlines, and of the names by which rails take a section. Checks of
flexible stock rails, and who stands at which rail. Checks of tabulated data: sections, stock rail
gaps, elastic laws of drives.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from turnout.core.keys import Path
from turnout.core.problems import Problem, choices, nearest, show_value
from turnout.law.friction_state import FASTEST, FRICTION_STATES
from turnout.panel.library_members import library_outline_names
from turnout.panel.profile import outline_points, section_columns
from turnout.panel.records import Chair, Drive, Profile, SectionTable
from turnout.panel.validate import Draft, Partial

Check = Callable[[Draft, Path, Any], Iterator[Problem]]
"""Yields the problems of a record at a path."""
_POSITIVE = (
    "area",
    "second_moment_vertical",
    "second_moment_lateral",
    "torsion_constant",
)


def rising_fault(values: Sequence[float], *, unit: str) -> str:
    """Return the first fault of a sequence that does not rise, or an empty text.

    Examples
    --------
    >>> rising_fault([0.0, 2.0, 1.0], unit="m")
    'must rise, but 1 m comes after 2 m'
    """
    for before, after in itertools.pairwise(values):
        if after <= before:
            return f"must rise, but {after:g} {unit} comes after {before:g} {unit}"
    return ""


def alone(check: Callable[[Path, Any], Iterator[Problem]]) -> Check:
    """Return a check of a record that looks at no others."""
    return lambda _, path, record: check(path, record)


def names_known(key: str, family: str) -> Check:
    """Return a check that a key of a record names members of a family, one or several."""

    def check(draft: Draft, path: Path, record: Any) -> Iterator[Problem]:
        given, names = getattr(record, key), draft.names[family]
        for name in [given] if isinstance(given, str) else given or ():
            if name not in names:
                yield Problem((*path, key), unknown_name(family.replace("_", " "), name, names))

    return check


def more_than(path: Path, record: Any, low: str, high: str) -> Iterator[Problem]:
    """Check that one length of a record is more than another."""
    below, above = getattr(record, low), getattr(record, high)
    if above <= below:
        text = f" = {above:g} m: must be more than {low}, {below:g} m"
        yield Problem((*path, high), text)


def check_profile(path: Path, profile: float | Profile, *, what: str = "gap") -> Iterator[Problem]:
    """Check the table, or the constant, of a gap or another length along a rail."""
    if not isinstance(profile, Profile):
        if profile < 0:
            yield Problem(path, f" = {profile:g} m: a {what} must be at least 0")
        return
    if len(profile.x) != len(profile.value):
        text = f": has {len(profile.value)} entries, x has {len(profile.x)}"
        yield Problem((*path, "value"), text)
    fault = rising_fault(profile.x, unit="m")
    if fault:
        yield Problem((*path, "x"), f": {fault}")
    if min(profile.value) < 0:
        yield Problem(
            (*path, "value"), f": a {what} must be at least 0, least {min(profile.value):g} m"
        )


def check_section(path: Path, table: SectionTable) -> Iterator[Problem]:
    """Check a section table: its stations, the lengths of its columns, impossible values."""
    kinds = [name for name in ("x", "running_edge_offset") if getattr(table, name) is not None]
    if len(kinds) != 1:
        text = ": needs stations, either x or running_edge_offset" + (", not both" if kinds else "")
        yield Problem(path, text)
        return
    stations = getattr(table, kinds[0])
    fault = rising_fault(stations, unit="m")
    if fault:
        yield Problem((*path, kinds[0]), f": {fault}")
    columns = {
        name: values
        for name, values in section_columns(table).items()
        if getattr(table, name) is not None
    }
    fits = True
    for name, values in columns.items():
        if len(values) != len(stations):
            fits = False
            text = f": has {len(values)} entries, {kinds[0]} has {len(stations)}"
            yield Problem((*path, name), text)
        if name in _POSITIVE and min(values) <= 0:
            fits = False
            yield Problem((*path, name), f": must be more than 0, least is {min(values):g}")
    if fits and table.product_moment is not None:
        product = np.square(table.product_moment)
        limit = np.multiply(table.second_moment_vertical, table.second_moment_lateral)
        if np.any(product >= limit):
            row = int(np.argmax(product >= limit)) + 1
            text = f": entry {row}: its square must be less than vertical times lateral"
            yield Problem((*path, "product_moment"), text)


def check_drive_table(path: Path, drive: Drive) -> Iterator[Problem]:
    """Check the elastic law of a drive if it is given as a table."""
    given = [name for name in ("extension", "force") if getattr(drive, name) is not None]
    if len(given) == 1:
        other = "force" if given == ["extension"] else "extension"
        yield Problem((*path, other), f": is missing; the elastic law has {given[0]}")
    if drive.extension is None or drive.force is None:
        return
    if len(drive.extension) != len(drive.force) or len(drive.force) < 2:
        text = f": has {len(drive.force)} entries, extension has {len(drive.extension)}; at least 2"
        yield Problem((*path, "force"), text)
        return
    faults = [
        (name, fault)
        for name, unit in (("extension", "m"), ("force", "N"))
        if (fault := rising_fault(getattr(drive, name), unit=unit))
    ]
    for name, fault in faults:
        yield Problem((*path, name), f": {fault}")
    if faults:
        return
    inside = drive.extension[0] <= 0.0 <= drive.extension[-1]
    at_zero = float(np.interp(0.0, drive.extension, drive.force))
    if not inside or abs(at_zero) > 1e-9 * max(abs(value) for value in drive.force):
        yield Problem((*path, "force"), ": the law must pass through the origin, 0 N at 0 m")


def check_saturation(path: Path, drive: Any) -> Iterator[Problem]:
    """Check that the saturated stiffness does not exceed the stiffness."""
    if drive.saturated_stiffness > drive.stiffness:
        text = (
            f" = {drive.saturated_stiffness:g} N/m: must not be more than stiffness, "
            f"{drive.stiffness:g} N/m"
        )
        yield Problem((*path, "saturated_stiffness"), text)


SECTION_KINDS = ("section", "outline_section", "planed_section")
_LEAST_POINTS = 3
# What a rail can measure across, and how far its underside may lie from z = 0 [m].
_LEAST_EXTENT, _LARGEST_EXTENT, _UNDERSIDE = 0.005, 1.0, 0.001


def find_section(draft: Draft, name: object) -> tuple[str, Any] | None:
    """Return kind and record of a section by its name, or None."""
    for kind in SECTION_KINDS:
        if name in draft.names.get(kind, ()):
            return kind, draft.records[kind][name]
    return None


def check_section_name(
    draft: Draft, path: Path, name: object, *, kinds: tuple[str, ...] = SECTION_KINDS
) -> Iterator[Problem]:
    """Say that a rail names no section of the kinds that it may have."""
    found = find_section(draft, name)
    if found is not None and found[0] not in kinds:
        text = f" = {show_value(name)}: is a {found[0]}; a stock rail's section does not vary"
        yield Problem((*path, "section"), text)
    elif found is None:
        names = [n for kind in kinds for n in draft.names.get(kind, ())]
        text = f"there is no such section{nearest(str(name), names)}; there are {choices(names)}"
        yield Problem((*path, "section"), f" = {show_value(name)}: {text}")


def check_section_kinds(draft: Draft) -> Iterator[Problem]:
    """Refuse one name for sections of two kinds."""
    seen: dict[str, str] = {}
    for kind in SECTION_KINDS:
        for name in draft.names.get(kind, ()):
            other = seen.setdefault(name, kind)
            if other != kind:
                text = f": a {other} has this name already; names are unique across kinds"
                yield Problem((kind, name), text)


def check_outline(draft: Draft, path: Path, outline: Any) -> Iterator[Problem]:
    """Refuse points that enclose no section."""
    where = (*path, "points")
    given = np.array(outline.points)
    if outline.symmetric and np.any(given[:, 0] < 0.0):
        place = int(np.argmax(given[:, 0] < 0.0)) + 1
        text = f": point {place} has y < 0; with symmetric = true give the half with y >= 0"
        yield Problem(where, text)
        return
    repeated = np.flatnonzero(np.all(given[1:] == given[:-1], axis=1))
    if repeated.size:
        number = int(repeated[0]) + 2
        yield Problem(where, f": point {number} repeats point {number - 1}; leave one of them out")
        return
    points = outline_points(outline.points, symmetric=outline.symmetric)
    if len(points) < _LEAST_POINTS:
        yield Problem(where, f": needs {_LEAST_POINTS} points or more, has {len(points)}")
        return
    crossing = first_crossing(points)
    if crossing is not None:
        y, z = 1e3 * crossing
        yield Problem(where, f": the boundary crosses itself near y = {y:.4g} mm, z = {z:.4g} mm")
        return
    yield from _extent(where, points)


def _extent(where: tuple[str, ...], points: npt.NDArray[np.float64]) -> Iterator[Problem]:
    """Refuse an outline of no rail's size, or one that is not drawn from its underside."""
    for axis, span in zip("yz", np.ptp(points, axis=0), strict=True):
        if not _LEAST_EXTENT <= span <= _LARGEST_EXTENT:
            text = (
                f": extends over {1e3 * span:.4g} mm along {axis}, allowed are "
                f"{1e3 * _LEAST_EXTENT:g} to {1e3 * _LARGEST_EXTENT:g} mm; check its unit"
            )
            yield Problem(where, text)
            return
    lowest = float(points[:, 1].min())
    if abs(lowest) > _UNDERSIDE:
        text = f": the lowest point is at z = {1e3 * lowest:.4g} mm; z counts from the underside"
        yield Problem(where, f"{text}, shift the drawing by {-1e3 * lowest:.4g} mm")


def check_outline_section(draft: Draft, path: Path, record: Any) -> Iterator[Problem]:
    """Check that the outline of a prismatic section exists."""
    yield from _named_outline(draft, (*path, "outline"), record.outline)


def first_crossing(points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64] | None:
    """Find a place at which the boundary crosses or touches itself, or None.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        Vertices in order; the last one is joined to the first.

    Returns
    -------
    ndarray, shape (2,), or None

    Examples
    --------
    >>> bow = np.array([[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 2.0]])
    >>> first_crossing(bow).tolist()
    [1.0, 1.0]
    """
    closed = len(points) > 1 and bool(np.all(points[0] == points[-1]))
    start = points[:-1] if closed else points
    edge = np.roll(start, -1, axis=0) - start
    count = len(start)
    if count < _LEAST_POINTS:
        return np.asarray(start[0])
    first, second = np.triu_indices(count, k=1)
    apart = (second - first > 1) & (second - first < count - 1)
    first, second = first[apart], second[apart]
    between = start[second] - start[first]
    determinant = _cross(edge[first], edge[second])
    with np.errstate(divide="ignore", invalid="ignore"):
        along = _cross(between, edge[second]) / determinant
        across = _cross(between, edge[first]) / determinant
    hits = (along >= 0.0) & (along <= 1.0) & (across >= 0.0) & (across <= 1.0)
    if hits.any():
        place = int(np.argmax(hits))
        return np.asarray(start[first[place]] + along[place] * edge[first[place]])
    area = 0.5 * float(np.sum(_cross(start, np.roll(start, -1, axis=0))))
    return np.asarray(start[0]) if area == 0.0 else None


def _cross(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    product: npt.NDArray[np.float64] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product


def _named_outline(draft: Draft, path: Path, name: str) -> Iterator[Problem]:
    names = draft.names["outline"]
    if name not in names:
        known = list(dict.fromkeys((*names, *library_outline_names())))
        text = f"there is no such outline{nearest(name, known)}; there are {choices(known)}"
        yield Problem(path, f" = {show_value(name)}: {text}")


def check_planing_outline(draft: Draft, path: Path, record: Any, key: str) -> Iterator[Problem]:
    """Check that an outline of a planed section exists, with its running edge."""
    name, path = getattr(record, key), (*path, key)
    yield from _named_outline(draft, path, name)
    outline = draft.records["outline"].get(name, Partial())
    if outline.running_edge is None:
        yield Problem(path, f" = {show_value(name)}: that outline lacks running_edge")


def check_offsets(path: Path, record: Any, key: str) -> Iterator[Problem]:
    """Check that the stations of a planed section rise from 0 or more."""
    values = getattr(record, key)
    fault = rising_fault(values, unit="m")
    if fault:
        yield Problem((*path, key), f": {fault}")
    elif values[0] < 0.0:
        yield Problem((*path, key), f": must be at least 0, the first is {values[0]:g} m")


def check_lowering(path: Path, record: Any) -> Iterator[Problem]:
    """Check that a lowering goes down, with a value for each station."""
    if len(record.lowering) != len(record.lowering_offset):
        text = (
            f": has {len(record.lowering)} entries, lowering_offset {len(record.lowering_offset)}"
        )
        yield Problem((*path, "lowering"), text)
    if min(record.lowering) < 0.0:
        text = f": must be at least 0, the least is {min(record.lowering):g} m"
        yield Problem((*path, "lowering"), text)


def check_lowest(draft: Draft, path: Path, record: Any) -> Iterator[Problem]:
    """Refuse a lowering that leaves nothing above the underside of the switch rail."""
    outline = draft.records["outline"].get(record.stock_outline, Partial())
    height = float(outline_points(outline.points, symmetric=outline.symmetric)[:, 1].max())
    room = height - record.seat_height
    if max(record.lowering) >= room:
        text = (
            f": must be less than {1e3 * room:g} mm, the height of the stock rail above "
            f"seat_height; the largest is {1e3 * max(record.lowering):g} mm"
        )
        yield Problem((*path, "lowering"), text)


ON_ONE_RAIL = ("drive", "sensor")


def unknown_name(what: str, name: object, names: Iterable[str]) -> str:
    """Return the text for an unknown name, with the known ones and the nearest."""
    known = list(names)
    return (
        f" = {show_value(name)}: there is no such {what}{nearest(str(name), known)}; "
        f"there are {choices(known)}"
    )


def rails_of(family: str, record: Any, draft: Draft) -> list[str]:
    """Give the names of the rails that a record stands at."""
    if family in ON_ONE_RAIL:
        return list(draft.names["rail"]) if record.rail is None else [record.rail]
    return list(draft.names["rail"]) if record.rails is None else list(record.rails)


def check_stock_rail_held(draft: Draft, path: Path, stock: Any) -> Iterator[Problem]:
    """Refuse a flexible stock rail that nothing holds along the track."""
    fastenings = draft.records["stock_fastening"].values()
    held = any(f.stiffness_x > 0 and (f.rails is None or path[1] in f.rails) for f in fastenings)
    if stock.ends == "free" and not held:
        text = ' = "free": nothing holds the rail; clamp it or give it stock_fastening'
        yield Problem((*path, "ends"), text)


def check_stock_rail_section(draft: Draft, path: Path, stock: Any) -> Iterator[Problem]:
    """Check that a flexible stock rail has a section that does not vary."""
    kinds = ("section", "outline_section")
    yield from check_section_name(draft, path, stock.section, kinds=kinds)
    kind, section = find_section(draft, stock.section) or ("", Partial())
    if kind == "section" and len(section.area) > 1:
        text = f" = {show_value(stock.section)}: has {len(section.area)} rows, a stock rail has one"
        yield Problem((*path, "section"), text)


def check_stock_rail_faces(draft: Draft, path: Path, stock: Any) -> Iterator[Problem]:
    """Check the rail that a flexible stock rail faces, and that it reaches its stops."""
    names = draft.names["rail"]
    if stock.faces not in names:
        yield Problem((*path, "faces"), unknown_name("rail", stock.faces, names))
        return
    others = [n for n, s in draft.records["stock_rail"].items() if s.faces == stock.faces]
    if others[0] != path[1]:
        text = f" = '{stock.faces}': stock rail '{others[0]}' faces it already"
        yield Problem((*path, "faces"), text)
    rail = draft.records["rail"][stock.faces]
    if not rail.has_stock_rail:
        yield Problem((*path, "faces"), f' = "{stock.faces}": that rail has no fit_gap')
    for family in ("stop", "stud"):
        for name, item in draft.records[family].items():
            if stock.faces in rails_of(family, item, draft) and not (
                stock.start <= item.x <= stock.end
            ):
                text = f": does not reach {family} '{name}' at {item.x:g} m"
                yield Problem(path, text)


def check_stock_fastening(draft: Draft, path: Path, record: Any) -> Iterator[Problem]:
    """Check that a fastening of stock rails stands on one."""
    names = draft.names["stock_rail"]
    for rail in names if record.rails is None else record.rails:
        if rail not in names:
            yield Problem((*path, "rails"), unknown_name("stock rail", rail, names))
            continue
        stock = draft.records["stock_rail"][rail]
        if not stock.start <= record.x <= stock.end:
            text = f" = {record.x:g} m: is off stock rail '{rail}'"
            yield Problem((*path, "x"), f"{text}, {stock.start:g} ... {stock.end:g} m")


LARGEST_RISE = 20.0
"""Largest coefficient over that in motion at any speed [-]."""


def check_friction_course(path: Path, chair: Any) -> Iterator[Problem]:
    """Find the faults of the friction of a chair along the stroke."""
    opening, factor = chair.friction_opening, chair.friction_factor
    states = chair.friction_states
    if opening is None and factor is None:
        return
    pairs = opening is not None and (len(states) > 1 if factor is None else True)
    if not pairs or (factor is not None and len(opening) != len(factor)):
        key, text = (
            "friction_factor",
            "friction_opening and friction_factor with as many values each",
        )
        if factor is None:
            key, text = (
                "friction_opening",
                "friction_factor, or states in friction_state, with as many values",
            )
        yield Problem((*path, key), f": needs {text}")
    elif opening[0] != 0.0 or any(b <= a for a, b in pairwise(opening)):
        yield Problem((*path, "friction_opening"), ": must begin with 0 and rise")
    elif factor is not None and (min(factor) < 0.0 or max(factor) > 10.0):
        yield Problem((*path, "friction_factor"), ": every factor must be 0 to 10")


def check_friction_curve(path: Path, chair: Any) -> Iterator[Problem]:
    """Find the faults of the friction of a chair over speed."""
    names, opening = chair.friction_states, chair.friction_opening or ()
    for name in names:
        if name not in FRICTION_STATES:
            text = unknown_name("state", name, FRICTION_STATES)
            yield Problem((*path, "friction_state"), text)
    if not names and chair.friction_state is not None:
        yield Problem((*path, "friction_state"), " = []: names no state; leave it out")
    elif len(names) > 1 and len(names) != len(opening):
        text = f" has {len(names)} states: needs friction_opening with as many values"
        yield Problem((*path, "friction_state"), text)
    ratio, rise = chair.static_ratio, chair.friction_rise
    if ratio is not None and not 1.0 <= ratio <= 5.0:
        text = f" = {ratio:g}: must be 1 to 5, as friction in motion is not above that at rest; "
        yield Problem((*path, "static_ratio"), text + "let grease rise by friction_rise")
    if rise is not None and 1.0 + rise * FASTEST > LARGEST_RISE:
        text = (
            f" = {rise:g} s/m: rises to {1.0 + rise * FASTEST:g} times the friction in motion at "
        )
        text += f"{FASTEST:g} m/s, at most {LARGEST_RISE:g} times; give {LARGEST_RISE - 1:g} s/m or"
        yield Problem((*path, "friction_rise"), f"{text} less")


NEEDED = {
    "stribeck_speed": ("static_ratio", "friction_state"),
    "roller_stiffness": ("roller_lift",),
    "roller_friction": ("roller_lift",),
}
"""Values of chairs, and those of which a chair must have one for them to have an effect."""


def check_needed_of_chairs(draft: Draft) -> Iterator[Problem]:
    """Refuse values that have no effect on any chair."""
    chairs = draft.records["chair"]
    for key, needed in NEEDED.items():
        default = Chair.model_fields[key].default
        given = [name for name, chair in chairs.items() if getattr(chair, key) != default]
        used = any([getattr(c, need) is not None for c in chairs.values() for need in needed])
        if given and not used:
            text = f": without effect, as no chair has {' or '.join(needed)}; give chair.N."
            yield Problem(("chair", given[0], key), f"{text}{needed[0]}, or leave it out")


OF_SECTIONS: Mapping[str, tuple[Check, ...]] = {
    "section": (alone(check_section),),
    "outline": (check_outline,),
    "outline_section": (check_outline_section,),
    "planed_section": (
        partial(check_planing_outline, key="outline"),
        partial(check_planing_outline, key="stock_outline"),
        alone(partial(check_offsets, key="running_edge_offset")),
        alone(partial(check_offsets, key="lowering_offset")),
        alone(check_lowering),
        check_lowest,
    ),
    "stock_rail": (
        check_stock_rail_faces,
        check_stock_rail_section,
        alone(partial(more_than, low="start", high="end")),
        check_stock_rail_held,
    ),
    "stock_fastening": (check_stock_fastening,),
}
"""Checks of sections and stock rails, by their family."""
