"""The true onset of movements that no motor current marked.

Forces begin to grow with the cube of time, so that they give the onset to some tens of milliseconds
only, and rather too early in all movements alike. Compared on that clock, the right model would be
off by more than repeats are. The part of a movement before it touches an object gives it better.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.evaluate import Response
from turnout.calibration.measured_movements import MeasuredMovement
from turnout.calibration.predict import predicted

Floats = NDArray[np.float64]
# As far as a marked onset may be off, and how finely this is searched at first [s].
REACH, COARSE, FINE = 0.4, 0.01, 0.001
# Expected of a marked onset: beyond it, forces must say so more clearly [s].
UNCERTAINTY = 0.05
# Before the onset, and before the contact [s]; a part shorter than `LEAST` is not used.
BEFORE, CLEARANCE, LEAST = 0.3, 0.1, 0.3
# Onsets that currents mark are good to 5 ms each; three times that in all movements is a lead [s].
CLEAR_LEAD = 0.015
# Share of the largest force that a model may miss without saying something of the onset [-].
MISSED = 0.01


def with_rest(response: Response) -> Response:
    """Return a response that stands still for a while before it begins.

    A closed switch may press its rods with some kilonewtons. Simulations begin a little before the
    first onset; without this, all forces would be zero before, and a shift would be found that
    avoids the step.
    """
    if response.failure:
        return response
    cell = float(response.time[1] - response.time[0])
    count = round((BEFORE + REACH) / cell)
    time = np.concatenate([response.time[0] + cell * np.arange(-count, 0), response.time])

    def held(row: Floats) -> Floats:
        return np.concatenate([np.full(count, row[0]), row])

    return replace(
        response,
        time=time,
        drive_force={name: held(row) for name, row in response.drive_force.items()},
        marker={name: held(row) for name, row in response.marker.items()},
        object_force=held(response.object_force),
    )


def onset_shifts(movements: Sequence[MeasuredMovement], responses: Sequence[Response]) -> Floats:
    """Return how much later than marked each movement began.

    Parameters
    ----------
    movements : sequence of MeasuredMovement
        From `observe`; onsets without motor current are searched.
    responses : sequence of Response
        Of the model, one each, from `with_rest`.

    Returns
    -------
    ndarray, shape (n_movements,)
        [s]; where motor currents marked the onsets, the lead of the motors over the rods, zero for
        none; of a movement that touches its object at once, the median of the others in its
        direction.
    """
    found = np.array(
        [_shift(item, response) for item, response in zip(movements, responses, strict=True)]
    )
    clocked = np.array([item.clocked for item in movements], dtype=np.bool_)
    found[clocked] = _lead(found[clocked])
    directions = np.array([item.direction for item in movements])
    for number in np.flatnonzero(np.isnan(found)):
        alike = found[(directions == directions[number]) & np.isfinite(found)]
        found[number] = float(np.median(alike)) if alike.size else 0.0
    return found


def _lead(shifts: Floats) -> float:
    """Return how long motors run before the rods move, where all movements say so [s].

    Examples
    --------
    >>> _lead(np.array([0.149, 0.151, np.nan])), _lead(np.array([0.004, -0.003]))
    (0.15, 0.0)
    """
    known = shifts[np.isfinite(shifts)]
    lead = float(np.median(known)) if known.size > 1 else 0.0
    return lead if abs(lead) > CLEAR_LEAD else 0.0


def _shift(item: MeasuredMovement, response: Response) -> float:
    """Return the shift that makes the free part of one movement fit best; NaN where there is none.

    The free part ends where the model touches the object, on a clock that may be off itself.
    """
    end = item.length
    if item.size > 0 and np.isfinite(response.contact_time):
        end = min(end, response.contact_time - response.onsets[item.direction] - CLEARANCE)
    if response.failure or end < LEAST:
        return float("nan")

    def cost(shift: float) -> float:
        total = (shift / UNCERTAINTY) ** 2
        for signal in item.signals:
            if signal.channel != "drive_force":
                continue
            late = min(end + shift, item.length)
            inside = (signal.time >= -BEFORE) & (signal.time <= late)
            bins = np.flatnonzero(inside & np.isfinite(signal.values))
            if not bins.size:
                continue
            scale = MISSED * max(float(np.nanmax(np.abs(signal.values))), 1.0)
            away = predicted(response, item, signal, bins, shift=shift) - signal.values[bins]
            total += bins.size * float(np.mean((away / scale) ** 2))
        return total

    coarse = np.arange(-REACH, REACH + 0.5 * COARSE, COARSE)
    near = coarse[int(np.argmin([cost(shift) for shift in coarse]))]
    fine = near + np.arange(-COARSE, COARSE + 0.5 * FINE, FINE)
    return float(fine[int(np.argmin([cost(shift) for shift in fine]))])
