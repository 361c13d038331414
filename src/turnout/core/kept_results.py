"""Results of a long job in its folder, each kept as soon as it is there, so that the job goes on.

They are lines of a file, or files of arrays by what made them. A head says whose a folder is. What
is read is what was written: digests show damage. Batches of a sweep, which are planned before the
first throw, are stored by `turnout.study.sweep`.
"""

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import FileError
from turnout.core.files import (
    is_leftover,
    make_folder,
    require_regular_file,
    write_atomic,
    write_fault,
)
from turnout.core.json_files import to_plain
from turnout.core.stored_arrays import arrays_from_bytes, arrays_to_bytes

T = TypeVar("T")
Arrays = Mapping[str, NDArray[Any]]
Line = dict[str, Any]

ABOUT, DIGEST = "described", "line_digest"
"""Member of a file of arrays with the plain data beside them; entry of a line that shows damage."""


def claim_for(folder: Path, head: str, identity: Mapping[str, Any], *, what: str) -> None:
    """Make a folder with a head that says whose it is, or refuse one of another job.

    Parameters
    ----------
    folder : Path
        Of the job.
    head : str
        Name of the file that says whose it is, perhaps in a folder of its own in that of the job.
    identity : mapping
        Content of it; its "digest" is compared.
    what : str
        Kind of job, for messages, such as "matching".

    Raises
    ------
    FileError
        When it belongs to another one or holds something else, or cannot be read or made.
    """
    path = folder / head
    if not path.exists():
        own = re.compile(re.escape(path.name))
        try:
            folders = [f for f in dict.fromkeys((folder, path.parent)) if f.is_dir()]
            there = [item for each in folders for item in sorted(each.iterdir())]
        except OSError as error:
            message = f"{folder}: cannot be read ({error}); name another folder"
            raise FileError(message) from None
        there = [item for item in there if item != path.parent]
        if strangers := [item.name for item in there if not is_leftover(item, of=own)]:
            message = (
                f"{folder}: is not empty and holds no {what} ({strangers[0]} is there); "
                "name another folder"
            )
            raise FileError(message)
        make_folder(path.parent)
        write_atomic(path, json.dumps(identity, indent=1, ensure_ascii=False) + "\n")
        return
    try:
        digest = json.loads(path.read_text(encoding="utf-8")).get("digest")
    except (OSError, ValueError, AttributeError) as error:
        message = f"{path}: cannot be read ({error}); name another folder"
        raise FileError(message) from None
    if not isinstance(digest, str):
        message = f"{path}: names no digest, as an older version wrote it; name another folder"
        raise FileError(message)
    if digest != identity["digest"]:
        message = (
            f"{folder}: holds another {what} (digest {digest[:12]}, this is "
            f"{identity['digest'][:12]}); name another folder, or give what it was begun with"
        )
        raise FileError(message)


def read_lines(path: Path) -> list[Line]:
    """Read the records of a file; a last line that was cut off is dropped from it.

    Lines without a digest before the first that has one, as older ones are, are taken as they are.

    Raises
    ------
    FileError
        When a line is damaged; it is named by its number.
    """
    if not path.exists():
        return []
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        write_atomic(path, whole)
    found, signed = [], False
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            record = json.loads(line)
            if not isinstance(record, dict):
                message = "no table"
                raise TypeError(message)
            said = record.pop(DIGEST, None)
            signed = signed or said is not None
            if signed and said != _line_digest(record):
                message = "its content is not that of its digest"
                raise ValueError(message)
        except (ValueError, TypeError) as error:
            message = f"{path}, line {number}: is damaged ({error}); remove the line or the folder"
            raise FileError(message) from None
        found.append(record)
    return found


def append_line(path: Path, record: object) -> None:
    """Append a mapping or record, in which numbers that are not finite become texts.

    Raises
    ------
    FileError
        When it cannot be written.
    """
    line = to_plain(record)
    line[DIGEST] = _line_digest(line)
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line, ensure_ascii=False) + "\n")
    except OSError as error:
        raise FileError(write_fault(path, error)) from None


def _line_digest(record: Line) -> str:
    return hashlib.blake2b(json.dumps(record).encode(), digest_size=8).hexdigest()


def write_arrays(
    path: Path, key: str, arrays: Arrays, about: object = None, *, durable: bool = True
) -> None:
    """Write arrays and plain data as the file of a key.

    Without `durable` it may not be on the disk yet.

    Raises
    ------
    FileError
        When it cannot be written.
    """
    content = arrays if about is None else {**arrays, ABOUT: np.array(json.dumps(about))}
    write_atomic(path, arrays_to_bytes(content, key), durable=durable)


def read_arrays(path: Path, key: str, make: Callable[[Arrays, Any], T]) -> T | None:
    """Make an object of the arrays and plain data of a file.

    None if it is missing, damaged, or of another key: what it held is then computed again.
    """
    try:
        require_regular_file(path)
        arrays = arrays_from_bytes(path.read_bytes(), key)
        about = json.loads(str(arrays.pop(ABOUT, "null")))
        return make(arrays, about)
    except (OSError, ValueError, LookupError, TypeError, FileError):
        return None
