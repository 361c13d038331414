"""Warnings about a panel: small margins, idle chairs, narrow flangeway, unusual values, flutter.

Margins, chairs and flangeway come from a throw without an object, flutter from the modes about
steady sliding.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import xarray as xr

from turnout.mechanism.drive_machines import blind_currents, weak_motors
from turnout.mechanism.rail_sections import severed_steel
from turnout.mechanism.rest import resting_slips
from turnout.metric.stability import FACTORS, friction_stability
from turnout.metric.summary import ends_inaccurate
from turnout.metric.test_piece import PieceLimit
from turnout.panel.lock_rule import SLIP
from turnout.panel.model import Panel
from turnout.panel.unusual import unusual_values
from turnout.throw.checks import (
    FLANGEWAY,
    GAUGE,
    SWITCHED_OFF,
    Check,
    checks,
    direction_of,
    unmet,
    wheel_rooms,
)
from turnout.throw.slip import LEAST_SHARE, STOPPED, machine_throws, periods, unfinished

OF_DRIVES = (SLIP.name, SWITCHED_OFF)
"""Criteria of a lock that the check of the drive reports too."""
# A chair that never bears more than this does not carry [N].
LEAST_LOAD = 1.0


@dataclass(frozen=True, slots=True)
class Concern:
    """One warning about a panel.

    Attributes
    ----------
    what, where, number, remedy : str
        For the screen, with units; no remedy where the number says it.
    """

    what: str
    where: str
    number: str
    remedy: str

    @property
    def text(self) -> str:
        """All of it in one line."""
        said = f"{self.what}: {self.where}: {self.number}"
        return f"{said}; {self.remedy}" if self.remedy else said


def concerns(dataset: xr.Dataset) -> list[Concern]:
    """Return faults of a switch that a throw without an object shows.

    Parameters
    ----------
    dataset : xarray.Dataset
        A simulated run with drive forces, flangeway and chair forces.

    Returns
    -------
    list of Concern
        Runs that ended early or are inaccurate, machines that do not arrive, drives within a tenth
        of their slip level in either direction, a flangeway below its limit, chairs that never
        carry; empty where all is well.
    """
    found = []
    if dataset.attrs.get("foreign_objects", "[]") != "[]":
        found.append(
            Concern(
                "thrown with an object",
                "the panel file",
                "it has foreign objects of its own",
                "take them out to see the switch alone",
            )
        )
    if not dataset.attrs.get("complete", True):
        message = str(dataset.attrs.get("outcome_message", "ended early"))
        what, where = "throw not complete", f"t = {_last_time(dataset):.3f} s"
        remedy = "what follows holds until then only"
        if ends_inaccurate(dataset):
            what, where = "throw is inaccurate", "its whole time"
            remedy = "the warnings below are not reliable either"
        found.append(Concern(what, where, message, remedy))
    if not dataset.sizes.get("time", 0):
        return found
    found, made = [*found, *_not_arriving(dataset)], checks(dataset)
    found += [*_near_limits(dataset, made), *_narrow(dataset, made)]
    return [*found, *_idle_chairs(dataset)]


def _last_time(dataset: xr.Dataset) -> float:
    return float(dataset["time"][-1]) if dataset.sizes.get("time", 0) else 0.0


def _not_arriving(dataset: xr.Dataset) -> list[Concern]:
    """Return the machines that never reach their limit contact, and movements that go on."""
    what, remedy = "machine does not arrive", "another machine, a stronger supply or less friction"
    late, found = unfinished(dataset), []
    for span, until in periods(dataset):
        if span is None:
            continue
        if span in late:
            found.append(Concern(what, f"movement '{span.name}'", late[span], remedy))
            continue
        found += [
            Concern(
                what,
                f"drive {item['drive']}, {item['machine']}, {direction_of(span)}",
                f"{STOPPED[item['outcome']]}, {item['off'] - item['on']:.1f} s after its contactor",
                remedy,
            )
            for item in machine_throws(dataset)
            if item["outcome"] in STOPPED and span.start <= item["on"] < until
        ]
    return found


def _near_limits(dataset: xr.Dataset, made: list[Check]) -> list[Concern]:
    """Return drives near their slip level and refused locks and sensors."""
    found = []
    for check in made:
        if check.kind == "slip" and check.numbers and check.tight:
            place = float(dataset["drive_x"].sel(drive=check.drive))
            left = "nothing left" if check.margin <= 0 else (
                f"{check.left.partition(' ')[0]} kN ({100 * check.share:.1f} %) left"
            )  # fmt: skip
            found.append(
                Concern(
                    "drive near its slip level",
                    f"drive {check.drive} at x = {place:g} m, {direction_of(check.movement)}",
                    f"{check.numbers}, {left}, at least {100 * LEAST_SHARE:.0f} % wanted",
                    "less friction, another drive or a higher slip level; "
                    "a slip here is no trapped object",
                )
            )
        elif check in unmet(made, "lock", "control") and check.criterion not in OF_DRIVES:
            what = "lock is refused" if check.kind == "lock" else "sensor out of control"
            after = f", after the movement to {check.movement.to}" if check.movement else ""
            remedy = "more over-travel at the nearest drive, or a higher limit"
            found.append(Concern(what, f"{check.name}{after}", check.said or check.text, remedy))
    return found


def _narrow(dataset: xr.Dataset, made: list[Check]) -> list[Concern]:
    """Return flangeway and gauge below their limits."""
    rooms = {room.kind: room for room in wheel_rooms(dataset)}
    return [
        Concern(
            f"{check.kind} below its limit",
            f"rail {rooms[check.kind].rail} at {rooms[check.kind].place}",
            f"{check.numbers}, {check.left}",
            REMEDIES[check.kind],
        )
        for check in unmet(made, *REMEDIES)
    ]


REMEDIES = {
    FLANGEWAY: "more stroke or over-travel at the nearest drive, or a drive closer to the place",
    GAUGE: "a smaller fit gap, a stop or a drive nearer to the place, or fit_gap_is_design",
}


def _idle_chairs(dataset: xr.Dataset) -> list[Concern]:
    if "chair_normal_force" not in dataset:
        return []
    largest = dataset["chair_normal_force"].max("time")
    found = []
    for rail in largest["rail"].values:
        loads = largest.sel(rail=rail)
        idle = loads["chair"].values[(loads < LEAST_LOAD).values]
        for chair in idle:
            load, x = float(loads.sel(chair=chair)), float(dataset["chair_x"].sel(chair=chair))
            found.append(
                Concern(
                    "chair never carries",
                    f"chair {chair} under rail {rail} at x = {x:g} m",
                    f"at most {load:.1f} N at any time",
                    f"check its height, chair.{chair}.clearance and chair.{chair}.foot_height",
                )
            )
    return found


REMEDY = "more chair.damping or less chair.friction_coefficient"


def panel_concerns(panel: Panel, dataset: xr.Dataset) -> list[Concern]:
    """Return the warnings about a panel.

    Parameters
    ----------
    panel : Panel
        The panel.
    dataset : xarray.Dataset
        A throw of it without an object.

    Returns
    -------
    list of Concern
        Unusual values, steel that planing severs, drives that slip at rest, those of the throw
        (`turnout.metric.panel_check.concerns`), then flutter.
    """
    return [
        *file_concerns(panel),
        *resting_concerns(panel),
        *blind_concerns(panel),
        *supply_concerns(panel, end=max(panel.schedule.end, _last_time(dataset))),
        *concerns(dataset),
        *flutter_concerns(panel),
    ]


def piece_concerns(panel: Panel, limits: Iterable[PieceLimit]) -> list[Concern]:
    """Return the drives that lock on a test piece as thick as their gap limit.

    Parameters
    ----------
    panel : Panel
        The panel.
    limits : iterable of PieceLimit
        The least piece that is refused, by drive (`turnout.metric.test_piece.least_piece`).

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> (concern,) = piece_concerns(load_panel("sb2"), [PieceLimit("1", 10.4e-3, "slip", 15e-3)])
    >>> concern.number
    'refuses to lock from 10.4 mm on, limit 5 mm'
    """
    found = []
    for item in limits:
        allowed = panel.gap_limits()[item.drive]
        if not item.size > allowed * (1 + 1e-9):
            continue
        size = f"refuses to lock from {1e3 * item.size:.1f} mm on"
        if math.isinf(item.size):
            size = f"locks on every piece up to {1e3 * item.largest:g} mm"
        found.append(
            Concern(
                "locks on the test piece",
                f"drive {item.drive}",
                f"{size}, limit {1e3 * allowed:g} mm",
                f"more drive.{item.drive}.over_travel_closed or a lower saturation_force",
            )
        )
    return found


def file_concerns(panel: Panel) -> list[Concern]:
    """Return the warnings that need no throw: unusual values, steel that planing severs."""
    return [*unusual_concerns(panel), *planing_concerns(panel)]


def unusual_concerns(panel: Panel) -> list[Concern]:
    """Return the values that no switch has, which need no throw to be seen.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> (concern,) = unusual_concerns(load_panel("sb1").with_overrides({"gravity": 1000.0}))
    >>> concern.text
    'unusual value: gravity = 1000 m/s^2: usual is 0 to 30 m/s^2; check value and unit'
    """
    return [
        Concern("unusual value", item.given, item.usual, "check value and unit")
        for item in unusual_values(panel)
    ]


LOST_SHARE = 0.05
"""A warning follows if planing severs more than this share of the remaining section [-]."""


def planing_concerns(panel: Panel) -> list[Concern]:
    """Return the stations at which planing severs a part of the switch rail, such as its head.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> planing_concerns(load_panel("uic60-760-1-15"))
    []
    """
    found = []
    used = dict.fromkeys(rail.section for rail in panel.rail.values())
    for name in (section for section in used if section in panel.planed_section):
        severed = [item for item in severed_steel(panel, name) if item.share > LOST_SHARE]
        if not severed:
            continue
        worst = max(severed, key=lambda item: item.share)
        places = ", ".join(f"{1e3 * item.running_edge_offset:g}" for item in severed)
        found.append(
            Concern(
                "planing severs a part of the switch rail",
                f"planed_section.{name} at running_edge_offset {places} mm",
                f"{1e6 * worst.area:.0f} mm2 are left out at {1e3 * worst.running_edge_offset:g} "
                f"mm; what remains ends {1e3 * worst.height:.0f} mm above the underside",
                "check outlines, running_edge and seat_height (turnout panel sections --plot)",
            )
        )
    return found


def blind_concerns(panel: Panel) -> list[Concern]:
    """Return the machines whose current hardly changes with the load.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> blind_concerns(load_panel("uic60-760-1-15"))
    []
    """
    return [
        Concern("blind current", f"drive {name}", text, "")
        for name, text in blind_currents(panel).items()
    ]


def supply_concerns(panel: Panel, *, end: float | None = None) -> list[Concern]:
    """Return the machines whose motor is too weak for its clutch, or loses a phase too late.

    Too late is after the `end` of a throw; default that of the schedule [s].

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("sb1", overrides={"drive.1.machine": "s700k"})
    >>> weak = panel.with_overrides({"machine.s700k.supply.voltage": 100.0})
    >>> print(supply_concerns(weak)[0].number)
    s700k: the motor stalls before the clutch slips (breakdown 0.791 N m, clutch 2.1 N m)
    """
    found = [
        Concern(
            "motor too weak",
            f"drive {name}",
            text,
            "raise supply.voltage, lower supply.line_resistance or clutch.torque",
        )
        for name, text in weak_motors(panel).items()
    ]
    end = panel.schedule.end if end is None else end
    for name, drive in panel.drive.items():
        lost = panel.machine[drive.machine].supply.phase_lost_at if drive.machine else None
        if lost is not None and lost > end:
            late = f"supply.phase_lost_at = {lost:g} s is after the end, {end:g} s"
            remedy = "without effect; give an earlier time, or a later schedule.end"
            found.append(Concern("phase lost too late", f"drive {name}", late, remedy))
    return found


def resting_concerns(panel: Panel) -> list[Concern]:
    """Return the drives whose closing force is beyond their slip level.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> resting_concerns(load_panel("uic60-760-1-15"))
    []
    """
    return [
        Concern(
            "drive slips at rest",
            f"drive {item.drive} against rail {item.rail}",
            f"{item.key} of {1e3 * item.reach:g} mm needs {item.force / 1e3:.2f} kN, "
            f"it slips at {item.limit / 1e3:.2f} kN",
            f"less than {1e3 * item.most:.2f} mm of {item.key}, or a higher slip level",
        )
        for item in resting_slips(panel)
    ]


def concern_lines(panel: Panel, found: list[Concern]) -> list[str]:
    """Return the text of a checked panel: a line per warning, or the checks found in order.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> concern_lines(load_panel("uic60-760-1-15"), [])
    ['no warnings: force margins, flangeway, chairs and flutter are in order']
    """
    if found:
        return [f"warning: {concern.text}" for concern in found]
    if panel.flangeway is not None:
        return ["no warnings: force margins, flangeway, chairs and flutter are in order"]
    return [
        "no warnings: force margins, chairs and flutter are in order; "
        "the flangeway was not judged, the file has no flangeway.limit"
    ]


def piece_lines(limits: Iterable[PieceLimit]) -> list[str]:
    """Return the text of the least pieces that are refused.

    Examples
    --------
    >>> piece_lines([PieceLimit("1", 3.2e-3, "slip", 15e-3)])
    ['test piece: drive 1 refuses to lock from 3.2 mm on, by slip']
    """
    return [f"test piece: {item.text}" for item in limits]


def flutter_concerns(panel: Panel, *, cutoff_frequency: float = float("inf")) -> list[Concern]:
    """Return concerns about flutter of the rails in motion, at their friction or a quarter more.

    Parameters
    ----------
    panel : Panel
        The panel.
    cutoff_frequency : float
        As in `turnout.metric.stability.friction_stability`: a finite one saves time [Hz].

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> flutter_concerns(load_panel("sb1"))
    []
    """
    if not panel.movement:
        return []
    for factor in FACTORS:
        found = friction_stability(panel, friction_factor=factor, cutoff_frequency=cutoff_frequency)
        if found.fault is not None:
            return [Concern(*found.fault, REMEDY)]
    return []
