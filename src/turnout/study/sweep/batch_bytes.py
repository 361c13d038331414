"""The netCDF-4 file of a batch, made in memory.

It is written with the functions of the HDF5 library themselves: for fifty small variables any layer
above them takes far more time than they do. Still, what a file says of its variables (names,
shapes, dimensions, attributes) takes five times as long to write as their values. Batches of a
study are alike in it, so that it is written once, to a *template* without values of scenarios, and
every file is a copy of its template that is filled in. Small numbers lie at known places, where
they are put without asking HDF5, which takes as long for a few as for thousands.

Values are compressed by ISA-L where it is installed (the extra "sweep"), which takes a fifth of the
time of zlib and leaves as many bytes. Whatever reads HDF5 reads both: streams of RFC 1950, as its
filter "deflate" writes them.
"""

import math
from collections.abc import Mapping
from functools import cache, lru_cache
from threading import Lock
from typing import Any, NamedTuple

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5f, h5p, h5s, h5t
from numpy.typing import NDArray

from turnout.core.channels import CONVENTIONS
from turnout.core.lru_cache import LRUCache
from turnout.study.sweep.batch import ORIGIN, BatchOrigin, StoredVariable

try:
    from isal import isal_zlib as _zlib
except ImportError:
    import zlib as _zlib  # type: ignore[no-redef]

LARGEST_CHUNK = 2_000_000
"""Of a variable in a file, before compression, rounded up to whole rows [bytes]."""

LARGEST_CONTIGUOUS = 4096
"""A variable up to this size is stored as it is: chunks and compression would take more [bytes]."""

MOST_TEMPLATES = 16
"""Files without values in memory, the latest used; some 100 kB each."""

LEVEL = 1
"""Of compression: above the quickest, which leaves a sixth more bytes; higher ones gain nothing."""

MEMORY_STEP = 1 << 21
"""The memory of a file grows by so much [bytes]."""

# Files of one name that are open at once are one to HDF5, also in memory.
_file_lock = Lock()
_TEXT = h5py.string_dtype()
_TEXT_KIND, _TEXT_HERE = h5t.py_create(_TEXT, logical=True), h5t.py_create(_TEXT)
_SINGLE = h5s.create(h5s.SCALAR)


class _Template(NamedTuple):
    """A file without values of scenarios, and the start of those of some variables [bytes]."""

    content: bytes
    places: Mapping[str, int]


_templates = LRUCache[_Template](MOST_TEMPLATES)


def file_bytes(
    variables: Mapping[str, StoredVariable], *, origin: BatchOrigin | None = None
) -> bytes:
    """Return the netCDF-4 file of some variables; the same ones give the same bytes on a processor.

    Parameters
    ----------
    variables : mapping of str to StoredVariable
        By their names.
    origin : BatchOrigin, optional
        Written as an attribute of the file; a batch of a sweep needs it.
    """
    template = _template(variables)
    content = bytearray(template.content)
    for name, at in template.places.items():
        values = variables[name].values
        content[at : at + values.nbytes] = values.tobytes()
    with _file_lock:
        _with_image().set_file_image(bytes(content))
        file = h5f.open(b"batch", h5f.ACC_RDWR, fapl=_with_image())
        if origin is not None:
            _write_attribute(file, ORIGIN.decode(), str(origin))
        for name, variable in variables.items():
            if _is_of_scenarios(variable) and name not in template.places:
                _write_values(h5d.open(file, name.encode()), variable.values)
        return _closed(file)


def _is_of_scenarios(variable: StoredVariable) -> bool:
    """Return True if a variable has values per scenario; others are the same in all batches."""
    return variable.dims[0] == "scenario"


def _template(variables: Mapping[str, StoredVariable]) -> _Template:
    """Return the template of variables like these, made once for all alike."""
    key = tuple(
        (name, item.dims, item.coordinate, _kind_of(item.values), item.values.shape)
        + tuple(item.attributes.items())
        + (() if _is_of_scenarios(item) else (item.values.tobytes(),))
        for name, item in variables.items()
    )
    kept = _templates.get(key)
    if kept is None:
        with _file_lock:
            kept = _templates.put(key, _made_template(variables))
    return kept


def _made_template(variables: Mapping[str, StoredVariable]) -> _Template:
    timeless = h5p.create(h5p.FILE_CREATE)
    timeless.set_obj_track_times(False)
    file = h5f.create(b"batch", h5f.ACC_TRUNC, timeless, _in_memory())
    _write_attribute(file, "Conventions", CONVENTIONS)
    stored: dict[str, h5d.DatasetID] = {}
    for name in sorted(variables, key=lambda name: variables[name].dims != (name,)):
        variable = variables[name]
        stored[name] = _create_variable(file, name, variable.values)
        if variable.dims == (name,):
            h5ds.set_scale(stored[name], name.encode())
        else:
            for axis, dim in enumerate(variable.dims):
                h5ds.attach_scale(stored[name], stored[dim], axis)
        for key, value in variable.attributes.items():
            _write_attribute(stored[name], key, value)
    named = {
        name: set(variable.dims)
        for name, variable in variables.items()
        if variable.coordinate and variable.dims != (name,)
    }
    for name, variable in variables.items():
        if not variable.coordinate:
            mine = [at for at, dims in named.items() if dims <= set(variable.dims)]
            _write_attribute(stored[name], "coordinates", " ".join(mine))
        if not _is_of_scenarios(variable):
            _write_values(stored[name], variable.values)
    h5f.flush(file)  # so that places are final
    places = {
        name: stored[name].get_offset()
        for name, variable in variables.items()
        if _is_of_scenarios(variable) and _is_contiguous(variable.values)
    }
    stored.clear()
    return _Template(_closed(file), places)


