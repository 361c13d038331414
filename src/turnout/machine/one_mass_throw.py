"""One machine on a one-mass rail: from records to time histories."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MachineError, SolverError
from turnout.law.table import Floats
from turnout.machine.components import Machine, OneMassRail, Throw
from turnout.machine.compute import places as at
from turnout.machine.compute.circuit import throw as throw_kernel
from turnout.machine.machine_file import LoadedMachines, load_machines
from turnout.machine.motor_kind import MOTOR_KINDS, MotorKind, nominal_voltage
from turnout.machine.rows import (
    command_rows,
    machine_row,
    rail_row,
    rest_on,
    start_state,
    stroke_table,
    with_lock_stroke,
    work_rows,
)

BALANCE = 1e-6
"""Largest residual of the energy balance, as a share of the energy turned over, of a good run."""
MOVED = 1e-4
"""A rod that moved by less never moved [m]."""
EVENTS = 64

ENERGIES = {
    "energy_supply": (at.SUPPLY, "taken from the supply"),
    "energy_copper": (at.COPPER, "lost in the motor's copper"),
    "energy_line": (at.LINE, "lost in line and supply"),
    "energy_brush": (at.BRUSH, "lost at the brushes"),
    "energy_snub": (at.SNUB, "lost in the snubber, or in arc and windings of an induction motor"),
    "energy_field": (
        at.FIELD,
        "lost in a separate field winding, or in the iron of an induction motor",
    ),
    "energy_T0": (at.MOTOR_FRICTION, "dry friction of the motor, brake included"),
    "energy_c1": (at.MOTOR_DRAG_HEAT, "viscous drag of the motor"),
    "energy_gear": (at.GEAR, "lost in the gear"),
    "energy_c2": (at.GEAR_DRAG_HEAT, "viscous drag of the gear"),
    "energy_clutch": (at.CLUTCH, "heat of the slipping clutch"),
    "energy_friction": (at.RAIL_FRICTION_HEAT, "friction of the rail"),
    "energy_rail_damping": (at.RAIL_DAMPING_HEAT, "damping of the rail"),
    "energy_hand": (at.HAND, "from the hand at the crank"),
    "energy_rod_on_rail": (at.ROD_ON_RAIL, "work of the rod on the rail"),
}
"""Sums of energy by their names: place in the sums, long name."""
LOSSES = tuple(
    name for name in ENERGIES if name not in ("energy_supply", "energy_hand", "energy_rod_on_rail")
)
BALANCES = {
    "energy_stored": "change of what is stored",
    "energy_numerical": "lost by the scheme in what is stored",
    "energy_residual": "residual of the balance",
}
"""Energies that follow from these, and their long names."""
STATES = {
    "lead_current": (at.CURRENT, "A", "current in the motor lead"),
    "voltage": (at.SUPPLIED, "V", "voltage at the motor circuit"),
    "speed": (at.SPEED, "rad/s", "speed of the motor"),
    "gear_speed": (at.GEAR_SPEED, "rad/s", "speed of the shaft behind the clutch"),
    "rod_force": (
        at.ROD_FORCE,
        "N",
        "force of the rod on the rail, positive when it pushes it home",
    ),
    "rod_position": (
        at.ROD_POSITION,
        "m",
        "position of the rod's machine end, positive in the closing direction",
    ),
    "rail_position": (at.RAIL_POSITION, "m", "position of the rail, 0 at home"),
    "rail_speed": (at.RAIL_SPEED, "m/s", "speed of the rail"),
    "clutch_slip": (at.SLIP, "rad", "angle by which the clutch has slipped"),
    "clutch_temperature": (
        at.CLUTCH_TEMPERATURE,
        "K",
        "temperature of the clutch above ambient",
    ),
    "energised": (at.ENERGISED, "1", "whether the motor is switched on"),
    "locked": (at.LOCKED, "1", "whether the lock holds the gear"),
}
"""Histories that are states: place in the state, unit, long name."""
DERIVED = {
    "current": ("A", "motor current where the clamp sits"),
    "power": ("W", "power drawn from the supply, active where it is three-phase"),
    "apparent_power": ("V A", "apparent power drawn from the supply"),
    "rail_friction": ("N", "friction on the rail, positive against the closing direction"),
    "clutch_torque": ("N m", "torque of the clutch"),
}
"""Histories that follow from states: unit, long name."""
ABOUT: Mapping[str, tuple[str, str]] = {
    **{name: (unit, text) for name, (_, unit, text) in STATES.items()},
    **DERIVED,
    **{name: ("J", text) for name, (_, text) in ENERGIES.items()},
    **{name: ("J", text) for name, text in BALANCES.items()},
}
"""Unit and long name of each history."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MachineThrow:
    """Histories of a throw: `throw["rod_force"]`, with what happened and how it ended.

    Attributes
    ----------
    time : ndarray, shape (n,)
        [s].
    histories : mapping of str to ndarray, shape (n,)
        `current` and `power` as drawn or as in the motor lead (see `circuit.measured_current`),
        `speed`, `rod_force`, `rod_position`, `rail_position`, `clutch_slip`, `clutch_torque`,
        `rail_friction`, ..., and the energies `energy_*` from time 0 [J]; units in `ABOUT`.
    events : tuple of (float, str)
        Time [s] and what happened.
    outcome : str
        "limit", "time-out", "overload", "stalled" (the rod never moved), "moving" (the throw was
        not over at the end).
    energised_time : float
        From the last contactor closing to the cut-off [s]; NaN where there was none.
    energy_residual : float
        Largest residual of the energy balance over the energy turned over [-].
    halved : int
        Steps that were taken in halves.
    kind : MotorKind
        Of its motor.
    """

    time: Floats
    histories: Mapping[str, Floats]
    events: tuple[tuple[float, str], ...]
    outcome: str
    energised_time: float
    energy_residual: float
    halved: int
    name: str = ""
    overrides: Mapping[str, object] = field(default_factory=dict)
    kind: MotorKind = MOTOR_KINDS["permanent magnet"]

    def __getitem__(self, name: str) -> Floats:
        """Return a history by its name."""
        return self.time if name == "time" else self.histories[name]

    @property
    def last_energised(self) -> NDArray[np.bool_]:
        """Instants at which the motor was on, of the last time that it was, shape (n,)."""
        on = self["energised"] > 0.0
        begins = np.flatnonzero(on & ~np.concatenate([[False], on[:-1]]))
        return on & (np.arange(on.size) >= begins[-1]) if begins.size else on

    @property
    def is_balanced(self) -> bool:
        """Whether the energy balance closes to 1e-6."""
        return self.energy_residual <= BALANCE


