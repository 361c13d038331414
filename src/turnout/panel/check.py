"""Cross checks between the records of a panel, its schedule among them.

Cross checks: what no single record of a panel can know about the others.

Every check works on what could be validated so far, so that its problems are reported together
with those of single fields. It falls silent where it needs a value that is wrong itself. `CHECKS`
has those of single records by their table, `BETWEEN` the others.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache, partial
from typing import Any

from turnout.core.keys import Path
from turnout.core.library import names_in_library
from turnout.core.problems import Problem, choices, nearest, show_value
from turnout.core.units import is_finite
from turnout.panel.check_rails import (
    OF_SECTIONS,
    Check,
    alone,
    check_drive_table,
    check_friction_course,
    check_friction_curve,
    check_needed_of_chairs,
    check_saturation,
    check_section_kinds,
    check_section_name,
    find_section,
    more_than,
    names_known,
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
from turnout.panel.records import Movement, ScaledSection, Schedule
from turnout.panel.validate import Draft, Field, NotedRecords, Partial, until_unknown

_SAME_TIME = 1e-9
_TABLE_KEYS = ("table_time", "table_fraction", "table_file")


def _times(movement: Movement, drives: tuple[str, ...]) -> list[float]:
    return [movement.duration + movement.extra_time.get(drive, 0.0) for drive in drives]


def _movement(draft: Draft, path: Path, movement: Movement) -> Iterator[Problem]:
    drives = draft.names["drive"]
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


def _table(path: Path, movement: Movement) -> Iterator[Problem]:
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


def _sequence(draft: Draft, path: Path, schedule: Schedule) -> Iterator[Problem]:
    """Refuse movements that overlap or go to the present position of the panel."""
    position, drives = schedule.starts, draft.names["drive"]
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


def _end(draft: Draft, path: Path, schedule: Schedule) -> Iterator[Problem]:
    end, drives = schedule.end, draft.names["drive"]
    for name, movement in _in_order(draft):
        arrival = movement.start + max(_times(movement, drives), default=movement.duration)
        if arrival > end + _SAME_TIME:
            text = f" = {end:g} s: movement '{name}' only ends at {arrival:g} s"
            yield Problem((*path, "end"), text)


def _cycles(draft: Draft, path: Path, schedule: Schedule) -> Iterator[Problem]:
    """Refuse cycles before the run that do not end where it starts, loaded."""
    movements = _in_order(draft)
    returns = movements and movements[-1][1].to == schedule.starts
    if schedule.loaded_by == "cycles" and not (schedule.loaded and returns):
        remedy = f"a last movement to {schedule.starts}" if schedule.loaded else "loaded = true"
        yield Problem((*path, "loaded_by"), f' = "cycles": needs {remedy}')


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


def reads_of_checks(records: Mapping[str, Any]) -> dict[str, frozenset[Field]]:
    """Return families and fields that each check of a valid panel reads, by name, in their order.

    Parameters
    ----------
    records : mapping of str to object
        Value by field name of `Panel`. Nothing counts as set by overrides, since what is set can
        make a check read less, never more.
    """
    noted = NotedRecords(records)
    names = {name: tuple(records[name]) for name in FAMILIES}
    found = {}
    for name, of_name in _all_checks().items():
        noted.read.clear()
        for _ in of_name(Draft(records=noted, names=names)):
            pass  # what it finds is found again when values are set
        found[name] = frozenset(noted.read)
    return found


@cache
def _all_checks() -> dict[str, Callable[[Draft], Iterable[Problem]]]:
    """Return all checks by name."""
    checks: dict[str, Callable[[Draft], Iterable[Problem]]] = {
        f"{table} {number}": partial(_each, table=table, check_one=check_one)
        for table, own in CHECKS.items()
        for number, check_one in enumerate(own)
    }
    checks |= {
        name: partial(_all_at_once, check_all=check_all) for name, check_all in BETWEEN.items()
    }
    return checks | {
        f"places of {name}": partial(_same_places, family=name) for name in _HAVE_PLACES
    }


def _each(draft: Draft, table: str, check_one: Check) -> Iterator[Problem]:
    """Make a check of the members of a family one by one, or of a table."""
    found = draft.records[table]
    members = (
        {(table, name): found[name] for name in found} if table in FAMILIES else {(table,): found}
    )
    for path, record in members.items():
        yield from until_unknown(check_one(draft, path, record))


def _all_at_once(
    draft: Draft, check_all: Callable[[Draft], Iterator[Problem]]
) -> Iterator[Problem]:
    return until_unknown(check_all(draft))


def _shared(draft: Draft, problem: Problem) -> Problem:
    """Name the family's key if the value came from the family."""
    path = problem.path
    if path[:3] in draft.shared:
        return Problem((path[0], *path[2:]), problem.text)
    return problem


