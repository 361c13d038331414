"""Statistics of a campaign of movements: end forces, their scatter, and decisive sizes."""

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy.special import stdtrit

from turnout.core.saturating_force import saturates

# Time over which an end value is averaged [s].
END_WINDOW = 0.3
# Share of throws without an object that may be taken for one with: three standard deviations of a
# distribution that is known, more of one that is known from a few throws.
FALSE_ALARM_RATE = 0.00135
# The same rate in standard deviations of a distribution that is known.
KNOWN_SCATTER = 3.0


@dataclass(frozen=True, slots=True)
class RepeatScatter:
    """End force of a drive in throws without an object: mean and standard deviation [N], count."""

    drive: str
    mean: float
    deviation: float
    count: int

    @property
    def threshold(self) -> float:
        """Largest excess over the mean of one more throw without an object [N]; NaN if unknown."""
        if self.count < 2:
            return math.nan
        quantile = float(stdtrit(self.count - 1, 1 - FALSE_ALARM_RATE))
        return quantile * self.deviation * math.sqrt(1 + 1 / self.count)


@dataclass(frozen=True, slots=True)
class PlaceSizes:
    """Effects of objects at a place, as sizes [m]; NaN for effects that never occurred.

    Attributes
    ----------
    place : str
        Such as "sleeper 6".
    smallest, largest : float
        That were thrown on.
    detectable : float
        Smallest from which on every object's end force at some drive is larger, in the direction of
        the movement, than the scatter of throws without one explains.
    slipped : float
        Smallest that made a drive slip.
    undecided : float
        The smallest below those that are detectable from which on every end force lies beyond three
        standard deviations of the throws without an object, where these are too few to say that
        this is no chance; where none is detectable, the smallest at all.
    """

    place: str
    smallest: float
    largest: float
    detectable: float
    slipped: float
    undecided: float = math.nan


def object_places(dataset: xr.Dataset) -> list[str]:
    """Return the places of objects in a campaign, in the order of the dataset."""
    objects = dataset["place"].values[dataset["size"].values > 0]
    return list(dict.fromkeys(str(place) for place in objects))


def end_values(channel: xr.DataArray) -> np.ndarray:
    """Return the mean of each movement over its last 0.3 s; NaN if nothing was measured.

    Parameters
    ----------
    channel : xarray.DataArray
        Dimensions movement and time.

    Returns
    -------
    ndarray, shape (n_movements,)

    Examples
    --------
    >>> time = np.arange(5) * 0.1
    >>> values = [[0.0, 1.0, 1.0, 1.0, np.nan], [np.nan] * 5]
    >>> end_values(xr.DataArray(values, {"time": time}, ("movement", "time")))
    array([ 1., nan])
    """
    time = channel["time"].values
    ends = np.full(channel.sizes["movement"], np.nan)
    for number, row in enumerate(channel.transpose("movement", "time").values):
        known = np.flatnonzero(np.isfinite(row))
        if known.size:
            last = time[known[-1]]
            part = row[(time > last - END_WINDOW + 1e-9) & (time <= last)]
            ends[number] = np.nanmean(part)
    return ends


def repeat_scatter(dataset: xr.Dataset, *, direction: str) -> list[RepeatScatter]:
    """Return the scatter of the end force of each drive in throws without an object.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of a campaign.
    direction : str
        "closing" or "opening".

    Returns
    -------
    list of RepeatScatter
        The deviation is NaN for fewer than two throws.
    """
    going = dataset["direction"].values == direction
    free = np.flatnonzero(going & (dataset["size"].values == 0))
    found = []
    for drive in dataset["drive"].values if "drive_force" in dataset else []:
        ends = end_values(dataset["drive_force"].sel(drive=drive).isel(movement=free))
        ends = ends[np.isfinite(ends)]
        mean = float(ends.mean()) if ends.size else float("nan")
        deviation = float(ends.std(ddof=1)) if ends.size > 1 else float("nan")
        found.append(RepeatScatter(str(drive), mean, deviation, int(ends.size)))
    return found


def saturating_places(dataset: xr.Dataset, *, direction: str) -> list[str]:
    """Return the places at which the end force of a drive grows with the object, and then stays."""
    kept = dataset.isel(movement=np.flatnonzero(dataset["direction"].values == direction))
    if "drive_force" not in kept or not kept.sizes["movement"]:
        return []
    ends = np.stack([end_values(kept["drive_force"].sel(drive=name)) for name in kept["drive"]])
    known = np.nan_to_num(ends)
    found = []
    for place in object_places(kept):
        here = np.flatnonzero((kept["place"].values == place) & (kept["size"].values > 0))
        if saturates([(float(kept["size"][number]), known[:, number]) for number in here]):
            found.append(place)
    return found


def place_sizes(dataset: xr.Dataset, *, direction: str) -> list[PlaceSizes]:
    """Return at each place the least sizes that are detectable, and that make a drive slip.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of a campaign.
    direction : str
        "closing" or "opening".

    Returns
    -------
    list of PlaceSizes
        In the order of the dataset.
    """
    scatter = repeat_scatter(dataset, direction=direction)
    sign = 1.0 if direction == "closing" else -1.0
    outside = np.zeros(dataset.sizes["movement"], dtype=bool)
    beyond = np.zeros(dataset.sizes["movement"], dtype=bool)
    for drive in scatter:
        ends = end_values(dataset["drive_force"].sel(drive=drive.drive))
        # A comparison with an unknown threshold is false: no size is detectable then.
        outside |= sign * (ends - drive.mean) > drive.threshold
        # A single throw without an object says nothing of the scatter, so any difference is open.
        known = KNOWN_SCATTER * np.nan_to_num(drive.deviation)
        beyond |= sign * (ends - drive.mean) > known
    slipped = dataset["slipped"].values.astype(bool) if "slipped" in dataset.coords else None
    found = []
    for place in object_places(dataset):
        here = (dataset["place"].values == place) & (dataset["size"].values > 0)
        here &= dataset["direction"].values == direction
        if not here.any():
            continue
        size = dataset["size"].values[here]
        hidden = size[~outside[here]].max(initial=0.0)
        detectable = size[size > hidden].min(initial=np.inf)
        near = size[~beyond[here]].max(initial=0.0) if np.isfinite(detectable) else 0.0
        open_sizes = size[beyond[here] & (size > near) & (size < detectable)]
        slips = size[slipped[here]] if slipped is not None else size[:0]
        found.append(
            PlaceSizes(
                place,
                float(size.min()),
                float(size.max()),
                float(detectable) if np.isfinite(detectable) else float("nan"),
                float(slips.min()) if slips.size else float("nan"),
                float(open_sizes.min()) if open_sizes.size else float("nan"),
            )
        )
    return found
