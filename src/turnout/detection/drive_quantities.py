"""Recorded quantities of each drive: its force, and of a machine its current and power."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import StudyError
from turnout.core.problems import choices
from turnout.core.scheme import Scheme
from turnout.detection.conditions import CURRENT, FORCE, POWER, Conditions
from turnout.detection.signal_discrepancy import Signal
from turnout.panel.foreign_object import resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.throw.drives import HELD, INRUSH, OFF
from turnout.throw.signals import drive_signals
from turnout.throw.simulate import solve_placed

Floats = NDArray[np.float64]

CHANNELS = {FORCE: "drive_force", CURRENT: "drive_current", POWER: "drive_power"}
"""Channel of a dataset of each quantity."""
ALL = "all"
CHOICES = (*CHANNELS, ALL)


def signals_of(panel: LoadedPanel, wanted: str = FORCE) -> tuple[Signal, ...]:
    """Return the signals of a panel's drives: every force, current and power of machines alone.

    Parameters
    ----------
    panel : LoadedPanel
        Whose drives.
    wanted : str
        One of `CHOICES`.

    Raises
    ------
    StudyError
        When nothing is left.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> [item.drive for item in signals_of(load_panel("uic60-760-1-15"))]
    ['1', '2']
    """
    if wanted not in CHOICES:
        raise StudyError([f'channels = "{wanted}": allowed are {choices(CHOICES)}'], source="limit")
    quantities = tuple(CHANNELS) if wanted == ALL else (wanted,)
    found = tuple(
        Signal(quantity=quantity, drive=name)
        for quantity in quantities
        for name, drive in panel.drive.items()
        if quantity == FORCE or drive.machine is not None
    )
    if not found:
        message = (
            f"channels = {wanted}: no channel is left, since no drive of panel {panel.name} is a "
            "machine; name one, as in --set drive.1.machine=jea73, or take --channels force"
        )
        raise StudyError([message], source="limit")
    return found


def stored_channels(panel: LoadedPanel) -> tuple[str, ...]:
    """Return the channels that throws of a panel keep, whatever is evaluated afterwards."""
    return tuple(dict.fromkeys(CHANNELS[item.quantity] for item in signals_of(panel, ALL)))


def read_signals(dataset: xr.Dataset, signals: Sequence[Signal]) -> Floats:
    """Return the signals of a sweep's throws, shape (n_throws, n_signals, n_times)."""
    rows = [
        dataset[CHANNELS[item.quantity]].sel(drive=item.drive).to_numpy().astype(np.float64)
        for item in signals
    ]
    return np.stack(rows, axis=1)


def after_inrush(time: Floats, state: Floats) -> NDArray[np.bool_]:
    """Return where a machine has been switched on for longer than its inrush."""
    on = (state > OFF) & (state < HELD)
    starts = time[1:][on[1:] & ~on[:-1]]
    since = np.full(time.size, np.inf)
    for start in starts:
        since = np.where(time >= start, np.minimum(since, time - start), since)
    return np.asarray(on & (since > INRUSH))


def force_peaks(panel: LoadedPanel, *, scheme: Scheme | None = None) -> Floats:
    """Return the peak absolute force of each drive in a sound throw [N]."""
    solved = solve_placed(panel, resolve_objects(panel, ()), scheme=scheme or Scheme())
    signals = drive_signals(panel, solved.mechanism, solved.history)
    force = np.asarray(signals["drive_force"][1], dtype=np.float64)
    return np.asarray(np.abs(force).max(axis=-1))


def quantities_of(signals: Sequence[Signal]) -> str:
    """Return which quantities there are, in words.

    Examples
    --------
    >>> quantities_of([Signal(quantity="force", drive="1"), Signal(quantity="current", drive="1")])
    'force and current'
    """
    return " and ".join(dict.fromkeys(item.quantity for item in signals))


def noise_of(signals: Sequence[Signal], conditions: Conditions) -> Floats:
    """Return the standard deviation of the white noise of a sample of each signal."""
    noise = {
        FORCE: conditions.noise,
        CURRENT: conditions.current_noise,
        POWER: conditions.power_noise,
    }
    return np.array([noise[item.quantity] for item in signals])
