"""Checks of a throw: one ordered list that verdict, lamps, findings and commands read.

A check is one question with its answer: whether a drive slips in a movement, whether the switch
locks at the rest after it, whether a sensor is in control there, whether wheels have room. It has
the value that decided beside its limit, of one instant and one criterion.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from turnout.core.value_text import shown_unit
from turnout.panel.gauge_limits import allowed_speed
from turnout.panel.lock_rule import LOCK_RULES, SLIP, DriveStates, LockCriterion, criteria_of
from turnout.solver.record import TIME_TOLERANCE
from turnout.throw.slip import (
    LEAST_SHARE,
    Slip,
    Span,
    movements,
    periods,
    slips,
    unfinished,
)

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Side = Literal["below", "at least"]

SWITCHED_OFF = "switched off"
"""Criterion of a machine that is switched off before its end position."""
FLANGEWAY, GAUGE = "flangeway", "gauge"
OF_WHEELS = (FLANGEWAY, GAUGE)
"""Kinds of checks on the room that passing wheels have; they report no object."""


def quantity_text(value: float, unit: str, *, decimals: int = 2) -> str:
    """Return a force [N] in kilonewtons, a gap [m] in millimetres, a time [s] as it is.

    Examples
    --------
    >>> quantity_text(4409.0, "N"), quantity_text(-0.4, "N"), quantity_text(0.012971, "m")
    ('4.41 kN', '0.00 kN', '12.97 mm')
    """
    name, size = shown_unit(unit)
    # Adding zero turns a negative zero into a plain one.
    return f"{round(value / size, decimals) + 0.0:.{decimals}f} {name}"


def format_force(force: "xr.DataArray | float") -> str:
    """Return a force [N] in kilonewtons."""
    return quantity_text(float(force), "N")


def format_length(length: "xr.DataArray | float") -> str:
    """Return a length [m] in millimetres."""
    return quantity_text(float(length), "m")


def format_gap(gap: "xr.DataArray | float") -> str:
    """Return a gap [m] in millimetres; one below zero is closed.

    Examples
    --------
    >>> format_gap(0.0052), format_gap(-2e-4)
    ('5.20 mm', 'closed')
    """
    return "closed" if float(gap) < 0.0 else format_length(gap)


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One question about a throw, and the value that decided its answer.

    Attributes
    ----------
    kind : str
        "slip" of a drive in a movement, "lock" and "control" at the rest after it, "flangeway",
        "gauge".
    name : str
        Its subject: "drive 1", "switch", "TKK1", "flangeway", "gauge".
    criterion : str
        Deciding criterion: "slip", "gap" or another one of the lock rule, `SWITCHED_OFF`,
        "flangeway", "gauge"; empty for none.
    met : bool or None
        Answer; None where it cannot be judged.
    time : float
        Instant that decided [s]; NaN where it is not known.
    movement : Span or None
        After or in which; None for the whole throw.
    label : str
        Name of the value, such as "Drive 1 force".
    value, limit : float
        In SI; NaN where no number decided.
    unit : str
        SI unit, "m" or "N".
    side : str
        Whether the value must be "below" the limit or "at least" the limit.
    drive : str
        Name of the drive that decided; empty for none.
    text : str
        The answer as a clause of a sentence.
    rest : str
        At which time a rest ended before the next movement, as an object was taken out [s];
        empty for the last one.
    """

    kind: str
    name: str
    criterion: str
    met: bool | None
    time: float = math.nan
    movement: Span | None = None
    label: str = ""
    value: float = math.nan
    limit: float = math.nan
    unit: str = "m"
    side: Side = "below"
    drive: str = ""
    text: str = ""
    rest: str = ""

    @property
    def key(self) -> str:
        """Short and stable name of its own, such as "control:TKK1:return"."""
        after = "" if self.movement is None else self.movement.name
        return ":".join(filter(None, [self.kind, self.name, after, self.rest]))

    @property
    def margin(self) -> float:
        """Distance to the limit, negative beyond it.

        None is left where a check is not met on the right side of its limit, such as that of a
        clutch that slips below its nominal force.
        """
        distance = self.limit - self.value if self.side == "below" else self.value - self.limit
        return min(distance, 0.0) if self.met is False else distance

    @property
    def share(self) -> float:
        """Margin as a share of the limit [-]."""
        return self.margin / self.limit

    @property
    def tight(self) -> bool:
        """True if less than a tenth of the limit is left."""
        return self.share < LEAST_SHARE

    @property
    def numbers(self) -> str:
        """Value and limit, as in "6.43 of 6 kN"; empty if no number decided."""
        if math.isnan(self.value + self.limit):
            return ""
        unit, size = shown_unit(self.unit)
        if self.unit == "m" and self.value < 0.0:
            return f"closed, limit {self.limit / size:.4g} {unit}"
        between = "of" if self.side == "below" else "of min"
        return f"{self.value / size + 0.0:.2f} {between} {self.limit / size:.4g} {unit}"

    @property
    def left(self) -> str:
        """Margin in words, as in "0.43 over"; empty if it is not the answer.

        Of a closed gap the whole limit is left.
        """
        if not self.numbers or self.met is None:
            return ""
        if not self.met and self.margin == 0.0 and self.value != self.limit:
            return ""
        _, size = shown_unit(self.unit)
        beyond = "over" if self.side == "below" else "short"
        closed = self.unit == "m" and self.value < 0.0
        distance = self.limit if closed else abs(self.margin)
        return f"{distance / size:.2f} {'left' if self.met else beyond}"

    @property
    def said(self) -> str:
        """Label, value and limit, and by how much it is over; the label alone without numbers."""
        over = f", {self.left}" if self.met is False and self.left else ""
        return f"{self.label} {self.numbers}".rstrip() + over


