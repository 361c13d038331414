"""Cross checks between the records of a panel, its schedule among them.

Cross checks: what no single record of a panel can know about the others.

Every check works on what could be validated so far, so that its problems are reported together
with those of single fields. It falls silent where it needs a value that is wrong itself.

Checks of the schedule: order, overlap, ramps, tables.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from functools import cache, partial
from typing import Any

from turnout.core.library import names_in_library
from turnout.core.problems import Problem, choices, nearest, show_value
from turnout.core.units import is_finite
from turnout.panel.check_rails import (
    ON_ONE_RAIL,
    check_drive_table,
    check_friction,
    check_outline,
    check_outline_section,
    check_planed_section,
    check_saturations,
    check_section,
    check_section_kinds,
    check_section_name,
    check_stock_fastening,
    check_stock_rail,
    find_section,
    rails_of,
    rising_fault,
    unknown_name,
)
from turnout.panel.check_shape import (
    check_adjustment,
    check_back_drive,
    check_shape,
    slips_at_rest,
)
from turnout.panel.foreign_object import from_record, object_faults
from turnout.panel.library_members import MACHINES
from turnout.panel.lock_rule import LOCK_RULES
from turnout.panel.model import FAMILIES, Panel
from turnout.panel.place import SAME_PLACE
from turnout.panel.records import Movement, ScaledSection
from turnout.panel.validate import Draft, Field, NotedRecords, Partial, until_unknown

_SAME_TIME = 1e-9
_TABLE_KEYS = ("table_time", "table_fraction", "table_file")


def check_schedule(draft: Draft) -> Iterator[Problem]:
    """Find problems of the movements, each and among each other."""
    drives = draft.names["drive"]
    for name, movement in draft.records["movement"].items():
        yield from until_unknown(_movement(("movement", name), movement, drives))
        yield from until_unknown(_table(("movement", name), movement))
    yield from until_unknown(_sequence(draft, drives))
    yield from until_unknown(_end(draft, drives))
    yield from until_unknown(_cycles(draft))


def _times(movement: Movement, drives: tuple[str, ...]) -> list[float]:
    return [movement.duration + movement.extra_time.get(drive, 0.0) for drive in drives]


def _movement(
    path: tuple[str, str], movement: Movement, drives: tuple[str, ...]
) -> Iterator[Problem]:
    for drive, extra in movement.extra_time.items():
        if drive not in drives:
            text = f": there is no such drive{nearest(drive, drives)}; there are {choices(drives)}"
            yield Problem((*path, "extra_time", drive), text)
        elif movement.duration + extra <= 0:
            text = f" = {extra:g} s: takes away the whole duration, {movement.duration:g} s"
            yield Problem((*path, "extra_time", drive), text)
    shortest = min(_times(movement, drives), default=movement.duration)
    if movement.shape == "raised cosine" and movement.ramp > shortest / 2:
        text = f" = {movement.ramp:g} s: must be at most half of the movement, {shortest / 2:g} s"
        yield Problem((*path, "ramp"), text)


def _table(path: tuple[str, ...], movement: Movement) -> Iterator[Problem]:
    given = [key for key in _TABLE_KEYS if getattr(movement, key) is not None]
    if movement.shape != "table":
        for key in given:
            text = f': only for shape = "table", the shape is {show_value(movement.shape)}'
            yield Problem((*path, key), text)
        return
    time, fraction = movement.table_time, movement.table_fraction
    if (time is None or fraction is None) and movement.table_file is not None:
        return  # that file could not be read, which has been reported
    if time is None or fraction is None:
        missing = "table_time" if time is None else "table_fraction"
        text = ': is missing; shape = "table" needs table_time and table_fraction, or table_file'
        yield Problem((*path, missing), text)
        return
    if len(time) != len(fraction) or len(time) < 2:
        text = f": has {len(fraction)} entries, table_time has {len(time)}; at least 2"
        yield Problem((*path, "table_fraction"), text)
        return
    fault = rising_fault(time, unit="s")
    if fault or time[0] != 0.0:
        text = fault or f"must start at 0 s, starts at {time[0]:g} s"
        yield Problem((*path, "table_time"), f": {text}")
    elif abs(time[-1] - movement.duration) > 1e-6 * movement.duration:
        text = f": must end at the duration, {movement.duration:g} s, ends at {time[-1]:g} s"
        yield Problem((*path, "table_time"), text)
    falls = any(after < before for before, after in zip(fraction, fraction[1:], strict=False))
    if falls or fraction[0] != 0.0 or fraction[-1] != 1.0:
        text = f": must rise from 0 to 1, goes from {fraction[0]:g} to {fraction[-1]:g}"
        yield Problem((*path, "table_fraction"), text + (" and falls between" if falls else ""))


def _in_order(draft: Draft) -> list[tuple[str, Movement]]:
    return sorted(draft.records["movement"].items(), key=lambda item: float(item[1].start))


def _sequence(draft: Draft, drives: tuple[str, ...]) -> Iterator[Problem]:
    """Refuse movements that overlap or go to the present position of the panel."""
    position = draft.records["schedule"].starts
    before, free_from = "", 0.0
    for name, movement in _in_order(draft):
        if before and movement.start < free_from - _SAME_TIME:
            text = f" = {movement.start:g} s: movement '{before}' only ends at {free_from:g} s"
            yield Problem(("movement", name, "start"), text)
        if movement.to == position:
            text = f' = "{movement.to}": the panel is already {movement.to} then'
            yield Problem(("movement", name, "to"), text)
        position = movement.to
        end = movement.start + max(_times(movement, drives), default=movement.duration)
        before, free_from = name, max(end, free_from)


def _end(draft: Draft, drives: tuple[str, ...]) -> Iterator[Problem]:
    end = draft.records["schedule"].end
    for name, movement in _in_order(draft):
        arrival = movement.start + max(_times(movement, drives), default=movement.duration)
        if arrival > end + _SAME_TIME:
            text = f" = {end:g} s: movement '{name}' only ends at {arrival:g} s"
            yield Problem(("schedule", "end"), text)


def _cycles(draft: Draft) -> Iterator[Problem]:
    """Refuse cycles before the run that do not end where it starts, loaded."""
    schedule, movements = draft.records["schedule"], _in_order(draft)
    returns = movements and movements[-1][1].to == schedule.starts
    if schedule.loaded_by == "cycles" and not (schedule.loaded and returns):
        remedy = f"a last movement to {schedule.starts}" if schedule.loaded else "loaded = true"
        yield Problem(("schedule", "loaded_by"), f' = "cycles": needs {remedy}')


_HAVE_PLACES = ("chair", "fastening", "stop", "stud", "drive", "link", "back_drive")
_OPENING_NEEDS = {"rail", "drive", "link", "fastening", "schedule", "movement", "object_defaults"}
_MOST_ELEMENTS, _MOST_FEET = 5000, 8


def check(draft: Draft, *, only: Iterable[str] | None = None) -> list[Problem]:
    """Find all problems between the records of a panel.

    Parameters
    ----------
    draft : Draft
        The records as far as they are valid by themselves.
    only : iterable of str, optional
        Names of the checks to make; by default all of them.

    Returns
    -------
    list of Problem
        Empty for a valid panel.
    """
    checks = _all_checks()
    names = checks if only is None else only
    found = [problem for name in names for problem in checks[name](draft)]
    if objects := draft.records["object"]:
        blocked = {problem.path[0] for problem in (*draft.problems, *found) if problem.path}
        records = {name: draft.records[name] for name in Panel.model_fields}
        panel = Panel.model_construct(**records)
        for name, record in objects.items():
            sized = not blocked & _OPENING_NEEDS
            found += until_unknown(_object(panel, ("object", name), record, sized=sized))
    return [_shared(draft, problem) for problem in found]


def checks_that_read(
    changed: Set[Field], records: Mapping[str, Any], given: Mapping[str, object]
) -> tuple[str, ...]:
    """Return the names of the checks of a valid panel that read what changes, in their order.

    Parameters
    ----------
    changed : set of (str, str)
        Families and fields, of which a value may change.
    records : mapping of str to object
        Value by field name of `Panel`.
    given : mapping of str to object
        What overrides set, by dotted place.
    """
    noted = NotedRecords(records)
    names = {name: tuple(records[name]) for name in FAMILIES}
    found = []
    for name, of_name in _all_checks().items():
        noted.read.clear()
        for _ in of_name(Draft(records=noted, names=names, given=given)):
            pass  # what it finds is found again when values are set
        if not noted.read.isdisjoint(changed):
            found.append(name)
    return tuple(found)


@cache
def _all_checks() -> dict[str, Callable[[Draft], Iterable[Problem]]]:
    """Return all checks by name."""
    checks: dict[str, Callable[[Draft], Iterable[Problem]]] = {
        "plain": _plain,
        "between rails": _between_rails,
        "section kinds": check_section_kinds,
        "schedule": check_schedule,
        "machines": check_machines,
    }
    checks |= {family: partial(_each, family=family) for family in _CHECKS}
    checks["saturation of drives"] = check_saturations
    checks["slips at rest"] = slips_at_rest
    return checks | {
        f"places of {name}": partial(_same_places, family=name) for name in _HAVE_PLACES
    }


def _each(draft: Draft, family: str) -> Iterator[Problem]:
    """Check the members of a family one by one."""
    check_one = _CHECKS[family]
    for name, record in draft.records[family].items():
        yield from until_unknown(check_one(draft, (family, name), record))


def _shared(draft: Draft, problem: Problem) -> Problem:
    """Name the family's key if the value came from the family."""
    path = problem.path
    if path[:3] in draft.shared:
        return Problem((path[0], *path[2:]), problem.text)
    return problem


