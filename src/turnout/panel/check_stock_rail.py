"""Checks of flexible stock rails, and who stands at which rail."""

from collections.abc import Iterable, Iterator
from typing import Any

from turnout.files.problems import Problem, choices, nearest, show_value
from turnout.panel.check_section import check_section_name, find_section
from turnout.panel.validate import Draft, Partial, known_part

ON_ONE_RAIL = ("drive", "sensor")


def unknown_name(what: str, name: object, names: Iterable[str]) -> str:
    """Say that there is no such thing, what there is and what is nearest."""
    known = list(names)
    return (
        f" = {show_value(name)}: there is no such {what}{nearest(str(name), known)}; "
        f"there are {choices(known)}"
    )


def rails_of(family: str, record: Any, draft: Draft) -> list[str]:
    """Give the names of the rails that a record stands at."""
    if family in ON_ONE_RAIL:
        return [record.rail]
    return list(draft.names["rail"]) if record.rails is None else list(record.rails)


def check_stock_rail(draft: Draft, path: tuple[str, str], stock: Any) -> Iterator[Problem]:
    """Check a flexible stock rail: whom it faces, where it reaches, that something holds it."""
    yield from known_part(_stock_rail_faces(draft, path, stock))
    yield from known_part(_stock_rail_section(draft, path, stock))
    if stock.end <= stock.start:
        text = f" = {stock.end:g} m: must be more than start, {stock.start:g} m"
        yield Problem((*path, "end"), text)
    fastenings = draft.records["stock_fastening"].values()
    held = any(f.stiffness_x > 0 and (f.rails is None or path[1] in f.rails) for f in fastenings)
    if stock.ends == "free" and not held:
        text = ' = "free": nothing holds the rail; clamp it or give it stock_fastening'
        yield Problem((*path, "ends"), text)


def _stock_rail_section(draft: Draft, path: tuple[str, str], stock: Any) -> Iterator[Problem]:
    kinds = ("section", "outline_section")
    yield from check_section_name(draft, path, stock.section, kinds=kinds)
    kind, section = find_section(draft, stock.section) or ("", Partial())
    if kind == "section" and len(section.area) > 1:
        text = f" = {show_value(stock.section)}: has {len(section.area)} rows, a stock rail has one"
        yield Problem((*path, "section"), text)


def _stock_rail_faces(draft: Draft, path: tuple[str, str], stock: Any) -> Iterator[Problem]:
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


def check_stock_fastening(draft: Draft, path: tuple[str, str], record: Any) -> Iterator[Problem]:
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
