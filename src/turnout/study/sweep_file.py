"""The file of a batch: netCDF-4, written whole or not at all.

It carries a digest of its content in its name, which every reader verifies, and in an attribute
which study, which sources and which batch of the study it comes from. It is written with the
functions of the HDF5 library themselves, since for fifty small variables any layer above them takes
far more time than they do.
"""

import hashlib
import io
import re
from collections.abc import Mapping
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5f, h5p, h5s, h5t
from numpy.typing import NDArray

from turnout.files.atomic import write_atomic
from turnout.schema.channels import CONVENTIONS

LARGEST_CHUNK = 1_000_000
"""Of a variable in a file, before compression [bytes]."""

SMALL = 2048
"""A variable up to this size is stored as it is: chunks and compression would take more [bytes]."""

DIGITS = 32
"""Of the SHA-256 of a file's content that stand in its name [hexadecimal]."""

ORIGIN = b"origin"
"""Attribute of a file that says where it comes from."""

BATCH_NAME = re.compile(r"(\d{6,})-([0-9a-f]{32})\.nc")
_TEXT = h5py.string_dtype()
_TEXT_KIND, _SINGLE = h5t.py_create(_TEXT, logical=True), h5s.create(h5s.SCALAR)


@dataclass(frozen=True, slots=True, eq=False)
class Stored:
    """A variable of a file.

    Attributes
    ----------
    dims : tuple of str
        Each has a variable of its name, its coordinate.
    values : ndarray
        Numbers or texts.
    attributes : mapping of str to str
        Unit, meaning and so on.
    coordinate : bool
        Whether it is one of others.
    """

    dims: tuple[str, ...]
    values: NDArray[Any]
    attributes: Mapping[str, str]
    coordinate: bool


@dataclass(frozen=True, slots=True)
class BatchOrigin:
    """Where a batch comes from, as its file says.

    Attributes
    ----------
    study : str
        Digest of the study.
    version, code : str
        Of the program that made it, and a digest of its sources.
    batch : str
        Its number in the study.
    """

    study: str
    version: str
    code: str
    batch: str

    def __str__(self) -> str:
        """Return all of it in one line, which is quicker to read than an attribute each."""
        return " ".join(astuple(self))


def file_bytes(variables: Mapping[str, Stored], *, origin: BatchOrigin | None = None) -> bytes:
    """Return the netCDF-4 file of some variables; the same ones always give the same bytes.

    Parameters
    ----------
    variables : mapping of str to Stored
        By their names.
    origin : BatchOrigin, optional
        Written as an attribute of the file; a batch of a sweep needs it.
    """
    content = io.BytesIO()
    with h5py.File(content, "w", libver="latest") as file:
        _attach(file.id, "Conventions", CONVENTIONS)
        if origin is not None:
            _attach(file.id, ORIGIN.decode(), str(origin))
        stored: dict[str, h5d.DatasetID] = {}
        for name in sorted(variables, key=lambda name: variables[name].dims != (name,)):
            variable = variables[name]
            stored[name] = _stored(file, name, variable)
            if variable.dims == (name,):
                h5ds.set_scale(stored[name], name.encode())
            else:
                for axis, dim in enumerate(variable.dims):
                    h5ds.attach_scale(stored[name], stored[dim], axis)
            for key, value in variable.attributes.items():
                _attach(stored[name], key, value)
        named = {
            name: set(variable.dims)
            for name, variable in variables.items()
            if variable.coordinate and variable.dims != (name,)
        }
        for name, variable in variables.items():
            if not variable.coordinate:
                mine = [at for at, dims in named.items() if dims <= set(variable.dims)]
                _attach(stored[name], "coordinates", " ".join(mine))
    return content.getvalue()


def _stored(file: h5py.File, name: str, variable: Stored) -> h5d.DatasetID:
    """Store the values of a variable."""
    values = np.ascontiguousarray(variable.values)
    properties = h5p.create(h5p.DATASET_CREATE)
    properties.set_obj_track_times(False)
    if values.dtype.kind not in "fib":
        values = values.astype(_TEXT)
    elif values.nbytes > SMALL:
        rows = max(1, LARGEST_CHUNK * values.shape[0] // values.nbytes)
        properties.set_chunk((min(values.shape[0], rows), *values.shape[1:]))
        properties.set_shuffle()
        properties.set_deflate(1)
    kind = h5t.py_create(values.dtype, logical=True)
    space = h5s.create_simple(variable.values.shape)
    made = h5d.create(file.id, name.encode(), kind, space, properties)
    made.write(h5s.ALL, h5s.ALL, values)
    return made


def _attach(stored: h5d.DatasetID | h5f.FileID, key: str, value: str) -> None:
    """Give a variable, or the file, an attribute."""
    attribute = h5a.create(stored, key.encode(), _TEXT_KIND, _SINGLE)
    attribute.write(np.array(value, dtype=_TEXT))


def write_batch(folder: Path, number: int, content: bytes) -> Path:
    """Write the file of a batch durably, named by its number and the digest of its content.

    Raises
    ------
    FileError
        When it cannot be written; nothing is left of it then.
    """
    digest = hashlib.sha256(content).hexdigest()[:DIGITS]
    path = folder / f"{number:06d}-{digest}.nc"
    write_atomic(path, content)
    return path


def written_batches(folder: Path) -> list[tuple[int, Path]]:
    """Return number and file of the batches of a folder, by their names alone."""
    found = ((BATCH_NAME.fullmatch(path.name), path) for path in folder.glob("[0-9]*.nc"))
    return sorted((int(match[1]), path) for match, path in found if match is not None)