def _plain(draft: Draft) -> Iterator[Problem]:
    names = draft.names["rail"]
    instrumented = draft.records["instrumented_rail"]
    if not isinstance(instrumented, Partial) and names and instrumented not in names:
        yield Problem(("instrumented_rail",), unknown_name("rail", instrumented, names))
    yield from until_unknown(_object_defaults(draft))
    yield from until_unknown(_damping(draft))
    yield from until_unknown(_lock(draft))


def _object_defaults(draft: Draft) -> Iterator[Problem]:
    rail, names = draft.records["object_defaults"].rail, draft.names["rail"]
    if rail not in names:
        yield Problem(("object_defaults", "rail"), unknown_name("rail", rail, names))


def _damping(draft: Draft) -> Iterator[Problem]:
    path, frequencies = ("damping", "frequencies"), draft.records["damping"].frequencies
    if min(frequencies) <= 0:
        yield Problem(path, f" = {show_value(frequencies)}: every frequency must be more than 0")
    elif any(after <= before for before, after in itertools.pairwise(frequencies)):
        yield Problem(path, f" = {show_value(frequencies)}: must rise")


def _lock(draft: Draft) -> Iterator[Problem]:
    rule = draft.records["lock"].rule
    if not all(criterion.needs_stock_rail for criterion in LOCK_RULES[rule]):
        return
    for name, rail in draft.records["rail"].items():
        if not rail.has_stock_rail:
            text = f": rail '{name}' has no stock rail, so no gap; give it fit_gap, or \"no slip\""
            yield Problem(("lock", "rule"), f' = "{rule}"{text}')


