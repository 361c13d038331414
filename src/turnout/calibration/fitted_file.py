"""The forces of a calibration, measured and fitted, in a file beside its record."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from turnout.calibration.fit import Fit
from turnout.calibration.misfit import shared_corrections
from turnout.calibration.result import Calibration
from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import FileError
from turnout.throw.store import open_response, save_response

KIND = "fitted forces"
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


def signals_path(record: Path) -> Path:
    """Return where the forces of a calibration lie.

    Examples
    --------
    >>> signals_path(Path("autumn/calibration.toml")).as_posix()
    'autumn/calibration-fit.nc'
    """
    return record.with_name(f"{record.stem}-fit.nc")


def save_signals(final: Fit, calibration: Calibration, record: Path) -> xr.Dataset:
    """Write measured and fitted forces of each movement beside the record of a calibration.

    Parameters
    ----------
    final : Fit
        Of the last stage.
    calibration : Calibration
        Its record.
    record : Path
        Where that lies (.toml).

    Returns
    -------
    xarray.Dataset
        As from `fitted_signals`, with what links it to the record.

    Raises
    ------
    FileError
        When the file cannot be written.
    """
    signals = fitted_signals(final).assign_attrs(
        kind=KIND, schema_version=SCHEMA_VERSION, **_link(calibration)
    )
    save_response(signals, signals_path(record))
    return signals


def load_signals(calibration: Calibration, record: Path) -> xr.Dataset | None:
    """Return the forces that a calibration was fitted to, where they lie beside its record.

    A file of another calibration, or one that cannot be read, is passed over.
    """
    try:
        found = open_response(signals_path(record))
    except FileError:
        return None
    wanted = {"kind": KIND, **_link(calibration)}
    return found if all(found.attrs.get(key) == text for key, text in wanted.items()) else None


def _link(calibration: Calibration) -> dict[str, str]:
    """Return what a file has in common with the record that it belongs to."""
    return {
        "data_hash": calibration.data_hash,
        "panel_hash": calibration.panel_hash,
        "written": str(calibration.about.get("written", "")),
    }
