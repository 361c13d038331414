"""What a monitoring system in service stores of currents and powers: RMS windows, coarse steps.

Such systems sample 25 to 100 times a second, each value the root mean square of a current (the mean
of a power) over the window since the last, in steps of 0.01 A, and often with one transformer
around the leads of two motors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.units import CURRENT, FREQUENCY, parse_quantity
from turnout.errors import MeasurementError
from turnout.measurement.recording import RecordedChannel, Recording

Floats = NDArray[np.float64]

MOST_RATE, LEAST_RATE = 1000.0, 1.0
"""Rates that are accepted; 25 to 100 are usual [1/s]."""
COLUMNS = {
    "drive_current": ("Current", "A"),
    "drive_power": ("Active power", "W"),
    "drive_apparent_power": ("Apparent power", "VA"),
}
"""What a file of such a system calls its channels, and their units, in its order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Monitoring:
    """How a monitoring system samples the machines of a switch.

    Attributes
    ----------
    rate : float
        Values a second, each of the window before it [1/s].
    current_step, power_step : float
        Resolution [A], [W]; 0 for none.
    together : mapping of str to sequence of str
        Transformers around the leads of several drives: name and drives. Drives that are not named
        have one each.
    """

    rate: float = 50.0
    current_step: float = 0.01
    power_step: float = 1.0
    together: Mapping[str, Sequence[str]] = field(default_factory=dict)


def monitored(run: xr.Dataset, monitoring: Monitoring | None = None) -> xr.Dataset:
    """Return currents and powers as a monitoring system stores them.

    Parameters
    ----------
    run : xarray.Dataset
        `drive_current` and, where known, `drive_power` and `drive_apparent_power` (drive, time).
        Currents of induction motors are rms values of the line already.
    monitoring : Monitoring, optional

    Returns
    -------
    xarray.Dataset
        The same channels by `drive`, a transformer around several being one of them, at the ends
        of the windows. Currents are not negative: an RMS value has no sign.

    Raises
    ------
    MeasurementError
        Without currents, for a rate that the run does not resolve, or unknown drives.

    Notes
    -----
    Line currents of two motors in one transformer add up as phasors. Their phase follows from
    active and apparent power: I^2 = (sum of P)^2 + (sum of Q)^2 over (3 U)^2, written as
    I = sum of I times that of S; direct currents add up with their signs.

    Examples
    --------
    >>> time = np.arange(0.0, 0.1, 1e-3)
    >>> run = xr.Dataset(
    ...     {"drive_current": (("drive", "time"), np.full((1, 100), 1.2345))},
    ...     {"time": time, "drive": ["1"]},
    ... )
    >>> monitored(run)["drive_current"].values.tolist()
    [[1.23, 1.23, 1.23, 1.23, 1.23]]
    """
    chosen = monitoring or Monitoring()
    size = _window(run, chosen)
    drives = [str(name) for name in run["drive"].values]
    groups = _groups(drives, chosen)
    count = run.sizes["time"] // size
    channels = {
        name: run[name].transpose("drive", "time").values[:, : count * size]
        for name in ("drive_current", "drive_power", "drive_apparent_power")
        if name in run
    }
    found: dict[str, list[Floats]] = {name: [] for name in channels}
    for names in groups.values():
        rows = [drives.index(name) for name in names]
        for name, values in _together({k: v[rows] for k, v in channels.items()}).items():
            windows = values.reshape(count, size)
            current = name == "drive_current"
            mean = np.sqrt((windows**2).mean(axis=1)) if current else windows.mean(axis=1)
            step = chosen.current_step if current else chosen.power_step
            found[name].append(np.round(step * np.round(mean / step), 9) if step else mean)
    return xr.Dataset(
        {
            name: (("drive", "time"), np.array(rows), run[name].attrs)
            for name, rows in found.items()
        },
        {"time": run["time"].values[size - 1 : count * size : size], "drive": list(groups)},
        {"monitoring_rate": chosen.rate},
    )


