"""Throws that several verification tests use, each simulated once."""

from functools import cache

import numpy as np
import xarray as xr

from turnout.core.scheme import Scheme
from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.throw.simulate import simulate

DEFAULT = "uic60-760-1-15"
SYMMETRIC = "uic60-760-1-15-symmetric"
STUDIED: dict[str, str | float | bool] = {
    "drive.2.stroke": 0.075,
    "drive.1.over_travel_open": 0.001,
    "drive.over_travel_closed": 0.0,
    "drive.2.saturation_force": 6e3,
    "drive.roll_stiffness": 0.0,
    "rail.straight.stress_free": "closed",
    "rail.curved.stress_free": "open",
    "rail.fit_gap": 0.0,
    "schedule.loaded": False,
    "lock.rule": "no slip",
}
"""What makes the default panel the one that an independent 3-D study used: the former default,
without closing force and free of force in the through route."""


@cache
def throw(
    panel: str,
    place: str | None = None,
    size_mm: float = 13.0,
    overrides: tuple[tuple[str, str | float], ...] = (),
    step: float = 1e-3,
) -> xr.Dataset:
    """Return the response of a library panel, with one foreign object if a place is given."""
    switch = load_panel(panel).with_overrides(dict(overrides))
    trapped = ForeignObject(size_mm / 1e3, place) if place else None
    return simulate(switch, foreign_object=trapped, scheme=Scheme(step=step))


def end_force(ds: xr.Dataset, drive: str) -> float:
    """Return a drive's force at the end of the run [N]."""
    return float(ds["drive_force"].sel(drive=drive)[-1])


def energy_balance(ds: xr.Dataset) -> tuple[float, float]:
    """Return largest energy residual and largest numerical loss as shares of the run's scale."""
    scale = ds.attrs["energy_scale"]
    residual = np.abs(ds["energy_residual"].to_numpy()).max() / scale
    return float(residual), float(np.abs(ds["energy_numerical"].to_numpy()).max() / scale)