def direction_of(span: Span | None) -> str:
    """Return "closing" or "opening", empty for no movement."""
    return "" if span is None else "closing" if span.to == "closed" else "opening"


class _Throw:
    """Arrays of a run that checks and lamps look at, each taken from its dataset once."""

    def __init__(self, dataset: "xr.Dataset") -> None:
        self.dataset, self.attributes = dataset, dataset.attrs
        self.time = dataset["time"].values
        self.periods, self.late = periods(dataset), unfinished(dataset)
        self.drives = [str(n) for n in dataset["drive"].values] if "drive" in dataset.coords else []
        known = "in_control" in dataset and "sensor" in dataset.coords
        self.sensors = [str(name) for name in dataset["sensor"].values] if known else []
        self.in_control = self._rows("sensor", "in_control", len(self.sensors)).astype(bool)
        self.locked = dataset["locked"].values.astype(bool) if "locked" in dataset else None
        rule = str(self.attributes.get("lock_rule", ""))
        self.criteria = LOCK_RULES.get(rule, ())
        self.open_criteria = criteria_of(rule, closes=False) if self.criteria else ()
        self.single_rail = "rail" in dataset.coords and dataset["rail"].size == 1
        self.sensor_gap = self._rows("sensor", "sensor_gap", len(self.sensors))
        limits = dataset["sensor_limit"].values if known and "sensor_limit" in dataset else math.nan
        self.sensor_limit = np.broadcast_to(limits, len(self.sensors)).tolist()
        self.slips = {(slip.drive, slip.movement): slip for slip in self._slips()}
        self.states = states = self._states()
        self.measured = {
            item.name: (item.refuses(states), item.value(states), item.limit(states))
            for item in dict.fromkeys((*self.criteria, *self.open_criteria))
        }

    def _slips(self) -> list[Slip]:
        return slips(self.dataset) if "drive_slipping" in self.dataset else []

    def _rows(self, dimension: str, name: str, count: int) -> Floats:
        if name not in self.dataset:
            return np.full((count, self.time.size), np.nan)
        found: Floats = self.dataset[name].transpose(dimension, "time").values
        return found

    def _states(self) -> DriveStates:
        dataset, count = self.dataset, len(self.drives)
        usual = self.attributes.get("lock_gap_limit", math.nan)
        own = json.loads(self.attributes.get("lock_gap_limits", "{}"))
        slipping = np.zeros((count, self.time.size), dtype=np.bool_)
        if "drive_slipping" in dataset:
            slipping = dataset["drive_slipping"].transpose("drive", "time").values.astype(bool)
        levels = np.full(count, np.nan)
        if "saturation_force" in dataset.coords:
            levels = np.broadcast_to(dataset["saturation_force"].values, count)
        return DriveStates(
            slipping=slipping,
            force=self._rows("drive", "drive_force", count),
            gap=self._rows("drive", "drive_gap", count),
            slip_limit=levels,
            gap_limit=np.array([float(own.get(name, usual)) for name in self.drives]),
        )

    def rest(self, span: Span | None, until: float) -> int | None:
        """Return the last instant before a time, or None if the movement is not over by then."""
        last = int((self.time < until - TIME_TOLERANCE).sum()) - 1
        if last < 0 or span in self.late:
            return None
        if span is not None and self.time[last] < span.end - TIME_TOLERANCE:
            return None
        return last

    def judges(self, sensor: str, to: str) -> bool:
        """Return True if a sensor is on the rail that closes in a movement to a position."""
        if "sensor_rails" not in self.attributes:  # of older files: all on the instrumented rail
            return to == "closed"
        rail = json.loads(self.attributes["sensor_rails"]).get(sensor)
        return sensor_judges(rail, to, instrumented=self.attributes.get("instrumented_rail"))