def throw_one_mass(
    machine: Machine | LoadedMachines | str | Path,
    rail: OneMassRail | None = None,
    throw: Throw | None = None,
    *,
    overrides: Mapping[str, object] | None = None,
) -> MachineThrow:
    """Throw a one-mass rail by one machine.

    Parameters
    ----------
    machine : Machine, LoadedMachines, str or Path
        A record; or a loaded file, the name of a library machine or the path of a file, whose rail
        and throw are taken where none is given here.
    rail : OneMassRail, optional
    throw : Throw, optional
        Start, commands, duration, step.
    overrides : mapping, optional
        Changes by key where a name or path was given: `{"rail.object_size": 0.013}`.

    Returns
    -------
    MachineThrow

    Raises
    ------
    MachineError
        When rail or throw are missing, or a value is not valid.
    SolverError
        When a step did not converge even in the shortest pieces.

    Examples
    --------
    >>> answer = throw_one_mass("sb3", overrides={"throw.duration": 0.3})
    >>> round(float(answer["current"].max()), 2)
    10.27
    """
    name, given = "", dict[str, object]()
    if not isinstance(machine, Machine):
        loaded = machine if isinstance(machine, LoadedMachines) else load_machines(machine)
        if overrides:
            loaded = loaded.with_overrides(overrides)
        rail, throw = rail or loaded.rail, throw or loaded.throw
        name, machine = loaded.pick(throw.machine if throw else None)
        given = dict(loaded.overrides)
        missing = [key for key, item in (("rail", rail), ("throw", throw)) if item is None]
        if missing:
            problems = [f"[{key}]: is missing; a throw needs it" for key in missing]
            raise MachineError(problems, source=loaded.source)
    elif overrides:
        message = "overrides change a machine that is given by name or path, not a record"
        raise MachineError([message])
    if rail is None or throw is None:
        raise MachineError(["a machine given as a record needs a rail and a throw"])
    machine = with_lock_stroke(machine)
    problems = list(_places_that_cannot_be(machine, rail, throw))
    if problems:
        raise MachineError(problems, source=name or "machine")
    return _march(machine, rail, throw, (name, given))


def _places_that_cannot_be(machine: Machine, rail: OneMassRail, throw: Throw) -> Iterator[str]:
    """Say which positions the stroke does not reach, and an object that is larger than the gap."""
    stroke, circuit = machine.stroke, machine.circuit
    if stroke.kind != "screw":
        ends = stroke.start, stroke.start + (stroke.length or 0.0)
        places = {
            "throw.start": throw.start,
            "circuit.limit_closing": circuit.limit_closing,
            "circuit.limit_opening": circuit.limit_opening,
        }
        for key, place in places.items():
            if place is not None and not ends[0] - MOVED <= place <= ends[1] + MOVED:
                yield (
                    f"{key} = {1e3 * place:g} mm: the stroke goes from {1e3 * ends[0]:g} to "
                    f"{1e3 * ends[1]:g} mm (stroke.start and stroke.length)"
                )
    if rail.object_size is not None and rail.object_size >= -throw.start:
        yield (
            f"rail.object_size = {1e3 * rail.object_size:g} mm: does not fit, the rod starts at "
            f"throw.start = {1e3 * throw.start:g} mm from home (0)"
        )


