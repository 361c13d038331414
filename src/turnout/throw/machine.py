"""The throw of a machine on a one-mass rail as a labelled dataset."""

import json

import numpy as np
import xarray as xr

from turnout.core.provenance import provenance
from turnout.machine.one_mass_throw import ABOUT, MachineThrow

SCHEMA_VERSION = 1


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
