"""Summary lines of a run in kilonewtons and millimetres, with its energy residual.

Residual and numerical dissipation are shares of the run's energy scale.
"""

import json
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from turnout.metric.channel_features import final_value
from turnout.metric.key_figure import peak_note
from turnout.throw.checks import (
    SWITCHED_OFF,
    Check,
    checks,
    direction_of,
    format_force,
    format_gap,
    format_length,
    margins,
    wheel_rooms,
)
from turnout.throw.slip import machine_throws, movements, unfinished

if TYPE_CHECKING:
    import xarray as xr


def format_required(least: float, required: float) -> str:
    """Return the requirement on a distance, and a remark if the least one [m] is too narrow.

    Examples
    --------
    >>> format_required(0.0565, 0.058)
    'TOO NARROW: at least 58 mm required'
    """
    requirement = f"at least {1e3 * required:g} mm required"
    return f"TOO NARROW: {requirement}" if least < required else requirement


def format_overrides(changes: Mapping[str, object]) -> str:
    """Return the changes of a panel as text; calibrated numbers with five digits.

    Examples
    --------
    >>> format_overrides({"chair.friction_coefficient": 0.27001253, "lock.gap_limit": 0.004})
    'chair.friction_coefficient = 0.27001, lock.gap_limit = 0.004'
    """

    def text(value: object) -> str:
        return f"{float(f'{value:.5g}'):.12g}" if isinstance(value, float) else str(value)

    return ", ".join(f"{key} = {text(value)}" for key, value in changes.items())


LARGEST_NUMERICAL_SHARE = 0.02
"""Share of the energy scale that a scheme may lose or make before a reader should know [-]."""

# Where less than this has moved, shares of the scale would be rounding over rounding [J].
LEAST_SCALE = 1e-3


def ends_inaccurate(dataset: "xr.Dataset") -> bool:
    """Return True if a run came to its end with an energy balance that does not close.

    Examples
    --------
    >>> import xarray as xr
    >>> ends_inaccurate(xr.Dataset(attrs={"complete": False, "outcome": "inaccurate"}))
    True
    """
    return str(dataset.attrs.get("outcome", "")) == "inaccurate"


def residual_share(dataset: "xr.Dataset") -> float:
    """Return the largest energy residual over the run's energy scale, at least 1 mJ [-]."""
    return _share(dataset, "energy_residual")


def numerical_share(dataset: "xr.Dataset") -> float:
    """Return the largest numerical loss over the run's energy scale, at least 1 mJ [-]."""
    return _share(dataset, "energy_numerical")


def numerical_warning(dataset: "xr.Dataset") -> str | None:
    """Return a warning with its remedy if numerical dissipation is too large, else None.

    Where less than `LEAST_SCALE` has moved there is nothing to say.
    """
    share = numerical_share(dataset)
    if share <= LARGEST_NUMERICAL_SHARE or float(dataset.attrs["energy_scale"]) <= LEAST_SCALE:
        return None
    values = dataset["energy_numerical"].to_numpy()
    lost = "lost" if values[np.abs(values).argmax()] > 0 else "MADE"
    return (
        f"the time stepping itself {lost} {100 * share:.3g} % of the energy, more than "
        f"{100 * LARGEST_NUMERICAL_SHARE:g} %; take a smaller step, or a spectral radius below 1 "
        "if it is 1"
    )


def _share(dataset: "xr.Dataset", name: str) -> float:
    scale = max(float(dataset.attrs["energy_scale"]), LEAST_SCALE)
    return float(abs(dataset[name]).max()) / scale


def summary(dataset: "xr.Dataset", found: Sequence[Check] | None = None) -> list[tuple[str, str]]:
    """Return heading and text of each line that a reader should see after a run.

    Parameters
    ----------
    dataset : xarray.Dataset
        A simulated run, complete or partial; what its dataset has not kept is left out.
    found : sequence of Check, optional
        Its checks, where they are known already.

    Returns
    -------
    list of (str, str)
        The heading is empty where a line continues the one before.
    """
    lines = [("panel", _panel(dataset)), *[("object", text) for text in _objects(dataset)]]
    lines.append(("run", _run(dataset)))
    if dataset.sizes.get("time", 0) == 0:
        return lines
    lines += [("start", text) for text in _start(dataset)]
    found = checks(dataset) if found is None else found
    lines += _state(dataset, found)
    lines += _drives(dataset, found)
    lines += [("slip", text) for text in _slips(dataset, found)]
    lines += [(f"least {kind}", text) for kind, text in wheel_texts(dataset).items()]
    lines += _energy(dataset)
    lines.append(("scheme", str(dataset.attrs.get("scheme", "not stated"))))
    return _blank_repeated_headings(lines)


