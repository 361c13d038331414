"""Currents, voltages and powers as a monitoring system in service stores them.

Such systems sample 25 to 100 times a second, each value the root mean square of a current or
voltage (the mean of a power) over the window since the last, in steps of 0.01 A within a range, and
often with one transformer around the leads of two motors.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import MeasurementError
from turnout.core.problems import choices
from turnout.core.units import CURRENT, FREQUENCY, POWER, VOLTAGE, parse_quantity
from turnout.measurement.chain.recorder import Recorder
from turnout.measurement.recording import RecordedChannel, Recording

Floats = NDArray[np.float64]

LIMITS = {
    "rate": (FREQUENCY, 1.0, 1000.0),
    "current_step": (CURRENT, 0.0, 100.0),
    "power_step": (POWER, 0.0, 100e3),
    "voltage_step": (VOLTAGE, 0.0, 100.0),
    "current_range": (CURRENT, 0.0, 1e3),
    "power_range": (POWER, 0.0, 1e6),
}
"""Dimension of each setting, and the range that is accepted; rates of 25 to 100 are usual [SI]."""
ROUNDING = 1e-6
"""Share of a window, and of an apparent power, that is rounding [-]."""
COLUMNS = {
    "drive_current": ("Current", "A"),
    "drive_power": ("Active power", "W"),
    "drive_apparent_power": ("Apparent power", "VA"),
    "drive_voltage": ("Voltage", "V"),
}
"""Names of the channels in a file of such a system, and their units, in its order."""
ROOT_MEAN_SQUARES = ("drive_current", "drive_voltage")
"""Channels of which a value is the root mean square of its window; the others have means."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Monitoring:
    """Sampling of the machines of a switch by a monitoring system.

    Attributes
    ----------
    rate : float
        Values a second, each of the window before it [1/s].
    current_step, power_step, voltage_step : float
        Resolution [A], [W], [V]; 0 for none.
    current_range, power_range : float
        Largest value [A], [W]; 0 for none.
    together : mapping of str to sequence of str
        Transformers around the leads of several drives: name and drives. Drives that are not named
        have one each.
    """

    rate: float = 50.0
    current_step: float = 0.01
    power_step: float = 1.0
    voltage_step: float = 0.1
    current_range: float = 0.0
    power_range: float = 0.0
    together: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def recorder(self, channel: str) -> Recorder:
        """Return the converter of a channel of `COLUMNS`."""
        if channel == "drive_voltage":
            return Recorder(resolution=self.voltage_step)
        if channel == "drive_current":
            return Recorder(resolution=self.current_step, saturation=self.current_range)
        return Recorder(resolution=self.power_step, saturation=self.power_range)


SYSTEMS: Mapping[str, Monitoring] = MappingProxyType(
    {
        # 23,806 throws of eight hydraulic machines: 10 A and 5 kW over 255 steps.
        "zyj7": Monitoring(
            rate=25.0,
            current_step=10.0 / 255,
            power_step=5e3 / 255,
            current_range=10.0,
            power_range=5e3,
        ),
        # 1,010 throws of six machines with three phases, one with a wattmeter: 1 mA, 0.1 W, 0.1 V.
        "switchmonitor": Monitoring(rate=25.0, current_step=1e-3, power_step=0.1),
    }
)
"""Systems in service by name; steps of the public recordings of SwitchMonitor (linhuanwen)."""