def _instrumented(draft: Draft, path: Path, given: Any) -> Iterator[Problem]:
    names = draft.names["rail"]
    if not isinstance(given, Partial) and names and given not in names:
        yield Problem(path, unknown_name("rail", given, names))


def _damping(path: Path, damping: Any) -> Iterator[Problem]:
    path, frequencies = (*path, "frequencies"), damping.frequencies
    if min(frequencies) <= 0:
        yield Problem(path, f" = {show_value(frequencies)}: every frequency must be more than 0")
    elif any(after <= before for before, after in itertools.pairwise(frequencies)):
        yield Problem(path, f" = {show_value(frequencies)}: must rise")


def _lock(draft: Draft, path: Path, lock: Any) -> Iterator[Problem]:
    rule = lock.rule
    if not all(criterion.needs_stock_rail for criterion in LOCK_RULES[rule]):
        return
    for name, rail in draft.records["rail"].items():
        if not rail.has_stock_rail:
            text = f": rail '{name}' has no stock rail, so no gap; give it fit_gap, or \"no slip\""
            yield Problem((*path, "rule"), f' = "{rule}"{text}')


def _gauge(path: Path, gauge: Any) -> Iterator[Problem]:
    """Refuse classes of limits that do not rise, and a line speed beyond them."""
    if gauge is None or isinstance(gauge.limits, str):  # a name that could not be read, as reported
        return
    speeds = [item.up_to for item in gauge.limits or ()]
    if fault := rising_fault(speeds, unit="m/s"):
        yield Problem((*path, "limits"), f": the speeds `up_to` {fault}")
    elif gauge.line_speed is not None and not any(gauge.line_speed <= top for top in speeds):
        text = f" = {3.6 * gauge.line_speed:g} km/h: no class of gauge.limits holds at it; "
        fastest = 3.6 * max(speeds, default=0.0)
        yield Problem((*path, "line_speed"), f"{text}they end at {fastest:g} km/h")


def _opposite_ways(draft: Draft) -> Iterator[Problem]:
    rails = draft.records["rail"].values()
    if len({rail.closes for rail in rails}) < len(rails) == 2:
        text = ': two rails must close opposite ways, one "+y" and one "-y"'
        yield Problem(("rail",), text)


def _running_edge(path: Path, rail: Any) -> Iterator[Problem]:
    if rail.running_edge is not None:
        yield from more_than((*path, "running_edge"), rail.running_edge, "minimum", "maximum")


def _rail_closes(draft: Draft, path: Path, rail: Any) -> Iterator[Problem]:
    if path[1] == draft.records["instrumented_rail"] and rail.closes != "+y":
        yield Problem((*path, "closes"), ' = "-y": the instrumented rail must close "+y"')


def _rail_section(draft: Draft, path: Path, rail: Any) -> Iterator[Problem]:
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


def _rail_support(draft: Draft, path: Path, rail: Any) -> Iterator[Problem]:
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


def _rail_elements(draft: Draft, path: Path, rail: Any) -> Iterator[Problem]:
    length = draft.records["discretisation"].element_length
    count = (rail.end - rail.start) / length
    if count > _MOST_ELEMENTS:
        text = f" = {length:g} m: makes {count:.6g} elements a rail, at most {_MOST_ELEMENTS}"
        yield Problem(("discretisation", "element_length"), text)


def _rail_factors(path: Path, rail: Any) -> Iterator[Problem]:
    if rail.matrices is None:
        return
    for key in ScaledSection.model_fields:
        if getattr(rail, key) != 1.0:
            text = f" = {getattr(rail, key):g}: the rail has matrices in place of a section; scale"
            yield Problem((*path, key), f"{text} those, or leave this out")


def _at_its_place(draft: Draft, path: Path, record: Any) -> Iterator[Problem]:
    """Check that the rails of a record, one, some or all, reach its place."""
    x = record.x
    for name in rails_of(path[0], record, draft):
        yield from until_unknown(
            _on_rail(path, x, name, draft.records["rail"].get(name, Partial()))
        )


def _rails_once(path: Path, record: Any) -> Iterator[Problem]:
    given = record.rails
    if given is None:
        return
    if not given:
        yield Problem((*path, "rails"), " = []: names no rail; leave it out for all rails")
    if len(set(given)) < len(given):
        yield Problem((*path, "rails"), f" = {show_value(given)}: names the same rail twice")


