"""Throws of three-phase machines as means over blocks, and what contradicts itself in them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.running_current import running_time

Floats = NDArray[np.float64]

SETTLED, MARGIN = 0.5, 0.2
"""Left out behind the contactor and before the cut-off [s]."""
BLOCK = 0.2
"""Samples are averaged over so long [s]."""
LEAST_BLOCKS, LEAST_THROWS = 5, 8
"""Blocks in a throw, and throws, that a fit needs at least."""
RESOLVED, LEAST_INRUSH = 0.9, 1.5
"""An inrush is resolved where two samples in a row are at least this share of the largest, which is
at least so much of the running current [-]."""
LEAST_FACTOR = 0.1
"""Least power factor of running machines, median of throws: stators of 6 to 9 ohm take 0.06 to 0.09
alone. Below, power is of one phase or in another unit [-]."""
DIRECT = 5e-3
"""Largest share by which P and U I of a direct current differ; a power factor of 1/sqrt(3) in all
throws, whatever their load, is none of three phases [-]."""
CURRENT_RANGE = (0.1, 100.0)
"""Running current of a point machine, least and most; beyond, it has another unit [A]."""
VOLTAGE_RANGE = (0.7, 1.4)
"""Recorded over rated voltage; beyond, it has another unit or is that of a phase [-]."""
POWER_PER_AMPERE = 200.0
"""Power that counts as an ampere where the running time is sought in power alone [W/A]."""
ONE_PHASE = (
    "another unit, or power of one phase or two; give those of all (phases = [...] in the channel "
    "map)"
)
WITHOUT_POWER = ", or leave the power out: current and slope with the voltage need none"
CHANNELS = {"voltage": "drive_voltage", "current": "drive_current", "power": "drive_power"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrowMeans:
    """Voltage, current and power of one throw while its motor runs, in blocks of `BLOCK`.

    Attributes
    ----------
    name : str
    blocks : mapping of str to ndarray, shape (2, n_blocks)
        Means over the even and the odd samples of each block of what was recorded, by the names of
        `CHANNELS`: between lines [V], of a line [A], active [W].
    inrush : tuple of float or None
        Voltage, current and power of the sample with the largest current.
    """

    name: str
    blocks: Mapping[str, Floats]
    inrush: tuple[float, float, float] | None

    def mean(self, what: str) -> float:
        """Return the mean of a quantity that was recorded."""
        return float(self.blocks[what].mean())


def recorded(campaign: xr.Dataset, drive: str) -> dict[str, Floats]:
    """Return magnitudes of voltage, current and power of a drive, those with any finite sample.

    Each has the shape (movement, time), in SI.
    """
    rows: dict[str, Floats] = {}
    for what, channel in CHANNELS.items():
        if channel in campaign:
            name = channel + "_unfiltered"
            data = campaign[name if name in campaign else channel].sel(drive=drive)
            values = np.abs(data.transpose("movement", "time").values)
            if np.isfinite(values).any():
                rows[what] = values
    return rows


def throw_means(
    campaign: xr.Dataset, rows: Mapping[str, Floats], *, to_neutral: bool = False
) -> Iterator[ThrowMeans]:
    """Yield block means while the motor runs, throw by throw, of what `recorded` found."""
    time = campaign["time"].values
    if "voltage" in rows and to_neutral:
        rows = {**rows, "voltage": math.sqrt(3.0) * rows["voltage"]}
    rate = (time.size - 1) / float(time[-1] - time[0])
    length = max(2, round(BLOCK * rate))
    for number, name in enumerate(map(str, campaign["movement"].values)):
        one = {what: values[number] for what, values in rows.items()}
        known = np.all([np.isfinite(values) for values in one.values()], axis=0)
        by = one["current"] if "current" in one else one["power"] / POWER_PER_AMPERE
        on, off = running_time(time[known], by[known])
        inside = np.flatnonzero(known & (time >= on + SETTLED) & (time <= off - MARGIN))
        count = inside.size // length
        if count < LEAST_BLOCKS:
            continue
        at = inside[: count * length].reshape(count, length)
        means = {
            what: np.stack([values[at[:, k::2]].mean(axis=1) for k in range(2)])
            for what, values in one.items()
        }
        start = np.flatnonzero(known & (time >= on - 0.1) & (time <= on + SETTLED))
        inrush = _inrush({what: v[start] for what, v in one.items()}, means)
        yield ThrowMeans(name=name, blocks=means, inrush=inrush)


def _inrush(
    start: Mapping[str, Floats], running: Mapping[str, Floats]
) -> tuple[float, float, float] | None:
    """Return voltage, current and power at the largest current of the start.

    None without one of them, or where no neighbour is near it: the motor ran up within a sample.
    """
    if len(start) < len(CHANNELS) or start["current"].size < 3:
        return None
    current = start["current"]
    at = int(current[1:-1].argmax()) + 1
    least = max(current[at] * RESOLVED, LEAST_INRUSH * float(np.median(running["current"])))
    if max(current[at - 1], current[at + 1]) < least:
        return None
    u, i, p = (float(start[what][at]) for what in CHANNELS)
    return (u, i, p) if math.sqrt(3.0) * u * i > p > 0.0 else None


def contradictions(
    throws: Sequence[ThrowMeans], drive: str, rated_voltage: float, *, to_neutral: bool
) -> Iterator[str]:
    """Yield what voltage, current and power of a drive cannot be together."""
    if "+" in drive:
        yield f"drive {drive}: the current of two machines is that of neither"
        return
    if len(throws) < LEAST_THROWS:
        yield (
            f"drive {drive}: its motor runs steadily in {len(throws)} movements, "
            f"{LEAST_THROWS} are needed"
        )
        return
    names: dict[bytes, str] = {}
    for t in throws:
        known = names.setdefault(b"".join(v.tobytes() for v in t.blocks.values()), t.name)
        # coarse steps agree by chance
        if known != t.name and all(np.ptp(v) > 0.0 for v in t.blocks.values()):
            yield f"drive {drive}: {known} and {t.name} are one recording; leave one out"
            return
    means = {what: [t.mean(what) for t in throws] for what in throws[0].blocks}
    least, most = CURRENT_RANGE
    if wrong := [value for value in means.get("current", ()) if not least <= value <= most]:
        yield (
            f"drive {drive}: runs with {wrong[0]:.4g} A, {least:g} to {most:g} A are usual: "
            "another unit; state it in the channel map"
        )
        return
    low, high = (share * rated_voltage for share in VOLTAGE_RANGE)
    if beyond := [value for value in means.get("voltage", ()) if not low <= value <= high]:
        turn, kind = "give", "voltages of a phase to neutral"
        if to_neutral:
            turn, kind = "leave out", "voltages between lines"
        yield (
            f"drive {drive}: {beyond[0]:.4g} V against {rated_voltage:g} V rated: another unit, or "
            f"{kind} ({turn} to_neutral, --to-neutral)"
        )
        return
    if not {"current", "power"} <= means.keys():
        return
    factors, slack = [], 1.0 if "voltage" in means else VOLTAGE_RANGE[1]
    voltages = means.get("voltage", [rated_voltage] * len(throws))
    for t, u, i, p in zip(throws, voltages, means["current"], means["power"], strict=True):
        most = math.sqrt(3.0) * u * i
        factors.append(p / most)
        if factors[-1] > slack:
            yield (
                f"drive {drive}, {t.name}: {p:.4g} W with {i:.4g} A and {u:.4g} V; "
                f"sqrt(3) U I is {most:.4g} VA and power factors are at most 1: another unit, a "
                "phase that is missing, or voltages of a phase to neutral"
            )
            return
    direct = max(abs(math.sqrt(3.0) * factor - 1.0) for factor in factors) < DIRECT
    if direct and "voltage" in means:
        yield f"drive {drive}: P is U I in all throws: direct current; leave out --three-phase"
    elif (factor := float(np.median(factors))) < LEAST_FACTOR:
        yield (
            f"drive {drive}: power factors are {LEAST_FACTOR:g} and more, this is {factor:.2g}: "
            f"{ONE_PHASE}{WITHOUT_POWER if 'voltage' in means else ''}"
        )


# --- one machine
