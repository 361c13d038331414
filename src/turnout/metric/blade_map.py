"""The blade coloured by what can be seen at one size: from the map that `turnout limit` writes."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from turnout.errors import ResponseError

BOTH = "both drives"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceSeen:
    """What can be seen at a place of an object of some size.

    Attributes
    ----------
    place : str
        "sleeper 6", "drive 1".
    x : float
        From the toe [m].
    pod : float or None
        Probability of detection; None where so large an object was not thrown [-].
    untouched : bool
        Whether the size lies below the touch floor, where nothing can be seen: to be hatched.
    touch_floor : float
        [m]
    a90, known_a90 : float or None
        Size that nine of ten times is seen, and the same if only the place is known; None beyond
        what was thrown, or where it is not in the map [m].
    """

    place: str
    x: float
    pod: float | None
    untouched: bool
    touch_floor: float
    a90: float | None
    known_a90: float | None


def blade_map(dataset: xr.Dataset, size: float, *, channel: str = BOTH) -> list[PlaceSeen]:
    """Return what can be seen along the blade of objects of one size, from the toe on.

    Parameters
    ----------
    dataset : xarray.Dataset
        A file of `turnout limit -o`, read by `turnout.open_response`; its `kind` is "limit".
    size : float
        Of the object [m].
    channel : str
        One of `dataset["channel"]`.

    Raises
    ------
    ResponseError
        For another dataset, or a channel that it does not have.
    """
    if dataset.attrs.get("kind") != "limit":
        message = "is no map of `turnout limit`: run turnout limit -o limit.nc and take that file"
        raise ResponseError(message)
    channels = [str(name) for name in dataset["channel"].to_numpy()]
    if channel not in channels:
        message = f'channel "{channel}": this map has {", ".join(channels)}'
        raise ResponseError(message)
    at = dataset.sel(channel=channel)
    pod = [
        np.interp(size, at["size"].to_numpy(), row) if size <= largest + ROUNDING else np.nan
        for row, largest in zip(at["pod"].to_numpy(), at["largest_size"].to_numpy(), strict=True)
    ]
    known = at["known_a90"].to_numpy() if "known_a90" in at else np.full(len(pod), np.nan)
    return [
        PlaceSeen(
            place=str(at["place"][number].item()),
            x=float(at["x"][number]),
            pod=_known(pod[number]),
            untouched=bool(size < float(at["touch_floor"][number])),
            touch_floor=float(at["touch_floor"][number]),
            a90=_known(at["a90"][number]),
            known_a90=_known(known[number]),
        )
        for number in range(len(pod))
    ]


ROUNDING = 1e-9
"""Of sizes [m]."""


def _known(value: float | xr.DataArray) -> float | None:
    number = float(value)
    return number if np.isfinite(number) else None