def monitoring_of(
    *,
    rate: str = "50 Hz",
    together: Sequence[str] = (),
    current_step: str = "0.01 A",
) -> Monitoring:
    """Return a monitoring system from what a user types.

    Parameters
    ----------
    rate : str
        Values a second, such as "25 Hz".
    together : sequence of str
        Transformers around the leads of several drives: "switch=1,2".
    current_step : str
        Resolution of currents, such as "0.01 A"; "0 A" for none.

    Raises
    ------
    MeasurementError
        With all problems.

    Examples
    --------
    >>> monitoring_of(rate="25 Hz", together=["switch=1,2"]).together
    {'switch': ['1', '2']}
    """
    problems, groups, found = [], {}, {"rate": 50.0, "current_step": 0.01}
    for key, text, dimension in (
        ("rate", rate, FREQUENCY),
        ("current_step", current_step, CURRENT),
    ):
        try:
            found[key] = parse_quantity(text, dimension)
        except ValueError as error:
            problems.append(f"--{key.replace('_', '-')} '{text}': {error}")
    if not LEAST_RATE <= found["rate"] <= MOST_RATE:
        problems.append(f"--rate '{rate}': must be {LEAST_RATE:g} to {MOST_RATE:g} Hz")
    if found["current_step"] < 0.0:
        problems.append(f"--current-step '{current_step}': must be at least 0 A")
    for text in together:
        name, sign, drives = (part.strip() for part in text.partition("="))
        members = [item.strip() for item in drives.split(",") if item.strip()]
        if not sign or not name or len(members) < 2:
            problems.append(f"--together '{text}': write NAME=DRIVE,DRIVE, such as switch=1,2")
        elif name in groups:
            problems.append(f"--together '{text}': {name} is given twice")
        else:
            groups[name] = members
    if problems:
        raise MeasurementError(problems, source="monitoring")
    return Monitoring(rate=found["rate"], current_step=found["current_step"], together=groups)


def check_monitoring(monitoring: Monitoring, drives: Sequence[str]) -> None:
    """Refuse transformers around drives that are not there.

    Raises
    ------
    MeasurementError
        With all problems.
    """
    _groups(list(drives), monitoring)


def monitoring_recording(stored: xr.Dataset, *, source: str) -> Recording:
    """Return what a monitoring system stored as a recording that a file can hold.

    Parameters
    ----------
    stored : xarray.Dataset
        From `monitored`.
    source : str
        What the file says of its origin.

    Returns
    -------
    Recording
        Channels "Current 1" [A], "Active power 1" [W] and "Apparent power 1" [VA], the last two of
        machines only; the number is the drive, or the name of the transformer. A value stands at
        the end of its window.
    """
    time, rate = stored["time"].values, float(stored.attrs["monitoring_rate"])
    channels = {}
    for name, (title, unit) in COLUMNS.items():
        if name not in stored:
            continue
        for drive, values in zip(stored["drive"].values, stored[name].values, strict=True):
            if np.isnan(values).all():
                continue
            column = f"{title} {drive}"
            channels[column] = RecordedChannel(
                column, unit, values, rate=rate, start=float(time[0]), description=source
            )
    return Recording(channels, source)


def _window(run: xr.Dataset, chosen: Monitoring) -> int:
    """Return samples in a window; refuse what cannot be sampled."""
    problems = []
    if "drive_current" not in run:
        problems.append("drive_current: is missing; only drives that are machines have a current")
    if not LEAST_RATE <= chosen.rate <= MOST_RATE:
        problems.append(f"rate = {chosen.rate:g} 1/s: must be {LEAST_RATE:g} to {MOST_RATE:g}")
    size = 1
    if not problems:
        time = run["time"].values
        own = (time.size - 1) / float(time[-1] - time[0])
        size = round(own / chosen.rate)
        if abs(size * chosen.rate - own) > 1e-3 * own or size < 1 or time.size < size:
            problems.append(
                f"rate = {chosen.rate:g} 1/s: the run has {own:g} 1/s, which must be a multiple "
                "of it; take such a rate, or store the run every 1 ms (--every '1 ms')"
            )
    if problems:
        raise MeasurementError(problems, source="monitoring")
    return size


def _groups(drives: Sequence[str], chosen: Monitoring) -> dict[str, list[str]]:
    groups = {name: list(map(str, names)) for name, names in chosen.together.items()}
    taken = [name for names in groups.values() for name in names]
    wrong = sorted({n for n in taken if n not in drives or taken.count(n) > 1})
    if wrong:
        text = f"together: drive {', '.join(wrong)} is not there or named twice"
        raise MeasurementError([text], source="monitoring")
    return groups | {name: [name] for name in drives if name not in taken}


def _together(rows: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return what one transformer sees of several drives."""
    found = {
        name: np.where(np.isnan(values).all(axis=0), np.nan, np.nansum(values, axis=0))
        for name, values in rows.items()
    }
    if "drive_apparent_power" in rows and rows["drive_current"].shape[0] > 1:
        active, apparent = np.nan_to_num(rows["drive_power"]), rows["drive_apparent_power"]
        whole = np.nan_to_num(apparent)
        reactive = np.sqrt(np.maximum(whole**2 - active**2, 0.0)).sum(axis=0)
        seen = np.hypot(active.sum(axis=0), reactive)
        share = np.divide(seen, whole.sum(axis=0), out=np.ones_like(seen), where=seen > 0.0)
        found["drive_apparent_power"] = seen
        found["drive_current"] = share * np.nansum(np.abs(rows["drive_current"]), axis=0)
    return found