def sensor_judges(rail: str | None, to: str, *, instrumented: str | None) -> bool:
    """Return True if a sensor is on the rail that closes in a movement to a position.

    Parameters
    ----------
    rail : str or None
        Rail of the sensor; None for a pair of sensors, one on each rail.
    to : str
        "open" or "closed", of the instrumented rail.
    instrumented : str or None
        Name of that rail.
    """
    return rail is None or (to == "closed") == (rail == instrumented)


def checks(dataset: "xr.Dataset") -> list[Check]:
    """Return the checks of a throw in order.

    Parameters
    ----------
    dataset : xarray.Dataset
        A simulated run; what it has not kept is left out.

    Returns
    -------
    list of Check
        Movement by movement the slips of drives in the order of time, then lock and sensors at the
        rest after it, where an object is taken out at rest also just before; then flangeway and
        gauge.

    Examples
    --------
    >>> import xarray as xr
    >>> run = xr.Dataset({"least_flangeway": 0.0607}, attrs={"flangeway_limit": 0.058})
    >>> check = checks(run)[0]
    >>> check.label, check.met, check.numbers, check.left
    ('Flangeway', True, '60.70 of min 58 mm', '2.70 left')
    """
    if "time" not in dataset.dims or not dataset.sizes["time"]:
        return _wheel_checks(dataset)
    throw, found = _Throw(dataset), list[Check]()
    for number, (span, until) in enumerate(throw.periods):
        found += _slip_checks(throw, span, until, first=not number)
        for instant in _rests(dataset, span, until):
            rest = "" if instant == until else f"{instant:g}"
            found += [replace(check, rest=rest) for check in _rest_checks(throw, span, instant)]
    return [*found, *_wheel_checks(dataset)]


def _rests(dataset: "xr.Dataset", span: Span | None, until: float) -> list[float]:
    """Return the ends of the rest after a movement: objects taken out, and the next onset [s]."""
    items: list[dict[str, Any]] = json.loads(dataset.attrs.get("foreign_objects", "[]"))
    after = -math.inf if span is None else span.end
    taken = {item["disappears"] for item in items if item.get("disappears") is not None}
    return [*sorted(time for time in taken if after < time < until), until]


def _slip_checks(throw: _Throw, span: Span | None, until: float, *, first: bool) -> Iterator[Check]:
    """Yield whether each drive slips in a movement: slips in the order of time, then the others."""
    if "drive_slipping" not in throw.dataset:
        return
    onset = -math.inf if span is None else span.start - TIME_TOLERANCE
    during = slice(*throw.time.searchsorted((onset, until - TIME_TOLERANCE)).tolist())
    if during.start == during.stop and not first:
        return
    made = [
        _slip_check(throw, number, throw.slips.get((name, span)), span, during)
        for number, name in enumerate(throw.drives)
    ]
    slipped = [check for check in made if check.met is False]
    yield from sorted(slipped, key=lambda check: check.time)
    yield from (check for check in made if check.met is not False)


