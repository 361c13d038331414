"""The verdict on a throw: one kind and one plain sentence, from its checks and objects.

Beside it what is trapped at the end, and the verdicts on the throws of a sequence as a table.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from turnout.core.channels import BREAK_NOTE
from turnout.solver.record import TIME_TOLERANCE
from turnout.throw.checks import (
    GAUGE,
    OF_WHEELS,
    SWITCHED_OFF,
    Check,
    checks,
    direction_of,
    format_force,
    unmet,
)
from turnout.throw.slip import Span, periods, unfinished

if TYPE_CHECKING:
    import xarray as xr


Kind = Literal[
    "sound",
    "not judged",
    "depends on how it breaks",
    "detected by TKK",
    "detected by lock",
    "detected by slip",
    "detected by switch-off",
    "not sound",
    "not locked",
    "undetected object",
]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""Every kind of verdict, from good to bad."""

# In words that need no knowledge of switches.
MEANINGS: dict[Kind, str] = {
    "undetected object": "An object holds the rail open, yet all checks report a locked switch: "
    "trains could run over it.",
    "detected by slip": "An object is in the switch, and a drive that slips reports it.",
    "detected by switch-off": "An object is in the switch, and a machine reports it: it is "
    "switched off before its end position.",
    "detected by lock": "An object is in the switch, and the lock reports it: it is not closed.",
    "detected by TKK": "An object is in the switch, and a sensor reports it: a gap stays open.",
    "not locked": "The switch does not report a locked end position, though no object keeps it.",
    "not sound": "The switch locks, but a drive slips, a sensor reports a gap, wheels have less "
    "room beside its open rail than they need, or its closed rail narrows the gauge; no object "
    "causes it.",
    "sound": "No object is trapped, and the switch closes and locks.",
    "depends on how it breaks": "An object breaks, or nearly does, and what the switch reports "
    "rests on it: a little more or less strength changes it.",
    "not judged": "",
}
"""Meaning of each kind for trains."""

# What is named first where several things report an object.
_ORDER: tuple[Kind, ...] = (
    *("detected by slip", "detected by switch-off", "detected by lock", "detected by TKK"),
)
_SIGNS: dict[str, Kind] = {"lock": "detected by lock", "control": "detected by TKK"}

# Without one of these a run cannot be judged.
_NEEDED = ("locked", "in_control", "drive_slipping")
_NEEDED_WORDS = {"locked": "lock", "in_control": "control (TKK)", "drive_slipping": "slip"}


@dataclass(frozen=True, slots=True)
class Verdict:
    """Judgement of a throw.

    Attributes
    ----------
    kind : str
        An object is judged by the movements in which its own rail closes, from its first contact
        on. "undetected object": an object is trapped, and lock, control and drives accept the
        movement. "detected by slip", "... switch-off", "... lock", "... TKK": a drive slips, a
        machine is switched off before its end position, the lock is refused, or a sensor reports a
        gap; the first of these that holds, the sentence names the others. The rest is for a switch
        in which no object is touched, nothing is left of one that is, or a drive slips before: "not
        locked", the lock is refused after a movement; "not sound", another check is not met;
        "sound", every check is met. "depends on how it breaks": throws in which objects break a
        little sooner or later, or in mode waveform, end with other reports. "not judged": the
        dataset lacks what the verdict rests on, an object does not fit, or a drive has not arrived
        and no object is detected or missed by what has.
    text : str
        One plain sentence with its numbers; where an object broke in a throw of a sequence a second
        one, that the verdict may depend on step and mode.
    own : str or None
        Kind of this throw alone where the verdict "depends on how it breaks"; otherwise None.
    """

    kind: Kind
    text: str
    own: Kind | None = None

    @property
    def meaning(self) -> str:
        """Meaning for trains, in a sentence without terms; empty if not judged."""
        return MEANINGS[self.kind]

    @property
    def head(self) -> str:
        """The verdict in a few words: its kind, and the movement of a lock refused alone."""
        return self.text.partition(": ")[0]

    @property
    def missed(self) -> bool:
        """True if in this throw an object is trapped and nothing reports it."""
        return "undetected object" in (self.kind, self.own)


