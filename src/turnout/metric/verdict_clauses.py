"""Reports of lock, control, drives and flangeway on a movement, in the words of the verdict."""

import json
import math
from typing import TYPE_CHECKING

import numpy as np

from turnout.metric.channel_features import final_value
from turnout.metric.slip import TIME_TOLERANCE, Slip, Span
from turnout.metric.summary import format_force, format_length

if TYPE_CHECKING:
    import xarray as xr


def narrow_flangeway(dataset: "xr.Dataset") -> list[str]:
    """Name a flangeway below the limit of the panel; empty if all are wide enough."""
    limit = float(dataset.attrs.get("flangeway_limit", math.nan))
    if "least_flangeway" not in dataset or not float(dataset["least_flangeway"]) < limit:
        return []
    where = ""
    if "least_flangeway_x" in dataset and "least_flangeway_rail" in dataset:
        rail, x = dataset["least_flangeway_rail"].values, float(dataset["least_flangeway_x"])
        where = f" of rail {rail!s} at x = {x:g} m"
    return [
        f"the flangeway{where} is {format_length(dataset['least_flangeway'])}, "
        f"limit {1e3 * limit:g} mm"
    ]


def slip_words(dataset: "xr.Dataset", slip: Slip) -> str:
    """Name a drive that slips, its slip level and time, or its switch-off."""
    if slip.stopped and slip.movement is not None:
        what = f"{slip.stopped}, {_direction(slip.movement.to)}"
        return f"Drive {slip.drive} {what}, at t = {slip.time:.2f} s"
    text = f"Drive {slip.drive} slips"
    level = ""
    if "saturation_force" in dataset.coords:
        level = f"at {format_force(dataset['saturation_force'].sel(drive=slip.drive))}"
    if slip.movement is None:
        return f"{text} {level}".rstrip()
    if slip.time < slip.movement.start - TIME_TOLERANCE:
        return f"{text} at rest{', ' if level else ''}{level}, before the first movement"
    return f"{text} {level}".rstrip() + f", {_direction(slip.movement.to)}"


def _direction(to: str) -> str:
    return "closing" if to == "closed" else "opening"


def _gap_limit(dataset: "xr.Dataset", drive: str) -> float:
    limits = json.loads(dataset.attrs.get("lock_gap_limits", "{}"))
    return float(limits.get(drive, dataset.attrs.get("lock_gap_limit", math.nan)))


def _gaps(dataset: "xr.Dataset") -> list[tuple[str, float, float]]:
    """Return drive, gap and limit at the end [m], if the lock rule looks at gaps."""
    if "drive_gap" not in dataset or dataset.attrs.get("lock_rule") == "no slip":
        return []
    gaps = final_value(dataset["drive_gap"]).values
    found = []
    for name, gap in zip(dataset["drive"].values, gaps.tolist(), strict=True):
        limit = _gap_limit(dataset, str(name))
        if not math.isnan(gap + limit):
            found.append((str(name), gap, limit))
    return found


def sizes_left(dataset: "xr.Dataset", count: int) -> list[float]:
    """Return the remaining size of each object [m]; NaN if it was not kept."""
    if "object_left" not in dataset or dataset["object_left"].size != count:
        return [math.nan] * count
    return [float(size) for size in dataset["object_left"].values]


def nothing_left(dataset: "xr.Dataset", count: int) -> list[str]:
    """Return the fate of each object of which nothing is left; empty for the others.

    In a throw of a sequence it may have been gone before: its size at the start is 0 then.
    """
    left = sizes_left(dataset, count)
    before = np.full(count, math.inf)
    if "object_size" in dataset and dataset["object_size"].size == count:
        before = dataset["object_size"].values
    return [
        "" if not size <= 0.0 else "broke and left nothing" if start > 0.0 else "was gone before"
        for size, start in zip(left, before, strict=True)
    ]


def wide_gaps(dataset: "xr.Dataset") -> str:
    """Name the gaps at drives that are at or above their limits; empty if all are below."""
    return " and ".join(
        f"{format_length(gap)} at Drive {drive}, limit {1e3 * limit:g} mm"
        for drive, gap, limit in _gaps(dataset)
        if gap >= limit
    )


def out_of_control(dataset: "xr.Dataset", span: Span | None) -> str:
    """Name the sensors that report a gap after a movement; empty if none does.

    They are on the instrumented rail, which closes in movements to "closed" alone.
    """
    if "in_control" not in dataset or (span is not None and span.to != "closed"):
        return ""
    inside = final_value(dataset["in_control"])
    out = [str(name) for name in dataset["sensor"].values if not bool(inside.sel(sensor=name))]
    if not out:
        return ""
    return f"out of control: {' and '.join(_sensor(dataset, name) for name in out)}"


def _sensor(dataset: "xr.Dataset", name: str) -> str:
    limit = 1e3 * float(dataset["sensor_limit"].sel(sensor=name))
    if "sensor_gap" not in dataset:
        return f"{name}, limit {limit:g} mm"
    gap = format_length(final_value(dataset["sensor_gap"]).sel(sensor=name))
    return f"{name} {gap}, limit {limit:g} mm"


def accepted_by(dataset: "xr.Dataset", span: Span | None) -> str:
    """Return the values nearest to their limits that accept a movement at its rest."""
    parts = []
    gaps = _gaps(dataset)
    if gaps:
        drive, gap, limit = max(gaps, key=lambda row: row[1] / row[2])
        parts.append(f"{1e3 * gap:.2f} of {1e3 * limit:g} mm open at Drive {drive}")
    if "drive_force" in dataset:
        forces = np.abs(final_value(dataset["drive_force"]).values)
        levels = dataset["saturation_force"].values
        most = int(np.argmax(forces / levels))
        parts.append(
            f"Drive {dataset['drive'].values[most]} holds {format_force(forces[most])} "
            f"of {format_force(levels[most])}"
        )
    words = f"locks ({', '.join(parts)})" if parts else "locks"
    if "in_control" not in dataset or (span is not None and span.to != "closed"):
        return words
    if "sensor_gap" not in dataset:
        return f"{words} and is in control"
    open_share = final_value(dataset["sensor_gap"]).values / dataset["sensor_limit"].values
    nearest = str(dataset["sensor"].values[int(np.argmax(open_share))])
    return f"{words} and is in control ({_sensor(dataset, nearest)})"
