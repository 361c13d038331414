"""The batches of a sweep as ONE dataset, read from its files only where it is looked at."""

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
from turnout.study.sweep_batch import UNKNOWN
from turnout.study.sweep_file import written_batches
from turnout.study.sweep_folder import BATCHES, read_identity

Ints = NDArray[np.int64]

_OF_THE_FORMAT = frozenset(
    ("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_Netcdf4Dimid", "coordinates")
)
"""Attributes of a stored variable that are no part of what it means."""


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
    index = _indexed(Path(folder))
    variables: dict[str, xr.Variable] = {}
    for name, like in index.like.items():
        if like.dims[:1] != ("scenario",):
            variables[name] = like
        elif name != "scenario":
            data = indexing.LazilyIndexedArray(_Stacked(index, name, like))
            variables[name] = xr.Variable(like.dims, data, like.attrs)
    return _whole(index, variables)


def read_labels(folder: Path | str, *, names: Collection[str] | None = None) -> xr.Dataset:
    """Read all that has no time: inputs, outcomes, labels and features, in one pass.

    Parameters
    ----------
    folder : path-like
        Of `turnout sweep run`.
    names : collection of str, optional
        What is wanted besides the inputs, so that the rest need not be read; default all.

    Returns
    -------
    xarray.Dataset
        In memory, as `open_sweep` has it.

    Raises
    ------
    FileError
        As `open_sweep`.
    """
    index = _indexed(Path(folder))
    arrays = {
        name: _Stacked(index, name, like)
        for name, like in index.like.items()
        if like.dims[:1] == ("scenario",) and "time" not in like.dims and name != "scenario"
        if names is None or name in names or "input" in like.attrs
    }
    values = {name: array.empty(index.scenario.size) for name, array in arrays.items()}
    for number, path in enumerate(index.paths):
        at = np.flatnonzero(index.file == number)
        with _opened(path) as file:
            for name, array in arrays.items():
                array.fill(values[name], at, file, index.row[at])
    variables = {
        name: xr.Variable(index.like[name].dims, values[name], index.like[name].attrs)
        for name in arrays
    }
    variables |= {
        name: like
        for name, like in index.like.items()
        if like.dims[:1] != ("scenario",) and name != "time"
    }
    return _whole(index, variables)


@dataclass(frozen=True, slots=True, eq=False)
class _Index:
    """Where the row of each scenario is: file and row in it; and what the variables are like."""

    paths: tuple[Path, ...]
    scenario: Ints
    file: Ints
    row: Ints
    like: Mapping[str, xr.Variable]
    coordinates: frozenset[str]
    attributes: Mapping[str, Any]


def _indexed(folder: Path) -> _Index:
    """Look into each file for its scenarios, and for variables that none before had."""
    identity = read_identity(folder)
    found, _ = written_batches(folder / BATCHES)
    if not found:
        message = f"{folder}: no batch is written yet; `turnout sweep run` goes on with it"
        raise FileError(message)
    paths = tuple(found[number] for number in sorted(found))
    numbers: list[Ints] = []
    like: dict[str, xr.Variable] = {}
    coordinates: set[str] = set()
    for path in paths:
        with _opened(path) as file:
            numbers.append(_values(file, "scenario").astype(np.int64))
            longer = "time" in file and file["time"].size > like.get("time", np.empty(0)).size
            if longer or not like.keys() >= set(file):
                _learn(file, like, coordinates)
    scenario = np.concatenate(numbers)
    file_of = np.repeat(np.arange(len(paths)), [n.size for n in numbers])
    row = np.concatenate([np.arange(n.size) for n in numbers])
    order = np.argsort(scenario, kind="stable")
    missing = identity.count - scenario.size
    attributes = {**asdict(identity), "missing": missing, "complete": missing == 0}
    return _Index(
        paths,
        scenario[order],
        file_of[order],
        row[order],
        like,
        frozenset(coordinates),
        attributes,
    )