def verdict(dataset: "xr.Dataset", found: Sequence[Check] | None = None) -> Verdict:
    """Judge a throw by its checks.

    Parameters
    ----------
    dataset : xarray.Dataset
        A simulated run. Measurements, campaigns, runs that ended early and runs of which lock,
        control or slip was not kept come back as "not judged", with the reason.
    found : sequence of Check, optional
        Its checks, where they are known already.

    Examples
    --------
    >>> import xarray as xr
    >>> verdict(xr.Dataset(attrs={"kind": "measurement"})).kind
    'not judged'
    """
    lacking, note = _missing_channels(dataset) or _unplaced(dataset), break_note(dataset)
    if lacking:
        return Verdict("not judged", f"Not judged: {lacking}.{f' {note}.' if note else ''}")
    found = checks(dataset) if found is None else found
    late = list(unfinished(dataset).values())
    cases = judge_objects(_trapped_items(dataset), found, periods(dataset))
    kind = kind_of(cases, found, late=bool(late))
    made = Verdict(kind, _sentence(kind, cases, found, late))
    if "break_check" in dataset.attrs and note:
        text = f"{note}; in this throw: {made.text[:1].lower()}{made.text[1:]}"
        return Verdict("depends on how it breaks", text, own=kind)
    note = note or str(dataset.attrs.get("break_gaps", ""))
    return replace(made, text=f"{made.text} {note}.") if note else made


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


def object_items(dataset: "xr.Dataset") -> list[dict[str, Any]]:
    """Return the records of the foreign objects of a run."""
    items: list[dict[str, Any]] = json.loads(dataset.attrs.get("foreign_objects", "[]"))
    return items


def object_name(item: dict[str, Any]) -> str:
    """Return size and place of an object."""
    return f"{1e3 * item['size']:g} mm at {item['place']}"


def _unplaced(dataset: "xr.Dataset") -> str:
    """Name the objects that had no room; empty if all had."""
    items = object_items(dataset)
    if not items or "object_placed" not in dataset or bool(dataset["object_placed"]):
        return ""
    most = [_largest_opening(dataset, item) for item in items]
    large = [
        f"{object_name(item)} (at most {1e3 * room:.1f} mm)"
        for item, room in zip(items, most, strict=True)
        if room < item["size"]
    ]
    named = large or [object_name(item) for item in items]
    return f"{' and '.join(named)} {'does' if len(named) == 1 else 'do'} not fit"


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


@dataclass(frozen=True, slots=True)
class TrappedItem:
    """An object of a throw: when it was touched, and how much of it remains.

    Attributes
    ----------
    contact, gone : float
        Time of the first touch, NaN for never, and of its removal, infinite if it stays [s].
    position : str
        Position of the instrumented rail, "open" or "closed", in which the object's rail is closed.
    left : float
        Remaining size at the end [m]; NaN for the whole object.
    name, fate : str
        Size and place, such as "13 mm at sleeper 6"; fate of an object that is gone, such as "was
        gone before".
    """

    contact: float
    gone: float
    position: str
    left: float = math.nan
    name: str = ""
    fate: str = ""

    @property
    def touched(self) -> bool:
        """True if a rail reached it before it was taken out."""
        return self.contact < self.gone

    @property
    def trapped(self) -> bool:
        """True if it was touched and is still there at the end."""
        return self.touched and math.isinf(self.gone) and not self.left <= 0.0


@dataclass(frozen=True, slots=True)
class JudgedItem:
    """An object and the checks that report it.

    Attributes
    ----------
    item : TrappedItem
        The object.
    signs : tuple of Check
        Checks that report it.
    passed : tuple of Check
        Lock and sensors that accept the last movement that could report it.
    refused : bool
        Whether a rest is refused after a slip before contact: the object's part is not known.
    open : bool
        Whether a movement that could report it is not over.
    """

    item: TrappedItem
    signs: tuple[Check, ...]
    passed: tuple[Check, ...]
    refused: bool
    open: bool


