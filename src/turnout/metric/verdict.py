"""The verdict on a throw: one kind and one plain sentence, the same on every face."""

import json
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from turnout.metric.channel_features import final_value
from turnout.metric.slip import (
    TIME_TOLERANCE,
    Slip,
    Span,
    movements,
    periods,
    slips,
    unfinished,
)
from turnout.metric.summary import format_force
from turnout.metric.trapped import break_note, is_trapped
from turnout.metric.verdict_clauses import (
    accepted_by,
    narrow_flangeway,
    nothing_left,
    out_of_control,
    sizes_left,
    slip_words,
    wide_gaps,
)

if TYPE_CHECKING:
    import xarray as xr


Kind = Literal[
    "undetected object",
    "detected by lock",
    "detected by TKK",
    "detected by slip",
    "not locked",
    "not sound",
    "sound",
    "depends on how it breaks",
    "not judged",
]
KINDS: tuple[str, ...] = get_args(Kind)
"""Every kind of verdict."""

# In words that need no knowledge of switches.
MEANINGS: dict[Kind, str] = {
    "undetected object": "An object holds the rail open, yet all checks report a locked switch: "
    "trains could run over it.",
    "detected by slip": "An object is in the switch, and a drive that slips reports it.",
    "detected by lock": "An object is in the switch, and the lock reports it: it is not closed.",
    "detected by TKK": "An object is in the switch, and a sensor reports it: a gap stays open.",
    "not locked": "The switch does not report a closed end position, though no object keeps it.",
    "not sound": "The switch closes and locks, but wheels have less room beside its open rail than "
    "they need.",
    "sound": "No object is trapped, and the switch closes and locks.",
    "depends on how it breaks": "An object breaks, or nearly does, and what the switch reports "
    "rests on it: a little more or less strength changes it.",
    "not judged": "",
}
"""Meaning of each kind for trains."""

# What is named first where several things report an object.
_ORDER: tuple[Kind, ...] = ("detected by slip", "detected by lock", "detected by TKK")

# Without one of these a run cannot be judged.
_NEEDED = ("locked", "in_control", "drive_slipping")
_NEEDED_WORDS = {"locked": "lock", "in_control": "control (TKK)", "drive_slipping": "slip"}


# All that a verdict rests on; picking an instant of everything else would take most of its time.
_JUDGED = (
    *_NEEDED,
    *("drive_force", "drive_gap", "sensor_gap"),
    *("object_touched", "contact_time", "object_contact_time", "object_left", "object_size"),
    *("least_flangeway", "least_flangeway_x", "least_flangeway_rail"),
    *("throw_movements", "throw_machine_throws"),
)


@dataclass(frozen=True, slots=True)
class Verdict:
    """Judgement of a throw.

    Attributes
    ----------
    kind : str
        An object is judged by the movements in which its own rail closes, from its first contact
        on. "undetected object": an object is trapped, and lock, control and drives accept the
        movement. "detected by slip", "detected by lock", "detected by TKK": a drive slips, the
        lock is refused, or a sensor reports a gap; the first of these that holds, the sentence
        names the others. The rest is for a switch in which no object is touched, nothing is
        left of one that is, or a drive slips before: "not locked", a drive slips, the lock is
        refused, or a sensor reports a gap; "not sound", only the flangeway is below its limit;
        "sound", every check is passed. "depends on how it breaks": throws in which objects break a
        little sooner or later, or in mode waveform, end with other reports.
        "not judged": the dataset lacks what the verdict rests on, an object does not fit, or a
        drive has not arrived and no object is detected or missed by what has.
    text : str
        One plain sentence with its numbers; where an object broke in a throw of a sequence a second
        one, that the verdict may depend on step and mode.
    """

    kind: Kind
    text: str

    @property
    def meaning(self) -> str:
        """Meaning for trains, in a sentence without terms; empty if not judged."""
        return MEANINGS[self.kind]

    @property
    def missed(self) -> bool:
        """True if an object is trapped and nothing reports it."""
        return self.kind == "undetected object"


