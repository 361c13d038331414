"""Throws that several verification tests look at, each simulated once."""

from functools import cache

import numpy as np
import xarray as xr

from turnout.panel.foreign_object import ForeignObject
from turnout.panel.load import load_panel
from turnout.response.simulate import simulate
from turnout.scheme import Scheme

DEFAULT = "uic60-760-1-15"
SYMMETRIC = "uic60-760-1-15-symmetric"


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


def books(ds: xr.Dataset) -> tuple[float, float]:
    """Return largest energy residual and largest numerical loss as shares of the run's scale."""
    scale = ds.attrs["energy_scale"]
    residual = np.abs(ds["energy_residual"].to_numpy()).max() / scale
    return float(residual), float(np.abs(ds["energy_numerical"].to_numpy()).max() / scale)