def _march(
    machine: Machine, rail: OneMassRail, throw: Throw, about: tuple[str, Mapping[str, object]]
) -> MachineThrow:
    constants, rail_constants = machine_row(machine), rail_row(rail)
    table, commands = stroke_table(machine.stroke), command_rows(throw.command)
    state = start_state(machine, constants, throw.start)
    rest_on(rail_constants, constants, state, friction_share=rail.friction_at_start)
    every = round(throw.output_interval / throw.step)
    count = max(1, round(throw.duration / throw.output_interval))
    kept, stored = np.zeros((count + 1, at.STATES)), np.zeros(count + 1)
    log = np.zeros((EVENTS, 2))
    stepping = (throw.output_interval / every, every, count)
    arrays = (constants, rail_constants, table, commands, state)
    reached = throw_kernel(*arrays, stepping, work_rows(), log, kept, stored)
    time = np.arange(count + 1, dtype=np.float64) * throw.output_interval
    if reached < count:
        message = (
            f"the machine's step did not converge at t = {time[reached]:.4f} s, even in pieces of "
            f"{throw.step / 2**20:.1e} s; check inertias and stiffnesses"
        )
        raise SolverError(message)
    histories = _histories(machine, constants, rail_constants, kept) | _energies(kept, stored)
    events = _events(log, int(state[at.EVENTS]))
    residual = histories.pop("energy_balance")
    return MachineThrow(
        time=time,
        histories=histories,
        events=events,
        outcome=_outcome(events, kept[:, at.ROD_POSITION]),
        energised_time=_energised_time(events),
        energy_residual=float(residual[-1]),
        halved=int(state[at.HALVED]),
        name=about[0],
        overrides=about[1],
        kind=machine.motor.of_kind,
    )


def _histories(
    machine: Machine, constants: Floats, rail: Floats, kept: Floats
) -> dict[str, Floats]:
    lead, on = kept[:, at.CURRENT], kept[:, at.ENERGISED]
    supply = on * np.where(kept[:, at.SUPPLIED] < 0.0, -1.0, 1.0) * lead
    voltage = nominal_voltage(machine.motor, machine.supply)
    drawn = supply + on * constants[at.FIELD_POWER] / voltage
    power, apparent = machine.motor.of_kind.powers(constants, kept)
    at_supply = machine.circuit.measured_current == "supply"
    return {name: kept[:, place] for name, (place, _, _) in STATES.items()} | {
        "current": drawn if at_supply else lead,
        "power": power,
        "apparent_power": apparent,
        "rail_friction": rail[at.FRICTION_STIFFNESS] * kept[:, at.RAIL_TWIST],
        "clutch_torque": constants[at.CLUTCH_STIFFNESS] * kept[:, at.TWIST],
    }


def _energies(kept: Floats, stored: Floats) -> dict[str, Floats]:
    """Return the sums of energy, and the residual of their balance over what was turned over."""
    sums = kept[:, at.ENERGIES :]
    found = {name: sums[:, place] for name, (place, _) in ENERGIES.items()}
    change = stored - stored[0]
    into = sums[:, at.INTO_STORES] + sums[:, at.ROD_INPUT] - sums[:, at.ROD_ON_RAIL]
    numerical = into - change
    given = found["energy_supply"] + found["energy_hand"]
    residual = given - sum(found[name] for name in LOSSES) - change - numerical
    turned_over = np.abs(given) + np.abs(change) + sum(np.abs(found[name]) for name in LOSSES)
    scale = max(float(turned_over.max()), 1e-12)
    return found | {
        "energy_stored": change,
        "energy_numerical": numerical,
        "energy_residual": residual,
        "energy_balance": np.array([np.abs(residual).max() / scale]),
    }


def _events(log: Floats, count: int) -> tuple[tuple[float, str], ...]:
    rows = log[: min(count, log.shape[0])]
    return tuple((float(time), at.EVENT_TEXTS[int(event)]) for time, event in rows)


def _outcome(events: tuple[tuple[float, str], ...], x: Floats) -> str:
    offs = [text for _, text in events if text.startswith("off ")]
    moved = float(np.ptp(x))
    if events and moved < MOVED:
        return "stalled"
    last_on = max((n for n, (_, text) in enumerate(events) if text == "on"), default=-1)
    last_off = max((n for n, (_, text) in enumerate(events) if text.startswith("off ")), default=-1)
    return offs[-1].removeprefix("off ") if offs and last_off > last_on else "moving"


def _energised_time(events: tuple[tuple[float, str], ...]) -> float:
    on = math.nan
    length = math.nan
    for time, text in events:
        if text == "on":
            on = time
        elif text.startswith("off "):
            length = time - on
    return length
