"""The forces of a calibration, measured and fitted, in a file beside its record."""

from pathlib import Path

import xarray as xr

from turnout.calibration.fit import Fit
from turnout.calibration.movement_rows import fitted_signals
from turnout.calibration.result import Calibration
from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import FileError
from turnout.throw.store import open_response, save_response

KIND = "fitted forces"


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
