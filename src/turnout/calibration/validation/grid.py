"""Measured and simulated movements of a campaign on common channels and times."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.evaluate import Response
from turnout.calibration.measured_movements import BIN, MeasuredMovement, Signal
from turnout.calibration.predict import predicted

Floats = NDArray[np.float64]
OBJECT, DRIVE = "object", "drive "


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Channels and bins of time that all movements share.

    Attributes
    ----------
    channels : tuple of str
        "drive 1", "drive 2", ..., "object".
    time : ndarray, shape (n,)
        Centres of the bins from the onset [s].
    bins : ndarray of int, shape (n,)
        Which bins of the signals these are.
    """

    channels: tuple[str, ...]
    time: Floats
    bins: NDArray[np.intp]

    @classmethod
    def of(cls, movements: Sequence[MeasuredMovement]) -> "Grid":
        """Return the grid from the onset to the end of the longest movement."""
        names = dict.fromkeys(channel_of(s) for item in movements for s in item.signals)
        time = movements[0].signals[0].time
        last = max(item.length for item in movements)
        bins = np.flatnonzero((time >= 0.0) & (time + 0.5 * BIN <= last))
        ordered = sorted(names, key=lambda name: (name == OBJECT, name))
        return cls(tuple(ordered), time[bins], bins)

    def measured(self, movements: Sequence[MeasuredMovement]) -> Floats:
        """Return means over bins, shape (n_channels, n_movements, n); NaN where there are none."""
        found = self._empty(movements)
        for number, item in enumerate(movements):
            inside = self._inside(item)
            for signal in item.signals:
                row = np.where(inside, signal.values[self.bins], np.nan)
                found[self.channels.index(channel_of(signal)), number] = row
        return found

    def predicted(
        self,
        movements: Sequence[MeasuredMovement],
        responses: Sequence[Response],
        *,
        shifts: Floats,
    ) -> Floats:
        """Return the same of simulations, also where nothing was measured.

        `shifts` is how much later than marked each movement began, shape (n_movements,) [s].
        """
        found = self._empty(movements)
        rows = zip(movements, responses, shifts.tolist(), strict=True)
        for number, (item, response, shift) in enumerate(rows):
            inside, any_signal = self._inside(item), item.signals[0]
            known = {channel_of(signal): signal.recorder for signal in item.signals}
            for row, name in enumerate(self.channels):
                drive = "" if name == OBJECT else name.removeprefix(DRIVE)
                wanted = Signal(
                    channel="drive_force" if drive else "object_force",
                    drive=drive,
                    time=any_signal.time,
                    values=any_signal.values,
                    recorder=known.get(name, any_signal.recorder),
                )
                values = predicted(response, item, wanted, self.bins, shift=shift)
                found[row, number] = np.where(inside, values, np.nan)
        return found

    def _empty(self, movements: Sequence[MeasuredMovement]) -> Floats:
        return np.full((len(self.channels), len(movements), self.time.size), np.nan)

    def _inside(self, item: MeasuredMovement) -> NDArray[np.bool_]:
        return np.asarray(self.time + 0.5 * BIN <= item.length)


def channel_of(signal: Signal) -> str:
    """Return the channel of a signal as validations name it."""
    return f"{DRIVE}{signal.drive}" if signal.drive else OBJECT


def later(forces: Floats) -> Floats:
    r"""Return the change of forces with a later onset, :math:`-\dot F`.

    Parameters
    ----------
    forces : ndarray, shape (..., n_times)
        In bins of `BIN`; NaN after the end of a movement, next to which the difference is taken
        on one side [N].

    Returns
    -------
    ndarray, shape (..., n_times)
        [N/s]; NaN where the forces are.

    Examples
    --------
    >>> later(np.array([0.0, 2.0, 4.0, np.nan])).tolist()
    [-100.0, -100.0, -100.0, nan]
    """
    slope = np.gradient(forces, BIN, axis=-1)
    steps = np.diff(forces, axis=-1) / BIN
    ends = np.full((*forces.shape[:-1], 1), np.nan)
    for aside in (np.concatenate((ends, steps), axis=-1), np.concatenate((steps, ends), axis=-1)):
        slope = np.where(np.isnan(slope) & np.isfinite(forces), aside, slope)
    return np.asarray(-slope, dtype=np.float64)