def _between_rails(draft: Draft) -> Iterator[Problem]:
    def ways() -> Iterator[Problem]:
        rails = draft.records["rail"].values()
        if len({rail.closes for rail in rails}) < len(rails) == 2:
            text = ': two rails must close opposite ways, one "+y" and one "-y"'
            yield Problem(("rail",), text)

    yield from until_unknown(ways())


def _rail(draft: Draft, path: tuple[str, str], rail: Any) -> Iterator[Problem]:
    yield from until_unknown(_rail_closes(draft, path, rail))
    yield from until_unknown(_rail_section(draft, path, rail))
    yield from until_unknown(_rail_support(draft, path, rail))
    yield from until_unknown(_rail_elements(draft, rail))
    yield from until_unknown(_rail_factors(path, rail))
    yield from until_unknown(check_shape(draft, path, rail))
    edge = rail.running_edge
    if edge and edge.maximum <= edge.minimum:
        text = f" = {edge.maximum:g} m: must be more than minimum, {edge.minimum:g} m"
        yield Problem((*path, "running_edge", "maximum"), text)
    if rail.end <= rail.start:
        yield Problem(
            (*path, "end"), f" = {rail.end:g} m: must be more than start, {rail.start:g} m"
        )


def _rail_closes(draft: Draft, path: tuple[str, str], rail: Any) -> Iterator[Problem]:
    if path[1] == draft.records["instrumented_rail"] and rail.closes != "+y":
        yield Problem((*path, "closes"), ' = "-y": the instrumented rail must close "+y"')


def _rail_section(draft: Draft, path: tuple[str, str], rail: Any) -> Iterator[Problem]:
    yield from check_section_name(draft, path, rail.section)
    kind, section = find_section(draft, rail.section) or ("", Partial())
    if kind == "outline_section":
        return
    by_offset = kind == "planed_section" or (
        section.x is None and section.running_edge_offset is not None
    )
    if by_offset and rail.running_edge is None:
        text = f": is missing; the stations of section '{rail.section}' are offsets of it"
        yield Problem((*path, "running_edge"), text)


