"""A panel as plain data for a file, and back through the same checks as a panel file.

The tables are written as they stand after families were spread out and values were set, with what
was read from other files beside them: the panel can be made again where none of these files is.
"""

import base64
import binascii
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from turnout.core.toml import Origin
from turnout.core.units import SI
from turnout.panel.document import Document
from turnout.panel.load import LoadedPanel, panel_from_document
from turnout.panel.records import RailMatrices

SI_MARK = "$si"
"""Key of a number that Python code gave in SI, for which a file would need a unit."""
_SPARSE = ("stiffness", "mass", "damping", "rows")
_ARRAYS = ("unit_weight", "x", "z")
_NUMBERS = ("<f8", "<i4", "<i8")


def panel_data(panel: LoadedPanel) -> dict[str, Any]:
    """Return a panel as nested plain data.

    Raises
    ------
    TypeError
        When a value of it is none that a file can hold.
    """
    document = panel.document
    return {
        "source": panel.source,
        "folder": None if panel.folder is None else str(panel.folder),
        "overrides": _marked(panel.overrides),
        "tree": _marked(document.tree),
        "shared": sorted(list(path) for path in document.shared),
        "origins": {key: [origin.kind, origin.text] for key, origin in document.origins.items()},
        "tables": {
            name: [list(time), list(part)] for name, (time, part) in document.tables.items()
        },
        "given": _marked(document.given),
        "matrices": {name: _of_matrices(given) for name, given in document.matrices.items()},
    }


def panel_from_data(data: Mapping[str, Any]) -> LoadedPanel:
    """Make a panel of plain data, completely checked.

    Raises
    ------
    PanelError
        When what it says is no valid panel.
    ValueError, TypeError, KeyError
        When the data are not of the form that `panel_data` gives.
    """
    document = Document(
        tree=_table(_unmarked(data["tree"])),
        shared=frozenset(tuple(map(str, path)) for path in data["shared"]),
        origins={
            key: Origin(str(kind), str(text)) for key, (kind, text) in data["origins"].items()
        },
        tables={
            name: ([float(t) for t in time], [float(f) for f in part])
            for name, (time, part) in data["tables"].items()
        },
        given=_table(_unmarked(data["given"])),
        matrices={name: _to_matrices(given) for name, given in data["matrices"].items()},
    )
    folder = data["folder"]
    return panel_from_document(
        document,
        source=str(data["source"]),
        folder=None if folder is None else Path(folder),
        overrides=_table(_unmarked(data["overrides"])),
    )


def _table(value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        message = "a table of the panel is none"
        raise TypeError(message)
    return value


def _marked(value: Any) -> Any:
    """Return values as plain data in which SI numbers are distinguished from those of a file."""
    if isinstance(value, Mapping):
        return {str(key): _marked(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_marked(item) for item in value]
    if isinstance(value, SI):
        return {SI_MARK: float(value)}
    if value is None or isinstance(value, str | bool | int | float):
        return value
    message = f"{value!r} is nothing that a file can hold"
    raise TypeError(message)


def _unmarked(value: Any) -> Any:
    if isinstance(value, dict):
        if value.keys() == {SI_MARK}:
            return SI(value[SI_MARK])
        return {key: _unmarked(item) for key, item in value.items()}
    return [_unmarked(item) for item in value] if isinstance(value, list) else value


def _of_matrices(given: RailMatrices) -> dict[str, Any]:
    """Return the matrices of a rail; arrays keep their bits as base64."""
    found: dict[str, Any] = {
        "direction": list(given.direction),
        "with_supports": bool(given.with_supports),
        "digest": given.digest,
    }
    for name in _ARRAYS:
        values = getattr(given, name)
        found[name] = None if values is None else _of_array(values)
    for name in _SPARSE:
        matrix = getattr(given, name)
        found[name] = None if matrix is None else _of_sparse(matrix)
    return found


def _of_sparse(matrix: sp.csr_array) -> dict[str, Any]:
    parts = {name: _of_array(getattr(matrix, name)) for name in ("data", "indices", "indptr")}
    return {"shape": list(matrix.shape), **parts}


def _of_array(values: np.ndarray) -> dict[str, str]:
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    return {"dtype": little.dtype.str, "base64": base64.b64encode(little.tobytes()).decode()}


def _to_matrices(data: Mapping[str, Any]) -> RailMatrices:
    found: dict[str, Any] = {
        "direction": tuple(map(str, data["direction"])),
        "with_supports": bool(data["with_supports"]),
        "digest": str(data["digest"]),
    }
    for name in _ARRAYS:
        found[name] = None if data[name] is None else _to_array(data[name])
    for name in _SPARSE:
        found[name] = None if data[name] is None else _to_sparse(data[name])
    return RailMatrices(**found)


def _to_sparse(data: Mapping[str, Any]) -> sp.csr_array:
    parts = tuple(_to_array(data[name]) for name in ("data", "indices", "indptr"))
    rows, columns = data["shape"]
    matrix = sp.csr_array(parts, shape=(int(rows), int(columns)))
    matrix.check_format(full_check=True)
    return matrix


def _to_array(data: Mapping[str, Any]) -> np.ndarray:
    if data["dtype"] not in _NUMBERS:
        message = f"an array of '{data['dtype']}'; allowed are {', '.join(_NUMBERS)}"
        raise ValueError(message)
    try:
        content = base64.b64decode(data["base64"], validate=True)
    except binascii.Error as error:
        message = f"an array cannot be read ({error})"
        raise ValueError(message) from None
    return np.frombuffer(content, dtype=data["dtype"]).copy()