def _trapped_items(dataset: "xr.Dataset") -> list[TrappedItem]:
    """Return the objects of a run with their times and remaining sizes."""
    items = object_items(dataset)
    count, end = len(items), float(dataset["time"][-1])

    def per_object(name: str, default: float) -> list[float]:
        if name not in dataset or dataset[name].size != count:
            return [default] * count
        return [float(value) for value in dataset[name].values.reshape(-1)]

    left, before = per_object("object_left", math.nan), per_object("object_size", math.inf)
    found = []
    for item, contact, size, start in zip(
        items, _contacts(dataset, count), left, before, strict=True
    ):
        taken = item.get("disappears")
        instrumented = dataset.attrs.get("instrumented_rail", item.get("rail"))
        met = round(start, 4) if 0.0 < start < math.inf else item["size"]  # to 0.1 mm
        fate = "broke and left nothing" if start > 0.0 else "was gone before"
        found.append(
            TrappedItem(
                contact=contact,
                gone=math.inf if taken is None or taken > end else float(taken),
                position="closed" if item.get("rail") in (None, instrumented) else "open",
                left=size,
                name=object_name(item | {"size": met}),
                fate=fate if size <= 0.0 else "",
            )
        )
    return found


def _contacts(dataset: "xr.Dataset", count: int) -> list[float]:
    """Return the first touch of each object [s]; NaN for never, from ever if not kept."""
    if "object_contact_time" in dataset and dataset["object_contact_time"].size == count:
        return [float(value) for value in dataset["object_contact_time"].values]
    if "object_touched" in dataset and not bool(dataset["object_touched"]):
        return [math.nan] * count
    return [float(dataset.get("contact_time", -math.inf))] * count


def judge_objects(
    items: Sequence[TrappedItem],
    found: Sequence[Check],
    spans: Sequence[tuple[Span | None, float]],
) -> list[JudgedItem]:
    """Judge every object by the movements in which its own rail closes.

    Parameters
    ----------
    items : sequence of TrappedItem
        The objects.
    found : sequence of Check
        Checks of the throw.
    spans : sequence of (Span, float)
        Movements, each with the onset of the next one [s].
    """
    return [_judge_object(item, found, spans) for item in items]


def _judge_object(
    item: TrappedItem, found: Sequence[Check], spans: Sequence[tuple[Span | None, float]]
) -> JudgedItem:
    signs, passed = list[Check](), tuple[Check, ...]()
    refused = is_open = False
    for span, until in spans:
        start = -math.inf if span is None else span.start
        if not (item.contact < min(item.gone, until) and start < item.gone):
            continue
        if span is not None and span.to != item.position:
            continue
        own = [check for check in found if check.movement == span and check.kind not in OF_WHEELS]
        is_open |= any(check.met is None for check in own)
        slipped = [c for c in own if c.kind == "slip" and c.met is False and c.time < item.gone]
        rest = _last_rest(own, item.gone)
        if any(check.time < item.contact - TIME_TOLERANCE for check in slipped):
            # Whether the object adds to what failed before it was touched is not known.
            refused |= bool(unmet(rest))
            continue
        signs += [check for check in (*slipped, *unmet(rest)) if check not in signs]
        passed = tuple(check for check in rest if check.met) or passed
    return JudgedItem(item, tuple(signs), passed, refused, is_open)


def _last_rest(own: Sequence[Check], before: float) -> list[Check]:
    """Return lock and sensors at the last rest of a movement before a time [s]."""
    rests = [c for c in own if c.kind in _SIGNS and c.time < before and c.met is not None]
    last = max((check.time for check in rests), default=math.nan)
    return [check for check in rests if check.time == last]


def kind_of(cases: Sequence[JudgedItem], found: Sequence[Check], *, late: bool) -> Kind:
    """Return the kind of verdict on judged objects and the checks of their throw.

    Parameters
    ----------
    cases : sequence of JudgedItem
        From `judge_objects`.
    found : sequence of Check
        Checks of the throw.
    late : bool
        Whether a movement is not over.
    """
    if _missed(cases):
        return "undetected object"
    signs = [_sign(check) for case in cases for check in case.signs]
    if signs:
        return min(signs, key=_ORDER.index)
    if late:
        return "not judged"
    if unmet(found, "lock"):
        return "not locked"
    return "not sound" if unmet(found) else "sound"


def _sign(check: Check) -> Kind:
    """Return the kind of verdict that a check that is not met makes of an object."""
    if check.kind == "slip":
        return "detected by switch-off" if check.criterion == SWITCHED_OFF else "detected by slip"
    return _SIGNS[check.kind]


