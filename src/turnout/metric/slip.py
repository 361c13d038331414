"""The movements of a dataset, when its drives slip in them, and how near they come to it."""

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

LEAST_SHARE = 0.1
TIME_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Span:
    """One movement: its name, target position ("open" or "closed"), onset and end [s]."""

    name: str
    to: str
    start: float
    end: float


@dataclass(frozen=True, slots=True)
class Slip:
    """A drive that reached its saturation force: which, when [s], in which movement."""

    drive: str
    time: float
    movement: Span | None


@dataclass(frozen=True, slots=True)
class Margin:
    """Margin of a drive below its slip level in movements of a direction: both forces [N]."""

    drive: str
    direction: str
    force: float
    limit: float

    @property
    def share(self) -> float:
        """Remaining force as a share of the slip level [-]."""
        return self.force / self.limit

    @property
    def largest(self) -> float:
        """The largest force in the direction of the movement [N]."""
        return self.limit - self.force

    @property
    def tight(self) -> bool:
        """True if less than a tenth of the saturation force is left."""
        return self.share < LEAST_SHARE


def movements(dataset: "xr.Dataset") -> tuple[Span, ...]:
    """Return the movements that a dataset names in its attributes, in the order of time."""
    return tuple(Span(**record) for record in json.loads(dataset.attrs.get("movements", "[]")))


def last_instant_at(dataset: "xr.Dataset", *, to: str) -> "xr.Dataset":
    """Return the last instant before the switch leaves a position for the last time.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with at least one instant.
    to : str
        "open" or "closed", of the instrumented rail.

    Returns
    -------
    xarray.Dataset
        Without "time": the instant before the onset of the movement that follows the last one to
        that position; the start where no movement goes there, the end where none follows.
    """
    spans = movements(dataset)
    going = [number for number, span in enumerate(spans) if span.to == to]
    after = (going[-1] if going else -1) + 1
    time = dataset["time"].values
    if after >= len(spans):
        return dataset.isel(time=-1)
    before = int((time < spans[after].start - TIME_TOLERANCE).sum())
    return dataset.isel(time=max(before - 1, 0))


def slips(dataset: "xr.Dataset") -> list[Slip]:
    """Return the first slip of each drive in each movement, in the order of time.

    A drive that has slipped and still rests at its saturation force when the next movement begins
    does not begin again.
    """
    spans = movements(dataset)
    bounds = [span.start for span in spans[1:]] + [float("inf")]
    periods = list(zip(spans, bounds, strict=True)) if spans else [(None, float("inf"))]
    time = dataset["time"].values
    flags = dataset["drive_slipping"].transpose("drive", "time").values.astype(bool)
    found = []
    for drive, flag in zip(dataset["drive"].values, flags, strict=True):
        onsets = time[flag & ~np.concatenate(([False], flag[:-1]))] if time.size else time
        for number, (span, until) in enumerate(periods):
            after = span.start if span is not None and number else -float("inf")
            within = onsets[(onsets >= after) & (onsets < until)]
            if within.size:
                found.append(Slip(str(drive), float(within[0]), span))
    return sorted(found, key=lambda slip: slip.time)


def margins(dataset: "xr.Dataset") -> list[Margin]:
    """Return the margin of each drive in each direction that it moved in."""
    limits = dataset["saturation_force"].values
    forces = dataset["force_margin"].transpose("drive", "direction").values
    return [
        Margin(str(drive), str(direction), float(force), float(limit))
        for drive, limit, row in zip(dataset["drive"].values, limits, forces, strict=True)
        for direction, force in zip(dataset["direction"].values, row, strict=True)
        if not math.isnan(force)
    ]
