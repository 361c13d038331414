"""A verdict in words: what it is called, what to do, and the lines that say it."""

from typing import TYPE_CHECKING

import numpy as np

from turnout.detection.detector.judging import ADJUSTED
from turnout.detection.detector.object_kinds import kinds_in_words
from turnout.detection.detector.throw_layout import CLOSING

if TYPE_CHECKING:
    from turnout.detection.detector.throw_verdict import Verdict

SOUND, ALARM, CAUSE = "sound", "object", "other cause"
UNKNOWN, CANNOT = "unknown deviation", "cannot judge"
OPEN_ADVICE = "check lock and end positions before trains pass: a gap is inferred above its limit"
MOST_SAID = 3
"""Causes whose odds are said in words."""

ADVICE = {
    SOUND: "nothing",
    ALARM: "throw again; if it is called again, inspect the place before trains pass",
    CAUSE: "no object is needed to explain it; maintenance at the next opportunity",
    UNKNOWN: "fits neither a sound switch nor a known cause: throw again, then inspect",
    CANNOT: "record again; the throw counts as not supervised",
}
CAUSE_ADVICE = {
    "dry chairs": "grease the slide chairs",
    ADJUSTED: "confirm the adjustment and take a new history: turnout detect learn",
    "clutch": "check the clutch of the drive that slips early",
    "loose rod": "check rod, bushing and bolts of the drive",
    "frozen blade": "clear ice from the slide chairs, check the heating",
    "in-drive": "check gear, bearings, brushes and cable of the drive that is slow",
    "supply": "check the supply of the drives: voltage, cable, contacts",
    "slow drive": "check supply, gear, brushes and cable of the drive",  # detectors of format 3
    "other speed": "check supply, sampling rate, and whether the panel has the durations of these "
    "drives; until then an object may go unnoticed",
    "force sensor": "check gain and zero of the force sensor; until then an object may go "
    "unnoticed",
}


def verdict_lines(verdict: "Verdict") -> list[str]:
    """Return a verdict in words, a few lines."""
    if verdict.status == CANNOT:
        return [f"{verdict.name}: cannot judge: {verdict.reason}", f"  next: {verdict.advice}"]
    head = f"{verdict.name}: {verdict.status}"
    if verdict.status == ALARM and verdict.size is not None:
        size = size_in_words(verdict.size.middle, verdict.size.low, verdict.size.high)
        head += f", {size} at {' or '.join(verdict.places)}"
        head += f", kind {kinds_in_words(verdict.kinds)}" if verdict.kinds else ""
    elif verdict.status == CAUSE:
        head += f": {verdict.cause}"
    if called := [gap.name for gap in verdict.gaps if gap.called]:
        head += f", gap above its limit at {', '.join(called)}"
    head += (
        f" (log odds {verdict.log_ratio:+.1f}, alarm from {verdict.threshold:.1f} = "
        f"{verdict.false_alarm_rate:g} false alarms a throw, {verdict.history} throws known"
        f"{', by its closing alone' if verdict.part == CLOSING else ''})"
    )
    found = [head]
    for gap in verdict.gaps:
        flag = "above" if gap.called else "below"
        gap_size = size_in_words(gap.middle, gap.low, gap.high)
        found.append(
            f"  gap at {gap.name}: {gap_size}, {flag} its limit "
            f"of {1e3 * gap.limit:.0f} mm (probability above {gap.above:.2f})"
        )
    if inferred := _inferred(verdict):
        found.append(f"  inferred: {inferred}")
    for item in verdict.changes:
        change = f"{item.force:+.{2 if item.unit == 'A' else 0}f} {item.unit}"
        found.append(f"  drive {item.drive}: {change}, {item.time:.2f} s after closing began")
    if verdict.status != SOUND and (likelier := _likelier(verdict)):
        found.append(f"  likelier than a sound switch: {likelier}")
    if verdict.excluded and verdict.status != SOUND:
        found.append(f"  not: {', '.join(verdict.excluded)}")
    found.append(f"  next: {verdict.advice}")
    return found


def _inferred(verdict: "Verdict") -> str:
    """Return what lock and control would report; nothing of one without a gap."""
    both = (("locked", verdict.locked), ("in control", verdict.in_control))
    return ", ".join(
        f"{name} {'yes' if is_so else 'no'}" for name, is_so in both if is_so is not None
    )


def _likelier(verdict: "Verdict") -> str:
    """Return the causes with the highest odds above 1, with the logarithms of these."""
    above = sorted((-odds, name) for name, odds in verdict.odds.items() if odds > 1.0)
    return ", ".join(f"{name} (log odds {np.log(-odds):.1f})" for odds, name in above[:MOST_SAID])


def size_in_words(middle: float, low: float, high: float) -> str:
    """Return a length and its interval in millimetres."""
    return f"{1e3 * middle:z.1f} mm ({1e3 * low:z.1f} to {1e3 * high:z.1f})"
