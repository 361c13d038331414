"""Files made of a throw."""

from collections.abc import Mapping

import xarray as xr

from turnout.measurement.history_text import history_text
from turnout.plot.style import rendered
from turnout.plot.throw import plot_throw
from turnout.response.store import response_bytes

FILES: Mapping[str, str] = {
    "nc": "application/x-netcdf",
    "csv": "text/csv",
    "png": "image/png",
    "svg": "image/svg+xml",
    "pdf": "application/pdf",
}
"""Kinds of files with their media types."""


def made_file(kind: str, dataset: xr.Dataset, *, behind: xr.Dataset | None = None) -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    kind : str
        One of `FILES`: the dataset (nc), its channels as a table (csv), or a figure.
    dataset : xarray.Dataset
        The throw.
    behind : xarray.Dataset, optional
        Drawn grey behind it in a figure.
    """
    if kind == "nc":
        return response_bytes(dataset)
    if kind == "csv":
        return history_text(dataset).encode()
    return rendered(plot_throw(dataset, compare=behind), f".{kind}")
