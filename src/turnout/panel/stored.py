"""A panel as plain data for a file, and back through the same checks as a panel file.

The tables are written as they stand after families were spread out and values were set, with what
was read from other files beside them: the panel can be made again where none of these files is.
"""

import base64
import binascii
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from turnout.core.toml import Origin
from turnout.core.units import SI
from turnout.panel.document import Document
from turnout.panel.load import LoadedPanel, panel_from_document
from turnout.panel.matrices import matrices_bytes, matrices_of_bytes
from turnout.panel.records import RailMatrices

SI_MARK = "$si"
"""Key of a number that Python code gave in SI, for which a file would need a unit."""


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


def _of_matrices(given: RailMatrices) -> dict[str, str]:
    """Return the matrices of a rail: the content of a file of them, which keeps their bits."""
    content = base64.b64encode(matrices_bytes(given, extra={})).decode()
    return {"digest": given.digest, "base64": content}


def _to_matrices(data: Mapping[str, Any]) -> RailMatrices:
    try:
        content = base64.b64decode(data["base64"], validate=True)
    except binascii.Error as error:
        message = f"matrices of a rail cannot be read ({error})"
        raise ValueError(message) from None
    matrices, problems = matrices_of_bytes(content)
    if matrices is None:
        message = f"matrices of a rail cannot be read ({'; '.join(problems)})"
        raise ValueError(message)
    return replace(matrices, digest=str(data["digest"]))