def _rail_support(draft: Draft, path: tuple[str, str], rail: Any) -> Iterator[Problem]:
    """Refuse a rail that nothing holds along the track: it has no equilibrium."""
    if rail.heel == "clamped":
        return
    fastenings = draft.records["fastening"].values()
    if not any(
        item.stiffness_x > 0 and path[1] in rails_of("fastening", item, draft)
        for item in fastenings
    ):
        text = ' = "free": nothing holds the rail along x; clamp it or give it fastenings'
        yield Problem((*path, "heel"), text)


def _rail_elements(draft: Draft, rail: Any) -> Iterator[Problem]:
    length = draft.records["discretisation"].element_length
    count = (rail.end - rail.start) / length
    if count > _MOST_ELEMENTS:
        text = f" = {length:g} m: makes {count:.6g} elements a rail, at most {_MOST_ELEMENTS}"
        yield Problem(("discretisation", "element_length"), text)


def _rail_factors(path: tuple[str, str], rail: Any) -> Iterator[Problem]:
    if rail.matrices is None:
        return
    for key in ScaledSection.model_fields:
        if getattr(rail, key) != 1.0:
            text = f" = {getattr(rail, key):g}: the rail has matrices in place of a section; scale"
            yield Problem((*path, key), f"{text} those, or leave this out")


def _section(draft: Draft, path: tuple[str, str], table: Any) -> Iterator[Problem]:
    yield from check_section(path, table)


def _standing(draft: Draft, path: tuple[str, str], record: Any) -> Iterator[Problem]:
    """Check that the rails of a record, one, some or all, exist and reach its place."""
    yield from until_unknown(_rails_exist(draft, path, record))
    x = record.x
    for name in rails_of(path[0], record, draft):
        yield from until_unknown(
            _on_rail(path, x, name, draft.records["rail"].get(name, Partial()))
        )


def _rails_exist(draft: Draft, path: tuple[str, str], record: Any) -> Iterator[Problem]:
    names = draft.names["rail"]
    if path[0] in ON_ONE_RAIL:
        if record.rail is not None and record.rail not in names:
            yield Problem((*path, "rail"), unknown_name("rail", record.rail, names))
        return
    given = record.rails
    if given is None:
        return
    for rail in given:
        if rail not in names:
            yield Problem((*path, "rails"), unknown_name("rail", rail, names))
    if not given:
        yield Problem((*path, "rails"), " = []: names no rail; leave it out for all rails")
    if len(set(given)) < len(given):
        yield Problem((*path, "rails"), f" = {show_value(given)}: names the same rail twice")


def _on_rail(path: tuple[str, str], x: float, name: str, rail: Any) -> Iterator[Problem]:
    if rail.start < rail.end and not rail.start <= x <= rail.end:
        text = f" = {x:g} m: is off rail '{name}', {rail.start:g} ... {rail.end:g} m"
        yield Problem((*path, "x"), text)


def _sleeper(draft: Draft, path: tuple[str, str], record: Any) -> Iterator[Problem]:
    rails = draft.records["rail"].values()
    if not rails:
        return
    first, last = min(rail.start for rail in rails), max(rail.end for rail in rails)
    if first < last and not first <= record.x <= last:
        yield Problem(
            (*path, "x"), f" = {record.x:g} m: is off the rails, {first:g} ... {last:g} m"
        )


def _chair(draft: Draft, path: tuple[str, str], chair: Any) -> Iterator[Problem]:
    yield from until_unknown(_standing(draft, path, chair))
    yield from check_friction(path, chair)
    feet = chair.foot_offsets
    if feet is not None and len(feet) > _MOST_FEET:
        text = f": {len(feet)} foot points, at most {_MOST_FEET}; give those of the edges"
        yield Problem((*path, "foot_offsets"), text)
    elif feet is not None and len(set(feet)) < len(feet):
        yield Problem((*path, "foot_offsets"), f" = {show_value(feet)}: the same foot point twice")


def _drive(draft: Draft, path: tuple[str, str], drive: Any) -> Iterator[Problem]:
    yield from until_unknown(_standing(draft, path, drive))
    yield from until_unknown(check_drive_table(path, drive))
    reaches = {"open": drive.over_travel_open, "closed": drive.over_travel_closed}
    for place, reach in reaches.items():
        if drive.stroke + reach <= 0:
            text = f" = {reach:g} m: takes away the whole stroke, {drive.stroke:g} m"
            yield Problem((*path, f"over_travel_{place}"), text)


