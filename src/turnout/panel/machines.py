"""The machines that a panel's drives name: taken from the library where the panel lacks them.

A panel's own `[machine.NAME]` with the name of a library machine need give only what differs. The
numbers become part of the panel: its hash, its origins and its overrides cover them. Limit contacts
of a library machine stand where its own example has its ends; in a panel they follow from the
drive, unless the panel gives them.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

from turnout.core.library import names_in_library, text_in_library
from turnout.core.problems import Problem, choices, nearest
from turnout.core.toml import TomlFile, parse_toml
from turnout.panel.document import Document
from turnout.panel.validate import Draft, until_unknown

LIBRARY = "turnout.machine"
_OF_THE_EXAMPLE = ("limit_closing", "limit_opening")


def add_library_machines(document: Document) -> Document:
    """Give the document what the library knows of the machines that its drives name.

    Parameters
    ----------
    document : Document
        The expanded document.

    Returns
    -------
    Document
        A new one where something was added.
    """
    own, drives = document.tree.get("machine", {}), document.tree.get("drive", {})
    if not isinstance(own, dict) or not isinstance(drives, dict):
        return document
    named = [drive.get("machine") for drive in drives.values() if isinstance(drive, dict)]
    wanted = dict.fromkeys(name.strip() for name in named if isinstance(name, str))
    members, origins = dict(own), dict(document.origins)
    for name in wanted:
        if name not in names_in_library(LIBRARY):
            continue
        member = _joined(_of_library(name), own.get(name, {}))
        if member == own.get(name):
            continue
        members[name] = member
        for path, origin in _file(name).origins.items():
            if path[:2] == ("machine", name):
                origins.setdefault(".".join(path), origin)
    if members == own:
        return document
    return replace(document, tree=document.tree | {"machine": members}, origins=origins)


@cache
def _file(name: str) -> TomlFile:
    return parse_toml(text_in_library(LIBRARY, name, kind="machine"), source=name)


def _of_library(name: str) -> dict[str, Any]:
    """Return a library machine without the limit contacts of its example."""
    found: dict[str, Any] = dict(_file(name).data["machine"][name])
    found["circuit"] = {k: v for k, v in found["circuit"].items() if k not in _OF_THE_EXAMPLE}
    return found


def _joined(library: dict[str, Any], own: Any) -> Any:
    """Return the library's values with the panel's own in their place, table by table."""
    if not isinstance(own, dict):
        return own
    return library | {
        key: _joined(library[key], value) if isinstance(library.get(key), dict) else value
        for key, value in own.items()
    }


def check_machines(draft: Draft) -> Iterator[Problem]:
    """Find drives whose machine is not there or does not go with the rest of the drive."""
    known = [*draft.names["machine"], *names_in_library(LIBRARY)]
    shared: dict[str, Any] = {}
    for name, drive in draft.records["drive"].items():
        yield from until_unknown(_drive(("drive", name), drive, known))
        yield from until_unknown(_supply(("drive", name), drive, draft.records["machine"], shared))


def _drive(path: tuple[str, str], drive: Any, known: list[str]) -> Iterator[Problem]:
    if drive.machine is None:
        return
    if drive.machine not in known:
        there = choices(dict.fromkeys(known))
        text = f' = "{drive.machine}": there is no such machine{nearest(drive.machine, known)}; '
        yield Problem((*path, "machine"), f"{text}there are {there}, or give [machine.NAME]")
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
    """Return what a machine must be fed with to share a supply with others."""
    if machine.motor.kind != "induction":
        return "direct current"
    voltage = machine.supply.voltage or machine.motor.voltage
    return f"three phases of {voltage:g} V, {machine.motor.frequency:g} Hz"