def monitored(run: xr.Dataset, monitoring: Monitoring | None = None) -> xr.Dataset:
    r"""Return currents, voltages and powers as a monitoring system stores them.

    Parameters
    ----------
    run : xarray.Dataset
        `drive_current` and, where known, `drive_power`, `drive_apparent_power` and `drive_voltage`
        (drive, time); or the throw of one machine on a one-mass rail. Currents of induction motors
        are rms values of the line already.
    monitoring : Monitoring, optional

    Returns
    -------
    xarray.Dataset
        The same channels by `drive`, a transformer around several being one of them, at the ends
        of the windows. Currents are not negative: an RMS value has no sign.

    Raises
    ------
    MeasurementError
        With all problems: no currents, a rate that the run does not resolve, unknown drives,
        motors whose currents one transformer does not add up.

    Notes
    -----
    Line currents of motors of one frequency add up in one transformer as phasors, each at the
    angle of its own power, whatever its voltage:

    .. math:: I = \left|\sum_k I_k\,\frac{P_k - \mathrm{j} Q_k}{S_k}\right|,\quad
              Q_k = \sqrt{S_k^2 - P_k^2}

    Direct currents add up with their signs, and to an alternating current in the squares,
    sqrt(I_dc^2 + I_ac^2), as a clamp that passes both shows it. The voltages of all motors are
    taken to be in phase; their recorded voltage is the largest of theirs. A sample stands for the
    time since the last; a window may begin within one.

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
    if "drive" not in run.dims and "lead_current" in run:
        run = _as_drive(run)
    drives = [str(name) for name in run["drive"].values] if "drive" in run.coords else []
    problems = [*_run_problems(run, chosen)]
    until = float(run["time"][-1]) if run.sizes.get("time") else math.inf
    supplies = json.loads(run.attrs.get("machine_supplies", "{}"))
    if drives:
        problems += _group_problems(drives, chosen, supplies, until)
    if problems:
        raise MeasurementError(problems, source="monitoring")
    groups = transformers(drives, chosen)
    time, edges = _edges(run["time"].values, chosen.rate)
    channels = {
        name: run[name].transpose("drive", "time").values for name in COLUMNS if name in run
    }
    direct = _direct(channels, drives, supplies)
    found: dict[str, list[Floats]] = {name: [] for name in channels}
    for names in groups.values():
        rows = [drives.index(name) for name in names]
        seen = _together({k: v[rows] for k, v in channels.items()}, direct[rows])
        for name, values in seen.items():
            squared = name in ROOT_MEAN_SQUARES
            mean = _means(values**2 if squared else values, time, edges)
            mean = np.sqrt(np.maximum(mean, 0.0)) if squared else mean
            recorder = chosen.recorder(name)
            stored = recorder.recorded(edges[1:], mean)
            found[name].append(np.round(stored, 9) if recorder.resolution else stored)
    return xr.Dataset(
        {
            name: (("drive", "time"), np.array(rows), run[name].attrs)
            for name, rows in found.items()
        },
        {"time": edges[1:], "drive": list(groups)},
        {"monitoring_rate": chosen.rate},
    )


def monitoring_of(
    *,
    rate: str = "50 Hz",
    together: Sequence[str] = (),
    current_step: str | None = None,
    power_step: str | None = None,
) -> Monitoring:
    """Return a monitoring system from typed options.

    Parameters
    ----------
    rate : str
        Values a second, such as "25 Hz", or a name of `SYSTEMS`, which has steps too.
    together : sequence of str
        Transformers around the leads of several drives: "switch=1,2".
    current_step : str, optional
        Resolution of currents, such as "0.01 A"; "0 A" for none. Default that of the system.
    power_step : str, optional
        Resolution of powers, such as "19.6 W"; "0 W" for none. Default that of the system.

    Raises
    ------
    MeasurementError
        With all problems.

    Examples
    --------
    >>> monitoring_of(rate="25 Hz", together=["switch=1,2"]).together
    {'switch': ['1', '2']}
    >>> round(monitoring_of(rate="zyj7").power_step, 1)
    19.6
    """
    problems, groups, found = list[str](), dict[str, Sequence[str]](), dict[str, Any]()
    typed = {"current_step": current_step, "power_step": power_step}
    for key, text in {"rate": rate, **typed}.items():
        if text is None or text in SYSTEMS:
            continue
        try:
            found[key] = parse_quantity(text, LIMITS[key][0])
            problem = _beyond(key, found[key])
        except ValueError as error:
            problem = str(error) + f"; or name a system, {choices(SYSTEMS)}" * (key == "rate")
        if problem:
            problems.append(f"--{key.replace('_', '-')} '{text}': {problem}")
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
    return replace(SYSTEMS.get(rate, Monitoring()), together=groups, **found)


def check_monitoring(
    monitoring: Monitoring,
    drives: Sequence[str],
    supplies: Mapping[str, Mapping[str, float | None]],
    *,
    rate: float,
) -> None:
    """Refuse settings that cannot sample any throw of a switch, before one is made.

    Parameters
    ----------
    monitoring : Monitoring
    drives : sequence of str
        Of the switch.
    supplies : mapping
        Of the drives that are machines: `frequency` [Hz], 0 of direct current, and `phase_lost_at`
        [s] or None.
    rate : float
        Samples a second of what it samples [1/s].

    Raises
    ------
    MeasurementError
        With all problems.
    """
    problems = [*_own_problems(monitoring, rate)]
    problems += _group_problems(drives, monitoring, supplies, math.inf)
    if problems:
        raise MeasurementError(problems, source="monitoring")


def monitoring_recording(stored: xr.Dataset, *, source: str) -> Recording:
    """Return the stored channels of a monitoring system as a recording that a file can hold.

    Parameters
    ----------
    stored : xarray.Dataset
        From `monitored`.
    source : str
        Origin, as stated in the file.

    Returns
    -------
    Recording
        Channels "Current 1" [A], "Active power 1" [W], "Apparent power 1" [VA] and "Voltage 1" [V],
        all but the first of machines only; the number is the drive, or the name of the transformer.
        A value stands at the end of its window.
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


