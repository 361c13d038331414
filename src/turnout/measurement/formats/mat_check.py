"""Consistency check of the parts of a MATLAB file of version 5.

`scipy.io.loadmat` trusts the sizes in a file: after one flipped bit it can return fewer variables,
or a number in place of a structure, without an error (docs/project/decisions.md). The isolated
process answers crashes, memory and time, but not that; so this is checked here, and nothing else.
Compressed variables carry a checksum that loadmat verifies. A bit flipped in the samples of an
uncompressed variable cannot be seen.

Layout: a header of 128 bytes, then elements of a tag (type and number of bytes, 4 bytes each) and
data; what is in a matrix is elements again, padded to 8 bytes.
"""

import struct
from pathlib import Path

HEADER, TAG = 128, 8
MATRIX, COMPRESSED = 14, 15
CELL, STRUCTURE, OBJECT, CHARACTERS, SPARSE, LARGEST_NUMERIC = 1, 2, 3, 4, 5, 15
OPAQUE = 17
# Bytes of a number by the type of its element.
WIDTHS = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}


def check_mat5(path: Path) -> None:
    """Check that the elements of a version 5 file fill it, and hold as many values as they say.

    Raises
    ------
    ValueError
        Saying what is wrong.
    """
    with path.open("rb") as file:
        header = file.read(HEADER)
        if header[126:128] not in (b"IM", b"MI"):
            message = "its header is damaged"
            raise ValueError(message)
        order = "<" if header[126:128] == b"IM" else ">"
        while tag := file.read(TAG):
            if len(tag) < TAG:
                message = "it is cut off within a tag"
                raise ValueError(message)
            kind, size = struct.unpack(f"{order}II", tag)
            if kind not in (MATRIX, COMPRESSED):
                message = f"an element of type {kind} stands where a variable must"
                raise ValueError(message)
            content = file.read(size)
            if len(content) < size:
                message = "it is cut off within a variable"
                raise ValueError(message)
            if kind == MATRIX:
                _check_matrix(memoryview(content), order)


def _check_matrix(content: memoryview, order: str) -> None:
    """Check that flags, dimensions, name and values of a matrix fit each other."""
    if not content.nbytes:
        return  # an empty cell
    parts = _elements(content, order)
    if (
        parts
        and parts[0][0] == 6
        and parts[0][1].nbytes == 8
        and parts[0][1][0 if order == "<" else 3] == OPAQUE
    ):
        return  # an object, whose values stand elsewhere
    kinds = [kind for kind, _ in parts[:3]]
    # Some programs write unsigned dimensions, and names in UTF-8.
    if len(parts) < 3 or kinds[0] != 6 or kinds[1] not in (5, 6) or kinds[2] not in (1, 2, 16):
        message = "a variable lacks its flags, dimensions or name"
        raise ValueError(message)
    flags, dimensions = parts[0][1], parts[1][1]
    if flags.nbytes != 8 or dimensions.nbytes < 8 or dimensions.nbytes % 4:
        message = "the flags or dimensions of a variable are damaged"
        raise ValueError(message)
    word = struct.unpack(f"{order}I", flags[:4])[0]
    _check_values(parts[3:], word, _count(dimensions, order), order)


def _check_values(parts: list[tuple[int, memoryview]], word: int, count: int, order: str) -> None:
    """Check the values after the name of a matrix, by its class."""
    kind = word & 0xFF
    if kind in (CELL, STRUCTURE, OBJECT):
        inner = [values for part, values in parts if part == MATRIX]
        if kind == CELL and (len(inner) != count or len(inner) != len(parts)):
            message = "a cell array does not hold as many values as it says"
            raise ValueError(message)
        if kind == STRUCTURE:
            _check_fields(parts, count, len(inner), order)
        for values in inner:
            _check_matrix(values, order)
        return
    # Characters may take several bytes; sparse matrices hold fewer values than their dimensions.
    if kind in (CHARACTERS, SPARSE) or kind > LARGEST_NUMERIC:
        return
    # Real values, and imaginary ones where a flag says so.
    wanted = 2 if word & 0x0800 else 1
    if len(parts) != wanted or any(
        WIDTHS.get(part, 0) == 0 or values.nbytes != count * WIDTHS[part] for part, values in parts
    ):
        message = "a variable does not hold as many numbers as it says"
        raise ValueError(message)


def _check_fields(parts: list[tuple[int, memoryview]], count: int, inner: int, order: str) -> None:
    """Check that a structure has a value for each of its fields."""
    if len(parts) < 2 or parts[0][0] != 5 or parts[0][1].nbytes != 4 or parts[1][0] != 1:
        message = "a structure lacks the names of its fields"
        raise ValueError(message)
    length = struct.unpack(f"{order}i", parts[0][1])[0]
    names = parts[1][1].nbytes
    if length <= 0 or names % length or inner != count * (names // length):
        message = "a structure does not hold as many values as it says"
        raise ValueError(message)


def _count(dimensions: memoryview, order: str) -> int:
    """Return the number of values for these dimensions."""
    count = 1
    for size in struct.unpack(f"{order}{dimensions.nbytes // 4}i", dimensions):
        if size < 0:
            message = "a variable has a negative dimension"
            raise ValueError(message)
        count *= size
    return count


def _elements(content: memoryview, order: str) -> list[tuple[int, memoryview]]:
    """Return type and data of each element within a matrix."""
    found, at = [], 0
    while at < content.nbytes:
        if content.nbytes - at < TAG:
            message = "a variable ends within a tag"
            raise ValueError(message)
        kind, size = struct.unpack(f"{order}II", content[at : at + TAG])
        start = at + TAG
        if kind >> 16:  # up to 4 bytes, packed into the tag
            size, kind, start = kind >> 16, kind & 0xFFFF, at + 4
            at += TAG
        else:
            at = start + size + (-size % 8 if kind != MATRIX else 0)
        if start + size > content.nbytes or (kind != MATRIX and kind not in WIDTHS):
            message = "an element is longer than its variable, or of no known type"
            raise ValueError(message)
        found.append((kind, content[start : start + size]))
    return found
