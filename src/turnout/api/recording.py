"""One recording, from its file to a dataset in the terms of a simulation."""

from pathlib import Path

import xarray as xr

from turnout.core.errors import FileError
from turnout.core.units import TIME, parse_quantity
from turnout.measurement.chain.apply import apply_chain, load_channel_map
from turnout.measurement.chain.condition import condition
from turnout.measurement.formats.file_format import read_recording


def import_recording(
    path: Path | str, *, channels: Path | str, smooth: float | str | None = None
) -> xr.Dataset:
    """Read a recording and turn its columns to forces and currents.

    Parameters
    ----------
    path : path-like
        A file that `read_recording` reads.
    channels : path-like
        Channel map (.toml): which column is which quantity, through what sensor; or the name of
        one of the library.
    smooth : float or str, optional
        Window of a centred moving average [s], such as 0.1 or "100 ms"; what was measured stays
        beside it as ``drive_force_unfiltered`` and so on.

    Returns
    -------
    xarray.Dataset
        With the names, units and signs of a simulation; ``recorded`` holds the columns as they
        were.

    Raises
    ------
    FileError
        When a file cannot be read, or the window is no time.
    MeasurementError
        When recording and map do not fit; with all problems.

    Examples
    --------
    >>> import_recording("throw.csv", channels="map.toml", smooth=0.1)  # doctest: +SKIP
    """
    window = None
    if smooth is not None:
        try:
            window = parse_quantity(smooth, TIME, si=True)
        except ValueError as error:
            message = f"smooth = {smooth!r}: {error}"
            raise FileError(message) from None
        if window <= 0:
            message = f"smooth = {smooth!r}: must be more than 0"
            raise FileError(message)
    dataset = apply_chain(read_recording(path), load_channel_map(channels))
    return dataset if window is None else condition(dataset, window=window)
