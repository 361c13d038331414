"""Chunks of a file as HDF5's filters "shuffle" and "deflate" leave them, in half of their time.

The bytes of numbers are sorted into byte planes: first all first bytes, then all second ones. What
comes last in a measured number hardly ever occurs again, and looking for it is most of the work of
the filter "deflate". Of such bytes only runs are shortened. What reads the file finds one stream of
RFC 1950 for each chunk, as the filter writes it.
"""

import zlib

import numpy as np
from numpy.typing import NDArray

LEVEL = 1
"""Of compression: the quickest that looks for what occurs again."""

SMALL = 1 << 16
"""A chunk up to this size is compressed in one go [bytes]."""

SAMPLE = 1 << 12
"""So many bytes of a plane show whether they occur again."""

LEAST_GAIN = 0.4
"""Share of a sample by which it must become smaller for what occurs again to be looked for."""

_RAW, _MEMORY = -15, 8
_HEADER = b"\x78\x01"
"""Of a stream of RFC 1950 with a window of 32 kB, compressed quickly."""


def deflate_chunk(values: NDArray[np.generic]) -> bytes:
    """Return numbers as a chunk of a file with the filters "shuffle" and "deflate".

    Parameters
    ----------
    values : ndarray
        Of any shape, contiguous.

    Examples
    --------
    >>> found = zlib.decompress(deflate_chunk(np.arange(3, dtype=np.int16)))
    >>> list(found)
    [0, 1, 2, 0, 0, 0]
    """
    size = values.dtype.itemsize
    planes = np.ascontiguousarray(values.reshape(-1).view(np.uint8).reshape(-1, size).T)
    if planes.nbytes <= SMALL:
        return zlib.compress(planes.data, LEVEL)
    pieces = [_HEADER]
    for number, plane in enumerate(planes, 1):
        stream = zlib.compressobj(LEVEL, zlib.DEFLATED, _RAW, _MEMORY, _strategy(plane))
        last = number == size
        pieces += (
            stream.compress(plane.data),
            stream.flush(zlib.Z_FINISH if last else zlib.Z_SYNC_FLUSH),
        )
    pieces.append(zlib.adler32(planes.data).to_bytes(4, "big"))
    return b"".join(pieces)


def _strategy(plane: NDArray[np.uint8]) -> int:
    """Return whether to look for all that occurs again, or for runs alone."""
    first = (plane.size - SAMPLE) // 2
    sample = plane[first : first + SAMPLE]
    again = len(zlib.compress(sample.data, LEVEL)) < (1.0 - LEAST_GAIN) * sample.size
    return zlib.Z_DEFAULT_STRATEGY if again else zlib.Z_RLE
