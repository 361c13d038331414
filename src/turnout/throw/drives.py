"""Channels of the drives that are machines: current, power, clutch, state, energies, throw times.

Rows of drives that are markers are NaN, and none of these channels is made where all are.
"""

import functools
import json
import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from turnout.machine.components import Machine
from turnout.machine.compute import places as at
from turnout.machine.motor_kind import nominal_voltage
from turnout.machine.steady import clutch_force, steady_point, torque_for
from turnout.panel.markers import movement_time, ordered_movements
from turnout.panel.model import Panel
from turnout.solver.driven import Duty, MachineHistory, sum_machines
from turnout.solver.integration import History
from turnout.throw.route import DirectedMovement, throws
from turnout.throw.signals import Channel

Floats = NDArray[np.float64]

OFF, ON, SLIPS, HELD = range(4)
"""Values of `drive_state`."""
INRUSH = 0.3
"""After the contactor, when the inrush is over [s]."""
FINAL_CURRENT_WINDOW = 0.1
"""Before the cut-off, over which the last current is averaged [s]."""
_ENERGIES = {
    "energy_copper": ("copper", "field"),
    "energy_line": ("line",),
    "energy_brush": ("brush",),
    "energy_motor_friction": ("motor friction",),
    "energy_gear": ("gear",),
}


def duties(history: History) -> tuple[Duty, ...]:
    """Return the movement of every machine on every command that it was given."""
    return history.machines.duties if history.machines is not None else ()


AnyPanel = TypeVar("AnyPanel", bound=Panel)


def as_thrown(panel: AnyPanel, history: History) -> AnyPanel:
    """Return a panel with the schedule that its run came to have, as it waited for machines."""
    late = _lateness(panel, history)
    if not any(late):
        return panel
    moved = {
        name: panel.movement[name].model_copy(update={"start": panel.movement[name].start + by})
        for (name, _), by in zip(ordered_movements(panel), late, strict=False)
    }
    movement = {name: moved[name] for name in panel.movement}
    schedule = panel.schedule.model_copy(update={"end": panel.schedule.end + late[-1]})
    return panel.model_copy(update={"movement": movement, "schedule": schedule})


def _lateness(panel: Panel, history: History) -> list[float]:
    """Return by how much each movement was late, and the end, as they waited for machines [s]."""
    waited = [item.length for item in history.machines.pauses] if history.machines else []
    return [sum(waited[:number]) for number in range(len(panel.movement))] + [sum(waited)]


def moved_throws(panel: Panel, history: History) -> tuple[DirectedMovement, ...]:
    """Return the movements as they were made, each until its last drive came to rest.

    Parameters
    ----------
    panel : Panel
        With the schedule of the run, whose movements may have waited for machines.
    history : History
    """
    made = duties(history)
    if history.machines is None:
        return throws(panel)
    late, planned = _lateness(panel, history), throws(panel)
    end_of_all = max([panel.schedule.end + late[-1], *history.time[-1:].tolist()])
    found = []
    for number, (throw, by) in enumerate(zip(planned, late, strict=False)):
        movement, ends = panel.movement[throw.name], []
        start, until = movement.start + by, math.inf
        if number + 1 < len(planned):
            until = planned[number + 1].start + late[number + 1]
        for name, drive in panel.drive.items():
            if drive.machine is None:
                ends.append(start + movement_time(movement, name))
                continue
            begins = start + movement.extra_time.get(name, 0.0)
            own = [d.rest for d in made if d.drive == name and abs(d.command - begins) < 1e-9]
            ends.append(own[0] if own and not math.isnan(own[0]) else math.inf)
        last = max(ends)
        end, unfinished = min(last, until, end_of_all + 1.0), last > until
        found.append(DirectedMovement(throw.name, throw.to, start, end, until, unfinished))
    return tuple(found)


def marker_ends(panel: Panel) -> list[float]:
    """Return when the last marker arrives in each movement [s]; nothing if all are machines."""
    markers = [name for name, drive in panel.drive.items() if drive.machine is None]
    moved = [panel.movement[throw.name] for throw in throws(panel)] if markers else []
    return [item.start + max(movement_time(item, name) for name in markers) for item in moved]


def duty_records(panel: Panel, made: Sequence[Duty], end: float) -> str:
    """Return the work of the machines until the end of a run [s] as JSON text, for attributes."""
    fed = machine_supplies(panel)

    def lost(duty: Duty) -> float | None:
        """Return the time of a phase loss of the machine, unless later than this command."""
        time = fed[duty.drive]["phase_lost_at"]
        until = end if np.isnan(duty.off) else duty.off
        return time if time is not None and time <= until else None

    return json.dumps(
        [
            {
                "drive": duty.drive,
                "machine": panel.drive[duty.drive].machine,
                "to": duty.to,
                "outcome": duty.outcome,
                "on": duty.on,
                "off": None if np.isnan(duty.off) else duty.off,
                "rest": None if np.isnan(duty.rest) else duty.rest,
                "phase_lost": lost(duty),
            }
            for duty in made
        ]
    )


