"""The blade coloured by visibility at one size: from the map that `turnout limit` writes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import ResponseError

Floats = NDArray[np.float64]

BOTH = "both drives"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceSeen:
    """Visibility of an object of some size at a place.

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
    known_pod : float or None
        Probability of detection if only the place is known; None as for `pod`, or where it is not
        in the map, which has it for both drives together [-].
    """

    place: str
    x: float
    pod: float | None
    untouched: bool
    touch_floor: float
    a90: float | None
    known_a90: float | None
    known_pod: float | None = None


def blade_maps(
    dataset: xr.Dataset, sizes: Sequence[float] | Floats, *, channel: str = BOTH
) -> list[list[PlaceSeen]]:
    """Return the visibility of objects along the blade, from the toe on, for each of some sizes.

    Parameters
    ----------
    dataset : xarray.Dataset
        A file of `turnout limit -o`.
    sizes : sequence of float
        Of the object [m].
    channel : str
        One of `dataset["channel"]`.
    """
    if dataset.attrs.get("kind") != "limit":
        message = "is no map of `turnout limit`: run turnout limit -o limit.nc and take that file"
        raise ResponseError(message)
    channels = [str(name) for name in dataset["channel"].to_numpy()]
    if channel not in channels:
        message = f'channel "{channel}": this map has {", ".join(channels)}'
        raise ResponseError(message)
    at = dataset.sel(channel=channel)
    own = at["size"].to_numpy()
    names, x = [str(name) for name in at["place"].to_numpy()], at["x"].to_numpy()
    floor, a90 = at["touch_floor"].to_numpy(), at["a90"].to_numpy()
    largest = at["largest_size"].to_numpy() if "largest_size" in at else np.full(x.size, np.inf)
    nothing = np.full(len(names), np.nan)
    has_known = channel == BOTH and "known_pod" in at
    known = at["known_a90"].to_numpy() if has_known else nothing
    pods, known_pods = (
        _at_sizes(at[name].transpose("place", "size").to_numpy(), own, sizes, largest)
        if present
        else np.full((len(sizes), len(names)), np.nan)
        for name, present in (("pod", True), ("known_pod", has_known))
    )
    return [
        [
            PlaceSeen(
                place=names[number],
                x=float(x[number]),
                pod=_known(pods[row, number]),
                untouched=bool(size < floor[number]),
                touch_floor=float(floor[number]),
                a90=_known(a90[number]),
                known_a90=_known(known[number]),
                known_pod=_known(known_pods[row, number]),
            )
            for number in range(len(names))
        ]
        for row, size in enumerate(sizes)
    ]


def _at_sizes(pod: Floats, own: Floats, sizes: Sequence[float] | Floats, largest: Floats) -> Floats:
    """Return a probability at some sizes, shape (n_sizes, n_places); NaN above the thrown ones."""
    wanted = np.asarray(sizes, dtype=np.float64)
    found = np.array([np.interp(wanted, own, row) for row in pod]).T
    return np.where(wanted[:, np.newaxis] <= largest + ROUNDING, found, np.nan)


ROUNDING = 1e-9
"""Of sizes [m]."""


def _known(value: float) -> float | None:
    number = float(value)
    return number if np.isfinite(number) else None