def _slip_check(
    throw: _Throw, drive: int, slip: Slip | None, span: Span | None, during: slice
) -> Check:
    name = throw.drives[drive]
    force, limit = throw.states.force[drive], float(throw.states.slip_limit[drive])
    common = Check(
        kind="slip",
        name=f"drive {name}",
        criterion=SLIP.name,
        met=True,
        movement=span,
        label=f"Drive {name} force",
        limit=limit,
        unit="N",
        drive=name,
    )
    if slip is not None:
        at = int(throw.time.searchsorted(slip.time))
        return replace(
            common,
            criterion=SWITCHED_OFF if slip.stopped else SLIP.name,
            met=False,
            time=slip.time,
            value=math.nan if slip.stopped else float(abs(force[at])),
            text=_slip_text(slip, limit),
        )
    side = -1.0 if span is not None and span.to == "open" else 1.0
    effort = np.maximum(side * force[during], 0.0) if span is not None else np.abs(force[during])
    met = None if span in throw.late else True
    if not effort.size or np.isnan(effort).all():
        return replace(common, met=met)
    most = int(np.nanargmax(effort))
    return replace(common, met=met, time=float(throw.time[during][most]), value=float(effort[most]))


def _slip_text(slip: Slip, limit: float) -> str:
    """Name a drive that slips, its slip level and time, or its switch-off."""
    if slip.stopped and slip.movement is not None:
        what = f"{slip.stopped}, {direction_of(slip.movement)}"
        return f"Drive {slip.drive} {what}, at t = {slip.time:.2f} s"
    text = f"Drive {slip.drive} slips"
    level = "" if math.isnan(limit) else f"at {format_force(limit)}"
    if slip.movement is None:
        return f"{text} {level}".rstrip()
    if slip.time < slip.movement.start - TIME_TOLERANCE:
        return f"{text} at rest{', ' if level else ''}{level}, before the first movement"
    return f"{text} {level}".rstrip() + f", {direction_of(slip.movement)}"


def _rest_checks(throw: _Throw, span: Span | None, until: float) -> Iterator[Check]:
    """Yield lock and sensors at the rest after a movement."""
    at = throw.rest(span, until)
    unknown = throw.late.get(span, "") if span is not None else ""
    if at is None and not unknown:
        return
    if throw.locked is not None:
        late = Check(
            kind="lock", name="switch", criterion="", met=None, movement=span, text=unknown
        )
        yield late if at is None else _lock_check(throw, at, span)
    for number, name in enumerate(throw.sensors):
        if not throw.judges(name, "closed" if span is None else span.to):
            continue
        yield _control_check(throw, number, at, span, unknown=unknown)


def _after(span: Span | None) -> str:
    return "" if span is None else f" after the movement to {span.to}"


def _control_check(
    throw: _Throw, sensor: int, at: int | None, span: Span | None, *, unknown: str = ""
) -> Check:
    """Return whether a sensor is in control at an instant; without one the reason for no answer."""
    name = throw.sensors[sensor]
    found = Check(
        kind="control",
        name=name,
        criterion="gap",
        met=None if at is None else bool(throw.in_control[sensor, at]),
        time=math.nan if at is None else float(throw.time[at]),
        movement=span,
        label=f"{name} gap",
        value=math.nan if at is None else float(throw.sensor_gap[sensor, at]),
        limit=throw.sensor_limit[sensor],
    )
    if found.met is None:
        return replace(found, text=unknown)
    out = f"out of control{_after(span)}: {found.said}"
    return replace(found, text=found.said if found.met else out)


def _nearest_first(check: Check) -> tuple[bool, float]:
    """Return the place of a check by its margin, last if that is not known."""
    return math.isnan(check.share), check.share


def _candidates(
    throw: _Throw, at: int, span: Span | None, criteria: Sequence[LockCriterion], *, locked: bool
) -> Iterator[list[Check]]:
    """Yield for each criterion the drives at which it holds, or refuses, nearest limit first."""
    for criterion in criteria:
        refuses, values, limits = throw.measured[criterion.name]
        found = [
            Check(
                kind="lock",
                name="switch",
                criterion=criterion.name,
                met=locked,
                time=float(throw.time[at]),
                movement=span,
                label=f"Drive {name} {criterion.quantity}",
                value=float(values[n, at]),
                limit=float(limits[n]),
                unit=criterion.unit,
                drive=name,
            )
            for n, name in enumerate(throw.drives)
            if refuses[n, at] != locked and (not locked or values[n, at] < limits[n])
        ]
        yield sorted(found, key=_nearest_first)


