"""Inputs, outcomes, labels and features of a sweep as a table, a row a scenario."""

import io
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from turnout.errors import FileError
from turnout.study.sweep_read import read_labels

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".parquet", ".csv", ".mat")
LONGEST_NAME = 63
"""Of a variable that MATLAB takes."""


def table_of(folder: Path | str) -> "pd.DataFrame":
    """Return all that has no time as columns; drive and direction are in their names.

    Parameters
    ----------
    folder : path-like
        Of a sweep.

    Returns
    -------
    pandas.DataFrame
        A row a scenario that was thrown, in SI; ``attrs["units"]`` holds the unit of each column.
        A feature of a drive in a direction is called as in ``peak_force.2.closing``.

    Raises
    ------
    FileError
        When the folder holds no sweep.
    """
    import pandas as pd

    labels = read_labels(folder)
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for name, variable in labels.variables.items():
        if variable.dims[:1] != ("scenario",):
            continue
        members = [labels[dim].values.tolist() for dim in variable.dims[1:]]
        for number, parts in enumerate(product(*members)):
            column = ".".join((str(name), *map(str, parts)))
            columns[column] = variable.values.reshape(variable.shape[0], -1)[:, number]
            units[column] = str(variable.attrs.get("units", "1"))
    table = pd.DataFrame(columns)
    table.attrs["units"] = units
    return table


def export_bytes(table: "pd.DataFrame", suffix: str) -> bytes:
    """Return the content of a file with a table.

    Parameters
    ----------
    table : pandas.DataFrame
        From `table_of`.
    suffix : str
        ".parquet", ".csv" or ".mat"; MATLAB gets a structure `sweep` of columns, in whose names
        all but letters and digits is "_", and `units` beside it.

    Returns
    -------
    bytes

    Raises
    ------
    FileError
        When another package is needed for it, or there is no such form.
    """
    if suffix == ".csv":
        return table.to_csv(index=False, float_format="%.9g").encode()
    if suffix == ".parquet":
        try:
            import pyarrow  # noqa: F401
        except ImportError:
            message = "--parquet needs pyarrow; install it with: pip install 'turnout[parquet]'"
            raise FileError(message) from None
        return bytes(table.to_parquet(index=False, engine="pyarrow"))
    if suffix == ".mat":
        return _matlab(table)
    message = f"'{suffix}': there are {', '.join(SUFFIXES)}"
    raise FileError(message)


def _matlab(table: "pd.DataFrame") -> bytes:
    from scipy.io import savemat

    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for column in table.columns:
        values = table[column].to_numpy()
        name = matlab_name(str(column))
        columns[name] = values if values.dtype.kind in "fib" else values.astype(object)
        units[name] = table.attrs["units"][column]
    content = io.BytesIO()
    savemat(
        content,  # type: ignore[arg-type]
        {"sweep": columns, "units": units},
        long_field_names=True,
        oned_as="column",
        do_compression=True,
    )
    return content.getvalue()


def matlab_name(column: str) -> str:
    """Return a name that MATLAB takes.

    Examples
    --------
    >>> matlab_name("peak_force.2.closing"), matlab_name("2nd")
    ('peak_force_2_closing', 'x2nd')
    """
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in column)
    return (plain if plain[:1].isalpha() else f"x{plain}")[:LONGEST_NAME]
