"""The throw of a machine on a one-mass rail as a labelled dataset."""

import json

import numpy as np
import xarray as xr

from turnout.core.provenance import provenance
from turnout.machine.one_mass_throw import ENERGY_NAMES, UNITS, MachineThrow

SCHEMA_VERSION = 1
LONG_NAMES = {
    "current": "motor current where the clamp sits",
    "lead_current": "current in the motor lead",
    "voltage": "voltage at the motor circuit",
    "power": "power drawn from the supply, active where it is three-phase",
    "apparent_power": "apparent power drawn from the supply",
    "speed": "speed of the motor",
    "gear_speed": "speed of the shaft behind the clutch",
    "rod_force": "force of the rod on the rail, positive when it pushes it home",
    "rod_position": "position of the rod's machine end, positive in the closing direction",
    "rail_position": "position of the rail, 0 at home",
    "rail_speed": "speed of the rail",
    "rail_friction": "friction on the rail, positive against the closing direction",
    "clutch_slip": "angle by which the clutch has slipped",
    "clutch_torque": "torque of the clutch",
    "clutch_temperature": "temperature of the clutch above ambient",
    "energised": "whether the motor is switched on",
    "locked": "whether the lock holds the gear",
}


def machine_dataset(throw: MachineThrow) -> xr.Dataset:
    """Return histories, events and outcome of a throw as a dataset.

    Parameters
    ----------
    throw : MachineThrow
        From `turnout.machine.one_mass_throw.throw_one_mass`.

    Returns
    -------
    xarray.Dataset
        SI, with `units` and `long_name` on each variable, over `time`, and the events over `event`.

    Examples
    --------
    >>> from turnout.machine.one_mass_throw import throw_one_mass
    >>> dataset = machine_dataset(throw_one_mass("sb3", overrides={"throw.duration": 0.2}))
    >>> dataset["current"].attrs["units"], dataset.attrs["outcome"]
    ('A', 'moving')
    """
    variables = {
        name: ("time", values, {"units": machine_unit(name), "long_name": long_name_of(name)})
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


def machine_unit(name: str) -> str:
    """Return the unit of a history of a throw."""
    return "J" if name.startswith("energy_") else UNITS[name]


def long_name_of(name: str) -> str:
    """Return the long name of a history of a throw."""
    return ENERGY_NAMES.get(name) or LONG_NAMES[name]
