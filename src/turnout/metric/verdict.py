"""The verdict on a throw: one kind and one plain sentence, the same on every face."""

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from turnout.metric.signal import at_end
from turnout.metric.slip import Slip, movements, slips
from turnout.metric.summary import kilo, milli

if TYPE_CHECKING:
    import xarray as xr

Kind = Literal[
    "undetected object",
    "detected by lock",
    "detected by TKK",
    "detected by slip",
    "not locked",
    "sound",
    "not judged",
]
KINDS: tuple[str, ...] = get_args(Kind)
"""Every kind of verdict."""

# Without one of these a run cannot be judged.
_NEEDED = ("locked", "in_control", "drive_slipping")
_NEEDED_WORDS = {"locked": "lock", "in_control": "control (TKK)", "drive_slipping": "slip"}


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a throw means.

    Attributes
    ----------
    kind : str
        "undetected object": an object is trapped, and lock, control and drives accept the
        movement. "detected by slip", "detected by lock", "detected by TKK": an object is trapped,
        and a drive slips in the last movement, the lock is refused, or a sensor reports a gap; the
        first of these that holds, the sentence names the others. "not locked": no object, and the
        switch fails a check of its own. "sound": no object, and every check is passed.
        "not judged": the dataset lacks what the verdict rests on.
    text : str
        One plain sentence with its numbers.
    """

    kind: Kind
    text: str

    @property
    def missed(self) -> bool:
        """Whether an object is trapped and nothing reports it."""
        return self.kind == "undetected object"


def verdict(dataset: "xr.Dataset") -> Verdict:
    """Judge a throw by what lock, control and drives report.

    Parameters
    ----------
    dataset : xarray.Dataset
        A simulated run. Measurements, campaigns, runs that ended early and runs of which lock,
        control or slip was not kept come back as "not judged", with the reason.

    Returns
    -------
    Verdict
        States are those at the end of the run and, without an object, at the end of every movement.

    Examples
    --------
    >>> import xarray as xr
    >>> verdict(xr.Dataset(attrs={"kind": "measurement"})).kind
    'not judged'
    """
    lacking = _lacking(dataset)
    if lacking:
        return Verdict("not judged", f"Not judged: {lacking}.")
    trapped = _trapped(dataset)
    return _with_object(dataset, trapped) if trapped else _without_object(dataset)


def _lacking(dataset: "xr.Dataset") -> str:
    """Say why a dataset cannot be judged; empty where it can."""
    if "movement" in dataset.dims:
        return "a campaign of many movements has no single verdict; select one movement"
    if dataset.attrs.get("kind", "simulation") != "simulation":
        return (
            "a recording has no lock or control contact, and nobody knows whether an object was "
            "trapped" + _measured_slip(dataset)
        )
    if not dataset.sizes.get("time", 0):
        return "the run ended before its first instant"
    if not dataset.attrs.get("complete", True):
        return f"the run is not complete ({dataset.attrs.get('outcome_message', 'ended early')})"
    absent = [_NEEDED_WORDS[name] for name in _NEEDED if _absent(dataset, name)]
    if absent:
        return f"the dataset has no {' and no '.join(absent)}; keep the channels they need"
    return ""


def _absent(dataset: "xr.Dataset", name: str) -> bool:
    """Whether a channel was not kept; a panel without sensors has no control to keep."""
    if name == "in_control" and "locked" in dataset:
        return "sensor_gap" in dataset and name not in dataset
    return name not in dataset


def _measured_slip(dataset: "xr.Dataset") -> str:
    """Say what a recording shows of slip: its largest force, where forces were measured."""
    if "drive_force" not in dataset:
        return ""
    found = []
    for name in dataset["drive"].values:
        largest = float(abs(dataset["drive_force"].sel(drive=name)).max())
        if not math.isnan(largest):
            found.append(f"{kilo(largest)} at Drive {name}")
    return f"; the largest forces are {', '.join(found)}" if found else ""


def _trapped(dataset: "xr.Dataset") -> list[dict[str, Any]]:
    """Return the objects that are in the switch at the end of the run."""
    if "object_placed" in dataset and not bool(dataset["object_placed"]):
        return []
    items: list[dict[str, Any]] = json.loads(dataset.attrs.get("foreign_objects", "[]"))
    end = float(dataset["time"][-1])
    return [item for item in items if item.get("disappears") is None or item["disappears"] > end]


def _with_object(dataset: "xr.Dataset", trapped: list[dict[str, Any]]) -> Verdict:
    what = " and ".join(f"{1e3 * item['size']:g} mm at {item['place']}" for item in trapped)
    signs = _signs(dataset)
    if not signs:
        return Verdict(
            "undetected object",
            f"Undetected object: {what} stays in the switch, which {_accepted(dataset)}.",
        )
    kind = signs[0][0]
    reasons = "; ".join(text for _, text in signs)
    return Verdict(kind, f"D{kind[1:]}: {what}; {reasons}.")


def _signs(dataset: "xr.Dataset") -> list[tuple[Kind, str]]:
    """Return what reports a trapped object, in the order of the kinds."""
    signs: list[tuple[Kind, str]] = []
    slipped = _last_slips(dataset)
    if slipped:
        signs.append(("detected by slip", "; ".join(_slip(dataset, slip) for slip in slipped)))
    if not bool(at_end(dataset["locked"])):
        wide = _wide_gaps(dataset)
        if wide:
            signs.append(("detected by lock", f"the lock is refused: {wide}"))
        elif not slipped:
            signs.append(("detected by lock", "the lock is refused"))
    out = _out_of_control(dataset)
    if out:
        signs.append(("detected by TKK", out))
    return signs


def _without_object(dataset: "xr.Dataset") -> Verdict:
    faults = [_slip(dataset, slip) for slip in slips(dataset)]
    faults += [
        f"the lock is refused after the movement to {to}{': ' + wide if wide else ''}"
        for to, wide in _refusals(dataset)
    ]
    out = _out_of_control(dataset)
    if out:
        faults.append(out)
    if faults:
        return Verdict("not locked", f"Not locked: no object, but {'; '.join(faults)}.")
    return Verdict("sound", f"Sound: no object, and the switch {_accepted(dataset)}.")


def _refusals(dataset: "xr.Dataset") -> list[tuple[str, str]]:
    """Return each position in which the switch rested unlocked, with the gaps that are too wide."""
    time, spans = dataset["time"].values, movements(dataset)
    locked = dataset["locked"].values.astype(bool)
    if not spans:
        return [] if locked[-1] else [("the end", _wide_gaps(dataset))]
    found = []
    for number, span in enumerate(spans):
        until = spans[number + 1].start if number + 1 < len(spans) else math.inf
        last = int((time < until - 1e-9).sum()) - 1
        if last >= 0 and time[last] >= span.end - 1e-9 and not locked[last]:
            found.append((span.to, _wide_gaps(dataset.isel(time=[last]))))
    return found


def _last_slips(dataset: "xr.Dataset") -> list[Slip]:
    """Return where drives slip in the last movement."""
    spans = movements(dataset)
    found = slips(dataset)
    return [slip for slip in found if slip.movement == spans[-1]] if spans else found


def _slip(dataset: "xr.Dataset", slip: Slip) -> str:
    limit = float(dataset["saturation_force"].sel(drive=slip.drive))
    where = "" if slip.movement is None else f", {_direction(slip.movement.to)}"
    return f"Drive {slip.drive} slips at {kilo(limit)}{where}"


def _direction(to: str) -> str:
    return "closing" if to == "closed" else "opening"


def _gap_limit(dataset: "xr.Dataset", drive: str) -> float:
    limits = json.loads(dataset.attrs.get("lock_gap_limits", "{}"))
    return float(limits.get(drive, dataset.attrs.get("lock_gap_limit", math.nan)))


def _gaps(dataset: "xr.Dataset") -> list[tuple[str, float, float]]:
    """Return drive, gap and limit at the end [m], where the lock rule looks at gaps."""
    if "drive_gap" not in dataset or dataset.attrs.get("lock_rule") == "no slip":
        return []
    gaps = at_end(dataset["drive_gap"])
    found = []
    for drive in dataset["drive"].values:
        gap, limit = float(gaps.sel(drive=drive)), _gap_limit(dataset, str(drive))
        if not math.isnan(gap + limit):
            found.append((str(drive), gap, limit))
    return found


def _wide_gaps(dataset: "xr.Dataset") -> str:
    """Name the gaps at drives that are at or above their limits; empty where there are none."""
    return " and ".join(
        f"{milli(gap)} at Drive {drive}, limit {1e3 * limit:g} mm"
        for drive, gap, limit in _gaps(dataset)
        if gap >= limit
    )


def _out_of_control(dataset: "xr.Dataset") -> str:
    """Name the sensors that report a gap at the end; empty where none does."""
    if "in_control" not in dataset:
        return ""
    inside = at_end(dataset["in_control"])
    out = [str(name) for name in dataset["sensor"].values if not bool(inside.sel(sensor=name))]
    if not out or not _closed_at_end(dataset):
        return ""
    return f"out of control: {' and '.join(_sensor(dataset, name) for name in out)}"


def _closed_at_end(dataset: "xr.Dataset") -> bool:
    """Whether the instrumented rail, which carries the sensors, should be closed at the end."""
    spans = movements(dataset)
    return not spans or spans[-1].to == "closed"


def _sensor(dataset: "xr.Dataset", name: str) -> str:
    limit = 1e3 * float(dataset["sensor_limit"].sel(sensor=name))
    if "sensor_gap" not in dataset:
        return f"{name}, limit {limit:g} mm"
    gap = milli(at_end(dataset["sensor_gap"]).sel(sensor=name))
    return f"{name} {gap}, limit {limit:g} mm"


def _accepted(dataset: "xr.Dataset") -> str:
    """Say what accepts a movement, with the numbers that come nearest to their limits."""
    parts = []
    gaps = _gaps(dataset)
    if gaps:
        drive, gap, limit = max(gaps, key=lambda row: row[1] / row[2])
        parts.append(f"{1e3 * gap:.2f} of {1e3 * limit:g} mm open at Drive {drive}")
    forces = abs(at_end(dataset["drive_force"])) if "drive_force" in dataset else None
    if forces is not None:
        drive = _largest(forces / dataset["saturation_force"], "drive")
        level = dataset["saturation_force"].sel(drive=drive)
        parts.append(f"Drive {drive} holds {kilo(forces.sel(drive=drive))} of {kilo(level)}")
    words = f"locks ({', '.join(parts)})" if parts else "locks"
    if "in_control" not in dataset or not _closed_at_end(dataset):
        return words
    if "sensor_gap" not in dataset:
        return f"{words} and is in control"
    nearest = _largest(at_end(dataset["sensor_gap"]) / dataset["sensor_limit"], "sensor")
    return f"{words} and is in control ({_sensor(dataset, nearest)})"


def _largest(values: "xr.DataArray", dimension: str) -> str:
    """Return the member of a dimension at which values are largest."""
    return str(values[dimension].values[int(np.argmax(values.values))])