def _missed(cases: Sequence[JudgedItem]) -> list[JudgedItem]:
    return [
        case
        for case in cases
        if case.item.trapped and not (case.signs or case.refused or case.open)
    ]


def _sentence(
    kind: Kind, cases: Sequence[JudgedItem], found: Sequence[Check], late: Sequence[str]
) -> str:
    """Return a kind of verdict with its numbers as one sentence."""
    head = f"{kind[0].upper()}{kind[1:]}"
    faults = _texts(check for check in unmet(found) if check.kind not in OF_WHEELS)
    caught = [case for case in cases if case.signs]
    if kind == "undetected object":
        parts = [_missed_text(_missed(cases)), *_texts(unmet(found, GAUGE))]
        parts += [
            f"{case.item.name} is detected: {'; '.join(_texts(case.signs))}" for case in caught
        ]
        parts += _gone_texts(cases)
        parts += ["apart from the object, " + "; ".join(faults)] if faults and not caught else []
    elif caught:
        first = min(case.item.contact for case in caught)
        before = _texts(check for check in unmet(found) if check.time < first - TIME_TOLERANCE)
        signs = [check for case in caught for check in case.signs]
        signs.sort(key=lambda check: _ORDER.index(_sign(check)))
        parts = [" and ".join(f"{case.item.name}{_removal_text(case.item)}" for case in caught)]
        parts += _texts(signs)
        parts += [f"before contact, {'; '.join(before)}"] if before else []
        parts += _gone_texts(cases)
    elif kind == "not judged":
        return f"{head}: {'; '.join([*late, *faults])}."
    else:
        return f"{head}{_not_locked_after(found)}: {_alone_text(kind, cases, found)}."
    return f"{head}: {'; '.join([*parts, *late])}."


def _texts(found: "Sequence[Check] | Any") -> list[str]:
    return list(dict.fromkeys(check.text for check in found))


def _not_locked_after(found: Sequence[Check]) -> str:
    """Name the movements of refused locks if a lock after another movement is not refused."""
    locks = {check.movement: check.met for check in found if check.kind == "lock"}
    refused = [span for span, met in locks.items() if met is False]
    if not refused or len(refused) == len(locks):
        return ""
    return f" after {' and '.join(direction_of(span) for span in refused)}"


def _missed_text(missed: Sequence[JudgedItem]) -> str:
    what = " and ".join(case.item.name for case in missed)
    stays = "stays" if len(missed) == 1 else "stay"
    accepted = accepted_by(missed[0].passed)
    return f"{what} {stays} in the switch and nothing reports it: the switch {accepted}"


def accepted_by(passed: Sequence[Check]) -> str:
    """Return lock and sensors that accept a movement, with their numbers."""
    parts = [check.text for check in passed if check.kind == "lock"]
    if sensors := [check for check in passed if check.kind == "control"]:
        nearest = min(sensors, key=lambda check: check.share if check.numbers else math.inf)
        parts.append(f"is in control ({nearest.text})")
    return " and ".join(parts) or "is asked at no rest"


def _removal_text(item: TrappedItem) -> str:
    if math.isinf(item.gone):
        return f", which {item.fate}" if item.fate else ""
    return f", taken out at t = {item.gone:.2f} s"


def _gone_texts(cases: Sequence[JudgedItem]) -> list[str]:
    """Name, beside other objects, those that have left nothing and were not detected."""
    gone = [case.item for case in cases if case.item.touched and case.item.fate and not case.signs]
    return [f"{item.name} {item.fate}" for item in gone]


def _alone_text(kind: Kind, cases: Sequence[JudgedItem], found: Sequence[Check]) -> str:
    """Judge a switch in which no object is trapped, or none distinct from its own faults."""
    reason = "; ".join(_untouched_text(case.item) for case in cases) or "no object"
    lock = next((check for check in reversed(found) if check.kind == "lock"), None)
    rest = [c for c in found if c.kind in _SIGNS and lock is not None and c.time == lock.time]
    faults = _texts(unmet(found))
    if kind == "sound":
        return f"{reason}, and the switch {accepted_by(rest)}"
    if kind == "not locked":
        return f"{reason}, but {'; '.join(faults)}"
    passed = [check for check in rest if check.met]
    return f"{reason}, and the switch {accepted_by(passed)}, but {'; '.join(faults)}"


