"""Rails of a panel that come as matrices, and the files that hold these.

Rails of a panel that come as matrices: their files, and whether what stands there fits. Files of
rail matrices: MATLAB version 5, written whole and read with all problems at once.

The variables of a file are described in docs/use/other-programs.md.
"""

import hashlib
import io
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.core.files import user_path
from turnout.core.problems import Problem, choices, nearest, show_value
from turnout.core.toml import read_bytes
from turnout.panel.place import SAME_PLACE
from turnout.panel.records import RailMatrices

Floats = NDArray[np.float64]

FORMAT = "turnout rail matrices 1"
DIRECTIONS = ("ux", "uy", "uz", "rx", "ry", "rz")
NEEDED = ("stiffness", "mass", "table_x", "table_direction")
MOST_FILE_BYTES = 2_000_000_000
LARGEST_UNPACKED = 1_000_000_000
_COMPRESSED, _CHUNK = 15, 1 << 20
HEAD_BYTES = 116
"""Bytes of text at the head of a file of version 5, for readers."""
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
    # the text at its head names the time at which it was written
    return FORMAT.ljust(HEAD_BYTES).encode() + stream.getvalue()[HEAD_BYTES:]


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
    try:
        return matrices_of_bytes(read_bytes(path, largest=MOST_FILE_BYTES))
    except FileError as error:
        return None, [str(error)]


def matrices_of_bytes(content: bytes) -> tuple[RailMatrices | None, list[str]]:
    """Read the matrices of one rail from the content of a file, as `read_rail_matrices` does."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

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
    """Return True if the variables of a file of version 5 unpack to no more than allowed."""
    order, position, total = "<" if content[126:128] == b"IM" else ">", 128, 0
    while position + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, position)
        position += 8
        if kind == _COMPRESSED:
            total += _unpacked_size(memoryview(content)[position : position + size], total)
        position += size
    return total <= LARGEST_UNPACKED


def _unpacked_size(packed: memoryview, before: int) -> int:
    """Return the number of bytes in a compressed variable, counted until that is too many."""
    machine, size = zlib.decompressobj(), 0
    with suppress(zlib.error):  # the reader reports what is damaged
        piece = machine.decompress(packed, _CHUNK)
        while piece and before + size <= LARGEST_UNPACKED:
            size += len(piece)
            piece = machine.decompress(machine.unconsumed_tail, _CHUNK)
    return size


@dataclass(slots=True)
class _Reader:
    """Reader of the variables of a file, one by one, that collects the problems."""

    found: Mapping[str, Any]
    problems: list[str]

    def matrices(self, digest: str) -> RailMatrices | None:
        """Return the matrices of the file as far as they are valid."""
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
            self.problems.append("mass has a negative number on its diagonal; check its sign")
        if damping is not None and np.any(damping.diagonal() < 0):
            self.problems.append("damping has a negative number on its diagonal; check its sign")
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
        if hasattr(given, "check_format"):
            try:
                given.check_format(full_check=True)
            except ValueError as error:
                self.problems.append(f"{name} is damaged: {error}; save it again")
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


# What something at a rail moves with or acts on.
USES = {
    "chair": ("uy", "uz", "rx"),
    "stop": ("uy", "rx"),
    "stud": ("uy", "rx"),
    "drive": ("uy", "rx"),
    "link": ("uy", "rx"),
    "back_drive": ("uy", "rx"),
}
FASTENING = {
    "stiffness_x": ("ux", "ry"),
    "stiffness_y": ("uy", "rx"),
    "stiffness_z": ("uz",),
    "stiffness_roll": ("rx",),
    "stiffness_pitch": ("ry",),
    "stiffness_yaw": ("rz",),
}

RailFiles = dict[str, RailMatrices]


def read_matrices(
    rails: object, *, folder: Path | None, known: Mapping[str, RailMatrices]
) -> tuple[RailFiles, list[Problem]]:
    """Read the files that rails name.

    Parameters
    ----------
    rails : object
        The table of rails of a document.
    folder : Path or None
        Folder of the panel file, from which relative paths start.
    known : mapping of str to RailMatrices
        Files that were read before, by the name given, so that a panel made from another one does
        not need them.

    Returns
    -------
    matrices : dict of str to RailMatrices
        By the name given.
    problems : list of Problem
        Faults of the files.
    """
    found, problems = dict(known), list[Problem]()
    for name, rail in rails.items() if isinstance(rails, dict) else ():
        given = rail.get("matrices") if isinstance(rail, dict) else None
        if not isinstance(given, str) or given in found:
            continue
        matrices, faults = read_rail_matrices((folder or Path()) / user_path(given))
        path = ("rail", name, "matrices")
        problems += [Problem(path, f" = {show_value(given)}: {fault}") for fault in faults]
        if matrices is not None:
            found[given] = matrices
    return found, problems


def check_matrices(records: Mapping[str, Any], matrices: RailFiles) -> Iterator[Problem]:
    """Yield the parts at a rail for which its matrices have no node or no coordinate.

    Parameters
    ----------
    records : mapping
        Records by field of the panel, all valid.
    matrices : dict of str to RailMatrices
        By the name given in the rail.
    """
    for name, rail in records["rail"].items():
        given = matrices.get(rail.matrices) if rail.matrices is not None else None
        if given is None:
            continue
        lacking: dict[str, list[str]] = {}
        places: dict[float, set[str]] = {}
        for x, direction in zip(given.x.tolist(), given.direction, strict=True):
            places.setdefault(x, set()).add(direction)
        nodes = np.array(list(places))
        for label, x, directions in _standing(records, name, given):
            nearest = float(nodes[np.argmin(np.abs(nodes - x))])
            if abs(nearest - x) > SAME_PLACE:
                text = f"no node where there is {{}}: the nearest to x = {x:g} m is {nearest:g} m"
                lacking.setdefault(text, []).append(label)
            elif missing := [d for d in directions if d not in places[nearest]]:
                text = f"no {' and no '.join(missing)} at x = {x:g} m, which {{}} needs"
                lacking.setdefault(text, []).append(label)
        for text, labels in lacking.items():
            yield Problem(
                ("rail", name, "matrices"),
                f" = {show_value(rail.matrices)}: has "
                + text.format(choices(labels, most=4).replace("'", ""))
                + "; add it to the model and its table",
            )


def _standing(
    records: Mapping[str, Any], rail: str, given: RailMatrices
) -> Iterator[tuple[str, float, tuple[str, ...]]]:
    """Yield the parts at a rail: label, place, and the directions of motion that each uses."""
    for family, directions in USES.items():
        for name, item in records[family].items():
            rails = item.rail if family == "drive" else item.rails
            if rails is None or rail in ([rails] if isinstance(rails, str) else rails):
                yield f"{family} {name}", item.x, directions
    if given.with_supports:
        return
    for name, item in records["fastening"].items():
        if item.rails is not None and rail not in item.rails:
            continue
        used = [d for key, ds in FASTENING.items() if getattr(item, key) > 0 for d in ds]
        yield f"fastening {name}", item.x, tuple(dict.fromkeys(used))
