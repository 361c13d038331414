"""The movements of a dataset, and when its drives slip in them."""

import json
from dataclasses import dataclass

import xarray as xr

from turnout.metric.signal import first_time


@dataclass(frozen=True, slots=True)
class Span:
    """One movement: its name, where it goes ("open" or "closed"), onset and end [s]."""

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


def movements(dataset: xr.Dataset) -> tuple[Span, ...]:
    """Return the movements that a dataset names in its attributes, in the order of time."""
    return tuple(Span(**record) for record in json.loads(dataset.attrs.get("movements", "[]")))


def slips(dataset: xr.Dataset) -> list[Slip]:
    """Return where each drive begins to slip first in each movement, in the order of time.

    A drive that has slipped and still rests at its saturation force when the next movement begins
    does not begin anew.
    """
    spans = movements(dataset)
    bounds = [span.start for span in spans[1:]] + [float("inf")]
    found = []
    for drive in dataset["drive"].values:
        flag = dataset["drive_slipping"].sel(drive=drive)
        onset = flag & ~flag.shift(time=1, fill_value=False)
        periods = list(zip(spans, bounds, strict=True)) if spans else [(None, float("inf"))]
        for number, (span, until) in enumerate(periods):
            after = span.start if span is not None and number else -float("inf")
            when = float(first_time(onset, after=after))
            if when < until:
                found.append(Slip(str(drive), when, span))
    return sorted(found, key=lambda slip: slip.time)