def _blank_repeated_headings(lines: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """Blank headings that repeat the one before."""
    before = ""
    cleaned = []
    for heading, text in lines:
        cleaned.append(("" if heading == before else heading, text))
        before = heading
    return cleaned


def _panel(dataset: "xr.Dataset") -> str:
    changes = json.loads(dataset.attrs.get("overrides", "{}"))
    text = str(dataset.attrs.get("panel", "?"))
    if changes:
        text += f" with {format_overrides(changes)}"
    return text


def _objects(dataset: "xr.Dataset") -> list[str]:
    items: list[dict[str, Any]] = json.loads(dataset.attrs.get("foreign_objects", "[]"))
    if not items:
        return ["none"]
    placed = [
        f"{item['size'] * 1e3:g} mm{_kind(item)} at {item['place']} (x = {item['x']:g} m), "
        f"rail {item['rail']}"
        for item in items
    ]
    if "object_touched" not in dataset or not dataset.sizes.get("time", 0):
        return placed
    if "object_placed" in dataset and not dataset["object_placed"]:
        placed.append("NOT PLACED: it does not fit into the gap at any time after it appears")
    if not dataset["object_touched"]:
        return [*placed, "never touched"]
    text = f"first touched at t = {float(dataset['contact_time']):.3f} s"
    if "object_force" in dataset:
        peak = float(dataset["object_force"].max())
        end = final_value(dataset["object_force"])
        text += f"; force {format_force(end)} at the end, {format_force(peak)} at most"
        text += peak_note(dataset)
    return [*placed, text, *_fates(dataset)]


def _kind(item: dict[str, Any]) -> str:
    """Return the kind of an object and its length, empty for a spring."""
    if "kind" not in item:
        return ""
    length = item.get("length", 0.0)
    along = f", {length:g} m long," if length > 2.0 * item["size"] else ""
    return f" {item['kind']}{along}"


def _fates(dataset: "xr.Dataset") -> list[str]:
    """Return the state at the end of objects that dent or break."""
    if "object_left" not in dataset:
        return []
    found = []
    for number in range(dataset.sizes["object"]):
        left = float(dataset["object_left"][number])
        broken = int(dataset["object_broken"][number])
        if not math.isnan(left):
            times = "once" if broken == 1 else f"{broken} times"
            text = f"broke {times}, " if broken else ""
            found.append(f"{text}{1e3 * left:.1f} mm left")
    return found


def _run(dataset: "xr.Dataset") -> str:
    if fault := ending_fault(dataset):
        return fault
    attributes, end = dataset.attrs, float(dataset["time"][-1])
    text = f"complete, {end:g} s of motion in {attributes.get('wall_time', math.nan):.2f} s"
    waited = sum(json.loads(attributes.get("schedule_waits", "[]")))
    return f"{text}; the schedule waited {waited:.2f} s for machines" if waited else text


def ending_fault(dataset: "xr.Dataset") -> str:
    """Return the fault by which a run is not complete or inaccurate; empty if there is none.

    Examples
    --------
    >>> import xarray as xr
    >>> ending_fault(xr.Dataset(attrs={"complete": False, "outcome_message": "no step"}))
    'NOT COMPLETE: no step'
    """
    if dataset.attrs.get("complete", True):
        return ""
    what = "INACCURATE" if ends_inaccurate(dataset) else "NOT COMPLETE"
    return f"{what}: {dataset.attrs.get('outcome_message', 'ended early')}"


def start_difference(dataset: "xr.Dataset") -> dict[str, float]:
    """Return by how much the force of each drive starts above that at the end of a run [N].

    It says how far a loaded start is from what a whole cycle leaves. Empty for any other start, and
    where the end is that of no such cycle: with objects or machines, or without a return.

    Examples
    --------
    >>> import xarray as xr
    >>> start_difference(xr.Dataset(attrs={"movements": "[]"}))
    {}
    """
    attributes = dataset.attrs
    whole = attributes.get("complete", True) and "machine_throws" not in attributes
    sound = attributes.get("foreign_objects", "[]") == "[]"
    # each movement goes to the other position, and a loaded start follows one at least
    returns = len(json.loads(attributes.get("movements", "[]"))) % 2 == 0
    loaded = "loaded_by" in attributes and "drive_force" in dataset
    if not (loaded and whole and sound and returns):
        return {}
    force = dataset["drive_force"].transpose("drive", "time").values
    names = map(str, dataset["drive"].values)
    return dict(zip(names, (force[:, 0] - force[:, -1]).tolist(), strict=True))


def _start(dataset: "xr.Dataset") -> list[str]:
    """Return the motion that a loaded start follows, and how far it is from a whole cycle."""
    by = dataset.attrs.get("loaded_by")
    if by is None:
        return []
    text = f"loaded by {'the last return' if by == 'return' else 'cycles that repeat'}; "
    found = start_difference(dataset)
    if not found:
        return [f"{text}distance from the end of a cycle not judged"]
    newtons = {name: round(value) for name, value in found.items()}
    off = ", ".join(f"drive {name} {f'{n:+d}' if n else 0} N" for name, n in newtons.items())
    return [f"{text}{off} from the end of this cycle"]


def _state(dataset: "xr.Dataset", found: Sequence[Check]) -> list[tuple[str, str]]:
    """Return lock and sensors at the rest after each movement, those that are not met first."""
    several, late = len(movements(dataset)) > 1, unfinished(dataset)
    rule = f" by the rule '{dataset.attrs.get('lock_rule', 'not stated')}'"
    lines: dict[tuple[str, str], list[str]] = {}
    for check in sorted(found, key=lambda check: (check.kind != "lock", bool(check.met))):
        if check.kind not in ("lock", "control"):
            continue
        sensor = check.name if check.kind == "control" else ""
        texts = lines.setdefault(("in control" if sensor else "locked", sensor), [])
        answer = {True: "yes", False: "NO", None: "NOT JUDGED"}[check.met]
        when = f" after {direction_of(check.movement)}" if several and check.movement else ""
        text = f"{answer}{when or ('' if sensor else ' at the end')}"
        text += rule if not sensor and not texts else ""
        why = late.get(check.movement, check.said) if check.movement else check.said
        why = why.removeprefix(f"{sensor} ") if sensor else why
        texts.append(f"{text}: {why}" if why else text)
    return [
        (heading, f"{sensor} {'; '.join(texts)}".strip())
        for (heading, sensor), texts in lines.items()
    ]


def _drives(dataset: "xr.Dataset", found: Sequence[Check]) -> list[tuple[str, str]]:
    """Return end force, raw end gap and margins of every drive."""
    if "drive" not in dataset.coords:
        return []
    lines = []
    shown = ("drive_force", "drive_slipping", "end_gap")
    # One drive is cut out of these only: cutting all that a run holds takes ten times as long.
    own = dataset[["drive", *(name for name in shown if name in dataset)]]
    for name in dataset["drive"].values:
        drive = own.sel(drive=name)
        parts = []
        if "drive_force" in drive:
            parts.append(f"end force {format_force(final_value(drive['drive_force']))}")
        if "end_gap" in drive:
            parts.append(_end_gap(drive))
        left = [_margin(check) for check in margins(found) if check.drive == str(name)]
        parts += [f"margin to slip {', '.join(left)}"] if left else []
        lines.append((f"drive {name}", "; ".join(parts)))
    if "end_gap" in dataset:
        lines.append(("", "gaps are raw: a held force stretches the bushing (force / stiffness)"))
    return lines + _machines(dataset)


def _machines(dataset: "xr.Dataset") -> list[tuple[str, str]]:
    """Return run time, outcome and consumption of each machine on its commands."""
    made = machine_throws(dataset)
    if not made or not {"drive_current", "drive_power"} <= set(dataset):
        return []
    lines = []
    time = dataset["time"].values
    for item in made:
        direction = "closing" if item["to"] == "closed" else "opening"
        off = time[-1] if item["off"] is None else item["off"]
        inside = (time >= item["on"]) & (time <= off)
        drive = dataset[["drive_current", "drive_power"]].sel(drive=item["drive"])
        current, power = np.abs(drive["drive_current"].values[inside]), drive["drive_power"]
        text = f"drive {item['drive']}, {item['machine']}, {direction}: "
        text += "limit contact" if item["outcome"] == "limit" else item["outcome"].upper()
        text += f" after {off - item['on']:.3f} s"
        lost = item.get("phase_lost")
        text += f", ONE PHASE LOST at t = {lost:.3f} s" if lost is not None else ""
        if current.size:
            last = time[inside] > off - 0.1
            text += f", {current.max():.2f} A at most; over its last 0.1 s "
            text += f"{current[last].mean():.2f} A, {power.values[inside][last].mean():.0f} W"
        lines.append(("machine", text))
    supplies = json.loads(dataset.attrs.get("machine_supplies", "{}"))
    for name, supply in supplies.items():
        late = supply.get("phase_lost_at")
        if late is not None and late > time[-1]:
            text = f"drive {name}: its phase would be lost at {late:g} s, after the end: no effect"
            lines.append(("", text))
    blind: dict[str, str] = json.loads(dataset.attrs.get("blind_currents", "{}"))
    return lines + [("", f"drive {name}, {text}") for name, text in blind.items()]


def _margin(check: Check) -> str:
    direction = direction_of(check.movement)
    if check.margin <= 0:
        return f"none left {direction}".rstrip()
    text = f"{format_force(check.margin)} {direction}".rstrip()
    return f"{text} (only {100 * check.share:.1f} %)" if check.tight else text


def _end_gap(drive: "xr.Dataset") -> str:
    if math.isnan(float(drive["end_gap"])):
        return "no gap known, as the rail has no stock rail"
    return f"raw end gap {format_gap(drive['end_gap'])}{_stretch(drive)}"


def _stretch(drive: "xr.Dataset") -> str:
    """Return the elastic stretch in an end gap of a bushing that does not slip, as text."""
    if "drive_force" not in drive or "drive_slipping" not in drive:
        return ""
    if not drive.attrs.get("complete", True):
        return ""
    if final_value(drive["drive_slipping"]):
        return ""
    if math.isnan(float(drive["drive_stiffness"])):
        return " (bushing stretched as its table says)"
    stretch = abs(final_value(drive["drive_force"])) / drive["drive_stiffness"]
    return f" (bushing stretch {format_length(stretch)})"


def _slips(dataset: "xr.Dataset", found: Sequence[Check]) -> list[str]:
    if "drive_slipping" not in dataset:
        return []
    slipped = [check for check in found if check.kind == "slip" and check.met is False]
    return [slip_text(dataset, check) for check in slipped] or ["no drive slipped"]


def slip_text(dataset: "xr.Dataset", check: Check) -> str:
    """Return drive, place and time of a slip, and whether an object was touched before."""
    text = f"drive {check.drive}"
    if "drive_x" in dataset.coords:
        text += f" at x = {float(dataset['drive_x'].sel(drive=check.drive)):g} m"
    if check.criterion == SWITCHED_OFF:
        return f"{text} {check.text.partition(check.drive)[2].strip()}"
    text += f" from t = {check.time:.3f} s"
    if check.movement is not None:
        text += f", in the {direction_of(check.movement)} movement"
    if "contact_time" not in dataset or dataset.attrs.get("foreign_objects", "[]") == "[]":
        return text
    touched = bool(dataset["contact_time"] <= check.time)  # a NaN is never before
    return text + (
        ", after an object was touched" if touched else ", without any object touched before"
    )


def wheel_texts(dataset: "xr.Dataset") -> dict[str, str]:
    """Return least flangeway and gauge with place and requirement, those that are known."""
    return {
        room.kind: f"{room.value} at {room.place}, rail {room.rail}; "
        + (
            "the panel gives no limit"
            if math.isnan(room.limit)
            else f"{format_required(room.least, room.limit)}{room.at_speed.removeprefix(' mm')}"
        )
        + (f"; {room.allowed}" if room.allowed else "")
        for room in wheel_rooms(dataset)
    }


def _energy(dataset: "xr.Dataset") -> list[tuple[str, str]]:
    if "energy_residual" not in dataset or "energy_numerical" not in dataset:
        return []
    scale = float(dataset.attrs.get("energy_scale", 0.0))
    if not scale > 0:
        return []
    lines = [
        (
            "energy",
            f"residual {residual_share(dataset):.1e} of {scale:.3g} J; "
            f"numerical dissipation {numerical_share(dataset):.1e} of it",
        )
    ]
    warning = numerical_warning(dataset)
    return lines if warning is None else [*lines, ("WARNING", warning)]
