"""Lock, control and slip as lamps: on or off over time, with the rule that says so in words."""

import json
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.metric.slip import TIME_TOLERANCE, movements

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """One state of a switch over time.

    Attributes
    ----------
    kind : str
        "lock", "control" or "slip".
    name : str
        What it belongs to: "switch", a sensor or "drive 1".
    on : ndarray of bool, shape (n_times,)
        Whether the state holds.
    wanted : bool
        Whether a switch at rest should have it.
    judged : ndarray of bool, shape (n_times,)
        When that may be asked: lock while nothing moves, control while the instrumented rail rests
        closed, slip always.
    words : (str, str)
        What it is called when on and when off.
    rule : str
        When it is on.
    """

    kind: str
    name: str
    on: Flags
    wanted: bool
    judged: Flags
    words: tuple[str, str]
    rule: str


def lamps(dataset: xr.Dataset) -> list[Lamp]:
    """Return the lamps of a run; those of channels that its dataset lacks are left out.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with `locked`, `in_control` and `drive_slipping`, or some of them.

    Returns
    -------
    list of Lamp
        Lock, then each sensor, then each drive.

    Examples
    --------
    >>> run = xr.Dataset({"locked": ("time", [True])}, {"time": [0.0]}, {"lock_rule": "no slip"})
    >>> lamps(run)[0].rule
    'no drive is at its saturation force, and no movement is under way'
    """
    found = []
    rest, closed = _resting(dataset)
    if "locked" in dataset:
        on = dataset["locked"].values.astype(bool)
        found.append(
            Lamp("lock", "switch", on, True, rest, ("locked", "not locked"), _lock(dataset))
        )
    if "in_control" in dataset:
        for name in dataset["sensor"].values:
            sensor = dataset["in_control"].sel(sensor=name)
            on = sensor.values.astype(bool)
            rule = f"its gap is below {1e3 * float(sensor['sensor_limit']):g} mm"
            words = ("in control", "not in control")
            found.append(Lamp("control", str(name), on, True, rest & closed, words, rule))
    if "drive_slipping" in dataset:
        machines = json.loads(dataset.attrs.get("machine_supplies", "{}"))
        for name in dataset["drive"].values:
            drive = dataset["drive_slipping"].sel(drive=name)
            on = drive.values.astype(bool)
            rule = f"its force has reached {float(drive['saturation_force']) / 1e3:.4g} kN"
            if str(name) in machines:
                rule = "its clutch slips, or it was switched off before its limit contact"
            always = np.ones_like(rest)
            words = ("slips" if str(name) not in machines else "slips or is off", "holds")
            found.append(Lamp("slip", f"drive {name}", on, False, always, words, rule))
    return found


def _resting(dataset: xr.Dataset) -> tuple[Flags, Flags]:
    """Flag the instants at rest, and those at which the instrumented rail should be closed."""
    time, spans = dataset["time"].values, movements(dataset)
    rest = np.ones(time.size, dtype=np.bool_)
    closed = np.full(time.size, not spans or spans[0].to != "closed")
    for span in spans:
        rest &= (time < span.start - TIME_TOLERANCE) | (time >= span.end - TIME_TOLERANCE)
        closed[time >= span.start - TIME_TOLERANCE] = span.to == "closed"
    return rest, closed


def _lock(dataset: xr.Dataset) -> str:
    """Say the lock rule of a run; numbers are those of its panel."""
    rest = "and no movement is under way"
    rule = dataset.attrs.get("lock_rule", "not stated")
    if rule == "no slip":
        return f"no drive is at its saturation force, {rest}"
    if rule in ("slip or gap", "raw gap"):
        gap = f"the gap at every drive is below {_limits(dataset)}, {rest}"
        return gap if rule == "raw gap" else f"no drive is at its saturation force, {gap}"
    return f"the rule is {rule}"


def _limits(dataset: xr.Dataset) -> str:
    """Say the gap limits of the drives: one, or each with its drive."""
    own: dict[str, float] = json.loads(dataset.attrs.get("lock_gap_limits", "{}"))
    limits = set(own.values()) or {float(dataset.attrs["lock_gap_limit"])}
    if len(limits) == 1:
        return f"{1e3 * limits.pop():g} mm"
    return " and ".join(f"{1e3 * limit:g} mm at drive {name}" for name, limit in own.items())