def verdict(dataset: "xr.Dataset") -> Verdict:
    """Judge a throw by the reports of lock, control and drives.

    Parameters
    ----------
    dataset : xarray.Dataset
        A simulated run. Measurements, campaigns, runs that ended early and runs of which lock,
        control or slip was not kept come back as "not judged", with the reason.

    Returns
    -------
    Verdict
        States are those at the rest after each movement.

    Examples
    --------
    >>> import xarray as xr
    >>> verdict(xr.Dataset(attrs={"kind": "measurement"})).kind
    'not judged'
    """
    lacking = _missing_channels(dataset)
    if lacking:
        return Verdict("not judged", f"Not judged: {lacking}.")
    unplaced = _unplaced(dataset)
    if unplaced:
        return Verdict("not judged", f"Not judged: {unplaced}.")
    judged = dataset[[name for name in _JUDGED if name in dataset]]
    found, note = _judged(judged, _cases(judged)), break_note(dataset)
    if "break_check" in dataset.attrs and note:
        text = f"{note}; in this throw: {found.text[:1].lower()}{found.text[1:]}"
        return Verdict("depends on how it breaks", text)
    return replace(found, text=f"{found.text} {note}.") if note else found


def _missing_channels(dataset: "xr.Dataset") -> str:
    """Return the reason for not judging a dataset; empty if it can be judged."""
    if "movement" in dataset.dims:
        return "a campaign of many movements has no single verdict; select one movement"
    if "throw" in dataset.dims:
        return "a sequence of throws has no single verdict; select one throw"
    if dataset.attrs.get("kind", "simulation") != "simulation":
        return (
            "a recording has no lock or control contact, and it is unknown whether an object was "
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
    """Return True if a channel was not kept; a panel without sensors has no control to keep."""
    if name == "in_control" and "locked" in dataset:
        return "sensor_gap" in dataset and name not in dataset
    return name not in dataset


def _measured_slip(dataset: "xr.Dataset") -> str:
    """Return the evidence of slip in a recording: its largest force, if forces were measured."""
    if "drive_force" not in dataset:
        return ""
    found = []
    for name in dataset["drive"].values:
        largest = float(abs(dataset["drive_force"].sel(drive=name)).max())
        if not math.isnan(largest):
            found.append(f"{format_force(largest)} at Drive {name}")
    return f"; the largest forces are {', '.join(found)}" if found else ""


@dataclass(frozen=True, slots=True)
class _Case:
    """One object: times of its first touch and removal [s], and the reports of it.

    `fate` says what became of it where nothing is left at the end, else it is empty; `left` is the
    size that is left of it [m], NaN where all is. It is `open` where a movement that could report
    it is not over.
    """

    what: str
    contact: float
    gone: float
    signs: tuple[tuple[Kind, str], ...]
    refused: bool
    accepted: str
    fate: str = ""
    left: float = math.nan
    open: bool = False

    @property
    def touched(self) -> bool:
        """True if a rail reached it before it was taken out."""
        return self.contact < self.gone

    @property
    def trapped(self) -> bool:
        """True if it was touched and is still there at the end."""
        return bool(is_trapped(self.contact, self.gone, self.left))


def _objects(dataset: "xr.Dataset") -> list[dict[str, Any]]:
    items: list[dict[str, Any]] = json.loads(dataset.attrs.get("foreign_objects", "[]"))
    return items


def _name(item: dict[str, Any]) -> str:
    return f"{1e3 * item['size']:g} mm at {item['place']}"


def _as_met(dataset: "xr.Dataset", items: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return objects with the sizes that a throw of a sequence met; those gone keep their own."""
    if "object_size" not in dataset or dataset["object_size"].size != len(items):
        return items
    sizes = [round(float(size), 4) for size in dataset["object_size"].values]  # to 0.1 mm
    return [item | {"size": size or item["size"]} for item, size in zip(items, sizes, strict=True)]


def _unplaced(dataset: "xr.Dataset") -> str:
    """Name the objects that had no room; empty if all had."""
    items = _objects(dataset)
    if not items or "object_placed" not in dataset or bool(dataset["object_placed"]):
        return ""
    most = [_largest_opening(dataset, item) for item in items]
    large = [
        f"{_name(item)} (at most {1e3 * room:.1f} mm)"
        for item, room in zip(items, most, strict=True)
        if room < item["size"]
    ]
    named = large or [_name(item) for item in items]
    return f"{_join_words(named)} {'does' if len(named) == 1 else 'do'} not fit"


def _largest_opening(dataset: "xr.Dataset", item: dict[str, Any]) -> float:
    """Return the widest gap at the place of an object while it should be there [m], or NaN."""
    if "gap" not in dataset or item.get("rail") not in dataset["gap"]["rail"].values:
        return math.nan
    time = dataset["time"].values
    appears, disappears = item.get("appears"), item.get("disappears")
    there = time >= (-math.inf if appears is None else appears)
    there &= time <= (math.inf if disappears is None else disappears)
    gap = dataset["gap"].sel(rail=item["rail"]).transpose("time", "x").values[there]
    places = dataset["x"].values
    return max((float(np.interp(item["x"], places, row)) for row in gap), default=math.nan)


def _cases(dataset: "xr.Dataset") -> list[_Case]:
    """Judge every object by the movements in which its own rail closes."""
    items = _as_met(dataset, _objects(dataset))
    end = float(dataset["time"][-1])
    cases = []
    left, fates = sizes_left(dataset, len(items)), nothing_left(dataset, len(items))
    contacts = _contacts(dataset, len(items))
    for item, contact, size, fate in zip(items, contacts, left, fates, strict=True):
        taken = item.get("disappears")
        gone = math.inf if taken is None or taken > end else float(taken)
        instrumented = dataset.attrs.get("instrumented_rail", item.get("rail"))
        position = "closed" if item.get("rail") in (None, instrumented) else "open"
        case = _case(dataset, _name(item), contact, gone, position)
        cases.append(replace(case, fate=fate, left=size))
    return cases


def _contacts(dataset: "xr.Dataset", count: int) -> list[float]:
    """Return the first touch of each object [s]; NaN for never, from ever if not kept."""
    if "object_contact_time" in dataset and dataset["object_contact_time"].size == count:
        return [float(value) for value in dataset["object_contact_time"].values]
    if "object_touched" in dataset and not bool(dataset["object_touched"]):
        return [math.nan] * count
    return [float(dataset.get("contact_time", -math.inf))] * count


def _case(dataset: "xr.Dataset", what: str, contact: float, gone: float, position: str) -> _Case:
    signs: list[tuple[Kind, str]] = []
    refused, accepted, late = False, "", unfinished(dataset)
    is_open = False
    for span, until in periods(dataset):
        start = -math.inf if span is None else span.start
        if not (contact < min(gone, until) and start < gone):
            continue
        if span is not None and span.to != position:
            continue
        is_open |= span in late
        mine = [slip for slip in slips(dataset) if slip.movement == span and slip.time < gone]
        rest = _at_rest(dataset, span, min(until, gone))
        if any(slip.time < contact - TIME_TOLERANCE for slip in mine):
            # Whether the object adds to what failed before it was touched is not known.
            refused |= rest is not None and bool(_signs(dataset, rest, [], span))
            continue
        last = math.isinf(until)
        after = "" if last or span is None else f" after the movement to {span.to}"
        found = _signs(dataset, rest, mine, span, after)
        signs += [sign for sign in found if sign not in signs]
        if rest is not None:
            accepted = f"{accepted_by(rest, span)}{after}"
    accepted = accepted or accepted_by(dataset, _last(dataset))
    return _Case(what, contact, gone, tuple(signs), refused, accepted, open=is_open)


def _last(dataset: "xr.Dataset") -> Span | None:
    spans = movements(dataset)
    return spans[-1] if spans else None


def _at_rest(dataset: "xr.Dataset", span: Span | None, until: float) -> "xr.Dataset | None":
    """Return the last instant before a time, or None if the movement is not over by then."""
    time = dataset["time"].values
    last = int((time < until - TIME_TOLERANCE).sum()) - 1
    if last < 0 or (span is not None and time[last] < span.end - TIME_TOLERANCE):
        return None
    if span in unfinished(dataset):
        return None
    return dataset.isel(time=[last])


def _signs(
    dataset: "xr.Dataset",
    rest: "xr.Dataset | None",
    slipped: list[Slip],
    span: Span | None,
    after: str = "",
) -> list[tuple[Kind, str]]:
    """Return the reports of an object in a movement and at its rest, in the order of the kinds."""
    signs: list[tuple[Kind, str]] = []
    if slipped:
        signs.append(("detected by slip", "; ".join(slip_words(dataset, slip) for slip in slipped)))
    if rest is None:
        return signs
    if not bool(final_value(rest["locked"])):
        wide = wide_gaps(rest)
        if wide or not slipped or after:
            reason = f"the lock is refused{after}{': ' + wide if wide else ''}"
            signs.append(("detected by lock", reason))
    out = out_of_control(rest, span)
    if out:
        signs.append(("detected by TKK", f"{out}{after}"))
    return signs


def _judged(dataset: "xr.Dataset", cases: list[_Case]) -> Verdict:
    caught = [case for case in cases if case.signs]
    silent = [case for case in cases if case.trapped and not case.signs and not case.refused]
    missed = [case for case in silent if not case.open]
    late = list(unfinished(dataset).values())
    if missed:
        what = _join_words([case.what for case in missed])
        stays = "stays" if len(missed) == 1 else "stay"
        text = f"Undetected object: {what} {stays} in the switch and nothing reports it: "
        text += f"the switch {missed[0].accepted}"
        for case in caught:
            text += f"; {case.what} is detected: {'; '.join(reason for _, reason in case.signs)}"
        text += _gone_texts(cases)
        faults = [] if caught else _faults(dataset)
        text += f"; apart from the object, {'; '.join(faults)}" if faults else ""
        return Verdict("undetected object", f"{'; '.join([text, *late])}.")
    if caught:
        signs = sorted(
            {sign: None for case in caught for sign in case.signs},
            key=lambda sign: _ORDER.index(sign[0]),
        )
        what = _join_words([f"{case.what}{_removal_text(case)}" for case in caught])
        before = _faults(dataset, before=min(case.contact for case in caught))
        reasons = "; ".join(reason for _, reason in signs)
        reasons += f"; before contact, {'; '.join(before)}" if before else ""
        text = f"D{signs[0][0][1:]}: {what}; {reasons}{_gone_texts(cases)}"
        return Verdict(signs[0][0], f"{'; '.join([text, *late])}.")
    if late:
        text = "; ".join([*late, *_faults(dataset)])
        return Verdict("not judged", f"Not judged: {text}.")
    return _switch_alone(dataset, cases)


def _removal_text(case: _Case) -> str:
    if math.isinf(case.gone):
        return f", which {case.fate}" if case.fate else ""
    return f", taken out at t = {case.gone:.2f} s"


def _gone_texts(cases: list[_Case]) -> str:
    """Name, beside other objects, those that have left nothing and were not detected."""
    gone = [case for case in cases if case.touched and case.fate and not case.signs]
    return "".join(f"; {case.what} {case.fate}" for case in gone)


def _join_words(parts: list[str]) -> str:
    return " and ".join(parts)


def _switch_alone(dataset: "xr.Dataset", cases: list[_Case]) -> Verdict:
    """Judge a switch in which no object is trapped, or none distinct from its own faults."""
    reason = "; ".join(_untouched_text(case) for case in cases) or "no object"
    faults = _faults(dataset)
    narrow = narrow_flangeway(dataset)
    accepted = accepted_by(dataset, _last(dataset))
    if faults:
        text = "; ".join([*faults, *narrow])
        return Verdict("not locked", f"Not locked: {reason}, but {text}.")
    if narrow:
        text = f"Not sound: {reason}, and the switch {accepted}, but {narrow[0]}."
        return Verdict("not sound", text)
    return Verdict("sound", f"Sound: {reason}, and the switch {accepted}.")


def _untouched_text(case: _Case) -> str:
    """Return the reason for not basing a verdict on an object."""
    if not math.isinf(case.gone):
        return f"{case.what} was taken out at t = {case.gone:.2f} s"
    if case.fate:
        return f"{case.what} {case.fate}"
    if not case.touched:
        return f"{case.what} is never touched"
    return f"{case.what} is touched only after a slip"


def _faults(dataset: "xr.Dataset", *, before: float = math.inf) -> list[str]:
    """Name the faults in any movement, its rest included; only those before a time [s]."""
    faults = [
        slip_words(dataset, slip) for slip in slips(dataset) if slip.time < before - TIME_TOLERANCE
    ]
    for span, until in periods(dataset):
        rest = _at_rest(dataset, span, until)
        if rest is None or not float(rest["time"][-1]) < before:
            continue
        to = "the end" if span is None else f"the movement to {span.to}"
        if not bool(final_value(rest["locked"])):
            wide = wide_gaps(rest)
            faults.append(f"the lock is refused after {to}{': ' + wide if wide else ''}")
        out = out_of_control(rest, span)
        if out and out not in faults:
            faults.append(out)
    return faults
