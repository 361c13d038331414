"""Records of a long job as lines of a file, each kept as soon as it is there."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from turnout.core.errors import FileError
from turnout.core.files import is_leftover, make_folder, write_atomic, write_fault
from turnout.core.json_files import to_plain

Line = dict[str, Any]


def claim_for(folder: Path, head: str, identity: Mapping[str, Any], *, what: str) -> None:
    """Make a folder with a head that says whose it is, or refuse one of another job.

    Parameters
    ----------
    folder : Path
        Of the job.
    head : str
        Name of the file that says whose it is.
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
        own = re.compile(re.escape(head))
        try:
            there = sorted(folder.iterdir()) if folder.is_dir() else []
        except OSError as error:
            message = f"{folder}: cannot be read ({error}); name another folder"
            raise FileError(message) from None
        if strangers := [item.name for item in there if not is_leftover(item, of=own)]:
            message = (
                f"{folder}: is not empty and holds no {what} ({strangers[0]} is there); "
                "name another folder"
            )
            raise FileError(message)
        make_folder(folder)
        write_atomic(path, json.dumps(identity, indent=1, ensure_ascii=False) + "\n")
        return
    try:
        digest = str(json.loads(path.read_text(encoding="utf-8")).get("digest"))
    except (OSError, ValueError, AttributeError) as error:
        message = f"{path}: cannot be read ({error}); name another folder"
        raise FileError(message) from None
    if digest != identity["digest"]:
        message = (
            f"{folder}: holds another {what} (digest {digest[:12]}, this is "
            f"{identity['digest'][:12]}); name another folder"
        )
        raise FileError(message)


def read_lines(path: Path) -> list[Line]:
    """Read the records of a file; a last line that was cut off is dropped from it.

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
    found = []
    for number, line in enumerate(whole.splitlines(), 1):
        try:
            record = json.loads(line)
            if not isinstance(record, dict):
                message = "no table"
                raise TypeError(message)
        except (ValueError, TypeError) as error:
            message = f"{path}, line {number}: is damaged ({error}); remove the line or the folder"
            raise FileError(message) from None
        found.append(record)
    return found


def append_line(path: Path, record: object) -> None:
    """Append a record, in which numbers that are not finite become texts.

    Raises
    ------
    FileError
        When it cannot be written.
    """
    try:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(to_plain(record), ensure_ascii=False) + "\n")
    except OSError as error:
        raise FileError(write_fault(path, error)) from None