def _link(draft: Draft, path: tuple[str, str], record: Any) -> Iterator[Problem]:
    yield from _standing(draft, path, record)
    remedy = "change the stroke of the drives to move a rail further"
    yield from until_unknown(check_adjustment(path, record, remedy=remedy))


def _back_drive(draft: Draft, path: tuple[str, str], record: Any) -> Iterator[Problem]:
    yield from _standing(draft, path, record)
    yield from until_unknown(check_back_drive(draft, path, record))


_CHECKS = {
    "stock_rail": check_stock_rail,
    "stock_fastening": check_stock_fastening,
    "rail": _rail,
    "section": _section,
    "outline": check_outline,
    "outline_section": check_outline_section,
    "planed_section": check_planed_section,
    "chair": _chair,
    "fastening": _standing,
    "stop": _standing,
    "stud": _standing,
    "drive": _drive,
    "link": _link,
    "back_drive": _back_drive,
    "sensor": _standing,
    "sleeper": _sleeper,
}


def _same_places(draft: Draft, family: str) -> Iterator[Problem]:
    seen: dict[tuple[str, int], str] = {}
    for name, record in draft.records[family].items():
        yield from until_unknown(_same_place(draft, (family, name), record, seen))


def _same_place(
    draft: Draft, path: tuple[str, str], record: Any, seen: dict[tuple[str, int], str]
) -> Iterator[Problem]:
    family, name = path
    if not is_finite(record.x / SAME_PLACE):
        return  # far off any rail, which is reported elsewhere
    for rail in rails_of(family, record, draft):
        other = seen.setdefault((rail, round(record.x / SAME_PLACE)), name)
        if other != name:
            text = f" = {record.x:g} m: {family} '{other}' is already there on rail '{rail}'"
            yield Problem((*path, "x"), text)
            return


def _object(panel: Panel, path: tuple[str, str], record: Any, *, sized: bool) -> Iterator[Problem]:
    """Check an object of the panel; its size only if all inputs of the opening are valid."""
    for key, text in object_faults(panel, from_record(record), sized=sized):
        yield Problem((*path, key), text)


def check_machines(draft: Draft) -> Iterator[Problem]:
    """Find drives whose machine is not there or does not go with the rest of the drive."""
    known = [*draft.names["machine"], *names_in_library(MACHINES)]
    shared: dict[str, Any] = {}
    for name, drive in draft.records["drive"].items():
        yield from until_unknown(_drive_machine(("drive", name), drive, known))
        yield from until_unknown(_supply(("drive", name), drive, draft.records["machine"], shared))


def _drive_machine(path: tuple[str, str], drive: Any, known: list[str]) -> Iterator[Problem]:
    if drive.machine is None:
        return
    if drive.machine not in known:
        there = choices(dict.fromkeys(known))
        text = f' = "{drive.machine}": there is no such machine{nearest(drive.machine, known)}; '
        yield Problem((*path, "machine"), f"{text}there are {there}, or give [machine.NAME]")
    if drive.lost_motion:
        text = f" = {drive.lost_motion:g} m: is of markers; give machine.{drive.machine}.lock"
        yield Problem((*path, "lost_motion"), text)
    if drive.extension is not None:
        text = ": a rod moved by a machine is linear; leave out extension and force, or the machine"
        yield Problem((*path, "extension"), text)


def _supply(
    path: tuple[str, str], drive: Any, machines: dict[str, Any], shared: dict[str, Any]
) -> Iterator[Problem]:
    """Refuse machines that share a supply and do not agree on it."""
    if drive.machine is None or drive.machine not in machines:
        return
    machine = machines[drive.machine]
    found = machine.supply.shared_resistance
    first = shared.setdefault("first", machine)
    if found != first.supply.shared_resistance:
        text = (
            f": its machine has supply.shared_resistance = {found:g} ohm, another drive's "
            f"{first.supply.shared_resistance:g} ohm; all drives share one supply, so give one "
            "value"
        )
        yield Problem((*path, "machine"), text)
    elif found and _source(machine) != _source(first):
        text = (
            f": its machine takes {_source(machine)}, another drive's {_source(first)}; machines "
            "with supply.shared_resistance share one supply"
        )
        yield Problem((*path, "machine"), text)


def _source(machine: Any) -> str:
    """Return the supply that a machine needs; machines that share one must need the same."""
    return str(machine.motor.of_kind.source(machine.motor, machine.supply))
