"""Open the batches of a sweep as one dataset with values that are read on use."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from turnout.core.channels import KINDS_NOTE
from turnout.law.object_kind import OBJECT_KINDS
from turnout.study.sweep.batch_index import BatchIndex, Column, label_arrays, read_index
from turnout.study.sweep.verify import open_verified


def open_batches(folder: Path | str) -> xr.Dataset:
    """Open the results of a sweep, also while it runs.

    Parameters
    ----------
    folder : path-like
        Of `turnout sweep run`.

    Returns
    -------
    xarray.Dataset
        With "scenario" as first dimension of all that differs between scenarios; inputs are
        coordinates, histories, labels and features are variables. Values are read when they are
        used. Where a scenario is not complete numbers are NaN and logical values -1; `outcome`
        says how it ended. ``attrs["missing"]`` counts the scenarios that are not thrown yet.

    Raises
    ------
    FileError
        When the folder holds no sweep, none of its batches, or a damaged one.
    """
    index = read_index(Path(folder))
    variables: dict[str, xr.Variable] = {}
    for name, like in index.like.items():
        if like.dims[:1] != ("scenario",):
            variables[name] = xr.Variable(like.dims, like.values, like.attributes)
        elif name != "scenario":
            data = indexing.LazilyIndexedArray(_LazyVariable(index, name))
            variables[name] = xr.Variable(like.dims, data, like.attributes)
    return _to_dataset(index, variables)


def read_labels(folder: Path | str) -> xr.Dataset:
    """Read all that has no time: inputs, outcomes, labels and features, in one pass.

    Parameters
    ----------
    folder : path-like
        Of `turnout sweep run`.

    Returns
    -------
    xarray.Dataset
        In memory, as `open_batches` has it.

    Raises
    ------
    FileError
        As `open_batches`.
    """
    index = read_index(Path(folder))
    same = {
        name: like
        for name, like in index.like.items()
        if like.dims[:1] != ("scenario",) and name != "time"
    }
    arrays = label_arrays(index) | same
    variables = {
        name: xr.Variable(array.dims, array.values, array.attributes)
        for name, array in arrays.items()
    }
    found = _to_dataset(index, variables)
    kinds = set(found["object.kind"].values.tolist()) if "object.kind" in found.coords else set()
    if any(OBJECT_KINDS[kind].breaks for kind in kinds & {*OBJECT_KINDS}):
        found.attrs["break_note"] = KINDS_NOTE
    return found


def last_values(channel: xr.DataArray) -> NDArray[Any]:
    """Return the last values of each throw over time.

    Throws that waited less for machines than the longest are filled up by NaN.

    Examples
    --------
    >>> last_values(xr.DataArray([[1.0, 2.0, np.nan], [3.0, 4.0, 5.0]], dims=("scenario", "time")))
    array([2., 5.])
    """
    values = channel.transpose(..., "time").to_numpy()
    known = np.isfinite(values[..., ::-1])
    at = values.shape[-1] - 1 - known.argmax(axis=-1, keepdims=True)
    return np.asarray(np.take_along_axis(values, at, axis=-1)[..., 0])


def _to_dataset(index: BatchIndex, variables: Mapping[str, xr.Variable]) -> xr.Dataset:
    scenario = xr.Variable("scenario", index.scenario, index.like["scenario"].attributes)
    dataset = xr.Dataset({**variables, "scenario": scenario}, attrs=dict(index.attributes))
    return dataset.set_coords([name for name in dataset if index.like[str(name)].coordinate])


class _LazyVariable(BackendArray):
    """One variable over all batches, as xarray's lazy indexing wants it."""

    def __init__(self, index: BatchIndex, name: str) -> None:
        self._index, self._column = index, Column(index, name)
        self.shape, self.dtype = self._column.shape, self._column.dtype

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        """Return values; xarray turns the requested index into one that `_taken` knows."""
        support = indexing.IndexingSupport.OUTER
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._taken)

    def _taken(self, key: tuple[Any, ...]) -> NDArray[Any]:
        wanted = np.atleast_1d(np.arange(self.shape[0])[key[0]])
        values = self._column.empty(wanted.size)
        files = self._index.file[wanted]
        for number in np.unique(files):
            at = np.flatnonzero(files == number)
            with open_verified(self._index.paths[number], self._index.origin) as file:
                self._column.fill(values, at, file, self._index.row[wanted[at]])
        for axis, part in enumerate(key[1:], start=1):
            whole = (slice(None),) * axis
            if not isinstance(part, int | np.integer):
                values = values[(*whole, part)]
        scalar = (slice(None),) + tuple(
            part if isinstance(part, int | np.integer) else slice(None) for part in key[1:]
        )
        values = values[scalar]
        return values[0] if isinstance(key[0], int | np.integer) else values
