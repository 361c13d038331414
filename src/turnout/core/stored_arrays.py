"""Serialise arrays as the content of a file with a digest, so that damage is detected.

The format is that of `numpy.savez` with one more member: a digest of all others and of the purpose
of the file. Nothing is unpickled, nothing is decompressed, and no array is larger than its file.
"""

import hashlib
import io
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

DIGEST = "content_digest"


class DamagedError(ValueError):
    """The content of a file differs from the arrays that were written."""


def arrays_to_bytes(arrays: Mapping[str, NDArray[Any]], purpose: str) -> bytes:
    """Return arrays as the content of a file.

    Parameters
    ----------
    arrays : mapping of str to ndarray
        Numbers, logical values or texts; no objects.
    purpose : str
        Purpose of the file, such as its key; reading it back needs the same.
    """
    if any(array.dtype.hasobject for array in arrays.values()):
        message = "arrays of objects would have to be pickled"
        raise TypeError(message)
    stream = io.BytesIO()
    members: dict[str, Any] = {**arrays, DIGEST: np.array(_digest(arrays, purpose))}
    try:
        np.savez(stream, **members)
    except ValueError as error:  # Ctrl-C within a member: closing the file fails in its place
        if isinstance(error.__context__, KeyboardInterrupt):
            raise error.__context__ from None
        raise
    return stream.getvalue()


def arrays_from_bytes(content: bytes, purpose: str) -> dict[str, NDArray[Any]]:
    """Return arrays from the content of a file.

    Raises
    ------
    DamagedError
        When the content is not what `arrays_to_bytes` wrote for this purpose.

    Examples
    --------
    >>> content = arrays_to_bytes({"a": np.array([1.0, 2.0])}, "example")
    >>> arrays_from_bytes(content, "example")["a"].tolist()
    [1.0, 2.0]
    >>> arrays_from_bytes(content, "another")
    Traceback (most recent call last):
        ...
    turnout.core.stored_arrays.DamagedError: was written for another purpose
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            arrays = {
                item.filename.removesuffix(".npy"): _read_member(archive, item)
                for item in archive.infolist()
            }
    except DamagedError:
        raise
    except Exception as error:  # zipfile and NumPy raise a dozen classes on damaged content
        message = f"is damaged ({error})"
        raise DamagedError(message) from None
    said = arrays.pop(DIGEST, None)
    if said is None or str(said) != _digest(arrays, purpose):
        message = "was written for another purpose"
        raise DamagedError(message)
    return arrays


def _read_member(archive: zipfile.ZipFile, item: zipfile.ZipInfo) -> NDArray[Any]:
    if item.compress_type != zipfile.ZIP_STORED:
        message = f"is damaged ({item.filename} is compressed)"
        raise DamagedError(message)
    data = archive.read(item)
    stream = io.BytesIO(data)
    if npy.read_magic(stream) != (1, 0):
        message = f"is damaged ({item.filename} has another shape or type)"
        raise DamagedError(message)
    shape, fortran_order, dtype = npy.read_array_header_1_0(stream)
    if dtype.hasobject:
        message = f"is damaged ({item.filename} holds objects)"
        raise DamagedError(message)
    order: Any = "F" if fortran_order else "C"
    # On the bytes themselves: a size that was never written is refused, not reserved.
    values: NDArray[Any] = np.ndarray(shape, dtype, data, stream.tell(), order=order)
    return values.copy(order="K")


def _digest(arrays: Mapping[str, NDArray[Any]], purpose: str) -> str:
    found = hashlib.blake2b(purpose.encode(), digest_size=16)
    for name, array in sorted(arrays.items()):
        found.update(f" {name!r} {array.dtype.str} {array.shape} ".encode())
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()