def _lock_check(throw: _Throw, at: int, span: Span | None) -> Check:
    """Return whether the switch is locked at an instant, by the criterion that decides."""
    locked = bool(throw.locked is not None and throw.locked[at])
    rule = throw.criteria
    if throw.single_rail and _position(throw.dataset, span) == "open":
        rule = throw.open_criteria
    ranked = [group for group in _candidates(throw, at, span, rule, locked=locked) if group]
    refused = f"the lock is refused{_after(span)}"
    if not ranked:
        text, time = "locks" if locked else refused, float(throw.time[at])
        found = Check(kind="lock", name="switch", criterion="", met=locked, time=time, text=text)
        return replace(found, movement=span)
    nearest = [group[0] for group in ranked]
    if locked:
        first = min(nearest, key=_nearest_first)
        return replace(first, text=f"locks ({', '.join(c.said for c in nearest)})")
    first, text = nearest[0], f"{refused}: {' and '.join(check.said for check in ranked[0])}"
    if first.criterion != SLIP.name:
        return replace(first, text=text)
    if _switched_off(throw, first.drive, span, at):
        first = replace(first, criterion=SWITCHED_OFF, value=math.nan)
    return replace(first, text=refused)  # the slip's own check says why


def _switched_off(throw: _Throw, drive: str, span: Span | None, at: int) -> bool:
    slip = throw.slips.get((drive, span))
    return slip is not None and bool(slip.stopped) and slip.time <= throw.time[at] + TIME_TOLERANCE


@dataclass(frozen=True, slots=True)
class WheelRoom:
    """Least room of passing wheels in a throw.

    Attributes
    ----------
    kind : str
        "flangeway" or "gauge".
    least, limit : float
        [m]; the limit is NaN for a panel without one.
    rail, place : str
        Of the least one; empty if not known.
    at_speed : str
        Line speed whose class gives the limit, in words; empty if it depends on none.
    allowed : str
        Line speed that a gauge allows, in words, and by which limits; empty for a flangeway.
    """

    kind: str
    least: float
    limit: float
    rail: str
    place: str
    at_speed: str = ""
    allowed: str = ""

    @property
    def value(self) -> str:
        """The least room in millimetres."""
        return quantity_text(self.least, "m", decimals=1 if self.kind == GAUGE else 2)

    @property
    def text(self) -> str:
        """Place and limit of the room as a clause of a sentence."""
        limit = f"{1e3 * self.limit:g}"
        if self.kind == FLANGEWAY:
            where = f" of rail {self.rail} at {self.place}" if self.rail and self.place else ""
            return f"the flangeway{where} is {self.value}, limit {limit} mm"
        wide = self.least >= self.limit
        what = "the gauge is" if wide else "the closed rail narrows the gauge to"
        where = f" at {self.place}" if self.place else ""
        return f"{what} {self.value}{where} (limit {limit}{self.at_speed})"


def wheel_rooms(dataset: "xr.Dataset") -> list[WheelRoom]:
    """Return the least flangeway and the least gauge of a run, of which they are known."""
    found = []
    for kind in (FLANGEWAY, GAUGE):
        least = float(dataset[f"least_{kind}"]) if f"least_{kind}" in dataset else math.nan
        rail, place, x = (
            str(dataset[name].values) if (name := f"least_{kind}_{end}") in dataset else ""
            for end in ("rail", "place", "x")
        )
        if not math.isnan(least):
            limit = float(dataset.attrs.get(f"{kind}_limit", math.nan))
            place = place or (f"x = {float(x):g} m" if x else "")
            room = WheelRoom(kind, least, limit, rail, place)
            found.append(_by_speed(room, dataset.attrs) if kind == GAUGE else room)
    return found


def _by_speed(room: WheelRoom, attributes: Mapping[Any, Any]) -> WheelRoom:
    """Return a gauge with the line speed of its limit, and that which it allows."""
    at = attributes.get("gauge_line_speed")
    at_speed = "" if at is None else f" mm at {3.6 * float(at):g} km/h"
    if "gauge_nominal" not in attributes:
        return replace(room, at_speed=at_speed)
    speed, by = allowed_speed(attributes, room.least)
    allowed = f"allowed {speed or 'at no speed'} {by}"
    return replace(room, at_speed=at_speed, allowed=allowed)