def machine_supplies(panel: Panel) -> dict[str, dict[str, float | None]]:
    """Return the supplies of the drives that are machines.

    Returns
    -------
    dict
        By drive `frequency`, 0 of direct current [Hz], `voltage` [V], and `phase_lost_at` [s] or
        None.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("sb1", overrides={"drive.1.machine": "s700k"})
    >>> machine_supplies(panel)
    {'1': {'frequency': 50.0, 'voltage': 380.0, 'phase_lost_at': None}}
    """
    named = {name: drive.machine for name, drive in panel.drive.items() if drive.machine}
    records = {name: panel.machine[machine] for name, machine in named.items()}
    return {
        name: {
            "frequency": machine.motor.frequency or 0.0,
            "voltage": nominal_voltage(machine.motor, machine.supply),
            "phase_lost_at": machine.supply.phase_lost_at,
        }
        for name, machine in records.items()
    }


def machine_signals(panel: Panel, history: History) -> dict[str, Channel]:
    """Return the channels of machines over time; none if all drives are markers.

    `drive_slipping` is not among them, see `machine_slips`. A watched run has no `clutch_heat`.
    """
    machines = history.machines
    if machines is None:
        return {}
    state = machines.states

    def of_drives(values: Floats) -> Channel:
        found = np.full((len(panel.drive), values.shape[0]), np.nan)
        found[machines.inputs] = values.T
        return ("drive", "time"), found

    power, apparent = np.empty((2, *state.shape[:2]))
    for number in range(len(machines.names)):
        power[:, number], apparent[:, number] = machine_powers(machines, number)
    alternating = any(machine.motor.of_kind.alternating for machine in machines.records)
    currents = [machine_current(machines, number) for number in range(len(machines.names))]
    found = {
        "drive_current": of_drives(np.stack(currents, axis=1)),
        "drive_voltage": of_drives(state[:, :, at.SUPPLIED]),
        "drive_power": of_drives(power),
        **({"drive_apparent_power": of_drives(apparent)} if alternating else {}),
        "motor_speed": of_drives(state[:, :, at.SPEED]),
        "clutch_slip": of_drives(state[:, :, at.SLIP]),
        "drive_state": _states(panel, machines),
    }
    if history.watched is None:
        found["clutch_heat"] = of_drives(machines.sums(at.CLUTCH))
    return found


def machine_powers(machines: MachineHistory, number: int) -> tuple[Floats, Floats]:
    """Return active [W] and apparent power [V A] of a machine over time."""
    kind = machines.records[number].motor.of_kind
    return kind.powers(machines.constants[number], machines.states[:, number])


def needs_powers(panel: Panel) -> bool:
    """Return whether the current of a drive's machine follows from its power."""
    named = [panel.machine[drive.machine] for drive in panel.drive.values() if drive.machine]
    return any(machine.circuit.measured_current == "supply" for machine in named)


def machine_current(machines: MachineHistory, number: int) -> Floats:
    """Return the current of a machine over time where it is measured [A]."""
    machine = machines.records[number]
    if machine.circuit.measured_current == "supply":
        return machine_powers(machines, number)[0] / nominal_voltage(machine.motor, machine.supply)
    lead: Floats = machines.states[:, number, at.CURRENT]
    return lead


def machine_slips(history: History, flags: NDArray[np.bool_]) -> None:
    """Put the clutches in the place of saturation forces, if drives are machines.

    A machine that was switched off before its limit contact stays marked until its next throw: its
    end position is not proved, as that of a drive which rests at its saturation force.

    Parameters
    ----------
    flags : ndarray of bool, shape (n_drives, n_times)
        `drive_slipping`; rows of machines are written.
    """
    machines = history.machines
    if machines is None:
        return
    flags[machines.inputs] = machines.slips
    rows = dict(zip(machines.names, machines.inputs, strict=True))
    made = duties(history)
    for duty in made:
        if duty.outcome == "limit" or np.isnan(duty.off):
            continue
        later = [d.on for d in made if d.drive == duty.drive and d.on > duty.on]
        until = min(later, default=np.inf)
        flags[rows[duty.drive]] |= (machines.time >= duty.off) & (machines.time < until)


def _states(panel: Panel, machines: MachineHistory) -> Channel:
    state = machines.states
    value = np.where(state[:, :, at.ENERGISED] > 0.0, ON, OFF)
    value = np.where((state[:, :, at.LOCKED] > 0.0) & (value == OFF), HELD, value)
    value[machines.slips.T & (value == ON)] = SLIPS
    found = np.full((len(panel.drive), value.shape[0]), -1, dtype=np.int64)
    found[machines.inputs] = value.T
    return ("drive", "time"), found


