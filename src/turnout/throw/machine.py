"""A throw of a rail of one mass by one machine: histories, events, energies, dataset."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import MachineError
from turnout.core.provenance import provenance
from turnout.core.scheme import Scheme
from turnout.machine.components import Machine, OneMassRail, Throw
from turnout.machine.compute import places as at
from turnout.machine.machine_file import LoadedMachines, load_machines
from turnout.machine.motor_kind import MOTOR_KINDS, MotorKind
from turnout.machine.rows import with_lock_stroke
from turnout.mechanism.one_mass import one_mass_mechanism, rod_before
from turnout.solver.driven import MachineHistory
from turnout.solver.energy import ALGORITHMIC, DAMPING, FRICTION, SEGMENTS
from turnout.solver.integration import History, integrate
from turnout.solver.outcome import NotConverged
from turnout.solver.start import PriorMotion
from turnout.throw.drives import machine_current, machine_powers

Floats = NDArray[np.float64]

SCHEMA_VERSION = 1
MOVED = 1e-4
"""Way beyond its ends by which a stroke may miss a position [m]."""
BEFORE = 2.0
"""Time in which the rod comes to its start [s]."""

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
    "energy_hand": (at.HAND, "from the hand at the crank"),
}
"""Sums of energy of the machine by their names: place in the sums, long name."""
RAIL_ENERGIES = {
    "energy_friction": (FRICTION, "friction of the rail"),
    "energy_rail_damping": (DAMPING, "damping of the rail"),
}
"""Losses of the rail by their names: column of the ledger, long name."""
BALANCES = {
    "energy_rod_on_rail": "work of the rod on the rail",
    "energy_stored": "change of what is stored",
    "energy_numerical": "lost by the schemes",
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
    "clutch_slip": (at.SLIP, "rad", "angle by which the clutch has slipped"),
    "clutch_temperature": (
        at.CLUTCH_TEMPERATURE,
        "K",
        "temperature of the clutch above ambient",
    ),
    "energised": (at.ENERGISED, "1", "whether the motor is switched on"),
    "locked": (at.LOCKED, "1", "whether the lock holds the gear"),
}
"""Histories that are states of the machine: place in the state, unit, long name."""
DERIVED = {
    "current": ("A", "motor current where the clamp sits"),
    "power": ("W", "power drawn from the supply, active where it is three-phase"),
    "apparent_power": ("V A", "apparent power drawn from the supply"),
    "rail_position": ("m", "position of the rail, 0 at home"),
    "rail_friction": ("N", "friction on the rail, positive against the closing direction"),
    "clutch_torque": ("N m", "torque of the clutch"),
}
"""Other histories: unit, long name."""
ABOUT: Mapping[str, tuple[str, str]] = {
    **{name: (unit, text) for name, (_, unit, text) in STATES.items()},
    **DERIVED,
    **{name: ("J", text) for name, (_, text) in (ENERGIES | RAIL_ENERGIES).items()},
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
        `current` where the clamp sits (`circuit.measured_current`), `power` as drawn,
        `speed`, `rod_force`, `rod_position`, `rail_position`, `clutch_slip`, `clutch_torque`,
        `rail_friction`, ..., and the energies `energy_*` from time 0 [J]; units in `ABOUT`.
    events : tuple of (float, str)
        Time [s] and what happened.
    outcome : str
        Of the last command: "limit", "time-out", "overload", "stalled" (the rod never moved),
        "moving" (the throw was not over at the end).
    energised_time : float
        From the last contactor closing to the cut-off [s]; NaN where there was none.
    energy_residual : float
        Largest residual of the energy balance over its scale [-].
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
    NotConverged
        When the run did not reach its end, or its energy balance does not close.

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
    history = _integrate(machine, rail, throw)
    machines, outcome = history.machines, history.outcome
    assert machines is not None
    last = machines.duties[-1] if machines.duties else None
    return MachineThrow(
        time=history.time,
        histories=_histories(history, machines) | _energies(history, machines),
        events=machines.events[0],
        outcome=last.outcome if last else "moving",
        energised_time=last.off - last.on if last else math.nan,
        energy_residual=outcome.energy_residual / max(outcome.energy_scale, 1e-12),
        halved=history.halved + int(machines.states[-1, 0, at.HALVED]),
        name=name,
        overrides=given,
        kind=machine.motor.of_kind,
    )


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


def _integrate(machine: Machine, rail: OneMassRail, throw: Throw) -> History:
    """Integrate rail and machine from the friction that the rail has at the start."""
    mechanism = one_mass_mechanism(machine, rail, throw)
    assert mechanism.machines is not None
    x, before = mechanism.machines.start[0, at.ROD_POSITION], rod_before(mechanism, rail)

    def come(time: Floats) -> Floats:
        share = 0.5 - 0.5 * np.cos(np.pi / BEFORE * time)
        return np.asarray([before + (x - before) * share])

    history = integrate(
        mechanism,
        Scheme(step=throw.step, output_interval=throw.output_interval, cutoff_frequency=math.inf),
        inputs=lambda time: np.full((1, time.size), x),
        end=max(throw.duration, throw.output_interval),
        prior=PriorMotion(BEFORE, come),
    )
    if not history.outcome.complete:
        raise NotConverged(history.outcome)
    return history


def _histories(history: History, machines: MachineHistory) -> dict[str, Floats]:
    states, constants = machines.states[:, 0], machines.constants[0]
    power, apparent = machine_powers(machines, 0)
    return {name: states[:, place] for name, (place, _, _) in STATES.items()} | {
        "current": machine_current(machines, 0),
        "power": power,
        "apparent_power": apparent,
        "rail_position": history.g[:, 0],
        "rail_friction": history.friction_force.sum(axis=1),
        "clutch_torque": constants[at.CLUTCH_STIFFNESS] * states[:, at.TWIST],
    }


def _energies(history: History, machines: MachineHistory) -> dict[str, Floats]:
    """Return the energies of machine and rail, and the residual of their balance."""
    found = {name: machines.sums(place)[:, 0] for name, (place, _) in ENERGIES.items()}
    found |= {name: history.ledger[:, place] for name, (place, _) in RAIL_ENERGIES.items()}
    rod = 0.5 * machines.states[:, 0, at.ROD_FORCE] ** 2 / machines.constants[0, at.ROD_STIFFNESS]
    stored = machines.stored[:, 0] + (history.stored - history.stored[0]).sum(axis=1)
    numerical = machines.numerical[:, 0] + history.ledger[:, [ALGORITHMIC, SEGMENTS]].sum(axis=1)
    given = found["energy_supply"] + found["energy_hand"]
    lost = sum(found.values()) - given
    return found | {
        "energy_rod_on_rail": machines.given[:, 0] - (rod - rod[0]),
        "energy_stored": stored,
        "energy_numerical": numerical,
        "energy_residual": given - lost - stored - numerical,
    }


def machine_dataset(throw: MachineThrow) -> xr.Dataset:
    """Return histories, events and outcome of a throw as a dataset.

    Parameters
    ----------
    throw : MachineThrow
        From `throw_one_mass`.

    Returns
    -------
    xarray.Dataset
        SI, with `units` and `long_name` on each variable, over `time`, and the events over `event`.

    Examples
    --------
    >>> dataset = machine_dataset(throw_one_mass("sb3", overrides={"throw.duration": 0.2}))
    >>> dataset["current"].attrs["units"], dataset.attrs["outcome"]
    ('A', 'moving')
    """
    variables = {
        name: ("time", values, dict(zip(("units", "long_name"), ABOUT[name], strict=True)))
        for name, values in throw.histories.items()
    }
    times = np.array([time for time, _ in throw.events], dtype=np.float64)
    texts = [text for _, text in throw.events]
    about = {"units": "s", "long_name": "time of the event"}
    dataset = xr.Dataset(
        variables | {"event_time": ("event", times, about)},
        coords={"time": ("time", throw.time, {"units": "s", "long_name": "time"}), "event": texts},
    )
    dataset.attrs |= {
        "title": f"throw of machine {throw.name} on a one-mass rail",
        "schema_version": SCHEMA_VERSION,
        "machine": throw.name,
        "outcome": throw.outcome,
        "energised_time": throw.energised_time,
        "energy_residual": throw.energy_residual,
        "halved_steps": throw.halved,
        "overrides": json.dumps(dict(throw.overrides), default=str),
        **provenance(),
    }
    return dataset
