"""Batch and row of each scenario of a sweep, and a summary of the batches.

Files are read without the layers above HDF5, which take longer to load than a small sweep takes.
"""

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5d, h5s
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.study.sweep.batch import BatchOrigin, StoredVariable, list_batches
from turnout.study.sweep.folder import BATCHES, read_identity
from turnout.study.sweep.labels import UNKNOWN_LOGICAL
from turnout.study.sweep.verify import open_verified

Ints = NDArray[np.int64]

_FORMAT_ATTRIBUTES = frozenset(
    ("CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_Netcdf4Dimid", "coordinates")
)
"""Attributes of a stored variable that are no part of its meaning."""


@dataclass(frozen=True, slots=True, eq=False)
class BatchIndex:
    """File and row of each scenario.

    Attributes
    ----------
    paths : tuple of Path
        Files of the batches.
    origin : BatchOrigin
        Origin that these must state.
    scenario, file, row : ndarray of int, shape (n,)
        Number of each scenario, rising; its file, and its row there.
    like : mapping of str to StoredVariable
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


def _merge_variables(file: h5py.File, like: dict[str, StoredVariable]) -> None:
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
    index : BatchIndex
        Of a sweep.
    names : collection of str, optional
        Labels besides the inputs, so that the rest need not be read; default all.
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
        """Return an array for so many scenarios, filled with the missing value."""
        if self.dtype.kind == "O":
            return np.full((count, *self.shape[1:]), "", dtype=object)
        nothing = np.nan if self.dtype.kind == "f" else UNKNOWN_LOGICAL
        return np.full((count, *self.shape[1:]), nothing, dtype=self.dtype)

    def fill(self, values: NDArray[Any], at: Ints, file: h5py.File, rows: Ints) -> None:
        """Copy some rows of a file into their places in an array."""
        if self._name not in file or not rows.size:
            return
        if self._short:
            found = _read_whole(file, self._name)[rows]
        else:
            first, last = int(rows.min()), int(rows.max()) + 1
            found = np.asarray(file[self._name][first:last])[rows - first]
        place: tuple[Ints | slice, ...] = (at, *(slice(n) for n in found.shape[1:]))
        values[place] = found


def _read_whole(file: h5py.File, name: str) -> NDArray[Any]:
    """Read a whole variable; texts become objects."""
    stored = h5d.open(file.id, name.encode())
    values = np.empty(stored.shape, dtype=stored.dtype)
    of_one_length = values.dtype.kind == "S"  # whose encoding numpy does not know
    stored.read(h5s.ALL, h5s.ALL, values, stored.get_type() if of_one_length else None)
    if values.dtype.kind in "OS":
        values = np.array([text.decode() for text in values.flat], dtype=object)
        return values.reshape(stored.shape)
    return values
