"""Read a TOML file with one clear message for whatever can be wrong, and its origin comments.

A trailing comment `# kind: text` states where a number comes from. A comment on a table's header,
or on the first or last line of an array, covers what is inside unless that has its own.
"""

import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from turnout.errors import FileError
from turnout.files.regular import read_fault, require_regular_file

ORIGIN_KINDS = ("paper", "source", "computed", "assumption")
LARGEST_FILE = 4_000_000
_COMMENT = re.compile(rf"#\s*({'|'.join(ORIGIN_KINDS)})\s*:\s*(.+?)\s*\Z")
_PLACE = re.compile(r"\s*\((?:at line (\d+), column (\d+)|at end of document)\)\s*\Z")
_TOKEN = re.compile(r'"""|\'\'\'|"(?:\\.|[^"\\])*"|\'[^\']*\'|#.*|[\[\]{},]')


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a value comes from: its kind (paper, source, computed, assumption) and a text."""

    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class TomlFile:
    """The content of a TOML file.

    Parameters
    ----------
    data : dict
        The nested tables.
    origins : dict
        Origin comments by the key path they stand at: a table, a key, or an item of an array
        (its number from 0 as the last part).
    source : str
        What to call the file in messages.
    folder : Path or None
        Where relative paths inside the file start.
    """

    data: dict[str, Any]
    origins: dict[tuple[str, ...], Origin]
    source: str
    folder: Path | None = None


def read_toml(path: Path | str) -> TomlFile:
    """Read a TOML file; every failure is a FileError that names the file and the remedy."""
    path = Path(path)
    text = decode(read_bytes(path), source=str(path))
    return parse_toml(text, source=str(path), folder=path.resolve().parent)


def read_bytes(path: Path, *, largest: int = LARGEST_FILE) -> bytes:
    """Read a whole small file; FileError when it is missing, no file, unreadable or too large."""
    require_regular_file(path)
    try:
        size = path.stat().st_size
        if size > largest:
            message = f"{path}: too large ({size} bytes, at most {largest} are read)"
            raise FileError(message)
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except (OSError, ValueError) as error:
        raise FileError(read_fault(path, error)) from None
    if len(content) > largest:
        message = f"{path}: too large (at most {largest} bytes are read)"
        raise FileError(message)
    return content


def decode(content: bytes, *, source: str) -> str:
    """Decode UTF-8 text; FileError when it is empty, binary or in another encoding."""
    if not content.strip():
        message = f"{source}: the file is empty"
        raise FileError(message)
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        message = f"{source}: is UTF-16 text; save it as UTF-8"
        raise FileError(message)
    if b"\0" in content:
        message = f"{source}: is a binary file (NUL byte at {content.index(0)}), not text"
        raise FileError(message)
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        message = (
            f"{source}: is not UTF-8 text (byte 0x{content[error.start]:02x} at position "
            f"{error.start}, line {line}); save it as UTF-8"
        )
        raise FileError(message) from None


def parse_toml(text: str, *, source: str, folder: Path | None = None) -> TomlFile:
    """Parse TOML text and collect its origin comments.

    Examples
    --------
    >>> file = parse_toml('size = "13 mm"  # paper: section 2', source="text")
    >>> file.data, file.origins[("size",)].kind
    ({'size': '13 mm'}, 'paper')
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FileError(_syntax(str(error), text, source)) from None
    except RecursionError:
        message = f"{source}: tables or lists are nested too deeply"
        raise FileError(message) from None
    return TomlFile(data, _origins(text), source, folder)


def _syntax(message: str, text: str, source: str) -> str:
    lines = text.splitlines()
    place = _PLACE.search(message)
    reason = _PLACE.sub("", message)
    if place is None:
        return f"{source}: not valid TOML: {reason}"
    if place[1] is None:
        last = lines[-1].strip() if lines else ""
        return f"{source}: not valid TOML: {reason} (the file ends too early, after: {last})"
    line = int(place[1])
    shown = lines[line - 1].strip() if line <= len(lines) else ""
    return f"{source}: not valid TOML: {reason} at line {line}, column {place[2]}: {shown}"


@dataclass(slots=True)
class _Scan:
    """State of the comment scanner; the text is known to be valid TOML."""

    table: tuple[str, ...] = ()
    key: tuple[str, ...] = ()
    depth: int = 0
    list_depth: int = 0
    item: int = 0
    string: str = ""
    first_line: bool = True
    origins: dict[tuple[str, ...], Origin] = field(default_factory=dict)


def _origins(text: str) -> dict[tuple[str, ...], Origin]:
    scan = _Scan()
    for line in text.splitlines():
        if scan.string or scan.depth:
            scan.first_line = False
        elif not line.strip() or line.lstrip().startswith("#"):
            continue
        elif line.lstrip().startswith("["):
            _header(scan, line)
            continue
        else:
            scan.key = (*scan.table, *_path(line))
            scan.list_depth = scan.item = 0
            scan.first_line = True
        _value_line(scan, line)
    return scan.origins


def _path(line: str) -> tuple[str, ...]:
    """Give the parts of a (dotted, quoted) key at the start of a line."""
    match = re.match(r"\s*((?:\"(?:\\.|[^\"\\])*\"|'[^']*'|[^='\"])+?)\s*=", line)
    return _parts(tomllib.loads(f"{match[1]} = 0")) if match else ()


def _header(scan: _Scan, line: str) -> None:
    scan.table = _parts(tomllib.loads(line))
    _note(scan, scan.table, _last_comment(line))


def _parts(nested: Any) -> tuple[str, ...]:
    parts: list[str] = []
    while isinstance(nested, dict | list) and nested:
        if isinstance(nested, list):
            nested = nested[0]
            continue
        name, nested = next(iter(nested.items()))
        parts.append(name)
    return tuple(parts)


def _last_comment(line: str) -> str:
    last = ""
    for token in _TOKEN.findall(line):
        last = token
    return last if last.startswith("#") else ""


def _note(scan: _Scan, path: tuple[str, ...], comment: str) -> None:
    match = _COMMENT.match(comment)
    if match:
        scan.origins.setdefault(path, Origin(match[1], match[2]))


def _value_line(scan: _Scan, line: str) -> None:
    position, item_before, comment = 0, scan.item, ""
    pending = False
    while position < len(line):
        if scan.string:
            end = line.find(scan.string, position)
            if end < 0:
                return
            position, scan.string = end + 3, ""
            continue
        match = _TOKEN.search(line, position)
        if match is None:
            pending = pending or bool(line[position:].strip())
            break
        pending = pending or bool(line[position : match.start()].strip())
        token, position = match[0], match.end()
        if token.startswith("#"):
            comment = token
            break
        if token in ('"""', "'''"):
            scan.string = token
        elif token in ("[", "{"):
            scan.depth += 1
            if token == "[" and not scan.list_depth:
                scan.list_depth = scan.depth
        elif token in ("]", "}"):
            scan.depth -= 1
        elif token == "," and scan.depth == scan.list_depth:
            scan.item, pending = scan.item + 1, False
        elif token != ",":
            pending = True
    if scan.first_line or not scan.depth:
        _note(scan, scan.key, comment)
    elif comment and scan.list_depth:
        for item in range(item_before, scan.item + pending):
            _note(scan, (*scan.key, str(item)), comment)
