"""Checks of the schedule: order, overlap, ramps, tables."""

from collections.abc import Iterator

from turnout.files.problems import Problem, choices, nearest, show_value
from turnout.panel.check_table import rising_fault
from turnout.panel.schedule_records import Movement
from turnout.panel.validate import Draft, known_part

_SAME_TIME = 1e-9
_TABLE_KEYS = ("table_time", "table_fraction", "table_file")


def check_schedule(draft: Draft) -> Iterator[Problem]:
    """Find problems of the movements, each and among each other."""
    drives = draft.names["drive"]
    for name, movement in draft.records["movement"].items():
        yield from known_part(_movement(("movement", name), movement, drives))
        yield from known_part(_table(("movement", name), movement))
    yield from known_part(_sequence(draft, drives))
    yield from known_part(_end(draft, drives))


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
    """Refuse movements that overlap or go where the panel already is."""
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