def _wheel_checks(dataset: "xr.Dataset") -> list[Check]:
    """Return whether wheels have room, of the rooms that the panel has a limit for."""
    return [
        Check(
            kind=room.kind,
            name=room.kind,
            criterion=room.kind,
            met=room.least >= room.limit,
            label=room.kind.capitalize(),
            value=room.least,
            limit=room.limit,
            side="at least",
            text=room.text,
        )
        for room in wheel_rooms(dataset)
        if not math.isnan(room.limit)
    ]


def unmet(found: Iterable[Check], *kinds: str) -> list[Check]:
    """Return the checks that are not met, of some kinds or of all."""
    return [item for item in found if item.met is False and (not kinds or item.kind in kinds)]


def margins(found: Iterable[Check]) -> list[Check]:
    """Return the slip check of each drive and direction with the least share left.

    They come by drive, then in the order of time. A machine that was switched off has no margin.

    Examples
    --------
    >>> slip = Check(kind="slip", name="drive 1", criterion="slip", met=True, limit=6e3, drive="1")
    >>> [check.margin for check in margins([replace(slip, value=f) for f in (2e3, 5e3, 4e3)])]
    [1000.0]
    """
    least: dict[tuple[str, str], Check] = {}
    known = (check for check in found if check.kind == "slip" and not math.isnan(check.share))
    for check in sorted(known, key=lambda check: check.share):
        least.setdefault((check.drive, direction_of(check.movement)), check)
    return sorted(least.values(), key=lambda check: (check.drive, check.time))


_MEANINGS = {
    "slip": "Force of the drive on the rail; it slips at its limit.",
    "lock": "Force or gap at the drive that decides.",
    "control": "Gap at the sensor on the rail that is closed at rest; the sensor reports control "
    "below its limit.",
    GAUGE: "Least distance between the running edges of a route, beside its closed switch rail; it "
    "must not be less than its limit.",
    FLANGEWAY: "Least distance between the open switch rail and its stock rail, which wheel "
    "flanges pass; it must not be less than its limit.",
}


def meaning_of(kind: str, dataset: "xr.Dataset") -> str:
    """Return the meaning of a kind of check in a sentence; of a lock with its rule."""
    rule = f" Locked when {lock_rule_text(dataset)}." if kind == "lock" else ""
    return f"{_MEANINGS[kind]}{rule}"


def lock_rule_text(dataset: "xr.Dataset") -> str:
    """Return when a run is locked, with the limits of its panel."""
    rule = str(dataset.attrs.get("lock_rule", "not stated"))
    if rule not in LOCK_RULES:
        return f"the rule is {rule}"
    parts = [item.holds.format(limit=_gap_limits(dataset)) for item in LOCK_RULES[rule]]
    return ", ".join([*parts, "and no movement is under way"])


def _gap_limits(dataset: "xr.Dataset") -> str:
    """Return the gap limits of the drives: one, or each with its drive."""
    own: dict[str, float] = json.loads(dataset.attrs.get("lock_gap_limits", "{}"))
    limits = set(own.values()) or {float(dataset.attrs.get("lock_gap_limit", math.nan))}
    if len(limits) == 1:
        return f"{1e3 * limits.pop():g} mm"
    return " and ".join(f"{1e3 * limit:g} mm at drive {name}" for name, limit in own.items())


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """One check at some instants.

    Attributes
    ----------
    kind, name : str
        As of `Check`.
    on : list of bool
        Whether the state holds: locked, in control, slipping.
    checks : list of Check
        The answer at each instant; not judged while the switch moves, a sensor also while its rail
        should be open.
    words : (str, str)
        Names of the state when on and when off.
    rule : str
        When it is on.
    """

    kind: str
    name: str
    on: list[bool]
    checks: list[Check]
    words: tuple[str, str]
    rule: str


