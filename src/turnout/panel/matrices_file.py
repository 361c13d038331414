"""Files of rail matrices: MATLAB version 5, written whole and read with all problems at once.

The variables of a file are described in docs/how-to/exchange-matrices.md.
"""

import hashlib
import io
import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from turnout.errors import FileError
from turnout.files.problems import choices, nearest
from turnout.files.toml import read_bytes
from turnout.panel.rail_matrices import RailMatrices

Floats = NDArray[np.float64]

FORMAT = "turnout rail matrices 1"
DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
NEEDED = ("stiffness", "mass", "table_x", "table_direction")
LARGEST = 2_000_000_000
LARGEST_UNPACKED = 1_000_000_000
_COMPRESSED, _CHUNK = 15, 1 << 20
SYMMETRIC = 1e-9
"""Largest difference of a matrix from its transpose, as a share of its largest entry."""


def matrices_bytes(matrices: RailMatrices, *, extra: Mapping[str, object]) -> bytes:
    """Return the content of a file of rail matrices.

    Parameters
    ----------
    matrices : RailMatrices
        The rail; `digest` is not written.
    extra : mapping of str to array or text
        Further variables for other programs, which reading passes over.
    """
    content: dict[str, object] = {
        "format": FORMAT,
        "stiffness": sp.csc_matrix(matrices.stiffness),
        "mass": sp.csc_matrix(matrices.mass),
        "table_x": matrices.x[:, np.newaxis],
        "table_z": matrices.z[:, np.newaxis],
        "table_direction": np.array(matrices.direction, dtype=object)[:, np.newaxis],
        "with_supports": float(matrices.with_supports),
        **extra,
    }
    if matrices.damping is not None:
        content["damping"] = sp.csc_matrix(matrices.damping)
    if matrices.unit_weight is not None:
        content["unit_weight"] = matrices.unit_weight[:, np.newaxis]
    if matrices.rows is not None:
        content["rows"] = sp.csc_matrix(matrices.rows)
    stream = io.BytesIO()
    target: Any = stream
    from scipy.io import savemat  # takes long to load, and few panels have matrices

    savemat(target, content, format="5", do_compression=True, oned_as="column")
    return stream.getvalue()


