"""A run as a table of text that other programs read, and `read_history` reads back."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.measurement.history import READ

Floats = NDArray[np.float64]
# Units on the edge, and their size in SI.
SHOWN = {"N": ("kN", 1e3), "m": ("mm", 1e-3)}
DIGITS = 10


def history_text(dataset: xr.Dataset) -> str:
    """Return the channels of a run that figures show, a column each.

    Parameters
    ----------
    dataset : xarray.Dataset
        Simulated or measured; columns without a number are left out.

    Returns
    -------
    str
        Comma-separated, the first line names columns with units: ``time [s]``,
        ``drive_force:1 [kN]``. Empty cells stand for NaN.

    Examples
    --------
    >>> run = xr.Dataset({"object_force": ("time", [0.0, 1500.0])}, {"time": [0.0, 0.5]})
    >>> history_text(run).splitlines()
    ['time [s],object_force [kN]', '0,0', '0.5,1.5']
    """
    names, columns = ["time [s]"], [dataset["time"].values]
    for channel, (family, dimension) in READ.items():
        if channel not in dataset:
            continue
        unit, factor = SHOWN[dimension.unit]
        members = [None] if family is None else dataset[family].values.tolist()
        for member in members:
            values = dataset[channel] if member is None else dataset[channel].sel({family: member})
            if np.isnan(values.values).all():
                continue
            own = "" if member is None else f":{member}"
            names.append(f"{channel}{own} [{unit}]")
            columns.append(values.values / factor)
    table: Floats = np.stack(columns, axis=1)
    lines = [",".join(names)]
    lines += [",".join(_number(value) for value in row) for row in table.tolist()]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    # Adding zero turns a negative zero into a plain one.
    return "" if value != value else f"{value + 0.0:.{DIGITS}g}"
