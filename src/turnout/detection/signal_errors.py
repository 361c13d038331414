"""Errors of the force in currents and powers: the nominal sound throw, simulated."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from turnout.core.scheme import Scheme
from turnout.detection.conditions import FORCE
from turnout.detection.drive_quantities import after_inrush, force_peaks, read_signals
from turnout.detection.signal_discrepancy import Signal, SignalErrors, forces_only
from turnout.panel.load import LoadedPanel
from turnout.throw.drives import gain_along
from turnout.throw.simulate import simulate

Floats = NDArray[np.float64]


def signal_errors(
    panel: LoadedPanel, signals: Sequence[Signal], *, time: Floats, scheme: Scheme | None = None
) -> SignalErrors:
    """Simulate the nominal sound throw and return how errors of its forces show.

    Parameters
    ----------
    panel : LoadedPanel
        At its nominal friction.
    signals : sequence of Signal
        Of its drives.
    time : ndarray, shape (n_times,)
        Of the gains [s].
    scheme : Scheme, optional
        Numerical choices.
    """
    if all(item.quantity == FORCE for item in signals):
        peaks = force_peaks(panel, scheme=scheme)
        names = list(panel.drive)
        own_peaks = np.array([peaks[names.index(item.drive)] for item in signals])
        return forces_only(own_peaks, count=time.size)
    dataset = simulate(panel, scheme=scheme)
    instants = dataset["time"].to_numpy()
    values = read_signals(dataset.expand_dims("scenario"), signals)[0]
    amplitudes, peaks_of, gains = [], [], []
    for item, row in zip(signals, values, strict=True):
        force = dataset["drive_force"].sel(drive=item.drive).to_numpy()
        peaks_of.append(float(np.abs(force).max()))
        if item.quantity == FORCE:
            amplitudes.append(peaks_of[-1])
            gains.append(np.ones(time.size))
            continue
        state = dataset["drive_state"].sel(drive=item.drive).to_numpy()
        used = np.isfinite(row) & after_inrush(instants, state)
        amplitudes.append(float(np.abs(row[used]).max()))
        own = gain_along(panel, item.drive, item.quantity, force=force, state=state)
        gains.append(own[np.clip(np.searchsorted(instants, time), 0, instants.size - 1)])
    return SignalErrors(
        amplitude=np.array(amplitudes), force_peak=np.array(peaks_of), gain=np.array(gains)
    )