def read_rail_matrices(path: Path) -> tuple[RailMatrices | None, list[str]]:
    """Read the matrices of one rail.

    Parameters
    ----------
    path : Path
        A MATLAB file of version 5.

    Returns
    -------
    matrices : RailMatrices or None
        None when anything is wrong.
    problems : list of str
        Everything that is, each with its remedy.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        content = read_bytes(path, largest=LARGEST)
    except FileError as error:
        return None, [str(error)]
    if not _fits_unpacked(content):
        return None, [f"holds more than {LARGEST_UNPACKED} bytes once unpacked; reduce the rail"]
    try:
        stream: Any = io.BytesIO(content)
        found = loadmat(stream, squeeze_me=False, chars_as_strings=True)
    except NotImplementedError:
        return None, ["is a MATLAB file of version 7.3; save it with '-v7'"]
    except (MatReadError, ValueError, TypeError, OSError, KeyError, zlib.error, struct.error):
        return None, ["is no MATLAB file of version 5, or a damaged one; save it with '-v7'"]
    reader = _Reader(found, [])
    matrices = reader.matrices(hashlib.sha256(content).hexdigest())
    return (None if reader.problems else matrices), reader.problems


def _fits_unpacked(content: bytes) -> bool:
    """Tell whether the compressed variables of a file of version 5 come to no more than allowed."""
    order, position, total = "<" if content[126:128] == b"IM" else ">", 128, 0
    while position + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, position)
        position += 8
        if kind == _COMPRESSED:
            total += _unpacked_size(memoryview(content)[position : position + size], total)
        position += size
    return total <= LARGEST_UNPACKED


def _unpacked_size(packed: memoryview, before: int) -> int:
    """Return how many bytes a compressed variable holds, counted until that is too many."""
    machine, size = zlib.decompressobj(), 0
    with suppress(zlib.error):  # what is damaged is told by the reader
        piece = machine.decompress(packed, _CHUNK)
        while piece and before + size <= LARGEST_UNPACKED:
            size += len(piece)
            piece = machine.decompress(machine.unconsumed_tail, _CHUNK)
    return size


@dataclass(slots=True)
class _Reader:
    """Takes the variables of a file one by one and collects what is wrong."""

    found: Mapping[str, Any]
    problems: list[str]

    def matrices(self, digest: str) -> RailMatrices | None:
        """Return what the file says, as far as it makes sense."""
        names = [name for name in self.found if not name.startswith("__")]
        for name in NEEDED:
            if name not in self.found:
                self.problems.append(f"has no variable '{name}'{nearest(name, names)}; add it")
        stiffness, mass = self._square("stiffness"), self._square("mass")
        size = next((m.shape[0] for m in (stiffness, mass) if m is not None), None)
        if stiffness is not None and mass is not None and stiffness.shape != mass.shape:
            self.problems.append(
                f"stiffness is {_shape(stiffness)} and mass {_shape(mass)}; they must be alike"
            )
        damping = self._square("damping") if "damping" in self.found else None
        if damping is not None and size is not None and damping.shape[0] != size:
            self.problems.append(f"damping is {_shape(damping)}, must be {size} x {size}")
        if mass is not None and np.any(mass.diagonal() < 0):
            self.problems.append("mass has a negative number on its diagonal; look at its sign")
        if damping is not None and np.any(damping.diagonal() < 0):
            self.problems.append("damping has a negative number on its diagonal; look at its sign")
        weight = self._vector("unit_weight", size) if "unit_weight" in self.found else None
        x = self._vector("table_x", None)
        count = None if x is None else x.size
        z = self._vector("table_z", count) if "table_z" in self.found else None
        direction = self._directions(count)
        rows = self._rows(count, size)
        if x is not None and direction is not None:
            self._repeats(x, direction)
        if "rows" not in self.found and None not in (count, size) and count != size:
            self.problems.append(
                f"the table has {count} entries and the matrices {size} coordinates; name "
                "every coordinate, or give 'rows' from coordinates to table entries"
            )
        if stiffness is None or mass is None or x is None or direction is None or self.problems:
            return None
        return RailMatrices(
            stiffness=stiffness,
            mass=mass,
            damping=damping,
            unit_weight=weight,
            x=x,
            z=np.zeros(x.size) if z is None else z,
            direction=direction,
            rows=rows,
            with_supports=bool(np.any(np.asarray(self.found.get("with_supports", 0.0)))),
            digest=digest,
        )

    def _square(self, name: str) -> sp.csr_array | None:
        """Return a square, finite, symmetric matrix."""
        matrix = self._matrix(name)
        if matrix is None:
            return None
        if matrix.shape[0] != matrix.shape[1] or not matrix.shape[0]:
            self.problems.append(f"{name} is {_shape(matrix)}, must be square")
            return None
        largest = np.abs(matrix.data).max(initial=0.0)
        difference = np.abs((matrix - matrix.T).tocsr().data).max(initial=0.0)
        if difference > SYMMETRIC * largest:
            self.problems.append(
                f"{name} is not symmetric: it differs from its transpose by "
                f"{difference / largest:.1e} of its largest entry; give ({name} + {name}') / 2 "
                "if that is rounding"
            )
        return matrix

    def _matrix(self, name: str) -> sp.csr_array | None:
        if name not in self.found:
            return None
        given: Any = self.found[name]
        if getattr(given, "ndim", 0) != 2 or given.dtype.kind not in "fiub":
            self.problems.append(f"{name} must be a matrix of real numbers")
            return None
        matrix: sp.csr_array = sp.csr_array(given).astype(np.float64)
        if not np.isfinite(matrix.data).all():
            self.problems.append(f"{name} holds numbers that are not finite")
            return None
        return matrix

    def _vector(self, name: str, size: int | None) -> Floats | None:
        matrix = self._matrix(name)
        if matrix is None:
            return None
        if 1 not in matrix.shape or (size is not None and max(matrix.shape) != size):
            wanted = "n x 1" if size is None else f"{size} x 1"
            self.problems.append(f"{name} is {_shape(matrix)}, must be {wanted}")
            return None
        return np.asarray(matrix.toarray(), dtype=np.float64).ravel()

    def _directions(self, count: int | None) -> tuple[str, ...] | None:
        if "table_direction" not in self.found:
            return None
        cells = np.asarray(self.found["table_direction"]).ravel()
        names = tuple(str(np.asarray(cell).ravel()[0] if np.size(cell) else "") for cell in cells)
        names = tuple(name.strip() for name in names)
        unknown = sorted(set(names) - set(DIRECTIONS))
        if unknown:
            self.problems.append(
                f"table_direction has {choices(unknown)}; allowed are {choices(DIRECTIONS)}"
            )
        if count is not None and len(names) != count:
            self.problems.append(f"table_direction has {len(names)} entries, table_x {count}")
            return None
        return None if unknown else names

    def _rows(self, count: int | None, size: int | None) -> sp.csr_array | None:
        rows = self._matrix("rows")
        if rows is None or count is None or size is None:
            return rows
        if rows.shape != (count, size):
            self.problems.append(
                f"rows is {_shape(rows)}, must be {count} x {size}: table entries by coordinates"
            )
            return None
        return rows

    def _repeats(self, x: Floats, direction: tuple[str, ...]) -> None:
        entries = Counter(zip(np.round(x, 9).tolist(), direction, strict=True))
        twice = sorted(entry for entry, count in entries.items() if count > 1)
        if twice:
            shown = choices([f"{name} at x = {place:g} m" for place, name in twice], most=4)
            self.problems.append(f"the table names {shown} more than once; name each once")


def _shape(matrix: sp.csr_array) -> str:
    return f"{matrix.shape[0]} x {matrix.shape[1]}"
