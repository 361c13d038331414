"""Errors of a measuring chain: noise, drift, hum, cross-talk, quantisation, a wrong clock."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from turnout.core.errors import FileError
from turnout.measurement.chain.recorder import PERFECT, Recorder, clocked, recorder_faults

CHANNELS = ("drive_force", "drive_current", "object_force")


@dataclass(frozen=True, slots=True, kw_only=True)
class Transducer:
    """Errors of one kind of channel, in its own unit.

    Attributes
    ----------
    noise : float
        Standard deviation of white noise.
    drift : float
        Standard deviation of the change from the start to the end of a recording.
    hum : float
        Amplitude of the mains, with a third of it at three times the frequency.
    step : float
        Of the converter; zero for none.
    """

    noise: float = 0.0
    drift: float = 0.0
    hum: float = 0.0
    step: float = 0.0

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        for name in ("noise", "drift", "hum", "step"):
            if not getattr(self, name) >= 0:
                message = f"{name} = {getattr(self, name)}: must be at least 0"
                raise FileError(message)


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """Errors of a whole measuring chain; the figures are assumptions.

    Attributes
    ----------
    drive_force, drive_current, object_force : Transducer
        By channel [N, A, N].
    cross_talk : float
        Share of each force bridge that its neighbour sees.
    mains : float
        Frequency of the mains [Hz].
    clock_rate, clock_offset : float
        Share by which the recorder's clock runs fast, and what it shows at time zero [s]; 0 unless
        it is wrong, see `turnout.measurement.chain.recorder`.
    """

    # A bridge of 0.37 mV/V at 6 kN: 5 N are 0.3 uV/V; 24 kN over 16 bits.
    drive_force: Transducer = Transducer(noise=5.0, drift=3.0, hum=8.0, step=24e3 / 2**16)
    drive_current: Transducer = Transducer(noise=0.02, drift=0.005, hum=0.02, step=60.0 / 2**16)
    object_force: Transducer = Transducer(noise=5.0, drift=3.0, hum=8.0, step=40e3 / 2**16)
    cross_talk: float = 5e-4
    mains: float = 50.0
    clock_rate: float = 0.0
    clock_offset: float = 0.0

    def __post_init__(self) -> None:
        """Refuse a clock that cannot be."""
        for name in ("clock_rate", "clock_offset"):
            for text in recorder_faults(name, getattr(self, name)):
                message = f"{name} = {getattr(self, name)}: {text}"
                raise FileError(message)


QUIET = Disturbance(
    drive_force=Transducer(),
    drive_current=Transducer(),
    object_force=Transducer(),
    cross_talk=0.0,
)


def add_disturbance(
    dataset: xr.Dataset,
    *,
    rng: np.random.Generator,
    disturbance: Disturbance | None = None,
    response: Recorder = PERFECT,
) -> xr.Dataset:
    """Return a recording with all that a measuring chain adds.

    Parameters
    ----------
    dataset : xarray.Dataset
        `drive_force`, `drive_current` (drive, time), `object_force` (time), as true.
    rng : numpy.random.Generator
        Source of the random numbers.
    disturbance : Disturbance, optional
        How much of each.
    response : Recorder
        Response of the recorder to forces and their noise, before the converter.

    Returns
    -------
    xarray.Dataset
        The same channels, as a converter would have given them out.

    Examples
    --------
    >>> time = np.arange(3) / 1000.0
    >>> true = xr.Dataset({"object_force": ("time", np.ones(3))}, {"time": time})
    >>> seen = add_disturbance(true, rng=np.random.default_rng(0), disturbance=QUIET)
    >>> seen["object_force"].values
    array([1., 1., 1.])
    """
    chosen = disturbance or Disturbance()
    time = dataset["time"].values
    seen = dataset.copy()
    clock = Recorder(clock_rate=chosen.clock_rate, clock_offset=chosen.clock_offset)
    # All channels of a recorder are sampled at the same times.
    phase = float(rng.uniform()) if response.rate else 0.0
    mixed = _add_cross_talk(dataset, chosen.cross_talk)
    for name in CHANNELS:
        if name not in dataset:
            continue
        kind: Transducer = getattr(chosen, name)
        rows = [
            _disturb_channel(row, time, kind=kind, mains=chosen.mains, rng=rng)
            for row in clocked(np.atleast_2d(mixed[name].values), time, clock)
        ]
        made = response if name.endswith("force") else PERFECT
        made = replace(made, resolution=kind.step)
        values = made.recorded(time, np.array(rows), phase=phase).reshape(dataset[name].shape)
        seen[name] = (dataset[name].dims, values, dataset[name].attrs)
    return seen


def _add_cross_talk(dataset: xr.Dataset, share: float) -> xr.Dataset:
    """Let each rod's bridge see a share of the other rods', and the load cell of all of them."""
    if "drive_force" not in dataset or share == 0.0:
        return dataset
    forces = dataset["drive_force"]
    total = forces.sum("drive")
    mixed = dataset.assign(drive_force=forces + share * (total - forces))
    if "object_force" in dataset:
        mixed = mixed.assign(object_force=dataset["object_force"] + share * total)
    return mixed.assign(drive_force=mixed["drive_force"].transpose(*forces.dims))


def _disturb_channel(
    row: np.ndarray,
    time: np.ndarray,
    *,
    kind: Transducer,
    mains: float,
    rng: np.random.Generator,
) -> np.ndarray:
    phases = rng.uniform(0.0, 2.0 * np.pi, size=2)
    hum = np.sin(2.0 * np.pi * mains * time + phases[0])
    hum += np.sin(6.0 * np.pi * mains * time + phases[1]) / 3.0
    drift = kind.drift * rng.standard_normal() * (time - time[0]) / max(time[-1] - time[0], 1e-9)
    return np.asarray(row + kind.noise * rng.standard_normal(row.size) + kind.hum * hum + drift)
