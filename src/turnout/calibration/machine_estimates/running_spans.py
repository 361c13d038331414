"""When the motors of a campaign ran, ran steadily and slipped: cut from currents."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.calibration.machine_estimates.current_fit import (
    STEP,
    RunningSpan,
    SlipLevel,
    slip_level,
)
from turnout.core.running_current import LARGEST_ZERO, running_time

Floats = NDArray[np.float64]

SHARP = "drive_current_unfiltered"
SETTLED = 0.4
"""After the contactor, when the inrush is over [s]."""
MARGIN = 0.15
"""Before the cut-off, which the moving average spreads [s]."""
LEAST_RUN = SETTLED + MARGIN
"""A motor that ran for less shows no steady current [s]."""
OVERRUN = 1.0
"""A motor that ran longer than the shortest tenth by this slipped until its time-out [s]."""
SLIP_BAND, LEAST_SLIP = 0.02, 0.5
"""A slipping span stays within this share of its last value, for so long at least [-, s]."""


def ran_spans(campaign: xr.Dataset, drive: str, direction: str) -> list[RunningSpan]:
    """Return the movements of a drive in which its motor ran."""
    time = campaign["time"].values
    rows = np.flatnonzero(campaign["direction"].values == direction)
    sign = 1.0 if direction == "closing" else -1.0
    found = []
    for number in rows:
        one = campaign.isel(movement=int(number))
        current = one["drive_current"].sel(drive=drive).values
        kept = np.isfinite(current)
        raw = one[SHARP].sel(drive=drive).values[kept] if SHARP in one else current[kept]
        ran = _switched(time[kept], current[kept], raw)
        if ran is None:
            continue
        freed, on, off = ran
        load = others = np.full(freed.size, np.nan)
        if "drive_force" in campaign:
            forces = sign * one["drive_force"].transpose("drive", "time").values[:, kept]
            row = list(map(str, campaign["drive"].values)).index(drive)
            if np.isfinite(forces[row]).all():
                load = forces[row]
                others = np.nansum(np.delete(forces, row, axis=0), axis=0)
        every = slice(None, None, max(1, round(STEP / float(time[1] - time[0]))))
        at = time[kept][every]
        span = RunningSpan(
            name=str(one["movement"].values),
            number=int(number),
            on=on,
            off=off,
            time=at,
            current=freed[every],
            load=load[every],
            others=others[every],
            usable=(at >= on + SETTLED) & (at <= off - MARGIN),
        )
        found.append(span)
    return found


def _switched(time: Floats, current: Floats, raw: Floats) -> tuple[Floats, float, float] | None:
    """Return the current freed of sign and zero of its clamp, and when the motor was on [s].

    That is read from the unfiltered current; the moving average adds half of its window to either
    end. None where the motor did not run for long enough to be of use.
    """
    on, off = running_time(time, raw)
    if not off - on >= LEAST_RUN:
        return None
    sign = 1.0 if np.median(current[(time >= on) & (time <= off)]) > 0.0 else -1.0
    current = sign * current
    before, after = current[time < on - 0.1], current[time > off + 0.6]
    if before.size and abs(np.median(before)) < LARGEST_ZERO:
        zero = np.full(time.size, np.median(before))
        if after.size and abs(np.median(after)) < LARGEST_ZERO:  # a clamp that drifts
            last = float(np.median(after))
            zero += (last - zero) * np.clip((time - on) / (off + 0.6 - on), 0.0, 1.0)
        current = current - zero
    return current, on, off


def steady_and_slipping(
    ran: Sequence[RunningSpan], usual: float
) -> tuple[list[RunningSpan], list[SlipLevel]]:
    """Cut the movements into steady running and slipping."""
    spans, levels = [], []
    for span in ran:
        if span.duration > usual + OVERRUN:
            until = np.flatnonzero(span.time <= span.off - MARGIN)
            last = float(np.median(span.current[until[-round(0.4 / STEP) :]]))
            off = np.flatnonzero(np.abs(span.current[until] - last) > SLIP_BAND * last)
            first = until[off[-1]] + round(0.2 / STEP) if off.size else until[0]
            slips = slice(first, until[-1] + 1)
            if (slips.stop - slips.start) * STEP >= LEAST_SLIP:
                current, held = span.current[slips], span.load[slips]
                levels.append(slip_level(span.name, number=span.number, current=current, held=held))
                steady = span.usable & (span.time < span.time[first] - 0.4)
                spans.append(replace(span, usable=steady))
                continue
        spans.append(span)
    return spans, levels
