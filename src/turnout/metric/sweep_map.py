"""Many throws as a map: their outcomes over two of their inputs, such as place and size."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.errors import ResponseError
from turnout.metric.sensitivity import value_classes
from turnout.throw.verdict import KINDS

STATES = (*KINDS, "failed", "not thrown")
"""Outcomes of a throw: kinds of verdict from good to bad, then two without a result."""
FAILED, NOT_THROWN = len(KINDS), len(KINDS) + 1
UNDETECTED, NOT_JUDGED = KINDS.index("undetected object"), KINDS.index("not judged")
SLIPS = (KINDS.index("detected by slip"), KINDS.index("detected by switch-off"))

# Numbers that take more values than this are shown in classes of equal width.
MOST_VALUES, CLASSES = 30, 12
QUANTITIES = ("peak_force", "object_force_peak", "end_gap", "least_gauge")


def end_state(labels: xr.Dataset) -> xr.DataArray:
    """Return the outcome of each throw.

    Parameters
    ----------
    labels : xarray.Dataset
        Of a sweep, with the dimension scenario: `outcome` and `verdict`.

    Returns
    -------
    xarray.DataArray of int
        A place in `STATES` for each scenario.

    Raises
    ------
    ResponseError
        For a sweep that was made before verdicts were stored.

    Examples
    --------
    >>> labels = xr.Dataset(
    ...     {
    ...         "outcome": ("scenario", ["complete", "complete", "skipped"]),
    ...         "verdict": ("scenario", [0, 5, -1]),
    ...     }
    ... )
    >>> [STATES[state] for state in end_state(labels).values]
    ['sound', 'detected by slip', 'not thrown']
    """
    if "verdict" not in labels:
        message = "this sweep has no verdicts, it was made by an older version; throw it again"
        raise ResponseError(message)
    outcome, kind = labels["outcome"].to_numpy().astype(str), labels["verdict"].to_numpy()
    state = np.where(outcome == "complete", kind, FAILED).astype(np.int64)
    state[outcome == "skipped"] = NOT_THROWN
    return xr.DataArray(state, dims="scenario", name="state", attrs={"states": list(STATES)})


def trapped_objects(labels: xr.Dataset) -> NDArray[np.bool_] | None:
    """Flag the throws with an object trapped at the end; None if that was not stored."""
    for name in ("object_trapped", "object_touched"):
        if name in labels:
            return np.asarray(labels[name].to_numpy() > 0)
    return None


def sweep_map(
    labels: xr.Dataset, *, x: str = "object.size", y: str = "object.at", direction: str = "closing"
) -> xr.Dataset:
    """Sort the throws of a sweep into cells of two inputs.

    Parameters
    ----------
    labels : xarray.Dataset
        Of a sweep, with the dimension scenario.
    x, y : str
        Inputs; one with many values is shown in classes of equal width.
    direction : str
        Movement whose forces are shown.

    Returns
    -------
    xarray.Dataset
        By (y, x): the medians of `peak_force` and `end_gap` of the drive with most [N], [m] and of
        `object_force_peak` [N], the least `least_gauge` [m], if it was stored, NaN where nothing
        was thrown; `state`, the worst of the cell, and `throws` that came to an end.
        ``attrs["skipped"]`` counts what a rule left out.

    Raises
    ------
    ResponseError
        When the sweep has no such inputs, with those there are.
    """
    missing = [name for name in (x, y) if name not in labels.coords]
    if missing:
        inputs = [str(name) for name in labels.coords if "input" in labels[name].attrs]
        message = f"no input '{missing[0]}' in this sweep; there are {', '.join(inputs)}"
        raise ResponseError(message)
    columns, across = _classes(labels[x])
    rows, along = _classes(labels[y])
    state = end_state(labels).to_numpy()
    shape = (along.size, across.size)
    cells = {name: np.full(shape, np.nan) for name in QUANTITIES}
    worst, throws = np.full(shape, NOT_THROWN), np.zeros(shape, dtype=np.int64)
    values = {name: _largest(labels, name, direction) for name in QUANTITIES if name in labels}
    for row, column in np.ndindex(*shape):
        inside = (rows == row) & (columns == column)
        thrown = inside & (state < FAILED)
        throws[row, column] = thrown.sum()
        if thrown.any():
            worst[row, column] = state[thrown].max()
            for name, numbers in values.items():
                known = numbers[thrown][~np.isnan(numbers[thrown])]
                of_cell = np.min if name == "least_gauge" else np.median
                cells[name][row, column] = of_cell(known) if known.size else np.nan
        elif inside.any():
            worst[row, column] = state[inside].min()
    return xr.Dataset(
        {
            **{name: (("y", "x"), cells[name]) for name in values},
            "state": (("y", "x"), worst),
            "throws": (("y", "x"), throws),
        },
        {"x": ("x", across, labels[x].attrs), "y": ("y", along, labels[y].attrs)},
        {**labels.attrs, "x_input": x, "y_input": y, "skipped": int((state == NOT_THROWN).sum())},
    )


def _classes(values: xr.DataArray) -> tuple[NDArray[np.int64], NDArray[np.generic]]:
    """Return the class of each scenario, and the representative of each class."""
    items = values.to_numpy()
    if (alike := value_classes(items, most=MOST_VALUES)) is not None:
        return alike
    edges = np.linspace(items.min(), items.max(), CLASSES + 1)
    found = np.clip(np.searchsorted(edges, items, side="right") - 1, 0, CLASSES - 1)
    return found, 0.5 * (edges[1:] + edges[:-1])


def _largest(labels: xr.Dataset, name: str, direction: str) -> NDArray[np.float64]:
    """Return a number a scenario: of all drives the largest, in the movement that is shown."""
    values = labels[name]
    if "direction" in values.dims:
        values = values.sel(direction=direction)
    others = [dim for dim in values.dims if dim != "scenario"]
    found = values.max(others) if others else values
    return np.asarray(found.to_numpy(), dtype=np.float64)
