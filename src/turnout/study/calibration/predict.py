"""What a simulation says that the bins of a measured movement should hold."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from turnout.study.calibration.evaluate import Response
from turnout.study.calibration.observed import BIN, Movement, Signal

Floats = NDArray[np.float64]


def compared(
    movement: Movement, channels: tuple[str, ...], window: tuple[float, float | None]
) -> list[tuple[Signal, NDArray[np.intp]]]:
    """Return the signals that are compared, and which of their bins.

    Parameters
    ----------
    movement : Movement
        As observed.
    channels : tuple of str
        Of the stage.
    window : tuple
        From the onset [s].

    Returns
    -------
    list of (Signal, ndarray of int)
    """
    end = movement.length if window[1] is None else min(window[1], movement.length)
    found = []
    for signal in movement.signals:
        if signal.channel not in channels:
            continue
        inside = (signal.time >= window[0]) & (signal.time + 0.5 * BIN <= end)
        bins = np.flatnonzero(inside & np.isfinite(signal.values))
        if bins.size:
            found.append((signal, bins))
    return found


def predicted(
    response: Response,
    movement: Movement,
    signal: Signal,
    bins: NDArray[np.intp],
    *,
    shift: float = 0.0,
) -> Floats:
    """Return the simulated means over bins.

    Parameters
    ----------
    response : Response
        Of the throw.
    movement : Movement
        Tells the direction.
    signal : Signal
        Tells channel, drive and time.
    bins : ndarray of int, shape (n,)
        Which bins.
    shift : float
        How much later than its marked onset the movement truly began [s].

    Returns
    -------
    ndarray, shape (n,)
        NaN where the simulation failed.
    """
    if response.failure:
        return np.full(bins.size, np.nan)
    values = _channel(response, signal)
    start = response.onsets[movement.direction] - shift
    centre = signal.time[bins] + start
    cell = response.time[1] - response.time[0]
    edges = response.time[0] + cell * (np.arange(values.size + 1) - 0.5)
    total = np.concatenate(([0.0], np.cumsum(values, dtype=np.float64) * cell))
    above = np.interp(centre + 0.5 * BIN, edges, total)
    below = np.interp(centre - 0.5 * BIN, edges, total)
    return np.asarray((above - below) / BIN, dtype=np.float64)


def _channel(response: Response, signal: Signal) -> Floats:
    rows: Mapping[str, Mapping[str, Floats]] = {
        "drive_force": response.drive_force,
        "drive_displacement": response.marker,
    }
    if signal.channel in rows:
        return rows[signal.channel][signal.drive]
    return response.object_force
