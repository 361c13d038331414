"""Plain-language findings of a run."""

import json
import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import xarray as xr

from turnout.metric.channel_features import final_value
from turnout.metric.slip import Slip, margins, slips, unfinished
from turnout.metric.summary import (
    ends_inaccurate,
    format_force,
    format_length,
    format_required_flangeway,
    numerical_warning,
)
from turnout.metric.trapped import break_note
from turnout.metric.verdict import Verdict, verdict

HEADLINE = "Outcome"
"""The question that the headline of a run answers; always given."""

UNDETECTED = "Undetected object"
"""The answer for an object that lock, control and drives accept."""

Severity = Literal["good", "look", "bad", "fact"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One answer.

    Attributes
    ----------
    level : str
        "good", "look" (should be checked), "bad", or "fact" (a fact without a judgement).
    question : str
        Such as "Locked?".
    answer : str
        In a word or two.
    detail : str
        Which, where, when, by what margin.
    meaning : str
        What it means for trains, in a sentence without terms; of the headline alone.
    """

    level: Severity
    question: str
    answer: str
    detail: str
    meaning: str = ""


def findings(dataset: xr.Dataset) -> list[Finding]:
    """Return the findings of a run, the answer to "was the object detected?" first.

    Parameters
    ----------
    dataset : xarray.Dataset
        One run, simulated or measured; questions that its channels cannot answer are left out.

    Returns
    -------
    list of Finding

    Examples
    --------
    >>> run = xr.Dataset({"locked": ("time", [False, True])}, {"time": [0.0, 1.0]})
    >>> [(item.question, item.answer) for item in findings(run)]
    [('Outcome', 'Locked'), ('Locked?', 'Yes')]
    """
    if not dataset.sizes.get("time", 0):
        reason = str(dataset.attrs.get("outcome_message", "it holds no instant"))
        return [Finding("bad", HEADLINE, "Nothing to judge", reason)]
    found = [*_complete(dataset), *_outcome(dataset), *_locked(dataset), *_control(dataset)]
    found += [*_slipped(dataset), *_nearest(dataset), *_object(dataset), *_flangeway(dataset)]
    warning = numerical_warning(dataset) if "energy_numerical" in dataset else None
    if warning is not None:
        found.append(Finding("look", "Can the numbers be trusted?", "With care", warning))
    return _without_praise(found)


# What accepts a movement; not good while an object is trapped.
_ACCEPTS = (
    *("Locked?", "In control?", "Did a drive slip?"),
    *("Least margin to slip", "Least flangeway"),
)


def _without_praise(found: list[Finding]) -> list[Finding]:
    """Take the good level from the checks that an undetected object has passed."""
    if not any(item.question == HEADLINE and item.answer == UNDETECTED for item in found):
        return found
    return [
        replace(item, level="look") if item.question in _ACCEPTS and item.level == "good" else item
        for item in found
    ]


def is_locked(dataset: xr.Dataset) -> bool | None:
    """Return True if a run ends locked, or None if that is not known."""
    return bool(final_value(dataset["locked"])) if "locked" in dataset else None


def is_in_control(dataset: xr.Dataset) -> bool | None:
    """Return True if every sensor is in control at the end, or None if that is not known."""
    return bool(final_value(dataset["in_control"]).all()) if "in_control" in dataset else None


def _complete(dataset: xr.Dataset) -> list[Finding]:
    if dataset.attrs.get("complete", True):
        return []
    message = str(dataset.attrs.get("outcome_message", "ended early"))
    if ends_inaccurate(dataset):
        return [Finding("bad", "Can the numbers be trusted?", "No", message)]
    return [Finding("bad", "Is the run whole?", "No", f"{message}; what follows holds until then")]


def _outcome(dataset: xr.Dataset) -> list[Finding]:
    """Return the one sentence that matters: detection of a trapped object by the switch, or not."""
    judged = headline(verdict(dataset), dataset)
    if judged is not None:
        return [judged]
    found, note = _states_at_the_end(dataset), break_note(dataset)
    return [replace(item, detail=f"{item.detail}. {note}") for item in found] if note else found


def _states_at_the_end(dataset: xr.Dataset) -> list[Finding]:
    """Return the same without a verdict, from lock and control at the end."""
    locked, control = is_locked(dataset), is_in_control(dataset)
    if locked is None and control is None:
        return []
    detects = locked is False or control is False
    states = [] if locked is None else ["locked" if locked else "not locked"]
    states += [] if control is None else ["in control" if control else "not in control"]
    state = " and ".join(states) if not detects else _refusal(locked, control)
    if not _objects(dataset):
        if detects:
            text = "nothing is trapped, yet the switch does not reach its end position"
            return [Finding("bad", HEADLINE, _capital(state), text)]
        text = "nothing is trapped, and the switch reaches its end position"
        return [Finding("good", HEADLINE, _capital(state), text)]
    what = " and ".join(
        f"{1e3 * item['size']:g} mm at {item['place']}" for item in _objects(dataset)
    )
    if "object_touched" in dataset and not dataset["object_touched"]:
        return [Finding("look", HEADLINE, "Object never touched", f"{what}; {state}")]
    if detects:
        return [Finding("good", HEADLINE, "Object detected", f"{what}; the switch is {state}")]
    return [Finding("bad", HEADLINE, UNDETECTED, f"{what}, yet the switch is {state}")]


def headline(found: Verdict, dataset: xr.Dataset) -> Finding | None:
    """Return a verdict as an answer, or None if only the states at the end are known."""
    detail = found.text.partition(": ")[2].rstrip(".")
    if found.kind == "not judged":
        if bool(dataset.get("object_placed", True)) and not unfinished(dataset):
            return None
        return Finding("look", HEADLINE, "Not judged", detail)
    if found.kind == "depends on how it breaks":
        return Finding("look", HEADLINE, _capital(found.kind), detail, found.meaning)
    if found.missed:
        return Finding("bad", HEADLINE, UNDETECTED, detail, found.meaning)
    if found.kind.startswith("detected"):
        return Finding("good", HEADLINE, "Object detected", detail, found.meaning)
    if _objects(dataset) and not bool(dataset.get("object_touched", True)):
        return Finding("look", HEADLINE, "Object never touched", detail)
    locked, control = is_locked(dataset), is_in_control(dataset)
    if found.kind == "sound":
        answer = "Locked" if control is None else "Locked and in control"
        return Finding("good", HEADLINE, answer, detail, found.meaning)
    answer = _refusal(locked, control) if locked is False or control is False else "not sound"
    return Finding("bad", HEADLINE, _capital(answer), detail, found.meaning)


def _refusal(locked: bool | None, control: bool | None) -> str:
    parts = ["not locked"] if locked is False else []
    parts += ["not in control"] if control is False else []
    return " and ".join(parts)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _locked(dataset: xr.Dataset) -> list[Finding]:
    locked = is_locked(dataset)
    if locked is None:
        return []
    rule = dataset.attrs.get("lock_rule")
    detail = f"at the end, by the rule '{rule}'" if rule else "at the end"
    late = [*unfinished(dataset).values()]
    level: Severity = "look" if late else "good" if locked else "bad"
    detail = "; ".join([detail, *late])
    return [Finding(level, "Locked?", "Yes" if locked else "No", detail)]


def _control(dataset: xr.Dataset) -> list[Finding]:
    control = is_in_control(dataset)
    if control is None or "sensor_gap" not in dataset:
        return []
    parts = []
    for name in dataset["sensor"].values:
        sensor = dataset.sel(sensor=name)
        gap, limit = float(final_value(sensor["sensor_gap"])), float(sensor["sensor_limit"])
        if math.isnan(gap):
            parts.append(f"{name} gap not known")
            continue
        side = (
            f"{format_length(limit - gap)} below"
            if gap < limit
            else f"{format_length(gap - limit)} above"
        )
        parts.append(f"{name} gap {format_length(gap)}, {side} its limit of {format_length(limit)}")
    level: Severity = "good" if control else "bad"
    return [Finding(level, "In control?", "Yes" if control else "No", "; ".join(parts))]


def _slipped(dataset: xr.Dataset) -> list[Finding]:
    if "drive_slipping" not in dataset:
        return []
    found = slips(dataset)
    if not found:
        machines = "drive_power" in dataset
        text = "no clutch or bushing slipped" if machines else "every drive followed its marker"
        return [Finding("good", "Did a drive slip?", "No", text)]
    slipped = dict.fromkeys(slip.drive for slip in found if not slip.stopped)
    names = ", ".join(slipped or dict.fromkeys(slip.drive for slip in found))
    answer = f"Yes, drive {names}" if slipped else f"No, but drive {names} has not arrived"
    detail = "; ".join(_slip(dataset, slip) for slip in found)
    return [Finding("look", "Did a drive slip?", answer, detail)]


def _slip(dataset: xr.Dataset, slip: Slip) -> str:
    text = f"drive {slip.drive}"
    if "drive_x" in dataset.coords:
        text += f" at x = {float(dataset['drive_x'].sel(drive=slip.drive)):g} m"
    text += f" {slip.stopped}, at" if slip.stopped else " from"
    text += f" t = {slip.time:.2f} s"
    if slip.movement is not None:
        text += " while closing" if slip.movement.to == "closed" else " while opening"
    if "contact_time" in dataset and _objects(dataset):
        touched = bool(dataset["contact_time"] <= slip.time)
        text += ", after the object was touched" if touched else ", before any object was touched"
    return text


def _nearest(dataset: xr.Dataset) -> list[Finding]:
    """Return the drive with the least force left if none has slipped, and its margin."""
    if "force_margin" not in dataset or "saturation_force" not in dataset.coords:
        return []
    left = [margin for margin in margins(dataset) if margin.force > 0]
    if not left:
        return []
    least = min(left, key=lambda margin: margin.share)
    detail = (
        f"drive {least.drive} {least.direction}: {format_force(least.largest)} of "
        f"{format_force(least.limit)}, {format_force(least.force)} left"
    )
    level: Severity = "look" if least.tight else "good"
    return [Finding(level, "Least margin to slip", f"{100 * least.share:.1f} %", detail)]


def _object(dataset: xr.Dataset) -> list[Finding]:
    if "object_touched" not in dataset or not dataset["object_touched"]:
        return []
    detail = f"first touched at t = {float(dataset['contact_time']):.2f} s"
    if "object_force" not in dataset:
        return [Finding("fact", "Force on the object", "not known", detail)]
    force = dataset["object_force"]
    detail += f"; {format_force(force.max())} at most"
    return [Finding("fact", "Force on the object", format_force(final_value(force)), detail)]


def _flangeway(dataset: xr.Dataset) -> list[Finding]:
    limit = float(dataset.attrs.get("flangeway_limit", float("nan")))
    if "least_flangeway" not in dataset:
        return []
    least = float(dataset["least_flangeway"])
    if math.isnan(least):
        return []
    detail = (
        f"rail {dataset['least_flangeway_rail'].values!s} at "
        f"x = {float(dataset['least_flangeway_x']):g} m"
    )
    if math.isnan(limit):
        detail += "; the panel gives no limit"
        return [Finding("fact", "Least flangeway", format_length(least), detail)]
    level: Severity = "good" if least >= limit else "look"
    detail += f"; {format_required_flangeway(least, limit)}"
    return [Finding(level, "Least flangeway", format_length(least), detail)]


def _objects(dataset: xr.Dataset) -> list[dict[str, Any]]:
    items: list[dict[str, Any]] = json.loads(dataset.attrs.get("foreign_objects", "[]"))
    return items