def _on_rail(path: Path, x: float, name: str, rail: Any) -> Iterator[Problem]:
    if rail.start < rail.end and not rail.start <= x <= rail.end:
        text = f" = {x:g} m: is off rail '{name}', {rail.start:g} ... {rail.end:g} m"
        yield Problem((*path, "x"), text)


def _sleeper(draft: Draft, path: Path, record: Any) -> Iterator[Problem]:
    rails = draft.records["rail"].values()
    if not rails:
        return
    first, last = min(rail.start for rail in rails), max(rail.end for rail in rails)
    if first < last and not first <= record.x <= last:
        yield Problem(
            (*path, "x"), f" = {record.x:g} m: is off the rails, {first:g} ... {last:g} m"
        )


def _feet(path: Path, chair: Any) -> Iterator[Problem]:
    feet = chair.foot_offsets
    if feet is not None and len(feet) > _MOST_FEET:
        text = f": {len(feet)} foot points, at most {_MOST_FEET}; give those of the edges"
        yield Problem((*path, "foot_offsets"), text)
    elif feet is not None and len(set(feet)) < len(feet):
        yield Problem((*path, "foot_offsets"), f" = {show_value(feet)}: the same foot point twice")


def _reaches(path: Path, drive: Any) -> Iterator[Problem]:
    reaches = {"open": drive.over_travel_open, "closed": drive.over_travel_closed}
    for place, reach in reaches.items():
        if drive.stroke + reach <= 0:
            text = f" = {reach:g} m: takes away the whole stroke, {drive.stroke:g} m"
            yield Problem((*path, f"over_travel_{place}"), text)


def _same_places(draft: Draft, family: str) -> Iterator[Problem]:
    seen: dict[tuple[str, int], str] = {}
    for name, record in draft.records[family].items():
        yield from until_unknown(_same_place(draft, (family, name), record, seen))


def _same_place(
    draft: Draft, path: Path, record: Any, seen: dict[tuple[str, int], str]
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


def _object(panel: Panel, path: Path, record: Any, *, sized: bool) -> Iterator[Problem]:
    """Check an object of the panel; its size only if all inputs of the opening are valid."""
    for key, text in object_faults(panel, from_record(record), sized=sized):
        yield Problem((*path, key), text)


def _supplies(draft: Draft) -> Iterator[Problem]:
    """Refuse drives whose machines share a supply and do not agree on it."""
    shared: dict[str, Any] = {}
    for name, drive in draft.records["drive"].items():
        yield from until_unknown(_supply(("drive", name), drive, draft.records["machine"], shared))


def _drive_machine(draft: Draft, path: Path, drive: Any) -> Iterator[Problem]:
    """Check that the machine of a drive is there and goes with the rest of the drive."""
    if drive.machine is None:
        return
    known = [*draft.names["machine"], *names_in_library(MACHINES)]
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
    path: Path, drive: Any, machines: dict[str, Any], shared: dict[str, Any]
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


_STANDING: tuple[Check, ...] = (names_known("rails", "rail"), alone(_rails_once), _at_its_place)
_ON_ONE: tuple[Check, ...] = (names_known("rail", "rail"), _at_its_place)

CHECKS: Mapping[str, tuple[Check, ...]] = {
    "instrumented_rail": (_instrumented,),
    "object_defaults": (names_known("rail", "rail"),),
    "damping": (alone(_damping),),
    "lock": (_lock,),
    "gauge": (alone(_gauge),),
    "movement": (_movement, alone(_table)),
    "schedule": (_sequence, _end, _cycles),
    **OF_SECTIONS,
    "rail": (
        _rail_closes,
        _rail_section,
        _rail_support,
        _rail_elements,
        alone(_rail_factors),
        check_shape,
        alone(_running_edge),
        alone(partial(more_than, low="start", high="end")),
    ),
    "chair": (*_STANDING, alone(check_friction_course), alone(check_friction_curve), alone(_feet)),
    "fastening": _STANDING,
    "stop": _STANDING,
    "stud": _STANDING,
    "drive": (
        *_ON_ONE,
        alone(check_drive_table),
        alone(_reaches),
        alone(check_saturation),
        slips_at_rest,
        _drive_machine,
    ),
    "link": (*_STANDING, alone(check_adjustment)),
    "back_drive": (*_STANDING, check_back_drive, alone(check_adjustment)),
    "sensor": _ON_ONE,
    "sleeper": (_sleeper,),
}
"""Checks of a table, or of each member of a family."""

BETWEEN: Mapping[str, Callable[[Draft], Iterator[Problem]]] = {
    "opposite ways": _opposite_ways,
    "section kinds": check_section_kinds,
    "needed of chairs": check_needed_of_chairs,
    "supplies": _supplies,
}
"""Checks of several records at once."""