def _as_drive(run: xr.Dataset) -> xr.Dataset:
    """Return the throw of one machine as that of a drive of its name."""
    own = {"drive_current": "current", "drive_power": "power", "drive_voltage": "voltage"}
    if (run["apparent_power"] > np.abs(run["power"]) * (1.0 + ROUNDING)).any():
        own["drive_apparent_power"] = "apparent_power"  # of three phases only
    rows = {name: (("drive", "time"), run[of].values[None]) for name, of in own.items()}
    return xr.Dataset(rows, {"time": run["time"], "drive": [str(run.attrs.get("machine", "1"))]})


def _own_problems(chosen: Monitoring, own: float = math.inf) -> Iterator[str]:
    """Yield the faults of settings for what has `own` samples a second."""
    for name, (dimension, *_) in LIMITS.items():
        value = getattr(chosen, name)
        if problem := _beyond(name, value):
            yield f"{name} = {value:g} {dimension.unit}: {problem}"
    if chosen.rate > own * (1.0 + ROUNDING):
        yield f"rate = {chosen.rate:g} 1/s: what it samples has {own:g} 1/s only; take at most that"


def _beyond(name: str, value: float) -> str:
    """Return the fault of a setting beyond its range; empty within."""
    dimension, least, most = LIMITS[name]
    return "" if least <= value <= most else f"must be {least:g} to {most:g} {dimension.unit}"


def _run_problems(run: xr.Dataset, chosen: Monitoring) -> Iterator[str]:
    """Yield the faults that keep a run from being sampled so."""
    if "drive_current" not in run:
        yield (
            "drive_current: is missing; take a throw whose drives are machines "
            "(turnout simulate --set drive.1.machine=...), or that of turnout machine run"
        )
    count = run.sizes.get("time", 0)
    step = float(run["time"][-1] - run["time"][0]) / (count - 1) if count > 1 else 0.0
    yield from _own_problems(chosen, 1.0 / step if step else math.inf)
    if count < 2:
        yield f"time: the run has {count} instants; a window needs at least 2"
    elif 0.0 < count * step * chosen.rate < 1.0 - ROUNDING:
        yield (
            f"rate = {chosen.rate:g} 1/s: the run is shorter than one window, "
            f"{count * step:g} of {1.0 / chosen.rate:g} s"
        )


def _group_problems(
    drives: Sequence[str],
    chosen: Monitoring,
    supplies: Mapping[str, Mapping[str, float | None]],
    until: float,
) -> Iterator[str]:
    """Yield the faults of transformers: impossible groups, or currents that do not add up."""
    taken = [str(name) for names in chosen.together.values() for name in names]
    for title, names in chosen.together.items():
        if isinstance(names, str) or not names:
            yield f"together '{title}': name its drives in a list, such as ['1', '2']"
            continue
        members = [str(name) for name in names]
        wrong = sorted({n for n in members if n not in drives or taken.count(n) > 1})
        if wrong:
            yield f"together '{title}': drive {', '.join(wrong)} is not there or named twice"
        if title in drives and title not in members:
            yield f"together '{title}': is the name of a drive outside it; choose another name"
        if len(members) > 1:
            yield from _unlike_problems(title, {n: supplies.get(n, {}) for n in members}, until)


