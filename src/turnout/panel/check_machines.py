"""Check the machines that drives name: there, alone with their rod, and agreed on their supply."""

from collections.abc import Iterator
from typing import Any

from turnout.core.library import names_in_library
from turnout.core.problems import Problem, choices, nearest
from turnout.panel.library_members import MACHINES
from turnout.panel.validate import Draft, until_unknown


def check_machines(draft: Draft) -> Iterator[Problem]:
    """Find drives whose machine is not there or does not go with the rest of the drive."""
    known = [*draft.names["machine"], *names_in_library(MACHINES)]
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