def _learn(file: "h5py.File", like: dict[str, xr.Variable], coordinates: set[str]) -> None:
    """Take up the variables of a file that are new, and longer times.

    It is read as it was written; to have it read by layers above takes as long as all labels do.
    """
    for name, stored in file.items():
        dims = tuple(axis[0].name.lstrip("/") for axis in stored.dims if len(axis)) or (name,)
        if name in like and not ("time" in dims and stored.shape[-1] > like[name].shape[-1]):
            continue
        about = {k: v for k, v in stored.attrs.items() if k not in _OF_THE_FORMAT}
        if dims[0] == "scenario":
            values = np.broadcast_to(np.zeros((), dtype=stored.dtype), (1, *stored.shape[1:]))
        else:
            values = _values(file, name)
        like[name] = xr.Variable(dims if stored.shape else (), values, about)
        named = str(stored.attrs.get("coordinates", "")).split()
        coordinates |= {name, *named} if dims == (name,) else set(named)


def _values(file: "h5py.File", name: str) -> NDArray[Any]:
    """Read a whole variable; texts become objects."""
    stored = h5d.open(file.id, name.encode())
    values = np.empty(stored.shape, dtype=stored.dtype)
    stored.read(h5s.ALL, h5s.ALL, values)
    if values.dtype.kind == "O":
        values = np.array([text.decode() for text in values.flat], dtype=object)
        return values.reshape(stored.shape)
    return values


def _whole(index: _Index, variables: Mapping[str, xr.Variable]) -> xr.Dataset:
    described = dict(index.like["scenario"].attrs)
    scenario = xr.Variable("scenario", index.scenario, described)
    dataset = xr.Dataset({**variables, "scenario": scenario}, attrs=dict(index.attributes))
    return dataset.set_coords([name for name in dataset if str(name) in index.coordinates])


class _Stacked(BackendArray):
    """One variable over all batches, as xarray's lazy indexing wants it."""

    def __init__(self, index: _Index, name: str, like: xr.Variable) -> None:
        self._index, self._name, self._short = index, name, "time" not in like.dims
        longest = index.like["time"].size if "time" in like.dims else 0
        rest = tuple(
            longest if dim == "time" else n
            for dim, n in zip(like.dims[1:], like.shape[1:], strict=True)
        )
        self.shape = (index.scenario.size, *rest)
        self.dtype = like.dtype if like.dtype.kind in "fib" else np.dtype(object)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        """Return values; xarray turns what it was asked for to what `_taken` knows."""
        support = indexing.IndexingSupport.OUTER
        return indexing.explicit_indexing_adapter(key, self.shape, support, self._taken)

    def empty(self, count: int) -> NDArray[Any]:
        """Return an array for so many scenarios, filled with what stands for nothing."""
        if self.dtype.kind == "O":
            return np.full((count, *self.shape[1:]), "", dtype=object)
        nothing = np.nan if self.dtype.kind == "f" else UNKNOWN
        return np.full((count, *self.shape[1:]), nothing, dtype=self.dtype)

    def fill(self, values: NDArray[Any], at: Ints, file: "h5py.File", rows: Ints) -> None:
        """Put some rows of a file where they belong."""
        if self._name not in file or not rows.size:
            return
        if self._short:
            found = _values(file, self._name)[rows]
        else:
            first, last = int(rows.min()), int(rows.max()) + 1
            found = np.asarray(file[self._name][first:last])[rows - first]
        place: tuple[Ints | slice, ...] = (at, *(slice(n) for n in found.shape[1:]))
        values[place] = found

    def _taken(self, key: tuple[Any, ...]) -> NDArray[Any]:
        wanted = np.atleast_1d(np.arange(self.shape[0])[key[0]])
        values = self.empty(wanted.size)
        files = self._index.file[wanted]
        for number in np.unique(files):
            at = np.flatnonzero(files == number)
            with _opened(self._index.paths[number]) as file:
                self.fill(values, at, file, self._index.row[wanted[at]])
        for axis, part in enumerate(key[1:], start=1):
            whole = (slice(None),) * axis
            if not isinstance(part, int | np.integer):
                values = values[(*whole, part)]
        scalar = (slice(None),) + tuple(
            part if isinstance(part, int | np.integer) else slice(None) for part in key[1:]
        )
        values = values[scalar]
        return values[0] if isinstance(key[0], int | np.integer) else values


class _opened:
    """A file of a batch, closed again in any case; a damaged one is told by its name."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> "h5py.File":
        try:
            self._file = h5py.File(self._path, "r")
        except OSError as error:
            message = f"{self._path}: cannot be read ({error}); `turnout sweep run` makes it anew"
            raise FileError(message) from None
        return self._file

    def __exit__(self, *given: object) -> None:
        self._file.close()
