"""The machines of a panel's drives, fitted to them and arranged for the kernels.

Stroke, over-travels, rod stiffness and schedule are the drive's and the panel's; motor, clutch,
gear and circuit are the machine's. A machine counts its rod position from home, the closed position
without over-travel; its input is that position from the stress-free one of the rail.

A command is given at the onset of a movement, later by the drive's `extra_time`: the supply does
not know how long a marker was meant to take, and a machine that starts later is nearer to what the
`extra_time` of a measured drive stands for than one with another gear.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.machine.components import Machine
from turnout.machine.rows import machine_row, start_state, stroke_table, with_lock_stroke
from turnout.machine.steady import blind_text, clutch_force, stall_text
from turnout.mechanism.mechanism import DriveMachines, LawIndex, Wait
from turnout.panel.markers import marker_offsets, movement_end, ordered_movements, start_level
from turnout.panel.model import Panel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

WITHOUT_TIME_OUT = 30.0
"""From its contactor on a schedule waits so long for a machine without a time-out [s]."""
GEAR_STOP_TIME = 1.0
"""In this time a gear comes to rest once its motor is off [s]."""


def fitted_machine(panel: Panel, name: str) -> Machine:
    """Return the machine of a drive with the drive's rod, limit contacts and travel.

    Parameters
    ----------
    panel : Panel
        A checked panel.
    name : str
        A drive that has a machine.

    Returns
    -------
    Machine
        A crank or table covers stroke and over-travels, whatever its own length; so does a screw
        with a lock bar. Limit contacts that the machine gives itself are kept.
    """
    drive = panel.drive[name]
    machine = panel.machine[drive.machine or ""]
    closed, opened = drive.over_travel_closed, -(drive.stroke + drive.over_travel_open)
    circuit, stroke = machine.circuit, machine.stroke
    limits = {"limit_closing": closed - circuit.overrun, "limit_opening": opened + circuit.overrun}
    given = {key: value for key in limits if (value := getattr(circuit, key)) is not None}
    changed = {
        "rod": machine.rod.model_copy(update={"stiffness": drive.stiffness}),
        "circuit": circuit.model_copy(update=limits | given),
    }
    if stroke.kind != "screw":
        travel = {"start": opened, "length": closed - opened}
        changed["stroke"] = stroke.model_copy(update=travel)
    return with_lock_stroke(machine.model_copy(update=changed))


def slip_force(panel: Panel, name: str) -> float:
    """Return the force at which a drive slips: its clutch's in mid-stroke, or as the panel says.

    Parameters
    ----------
    panel : Panel
    name : str
        Of the drive.

    Returns
    -------
    float
        [N]. A standing gear may hold more, up to this over the gear's efficiencies both ways.
    """
    drive = panel.drive[name]
    if drive.machine is None:
        return drive.saturation_force
    machine = panel.machine[drive.machine]
    if machine.stroke.kind != "screw":  # a screw keeps its ratio
        machine = fitted_machine(panel, name)
    return clutch_force(machine)


def blind_currents(panel: Panel) -> dict[str, str]:
    """Return the drives whose machine current cannot show the load, with the reason of each."""
    return _said_of_machines(panel, blind_text)


def weak_motors(panel: Panel) -> dict[str, str]:
    """Return the drives whose motor stalls before the clutch slips, with a text on each."""
    return _said_of_machines(panel, stall_text)


def _said_of_machines(panel: Panel, say: Callable[[Machine], str]) -> dict[str, str]:
    named = {name: drive.machine for name, drive in panel.drive.items() if drive.machine}
    texts = {name: say(panel.machine[machine]) for name, machine in named.items()}
    return {name: f"{named[name]}: {text}" for name, text in texts.items() if text}


def command_times(panel: Panel, name: str) -> Floats:
    """Return the commands of a drive: time [s], and 1 closing or -1 opening.

    Parameters
    ----------
    panel : Panel
    name : str
        Of the drive.
    """
    rows = [
        (
            movement.start + movement.extra_time.get(name, 0.0),
            1.0 if movement.to == "closed" else -1,
        )
        for _, movement in ordered_movements(panel)
    ]
    return np.array(rows, dtype=np.float64).reshape(len(rows), 2)


def schedule_waits(panel: Panel) -> tuple[Wait, ...]:
    """Return where a schedule waits for the machines of its drives; nowhere if all are markers.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> schedule_waits(load_panel("60e1-300-1-9"))
    ()
    >>> panel = load_panel("60e1-300-1-9", overrides={"drive.1.machine": "jea73"})
    >>> [(item.time, round(item.rest, 2), round(item.longest, 2)) for item in schedule_waits(panel)]
    [(4.4, 1.0, 4.86), (8.5, 0.9, 4.96)]
    """
    circuits = {
        name: panel.machine[drive.machine].circuit
        for name, drive in panel.drive.items()
        if drive.machine is not None
    }
    moved = [movement for _, movement in ordered_movements(panel)]
    if not circuits or not moved:
        return ()
    found = []
    nexts = [*(movement.start for movement in moved[1:]), panel.schedule.end]
    for movement, time in zip(moved, nexts, strict=True):
        off = movement.start + max(
            movement.extra_time.get(name, 0.0)
            + circuit.contactor_delay
            + (WITHOUT_TIME_OUT if circuit.time_out is None else circuit.time_out)
            for name, circuit in circuits.items()
        )
        rest = time - movement_end(panel, movement)
        found.append(Wait(time, max(rest, 0.0), max(off + GEAR_STOP_TIME - time, 0.0)))
    return tuple(found)


_made = LRUCache[DriveMachines](64)


def drive_machines(panel: Panel, index: LawIndex) -> DriveMachines | None:
    """Return the machines of a panel's drives, or None if all are markers.

    Parameters
    ----------
    panel : Panel
        A checked panel.
    index : LawIndex
        With the laws of the drives.
    """
    names = tuple(name for name, drive in panel.drive.items() if drive.machine is not None)
    if not names:
        return None
    laws = np.array([index.drive[name] for name in names], dtype=np.int64)
    key = (
        panel.key_of("movement", "machine", "schedule"),
        *(*panel.drive.items(), *panel.rail.items(), laws.tobytes()),
    )
    return _made.get(key) or _made.put(key, _fitted_machines(panel, names, laws))


def _fitted_machines(panel: Panel, names: tuple[str, ...], laws: Ints) -> DriveMachines:
    """Return the machines of some drives; `laws` are those of their rods."""
    records = tuple(fitted_machine(panel, name) for name in names)
    inputs = [number for number, name in enumerate(panel.drive) if name in names]
    constants = [machine_row(machine) for machine in records]
    drives = [panel.drive[name] for name in names]
    nominal = [-drive.stroke if panel.schedule.starts == "open" else 0.0 for drive in drives]
    levels = [start_level(panel, drive) for drive in drives]
    starts = [home + level for home, level in zip(nominal, levels, strict=True)]
    states = [start_state(*item) for item in zip(records, constants, starts, strict=True)]
    return DriveMachines(
        names=names,
        records=records,
        inputs=np.array(inputs, dtype=np.int64),
        laws=laws,
        constants=np.array(constants),
        tables=_stacked([stroke_table(machine.stroke)[:-1] for machine in records], more=1),
        commands=_stacked([command_times(panel, name) for name in names]),
        shared_resistance=records[0].supply.shared_resistance,
        start=np.array(states),
        shift=marker_offsets(panel)[inputs] - np.array(nominal),
        lock_gap=np.array([_or_inf(machine.circuit.lock_gap) for machine in records]),
    )


def _or_inf(value: float | None) -> float:
    return math.inf if value is None else value


def _stacked(tables: list[Floats], *, more: int = 0) -> Floats:
    """Stack tables of different lengths, filled up with rows that begin at infinity."""
    most = max(len(table) for table in tables) + more
    filled = np.zeros((len(tables), most, tables[0].shape[1]))
    filled[:, :, 0] = math.inf
    for whole, table in zip(filled, tables, strict=True):
        whole[: len(table)] = table
    return filled
