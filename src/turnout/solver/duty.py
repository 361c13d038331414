"""Duty of a machine on each command: when its motor was on, and what switched it off."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.machine.compute import places as at

Floats = NDArray[np.float64]

LEAST_MOVE = 1e-4
"""A rod that moved by less while its motor was on never moved [m]."""


@dataclass(frozen=True, slots=True)
class Duty:
    """Duty of a machine on one command.

    Attributes
    ----------
    drive : str
    to : str
        "open" or "closed".
    command, on, off, rest : float
        Command, contactor closed, motor off, gear at rest [s]; NaN where it did not come to that.
    outcome : str
        "limit", "time-out", "overload"; "reversed" by the next command; "moving" where the motor
        was still on at the end; "stalled" where the rod never moved and no limit contact opened.
    """

    drive: str
    to: str
    command: float
    on: float
    off: float
    rest: float
    outcome: str


def machine_duties(
    name: str,
    *,
    commands: Floats,
    events: Sequence[tuple[float, str]],
    time: Floats,
    states: Floats,
) -> list[Duty]:
    """Return what one machine did on every command that it was given.

    Parameters
    ----------
    name : str
        Of its drive.
    commands : ndarray, shape (n, 2)
        Time [s] and direction, 1 closing or -1 opening; what fills the table up is infinite.
    events : sequence of (float, str)
        Time [s] and what happened.
    time : ndarray, shape (n_times,)
        [s].
    states : ndarray, shape (n_times, STATES)
        See `turnout.machine.compute.places`.
    """
    ons = [place for place, (_, text) in enumerate(events) if text == "on"]
    given = [row for row in commands.tolist() if math.isfinite(row[0])]
    found = []
    for (command, direction), first, last in zip(given, ons, [*ons[1:], None], strict=False):
        after = events[first:last]
        on = after[0][0]
        offs = [(t, text) for t, text in after if text.startswith("off ")]
        unended = (events[last][0], "off reversed") if last else (math.nan, "off moving")
        off, how = offs[0] if offs else unended
        outcome = how.removeprefix("off ")
        if outcome != "limit" and _rod_travel(time, states, on, off) < LEAST_MOVE:
            outcome = "stalled"
        to = "closed" if direction > 0 else "open"
        rest = _rest_after(off, after, time, states)
        found.append(Duty(name, to, command, on, off, rest, outcome))
    return found


def _rod_travel(time: Floats, states: Floats, on: float, off: float) -> float:
    """Return the way of the rod between two times, until the end where `off` is NaN [m]."""
    inside = (time >= on) & ~(time > off)
    rod = states[inside, at.ROD_POSITION]
    return float(np.ptp(rod)) if rod.size else 0.0


def _rest_after(
    off: float, after: Sequence[tuple[float, str]], time: Floats, states: Floats
) -> float:
    """Return when the gear stands after the cut-off, locked or not; NaN where it never does [s]."""
    if math.isnan(off):
        return math.nan
    held = [t for t, text in after if text == "locked" and t >= off]
    if held:
        return held[0]
    begin = int(np.searchsorted(time, off))
    standing = np.flatnonzero(states[begin:, at.GEAR_SPEED] == 0.0)
    return float(time[begin + standing[0]]) if standing.size else math.nan
