"""What a fit found of each movement, and its residuals: for tables and figures."""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from turnout.calibration.fit import Fit
from turnout.calibration.misfit import shared_corrections

Row = Mapping[str, float]


def movement_rows(found: Fit) -> dict[str, Row]:
    """Return onset, scattering parameters, zeros, gains and misfit of each movement.

    Parameters
    ----------
    found : Fit
        At its end.

    Returns
    -------
    dict of str to mapping of str to float
        By movement: "onset" [s] later than marked; scattering parameters as shares off the common
        value; by channel "zero" [N], "gain" [-] and "residual", the root mean square of what is
        left [N], as "zero drive_force.1".
    """
    rows: dict[str, Row] = {}
    corrections = shared_corrections(found.local, found.frame)
    for alignment, response, shared in zip(
        found.frame.alignments, found.local.simulated, corrections, strict=True
    ):
        row = {name: mean for name, (mean, _) in alignment.estimates.items()}
        left = alignment.remaining_residuals(response, shared=shared)
        for (signal, _), (zero, gain), rest in zip(
            alignment.parts, alignment.channels, left, strict=True
        ):
            key = f"{signal.channel}.{signal.drive}".rstrip(".")
            row |= {f"zero {key}": zero, f"gain {key}": gain}
            row[f"residual {key}"] = float(np.sqrt(np.mean(rest**2)))
        rows[alignment.movement.name] = row
    return rows


def fitted_signals(found: Fit) -> xr.Dataset:
    """Return measured and fitted forces of each movement, and what is left between them.

    Returns
    -------
    xarray.Dataset
        `measured`, `fitted`, `residual` (movement, channel, time) [N], NaN where nothing was
        compared; the residual is without what onset, friction, zero and gain of the movement, and
        the sensors, explain.
    """
    parts = [
        (alignment, signal, bins)
        for alignment in found.frame.alignments
        for signal, bins in alignment.parts
    ]
    channels = list(dict.fromkeys(_label(signal.drive) for _, signal, _ in parts))
    names = [alignment.movement.name for alignment in found.frame.alignments]
    time = max((signal.time[bins] for _, signal, bins in parts), key=lambda row: row.size)
    shape = (len(names), len(channels), time.size)
    measured, residual = np.full(shape, np.nan), np.full(shape, np.nan)
    corrections = shared_corrections(found.local, found.frame)
    for number, (alignment, response, shared) in enumerate(
        zip(found.frame.alignments, found.local.simulated, corrections, strict=True)
    ):
        left = alignment.remaining_residuals(response, shared=shared)
        for (signal, bins), rest in zip(alignment.parts, left, strict=True):
            at = np.searchsorted(time, signal.time[bins] - 1e-6)
            place = channels.index(_label(signal.drive))
            inside = at < time.size
            measured[number, place, at[inside]] = signal.values[bins][inside]
            residual[number, place, at[inside]] = rest[inside]
    dims = ("movement", "channel", "time")
    return xr.Dataset(
        {
            "measured": (dims, measured, {"units": "N"}),
            "fitted": (dims, measured - residual, {"units": "N"}),
            "residual": (dims, residual, {"units": "N"}),
        },
        {"movement": names, "channel": channels, "time": time},
        {"texts": [alignment.movement.text for alignment in found.frame.alignments]},
    )


def _label(drive: str) -> str:
    return f"Drive {drive}" if drive else "Object"
