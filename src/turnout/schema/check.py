"""Whether a dataset keeps to the table of channels."""

import difflib
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from turnout.errors import ResponseError
from turnout.schema.channels import CHANNELS, SEQUENCE, Channel, known_channel, outer_dimension

if TYPE_CHECKING:
    import xarray as xr

_KINDS = {"number": "f", "count": "i", "logical": "b", "text": "U"}


def schema_problems(dataset: "xr.Dataset") -> list[str]:
    """List everything in which a dataset departs from the table.

    Parameters
    ----------
    dataset : xarray.Dataset
        Simulated or measured; channels may be missing, none may be unknown.

    Returns
    -------
    list of str
        One sentence each; empty when the dataset is in order.
    """
    problems = []
    for name, variable in dataset.variables.items():
        channel = known_channel(str(name), outer=outer_dimension(dataset))
        if channel is None or (name in dataset.coords) == (name in CHANNELS or name in SEQUENCE):
            near = nearest_channel(str(name))
            problems.append(f"{name}: no such channel{near}")
            continue
        problems += _departures(channel, variable)
    if "time" in dataset.coords:
        time = dataset["time"].values
        if not np.all(np.isfinite(time)) or np.any(np.diff(time) <= 0):
            problems.append("time: must be finite and rise")
    return problems


def check_schema(dataset: "xr.Dataset") -> "xr.Dataset":
    """Return a dataset that keeps to the table, or raise with everything that is wrong.

    Raises
    ------
    ResponseError
        With all problems.
    """
    problems = schema_problems(dataset)
    if problems:
        message = "dataset: " + "; ".join(problems)
        raise ResponseError(message)
    return dataset


def unknown_channels(names: Iterable[str]) -> list[str]:
    """Describe the names that are no channels, each with the nearest one that is."""
    return [
        f"{name}: no such channel{nearest_channel(name)}" for name in names if name not in CHANNELS
    ]


def nearest_channel(name: str) -> str:
    """Suggest a channel for a name that is none, as the end of a sentence.

    Examples
    --------
    >>> nearest_channel("drive_forse")
    '; nearest is drive_force'
    """
    close = difflib.get_close_matches(name, list(CHANNELS), n=1)
    return f"; nearest is {close[0]}" if close else ""


def _departures(channel: Channel, variable: "xr.Variable") -> list[str]:
    problems = []
    if variable.dims != channel.dims:
        problems.append(f"{channel.name}: dimensions {variable.dims}, must be {channel.dims}")
    if variable.dtype.kind != _KINDS[channel.kind]:
        problems.append(f"{channel.name}: {variable.dtype} is not a {channel.kind}")
    if channel.kind == "number" and variable.dtype != np.float64:
        problems.append(f"{channel.name}: {variable.dtype}, must be float64")
    for key, expected in (("units", channel.units), ("long_name", channel.long_name)):
        if variable.attrs.get(key) != expected:
            problems.append(
                f"{channel.name}: {key} {variable.attrs.get(key)!r}, must be {expected!r}"
            )
    return problems
