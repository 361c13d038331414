"""The single numbers that a run is compared by."""

from collections.abc import Sequence
from dataclasses import dataclass

import xarray as xr

from turnout.metric.channel_features import final_value
from turnout.throw.checks import OF_WHEELS, Check, checks, direction_of, margins


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """A number that sums up a throw.

    Attributes
    ----------
    key : str
        Short and stable, such as "end_force:1".
    label : str
        Text beside the number, such as "end force, drive 1".
    value : float
        In SI; NaN for none.
    unit : str
        SI unit of the value; empty for shares and states.
    """

    key: str
    label: str
    value: float
    unit: str


def key_figures(dataset: xr.Dataset, made: Sequence[Check] | None = None) -> list[KeyFigure]:
    """Return the numbers of a run: forces and gaps at the end, margins, object, room for wheels.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with at least one instant; channels that it lacks are left out.
    made : sequence of Check, optional
        Its checks, where they are known already.

    Returns
    -------
    list of KeyFigure
        Exactly as the dataset has them.

    Examples
    --------
    >>> run = xr.Dataset({"object_force": ("time", [0.0, 3.0, 2.0])})
    >>> [(item.key, item.value) for item in key_figures(run)]
    [('object_end', 2.0), ('object_peak', 3.0)]
    """
    found = []
    for name in dataset["drive"].values if "drive" in dataset.coords else []:
        if "drive_force" in dataset:
            force = float(final_value(dataset["drive_force"].sel(drive=name)))
            found.append(KeyFigure(f"end_force:{name}", f"Drive {name}, end force", force, "N"))
        if "end_gap" in dataset:
            gap = float(dataset["end_gap"].sel(drive=name))
            found.append(KeyFigure(f"end_gap:{name}", f"Drive {name}, raw end gap", gap, "m"))
    for check in margins(checks(dataset) if made is None else made):
        direction = direction_of(check.movement)
        label = f"Drive {check.drive}, margin to slip {direction}".rstrip()
        found.append(KeyFigure(f"margin:{check.drive}:{direction}", label, check.margin, "N"))
    if "sensor_gap" in dataset:
        for name in dataset["sensor"].values:
            gap = float(final_value(dataset["sensor_gap"].sel(sensor=name)))
            found.append(KeyFigure(f"sensor_gap:{name}", f"{name}, end gap", gap, "m"))
    return found + _of_object(dataset) + _of_wheels(dataset)


def _of_object(dataset: xr.Dataset) -> list[KeyFigure]:
    if "object_force" not in dataset or dataset.attrs.get("foreign_objects", "") == "[]":
        return []
    force, note = dataset["object_force"], peak_note(dataset)
    found = [
        KeyFigure("object_end", "Object, end force", float(final_value(force)), "N"),
        KeyFigure("object_peak", f"Object, largest force{note}", float(force.max()), "N"),
    ]
    if "contact_time" in dataset:
        when = float(dataset["contact_time"])
        found.append(KeyFigure("contact_time", "Object, first contact", when, "s"))
    return found


def peak_note(dataset: xr.Dataset) -> str:
    """Return by how much the largest force on an object may be off, in brackets after a space.

    Empty where none was struck, and for datasets from before it was stated.

    Examples
    --------
    >>> peak_note(xr.Dataset(attrs={"object_peak_note": "the peak of a blow is off by up to 4 %"}))
    ' (the peak of a blow is off by up to 4 %)'
    """
    note = dataset.attrs.get("object_peak_note", "")
    return f" ({note})" if note else ""


def _of_wheels(dataset: xr.Dataset) -> list[KeyFigure]:
    return [
        KeyFigure(name, f"Least {name}", float(dataset[f"least_{name}"]), "m")
        for name in OF_WHEELS
        if f"least_{name}" in dataset
    ]