def _in_memory() -> h5p.PropFAID:
    """Return the access properties of a file that is in memory alone."""
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_fapl_core(MEMORY_STEP, False)
    access.set_libver_bounds(h5f.LIBVER_LATEST, h5f.LIBVER_LATEST)
    access.set_fclose_degree(h5f.CLOSE_STRONG)
    return access


@cache
def _with_image() -> h5p.PropFAID:
    """Return the access properties of a file in memory that begins as the image set last."""
    return _in_memory()


def _closed(file: h5f.FileID) -> bytes:
    """Close a file in memory and return its content."""
    h5f.flush(file)
    content: bytes = file.get_file_image()
    file.close()
    return content


def _kind_of(values: NDArray[Any]) -> str:
    """Return the kind of numbers or texts that a file holds; texts of any length are of one."""
    return values.dtype.str if values.dtype.kind in "fibS" else "text"


def _is_contiguous(values: NDArray[Any]) -> bool:
    """Return True if values lie in a file as they are in memory."""
    return _kind_of(values) != "text" and 0 < values.nbytes <= LARGEST_CONTIGUOUS


def _create_variable(file: h5f.FileID, name: str, values: NDArray[Any]) -> h5d.DatasetID:
    """Add a variable for values like these."""
    kind, rows = _TEXT_KIND, 0
    if _kind_of(values) != "text":
        kind = _kind_in_file(values.dtype)
        if not _is_contiguous(values) and values.size:
            rows = math.ceil(values.shape[0] / math.ceil(values.nbytes / LARGEST_CHUNK))
    chunk = (rows, *values.shape[1:]) if rows else ()
    return h5d.create(file, name.encode(), kind, _shape_in_file(values.shape), _storage(chunk))


# A template has many variables alike in kind, shape and storage; naming these takes as long as
# adding a variable.
@lru_cache(maxsize=64)
def _kind_in_file(dtype: np.dtype[Any]) -> h5t.TypeID:
    of_file = h5py.string_dtype(length=dtype.itemsize) if dtype.kind == "S" else dtype
    return h5t.py_create(of_file, logical=True)


@lru_cache(maxsize=64)
def _shape_in_file(shape: tuple[int, ...]) -> h5s.SpaceID:
    return h5s.create_simple(shape)


@lru_cache(maxsize=64)
def _storage(chunk: tuple[int, ...]) -> h5p.PropDCID:
    """Return the storage properties of values: compressed in chunks, or as they are."""
    properties = h5p.create(h5p.DATASET_CREATE)
    properties.set_obj_track_times(False)
    if chunk:
        properties.set_chunk(chunk)
        properties.set_shuffle()
        properties.set_deflate(LEVEL)
    else:
        properties.set_alloc_time(h5d.ALLOC_TIME_EARLY)
    return properties


def _write_values(stored: h5d.DatasetID, values: NDArray[Any]) -> None:
    """Store the values of a variable."""
    if _kind_of(values) == "text":
        stored.write(h5s.ALL, h5s.ALL, values.astype(_TEXT))
    elif values.dtype.kind == "S":
        stored.write(h5s.ALL, h5s.ALL, np.ascontiguousarray(values), stored.get_type())
    elif values.nbytes > LARGEST_CONTIGUOUS:
        _write_chunks(stored, values, rows=stored.get_create_plist().get_chunk()[0])
    else:
        stored.write(h5s.ALL, h5s.ALL, np.ascontiguousarray(values))


def _write_chunks(stored: h5d.DatasetID, values: NDArray[Any], *, rows: int) -> None:
    """Store values in chunks of some rows; the last one is padded with zeros, as in any file."""
    for first in range(0, values.shape[0], rows):
        chunk = values[first : first + rows]
        if chunk.shape[0] < rows:
            chunk = np.zeros((rows, *chunk.shape[1:]), dtype=chunk.dtype)
            chunk[: values.shape[0] - first] = values[first:]
        alike = chunk.strides[0] == 0 and chunk.size > 0
        made = _deflate_alike(chunk[0].tobytes(), chunk.dtype, chunk.shape) if alike else None
        stored.write_direct_chunk((first, *[0] * (chunk.ndim - 1)), made or deflate_chunk(chunk))


@lru_cache(maxsize=MOST_TEMPLATES)
def _deflate_alike(row: bytes, dtype: np.dtype[Any], shape: tuple[int, ...]) -> bytes:
    """Return `deflate_chunk` of rows that are all the same, such as the positions of markers."""
    one = np.frombuffer(row, dtype=dtype).reshape(shape[1:])
    return deflate_chunk(np.broadcast_to(one, shape))


def deflate_chunk(values: NDArray[np.generic]) -> bytes:
    """Return numbers as a chunk of a file with the filters "shuffle" and "deflate".

    The bytes of the numbers are sorted first: all first bytes, then all second ones, and so on.

    Parameters
    ----------
    values : ndarray
        Of any shape.

    Examples
    --------
    >>> import zlib
    >>> found = zlib.decompress(deflate_chunk(np.arange(3, dtype=np.int16)))
    >>> list(found)
    [0, 1, 2, 0, 0, 0]
    """
    size = values.dtype.itemsize
    planes = np.ascontiguousarray(values.reshape(-1).view(np.uint8).reshape(-1, size).T)
    deflated: bytes = _zlib.compress(planes.data, LEVEL)
    return deflated


def _write_attribute(stored: h5d.DatasetID | h5f.FileID, key: str, value: str) -> None:
    """Give a variable, or the file, an attribute."""
    attribute = h5a.create(stored, key.encode(), _TEXT_KIND, _SINGLE)
    text = np.empty((), dtype=object)
    text[()] = value
    attribute.write(text, _TEXT_HERE)
