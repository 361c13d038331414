"""JSON files with a checksum of their content, so that damage is seen before anything is used."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from turnout.files.provenance import content_hash
from turnout.files.toml import read_bytes

CHECKSUM = "checksum"


def sealed_json(content: Mapping[str, Any]) -> str:
    """Return plain data as JSON text with a checksum beside the other keys.

    Raises
    ------
    TypeError, ValueError
        When something is no plain data, or no finite number.
    """
    return json.dumps({**content, CHECKSUM: content_hash(dict(content))}, indent=1)


def read_sealed(path: Path, *, largest: int) -> tuple[dict[str, Any], str]:
    """Read a JSON file that should have a checksum.

    Parameters
    ----------
    path : Path
        Of the file, which must be there.
    largest : int
        So much is read [bytes].

    Returns
    -------
    content : dict
        Without the checksum; empty where the file is no JSON table at all.
    fault : str
        What is wrong with it; empty where nothing is.

    Raises
    ------
    FileError
        When it cannot be read, or is too large.
    """
    text = read_bytes(path, largest=largest)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = "too deeply nested" if isinstance(error, RecursionError) else str(error)
        return {}, f"is damaged: no JSON ({reason})"
    if not isinstance(content, dict):
        return {}, "is damaged: no table of keys and values"
    given = content.pop(CHECKSUM, None)
    if given is None:
        return content, "has no checksum"
    try:
        intact = given == content_hash(content)
    except (ValueError, RecursionError):
        intact = False
    return content, "" if intact else "is damaged: its checksum is not that of its content"
