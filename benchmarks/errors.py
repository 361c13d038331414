"""Difference of one run from another, channel by channel."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

RMS_LIMIT, END_SHARE, END_FORCE, CONTACT_LIMIT = 0.5, 0.01, 15.0, 5e-3
"""Promised of quick mode: rms [% of peak], end [-] or [N], first contact [s]."""
LEFT_OUT = ("drive_displacement", "energy_residual", "energy_numerical")


@dataclass(frozen=True, slots=True)
class Error:
    """The error of one channel; of several members (chairs, drives) the worst.

    Attributes
    ----------
    rms, largest : float
        Of the difference, in percent of the channel's peak in the reference, of energies in percent
        of the scale of its energy balance.
    end : float
        Largest difference at the end [unit of the channel].
    end_allowed : float
        The share of it in what is allowed there, 1 % or 15 N; nan where that is no force.
    """

    rms: float
    largest: float
    end: float
    end_allowed: float

    @property
    def within(self) -> bool:
        """True if the channel keeps the promise of quick mode."""
        return self.rms <= RMS_LIMIT and not self.end_allowed > 1.0


@dataclass(frozen=True, slots=True)
class Run:
    """One run of a scheme, its cost and its difference from the reference.

    Times in seconds; `channels` is empty where the run ended early.
    """

    case: str
    name: str
    step: float
    cutoff_frequency: float
    scheme: str
    modes: int
    halved: int
    seconds: float
    load: float
    contact_late: float
    channels: dict[str, Error]


def channels(dataset: xr.Dataset) -> dict[str, NDArray[np.float64]]:
    """Return the histories of a dataset, time last, one row a member."""
    found = {}
    for name, channel in dataset.data_vars.items():
        if "time" in channel.dims and channel.dtype == np.float64 and name not in LEFT_OUT:
            values = channel.transpose(..., "time").to_numpy()
            found[str(name)] = values.reshape(-1, values.shape[-1])
    return found


def error(
    ours: NDArray[np.float64],
    theirs: NDArray[np.float64],
    *,
    unit: str,
    scale: float | None = None,
) -> Error:
    """Compare one channel, shapes (members, instants), at the same instants.

    Differences are shares of `scale`, which is the channel's peak where none is given.

    Examples
    --------
    >>> found = error(np.array([[0.0, 1.0]]), np.array([[0.0, 2.0]]), unit="mm")
    >>> found.largest, found.end
    (50.0, 1.0)
    """
    kept = np.isfinite(theirs).all(axis=1) & np.isfinite(ours).all(axis=1)
    if not kept.any():
        return Error(0.0, 0.0, 0.0, np.nan)
    ours, theirs = ours[kept], theirs[kept]
    peak = np.abs(theirs).max() if scale is None else scale
    off = np.abs(ours - theirs)
    end = off[:, -1]
    allowed = np.maximum(END_SHARE * np.abs(theirs[:, -1]), END_FORCE)
    if peak == 0.0:
        worst = 0.0 if not off.any() else np.inf
        return Error(worst, worst, float(end.max()), np.nan)
    return Error(
        rms=float(100 * np.sqrt(np.mean(off**2, axis=1)).max() / peak),
        largest=float(100 * off.max() / peak),
        end=float(end.max()),
        end_allowed=float((end / allowed).max()) if unit == "N" else np.nan,
    )


def errors(run: xr.Dataset, reference: xr.Dataset) -> dict[str, Error]:
    """Compare every channel at the instants of the run, which the reference must have too.

    Energies are compared with the scale of the energy balance, since a constant one has no peak.
    """
    every = np.searchsorted(reference["time"].to_numpy(), run["time"].to_numpy() - 1e-9)
    if not np.allclose(reference["time"].to_numpy()[every], run["time"].to_numpy(), atol=1e-9):
        message = "the reference has other instants than the run"
        raise ValueError(message)
    theirs, ours = channels(reference), channels(run)
    found = {}
    for name, values in theirs.items():
        unit = str(run[name].attrs.get("units", ""))
        scale = float(reference.attrs["energy_scale"]) if unit == "J" else None
        found[name] = error(ours[name], values[:, every], unit=unit, scale=scale)
    return found


def contact_late(run: xr.Dataset, reference: xr.Dataset) -> float:
    """Return the delay of the first touch of the object [s]; 0 if neither touches it."""
    ours, theirs = (float(np.nanmin(d["contact_time"])) if _touched(d) else np.nan
                    for d in (run, reference))  # fmt: skip
    return 0.0 if np.isnan(ours) and np.isnan(theirs) else ours - theirs


def _touched(dataset: xr.Dataset) -> bool:
    return "contact_time" in dataset and bool(np.isfinite(dataset["contact_time"]).any())