def _untouched_text(item: TrappedItem) -> str:
    """Return the reason for not basing a verdict on an object."""
    if not math.isinf(item.gone):
        return f"{item.name} was taken out at t = {item.gone:.2f} s"
    if item.fate:
        return f"{item.name} {item.fate}"
    if not item.touched:
        return f"{item.name} is never touched"
    return f"{item.name} is touched only after a slip"


def break_note(dataset: "xr.Dataset") -> str:
    """Return the note beside a verdict that may rest on how objects broke; empty for none.

    A single throw has one where the throws that it was compared with end otherwise. Sequences and
    sweeps, which are not compared, have one where an object broke.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run, a sequence or a throw of one, or labels of a sweep that stores `object_broken`.

    Examples
    --------
    >>> import xarray as xr
    >>> break_note(xr.Dataset({"object_broken": ("object", [3, 0])}))
    'An object broke: where its strength is nearly met, the verdict may depend on step and mode'
    >>> break_note(xr.Dataset({"object_broken": ("object", [0, 0])}))
    ''
    """
    if "break_check" in dataset.attrs:
        return str(dataset.attrs.get("break_note", ""))
    if "scenario" in dataset.dims or "break_note" not in dataset.attrs:
        if "object_broken" not in dataset:
            return str(dataset.attrs.get("break_note", ""))
        return BREAK_NOTE if bool((dataset["object_broken"] > 0).any()) else ""
    first = dataset.attrs.get("break_throw", 1)
    if "throw" in dataset.dims:
        return f"{BREAK_NOTE} (from throw {first} on)"
    return BREAK_NOTE if int(dataset.coords.get("throw", first)) >= first else ""


def throw_table(dataset: "xr.Dataset") -> list[dict[str, Any]]:
    """Return a row for each throw of a sequence.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `simulate_sequence`, with what it keeps by default.

    Returns
    -------
    list of dict
        `throw`; `size` before and `left` after it of each object, `broken` in it [m];
        `object_force_peak`, `drive_force_end` and least `force_margin` of each drive [N]; `locked`,
        `in_control` of each sensor on the closed rail, and `state` in words, at the end; `verdict`,
        its kind, which judges the movements before it too.
    """
    found = []
    dataset = dataset.load()
    for number in range(dataset.sizes["throw"]):
        one = dataset.isel(throw=number)
        made = checks(one)
        end = max((check.time for check in made if check.kind == "lock"), default=math.nan)
        last = [check for check in made if check.kind in _SIGNS and check.time == end]
        row: dict[str, Any] = {
            "throw": int(one["throw"]),
            "size": _values(one, "object_size"),
            "left": _values(one, "object_left"),
            "broken": _values(one, "object_broken"),
            "object_force_peak": float(one["object_force"].max()),
            "drive_force_end": one["drive_force"].values[:, -1].tolist(),
            "force_margin": np.nanmin(one["force_margin"].values, axis=1).tolist(),
            "locked": bool(one["locked"].values[-1]),
            "in_control": [bool(check.met) for check in last if check.kind == "control"],
            "state": state_text(last),
            "verdict": verdict(one, made).kind,
        }
        if "throw_temperature" in one:
            row["temperature"] = float(one["throw_temperature"])
        found.append(row)
    return found


def _values(one: "xr.Dataset", name: str) -> list[float]:
    return np.nan_to_num(one[name].values).tolist() if name in one else []


def state_text(rest: Sequence[Check]) -> str:
    """Return the reports of lock and sensors at a rest, those that are not met if any.

    Examples
    --------
    >>> lock = Check(kind="lock", name="switch", criterion="slip", met=False)
    >>> state_text([lock]), state_text([replace(lock, met=True)])
    ('not locked', 'locked')
    """
    if not rest:
        return "not judged"
    out = ["not locked" if c.kind == "lock" else f"{c.name} not in control" for c in unmet(rest)]
    both = dict.fromkeys("locked" if check.kind == "lock" else "in control" for check in rest)
    return ", ".join(out or both)
