"""Prediction of the bins of a measured movement by a simulation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.evaluate import Response
from turnout.calibration.measured_movements import BIN, MeasuredMovement, Signal

Floats = NDArray[np.float64]


def compared(
    movement: MeasuredMovement, channels: tuple[str, ...], window: tuple[float, float | None]
) -> list[tuple[Signal, NDArray[np.intp]]]:
    """Return the signals that are compared, and which of their bins.

    Parameters
    ----------
    movement : MeasuredMovement
        From `observe`: bins of `BIN` seconds with the samples in each.
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


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """A response as the parts of a movement see it, integrated once for any onset.

    Attributes
    ----------
    centres : tuple of ndarray
        Of the bins of each part, from the onset [s].
    onset : float
        On the schedule of the response [s].
    edges : ndarray, shape (n + 1,)
        Of the cells of the response [s].
    totals : tuple of ndarray, shape (n + 1,)
        Integral of each part's signal up to each edge.
    failed : bool
        Whether there is no response.
    """

    centres: tuple[Floats, ...]
    onset: float
    edges: Floats
    totals: tuple[Floats, ...]
    failed: bool

    def row(self, shift: float, rate: float = 0.0) -> Floats:
        """Return the means over all bins, part after part; NaN where the simulation failed.

        Parameters
        ----------
        shift : float
            How much later than its marked onset the movement truly began [s].
        rate : float
            Share by which the seconds of the recorder are too short [-].
        """
        if self.failed:
            return np.full(sum(centre.size for centre in self.centres), np.nan)
        rows = []
        for centre, total in zip(self.centres, self.totals, strict=True):
            middle = centre / (1.0 + rate) + (self.onset - shift)
            ends = np.interp(
                np.concatenate((middle + 0.5 * BIN, middle - 0.5 * BIN)), self.edges, total
            )
            rows.append((ends[: middle.size] - ends[middle.size :]) / BIN)
        return np.concatenate(rows)


def prediction(
    response: Response, movement: MeasuredMovement, parts: Sequence[tuple[Signal, NDArray[np.intp]]]
) -> Prediction:
    """Make a response ready to be compared with the parts of a movement.

    Parameters
    ----------
    response : Response
        Of the throw.
    movement : MeasuredMovement
        Its direction selects the movement of the response.
    parts : sequence of (Signal, ndarray of int)
        With channel, drive and bins.
    """
    centres = tuple(signal.time[bins] for signal, bins in parts)
    if response.failure:
        return Prediction(centres, 0.0, np.zeros(0), (), failed=True)
    cell = response.time[1] - response.time[0]
    return Prediction(
        centres,
        onset=response.onsets[movement.direction],
        edges=response.time[0] + cell * (np.arange(response.time.size + 1) - 0.5),
        totals=tuple(
            np.concatenate(
                (
                    [0.0],
                    np.cumsum(_recorded(response, signal), dtype=np.float64) * cell,
                )
            )
            for signal, _ in parts
        ),
        failed=False,
    )


def predicted(
    response: Response,
    movement: MeasuredMovement,
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
    movement : MeasuredMovement
        Its direction selects the movement of the response.
    signal : Signal
        With channel, drive and time.
    bins : ndarray of int, shape (n,)
        Numbers of bins of the movement, from 0.
    shift : float
        How much later than its marked onset the movement truly began [s].

    Returns
    -------
    ndarray, shape (n,)
        NaN where the simulation failed.
    """
    return prediction(response, movement, [(signal, bins)]).row(shift)


def _recorded(response: Response, signal: Signal) -> Floats:
    """Return a signal of a response as its recorder keeps it."""
    values = _channel(response, signal)
    return signal.recorder.applied(response.time, values) if signal.recorder else values


def _channel(response: Response, signal: Signal) -> Floats:
    rows: Mapping[str, Mapping[str, Floats]] = {
        "drive_force": response.drive_force,
        "drive_displacement": response.marker,
    }
    if signal.channel in rows:
        return rows[signal.channel][signal.drive]
    return response.object_force