def machine_labels(panel: Panel, history: History) -> dict[str, Channel]:
    """Return throw time and currents of the last throw in each direction, opening first.

    Nothing if all drives are markers.
    """
    machines, names = history.machines, list(panel.drive)
    if machines is None:
        return {}
    found, made = np.full((3, len(names), 2), np.nan), machines.duties
    currents = [machine_current(machines, number) for number in range(len(machines.names))]
    ends = [duty.off if math.isfinite(duty.off) else math.inf for duty in made]
    times = [
        (duty.on + INRUSH, max(off - FINAL_CURRENT_WINDOW, duty.on), off)
        for duty, off in zip(made, ends, strict=True)
    ]
    bounds = np.searchsorted(machines.time, np.array(times).reshape(-1, 3)).tolist()
    for duty, (*begins, end) in zip(made, bounds, strict=True):
        row = currents[machines.names.index(duty.drive)]
        place = names.index(duty.drive), int(duty.to == "closed")
        means = [
            np.add.reduce(np.abs(row[begin:end])) / (end - begin) if end > begin else np.nan
            for begin in begins
        ]
        found[(slice(None), *place)] = duty.off - duty.on, *means
    dims = ("drive", "direction")
    labels = zip(("throw_time", "mean_current", "end_current"), found, strict=True)
    return {name: (dims, values) for name, values in labels}


def machine_energies(history: History, channels: dict[str, Channel]) -> dict[str, Channel]:
    """Return the energies of all machines, and the energy balance of rails and machines together.

    Parameters
    ----------
    history : History
    channels : dict
        From `energy_channels`, of the rails.

    Returns
    -------
    dict
        Supply = copper + line + brush + motor friction + gear + clutch heat + work of the rods +
        what the machines store + what the schemes lose.
    """
    machines = history.machines
    if machines is None:
        return {}
    losses = machines.losses

    def total(values: Floats) -> Channel:
        return ("time",), sum_machines(values)

    found = {
        name: total(functools.reduce(np.add, (losses[part] for part in parts)))
        for name, parts in _ENERGIES.items()
    }
    numerical = np.asarray(channels["energy_numerical"][1], dtype=np.float64)
    residual = np.asarray(channels["energy_residual"][1], dtype=np.float64)
    return found | {
        "energy_supply": total(machines.sums(at.SUPPLY, at.HAND)),
        "energy_machine": total(machines.stored),
        "work_rods": total(machines.given),
        "energy_numerical": (("time",), numerical + sum_machines(machines.numerical)),
        "energy_residual": (("time",), residual - sum_machines(machines.residual)),
    }


POWER = "power"
FORCES = 41
"""Of the table of steady points, from 0 to the force that the clutch holds."""


def gain_along(panel: Panel, drive: str, quantity: str, *, force: Floats, state: Floats) -> Floats:
    """Return the local gain of a drive's machine at every instant of a throw.

    Parameters
    ----------
    panel : Panel
        With the machine.
    drive : str
        A drive that is a machine.
    quantity : str
        "current" or "power".
    force : ndarray, shape (n_times,)
        Of the drive [N].
    state : ndarray, shape (n_times,)
        `drive_state`; the gain is 0 where the machine is off, held, or its clutch slips.

    Returns
    -------
    ndarray, shape (n_times,)
        [A/N] or [W/N].
    """
    name = panel.drive[drive].machine
    assert name is not None
    table = local_gain(panel.machine[name], quantity)
    return np.where(state == ON, np.interp(np.maximum(force, 0.0), *table), 0.0)


def local_gain(machine: Machine, quantity: str) -> tuple[Floats, Floats]:
    """Return forces [N] and the change of current [A/N] or power [W/N] with the force there.

    Parameters
    ----------
    machine : Machine
        In mid-stroke, moving.
    quantity : str
        "current" or "power".

    Examples
    --------
    >>> from turnout.machine.machine_file import load_machines
    >>> force, gain = local_gain(load_machines("jea73").machine["jea73"], "current")
    >>> bool(np.all((1e3 * gain > 0.1) & (1e3 * gain < 0.3)))  # A/kN
    True
    """
    force = np.linspace(0.0, clutch_force(machine), FORCES)
    points = [steady_point(machine, torque=torque_for(machine, float(each))) for each in force]
    power = np.array([point.power for point in points])
    from_supply = machine.circuit.measured_current == "supply"
    voltage = nominal_voltage(machine.motor, machine.supply)
    current = power / voltage if from_supply else [p.current for p in points]
    values = power if quantity == POWER else np.asarray(current)
    return force, np.gradient(values, force)
