"""Open the batches of a sweep as one dataset whose values are read where they are used.

An index says in which file and row each scenario is. Files are read without the layers above HDF5,
which take longer to load than a small sweep takes.
"""

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from h5py import h5d, h5s
from numpy.typing import NDArray
from xarray.backends import BackendArray
from xarray.core import indexing

from turnout.errors import FileError
from turnout.sweep.batch import UNKNOWN_LOGICAL, BatchOrigin, StoredVariable, list_batches
from turnout.sweep.folder import BATCHES, read_identity
from turnout.sweep.verify import open_verified

Ints = NDArray[np.int64]

_FORMAT_ATTRIBUTES = frozenset(
    ("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_Netcdf4Dimid", "coordinates")
)
"""Attributes of a stored variable that are no part of what it means."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchIndex:
    """Where the row of each scenario is.

    Attributes
    ----------
    paths : tuple of Path
        Files of the batches.
    origin : BatchOrigin
        What these must say.
    scenario, file, row : ndarray of int, shape (n,)
        Number of each scenario, rising; its file, and its row there.
    like : mapping of str to Stored
        Each variable with its values if they are the same for all scenarios, otherwise with the
        shape of one.
    attributes : mapping
        Of the sweep; "missing" counts the scenarios that are not thrown yet.
    """

    paths: tuple[Path, ...]
    origin: BatchOrigin
    scenario: Ints
    file: Ints
    row: Ints
    like: Mapping[str, StoredVariable]
    attributes: Mapping[str, Any]


def read_index(folder: Path) -> BatchIndex:
    """Look into each file for its scenarios, and for variables that none before had.

    Raises
    ------
    FileError
        When the folder holds no sweep, none of its batches, or a damaged one.
    """
    identity = read_identity(folder)
    found: dict[int, Path] = {}
    for number, path in list_batches(folder / BATCHES):
        found.setdefault(number, path)
    if not found:
        message = f"{folder}: no batch is written yet; `turnout sweep run` goes on with it"
        raise FileError(message)
    paths = tuple(found.values())
    numbers: list[Ints] = []
    like: dict[str, StoredVariable] = {}
    for path in paths:
        with open_verified(path, identity.origin) as file:
            numbers.append(_read_whole(file, "scenario").astype(np.int64))
            longest = like["time"].values.size if "time" in like else 0
            longer = "time" in file and file["time"].size > longest
            if longer or not like.keys() >= set(file):
                _merge_variables(file, like)
    scenario = np.concatenate(numbers)
    file_of = np.repeat(np.arange(len(paths)), [n.size for n in numbers])
    row = np.concatenate([np.arange(n.size) for n in numbers])
    order = np.argsort(scenario, kind="stable")
    missing = identity.count - scenario.size
    attributes = {**asdict(identity), "missing": missing, "complete": missing == 0}
    return BatchIndex(
        paths, identity.origin, scenario[order], file_of[order], row[order], like, attributes
    )


def _merge_variables(file: "h5py.File", like: dict[str, StoredVariable]) -> None:
    """Take up the variables of a file that are new, and longer times."""
    named = {name for v in file.values() for name in str(v.attrs.get("coordinates", "")).split()}
    for name, stored in file.items():
        dims = tuple(axis[0].name.lstrip("/") for axis in stored.dims if len(axis)) or (name,)
        if name in like and not ("time" in dims and stored.shape[-1] > like[name].values.shape[-1]):
            continue
        about = {k: v for k, v in stored.attrs.items() if k not in _FORMAT_ATTRIBUTES}
        if dims[0] == "scenario":
            values = np.broadcast_to(np.zeros((), dtype=stored.dtype), (1, *stored.shape[1:]))
        else:
            values = _read_whole(file, name)
        coordinate = name in named or dims == (name,)
        like[name] = StoredVariable(
            dims if stored.shape else (), values, about, coordinate=coordinate
        )


def label_arrays(
    index: BatchIndex, *, names: Collection[str] | None = None
) -> dict[str, StoredVariable]:
    """Read all that has no time, in one pass.

    Parameters
    ----------
    index : Index
        Of a sweep.
    names : collection of str, optional
        What is wanted besides the inputs, so that the rest need not be read; default all.
    """
    columns = {
        name: Column(index, name)
        for name, like in index.like.items()
        if like.dims[:1] == ("scenario",) and "time" not in like.dims and name != "scenario"
        if names is None or name in names or "input" in like.attributes
    }
    values = {name: column.empty(index.scenario.size) for name, column in columns.items()}
    for number, path in enumerate(index.paths):
        at = np.flatnonzero(index.file == number)
        with open_verified(path, index.origin) as file:
            for name, column in columns.items():
                column.fill(values[name], at, file, index.row[at])
    like = index.like
    return {
        name: StoredVariable(like[name].dims, found, like[name].attributes, like[name].coordinate)
        for name, found in values.items()
    }


class Column:
    """A variable over all batches."""

    def __init__(self, index: BatchIndex, name: str) -> None:
        like = index.like[name]
        self._name, self._short = name, "time" not in like.dims
        longest = 0 if self._short else index.like["time"].values.size
        rest = tuple(
            longest if dim == "time" else n
            for dim, n in zip(like.dims[1:], like.values.shape[1:], strict=True)
        )
        kind = like.values.dtype
        self.shape = (index.scenario.size, *rest)
        self.dtype = kind if kind.kind in "fib" else np.dtype(object)

    def empty(self, count: int) -> NDArray[Any]:
        """Return an array for so many scenarios, filled with what stands for nothing."""
        if self.dtype.kind == "O":
            return np.full((count, *self.shape[1:]), "", dtype=object)
        nothing = np.nan if self.dtype.kind == "f" else UNKNOWN_LOGICAL
        return np.full((count, *self.shape[1:]), nothing, dtype=self.dtype)

    def fill(self, values: NDArray[Any], at: Ints, file: "h5py.File", rows: Ints) -> None:
        """Put some rows of a file where they belong."""
        if self._name not in file or not rows.size:
            return
        if self._short:
            found = _read_whole(file, self._name)[rows]
        else:
            first, last = int(rows.min()), int(rows.max()) + 1
            found = np.asarray(file[self._name][first:last])[rows - first]
        place: tuple[Ints | slice, ...] = (at, *(slice(n) for n in found.shape[1:]))
        values[place] = found


def _read_whole(file: "h5py.File", name: str) -> NDArray[Any]:
    """Read a whole variable; texts become objects."""
    stored = h5d.open(file.id, name.encode())
    values = np.empty(stored.shape, dtype=stored.dtype)
    of_one_length = values.dtype.kind == "S"  # whose encoding numpy does not know
    stored.read(h5s.ALL, h5s.ALL, values, stored.get_type() if of_one_length else None)
    if values.dtype.kind in "OS":
        values = np.array([text.decode() for text in values.flat], dtype=object)
        return values.reshape(stored.shape)
    return values


def open_sweep(folder: Path | str) -> xr.Dataset:
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
        In memory, as `open_sweep` has it.

    Raises
    ------
    FileError
        As `open_sweep`.
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
    return _to_dataset(index, variables)


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