def _unlike_problems(
    title: str, supplies: Mapping[str, Mapping[str, float | None]], until: float
) -> Iterator[str]:
    rates = sorted({own for supply in supplies.values() if (own := supply.get("frequency"))})
    if len(rates) > 1:
        yield (
            f"together '{title}': its motors take {' and '.join(f'{rate:g}' for rate in rates)} "
            "Hz; their currents beat, so give each frequency a transformer of its own"
        )
    for name, supply in supplies.items():
        lost = supply.get("phase_lost_at")
        if lost is not None and lost <= until:
            yield (
                f"together '{title}': drive {name} loses a phase at {lost:g} s; the angle of its "
                "current depends on the conductor, so give it a transformer of its own"
            )


def transformers(drives: Sequence[str], chosen: Monitoring) -> dict[str, list[str]]:
    """Return the transformers of a monitoring system by name, and the drives of each."""
    groups = {name: list(map(str, names)) for name, names in chosen.together.items()}
    taken = [name for names in groups.values() for name in names]
    return groups | {name: [name] for name in drives if name not in taken}


def _edges(time: Floats, rate: float) -> tuple[Floats, Floats]:
    """Return the edges of the samples, and those of the windows [s]."""
    step = (time[-1] - time[0]) / (time.size - 1)
    spans = np.concatenate([[time[0] - step], time])
    count = math.floor((spans[-1] - spans[0]) * rate + ROUNDING)
    return spans, spans[0] + np.arange(count + 1) / rate


def _means(values: Floats, spans: Floats, edges: Floats) -> Floats:
    """Return the means over windows of samples that each stand for a span, shape (n_windows,)."""
    whole = np.concatenate([[0.0], np.cumsum(values * np.diff(spans))])
    return np.asarray(np.diff(np.interp(edges, spans, whole)) / np.diff(edges))


def _direct(
    channels: Mapping[str, Floats],
    drives: Sequence[str],
    supplies: Mapping[str, Mapping[str, float | None]],
) -> NDArray[np.bool_]:
    """Flag the drives that take direct current, markers included, shape (n_drives,).

    Where a run does not say: those without reactive power.
    """
    found = np.ones(len(drives), dtype=np.bool_)
    if "drive_apparent_power" in channels and "drive_power" in channels:
        active = (1.0 + ROUNDING) * np.abs(channels["drive_power"])
        found = np.logical_not(np.any(channels["drive_apparent_power"] > active, axis=1))
    for row, name in enumerate(drives):
        if name in supplies:
            found[row] = not supplies[name].get("frequency")
    return found


def _together(rows: Mapping[str, Floats], direct: NDArray[np.bool_]) -> dict[str, Floats]:
    """Return the signals of one transformer of several drives; `direct` flags direct current.

    See the notes of `monitored`.
    """
    found = {
        name: np.where(np.isnan(values).all(axis=0), np.nan, np.nansum(values, axis=0))
        for name, values in rows.items()
        if name != "drive_voltage"
    }
    if "drive_voltage" in rows:
        found["drive_voltage"] = np.fmax.reduce(np.abs(rows["drive_voltage"]), axis=0)
    if direct.size == 1 or direct.all() or not {"drive_power", "drive_apparent_power"} <= set(rows):
        if "drive_apparent_power" in found and direct.size > 1:
            found["drive_apparent_power"] = np.abs(found["drive_power"])
        return found
    active, whole = (
        np.nan_to_num(rows[name][~direct]) for name in ("drive_power", "drive_apparent_power")
    )
    phasor = active - 1j * np.sqrt(np.maximum(whole**2 - active**2, 0.0))
    unit = np.divide(phasor, whole, out=np.zeros_like(phasor), where=whole > 0.0)
    alternating = np.abs((np.nan_to_num(np.abs(rows["drive_current"][~direct])) * unit).sum(axis=0))
    steady = np.nansum(rows["drive_current"][direct], axis=0)
    found["drive_current"] = np.hypot(alternating, steady)
    found["drive_apparent_power"] = np.hypot(found["drive_power"], phasor.imag.sum(axis=0))
    return found