def lamps(dataset: "xr.Dataset", at: Sequence[int] | None = None) -> list[Lamp]:
    """Return lock, each sensor and each drive as lamps, from the same rules as `checks`.

    Parameters
    ----------
    dataset : xarray.Dataset
        A run with `locked`, `in_control` and `drive_slipping`, or some of them.
    at : sequence of int, optional
        Numbers of the instants; default all.

    Examples
    --------
    >>> import xarray as xr
    >>> run = xr.Dataset({"locked": ("time", [True])}, {"time": [0.0]}, {"lock_rule": "no slip"})
    >>> lamps(run)[0].rule
    'no drive is at its saturation force, and no movement is under way'
    """
    throw, found = _Throw(dataset), list[Lamp]()
    instants = range(throw.time.size) if at is None else [int(number) for number in at]
    spans, rest = _span_at(dataset, throw.time), _at_rest(dataset, throw.time)
    judged = [bool(rest[n]) and spans[n] not in throw.late for n in instants]
    if throw.locked is not None:
        made = [_lock_check(throw, n, spans[n]) for n in instants]
        on = [bool(throw.locked[n]) for n in instants]
        rule, words = lock_rule_text(dataset), ("locked", "not locked")
        found.append(Lamp("lock", "switch", on, _judged(made, judged), words, rule))
    for number, name in enumerate(throw.sensors):
        on = [bool(throw.in_control[number, n]) for n in instants]
        made = [_control_check(throw, number, n, spans[n]) for n in instants]
        asked = [
            known and throw.judges(name, _position(dataset, spans[n]))
            for n, known in zip(instants, judged, strict=True)
        ]
        limit = throw.sensor_limit[number]
        rule = f"its gap is below {'its limit' if math.isnan(limit) else f'{1e3 * limit:g} mm'}"
        words = ("in control", "not in control")
        found.append(Lamp("control", name, on, _judged(made, asked), words, rule))
    if "drive_slipping" in dataset:
        found += [
            _drive_lamp(throw, number, instants, spans) for number in range(len(throw.drives))
        ]
    return found


def _drive_lamp(
    throw: _Throw, drive: int, instants: Sequence[int], spans: Sequence[Span | None]
) -> Lamp:
    name, machines = throw.drives[drive], json.loads(throw.attributes.get("machine_supplies", "{}"))
    level = float(throw.states.slip_limit[drive])
    rule, words = f"its force has reached {level / 1e3:.4g} kN", ("slips", "holds")
    if name in machines:
        rule = "its clutch slips, or it was switched off before its limit contact"
        words = ("slips or is off", "holds")
    made, on = [], [bool(throw.states.slipping[drive, n]) for n in instants]
    for n, lit in zip(instants, on, strict=True):
        off = lit and _switched_off(throw, name, spans[n], n)
        value = float(abs(throw.states.force[drive, n]))
        made.append(
            Check(
                kind="slip",
                name=f"drive {name}",
                criterion=SWITCHED_OFF if off else SLIP.name,
                met=not lit,
                time=float(throw.time[n]),
                movement=spans[n],
                label=f"Drive {name} force",
                value=math.nan if off or (not lit and value >= level) else value,
                limit=level,
                unit="N",
                drive=name,
            )
        )
    return Lamp("slip", f"drive {name}", on, made, words, rule)


def _judged(made: Sequence[Check], judged: Iterable[bool]) -> list[Check]:
    return [
        item if asked else replace(item, met=None) for item, asked in zip(made, judged, strict=True)
    ]


def _span_at(dataset: "xr.Dataset", time: Floats) -> list[Span | None]:
    """Return the present or last movement at each instant; before the first one none."""
    spans = movements(dataset)
    onsets = np.array([span.start - TIME_TOLERANCE for span in spans])
    numbers = np.searchsorted(onsets, time, side="right") - 1
    return [spans[number] if number >= 0 else None for number in numbers]


def _position(dataset: "xr.Dataset", span: Span | None) -> str:
    """Return the target position of a movement, before the first one the start position."""
    if span is not None:
        return span.to
    spans = movements(dataset)
    return "closed" if not spans or spans[0].to == "open" else "open"


def _at_rest(dataset: "xr.Dataset", time: Floats) -> Flags:
    """Flag the instants at which no movement is under way."""
    rest = np.ones(time.size, dtype=np.bool_)
    for span in movements(dataset):
        rest &= (time < span.start - TIME_TOLERANCE) | (time >= span.end - TIME_TOLERANCE)
    return rest
