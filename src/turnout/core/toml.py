"""Read a TOML file and its origin comments, with one clear message for whatever can be wrong.

A trailing comment `# kind: text` states where a number comes from. A comment on a table's header,
or on the first or last line of an array, covers its items unless they have their own. Comments are
found by a scanner of one pass, in time proportional to the text; it splits any text, and `tomllib`
decides whether that is valid TOML.
"""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from turnout.core.errors import FileError
from turnout.core.files import read_fault, require_regular_file
from turnout.core.problems import shortened

MOST_NESTED = 30
"""Deepest nesting of lists and tables, and most names in one key."""

LONGEST_NUMBER = 100
"""Most characters of a number; Python limits some operations on long integers."""

_DIGITS = "0123456789+-"

# Possessive repetitions: a string without an end is scanned once, without backtracking.
_TOKEN = re.compile(
    r'''
    (?P<string> """ (?: [^"\\]++ | \\. | "{1,2}(?!") )*+ (?:"{3,5})?
              | \'\'\' (?: [^']++ | '{1,2}(?!') )*+ (?:'{3,5})?
              | " (?: [^"\\\n]++ | \\[^\n] )*+ "?
              | ' [^'\n]*+ '? )
  | (?P<comment> \#[^\n]*+ )
  | (?P<sign> [\[\]{},=.\n] )
  | (?P<plain> [^\s"'#\[\]{},=.]++ )
    ''',
    re.VERBOSE | re.DOTALL,
)


class Token(NamedTuple):
    """A token of TOML: kind (string, comment, sign, plain), text, and position in characters."""

    kind: str
    text: str
    start: int


def tokens(text: str) -> Iterator[Token]:
    r"""Yield the tokens of a TOML text; line ends are tokens, other blanks are skipped.

    Examples
    --------
    >>> [token.text for token in tokens("a.b = ['#', 2] # c")]
    ['a', '.', 'b', '=', '[', "'#'", ',', '2', ']', '# c']
    """
    for match in _TOKEN.finditer(text):
        yield Token(match.lastgroup or "", match[0], match.start())


def key_name(token: Token) -> str:
    """Return the name that one token of a key stands for.

    Examples
    --------
    >>> [key_name(token) for token in tokens(r'''bare 'a.b' "\u00e9"''')]
    ['bare', 'a.b', 'é']
    """
    if token.kind != "string":
        return token.text
    if token.text[0] == "'" or "\\" not in token.text:
        return token.text[1:-1]
    return next(iter(tomllib.loads(f"{token.text} = 0")))


def beyond_limits(text: str) -> tuple[str, int] | None:
    r"""Return the limit of nesting or length that a text exceeds, and the line; None if none.

    Examples
    --------
    >>> beyond_limits("a = 1\nb = " + "[" * 31)
    ('lists, tables or names are nested more than 30 deep', 2)
    >>> beyond_limits("a = 0x" + "f" * 200)
    ('a number has more than 100 characters', 1)
    >>> beyond_limits("a = " + "[" * 30) is None
    True
    """
    depth = names = 0
    for token in tokens(text):
        if token.kind == "plain" and len(token.text) > LONGEST_NUMBER and token.text[0] in _DIGITS:
            fault = f"a number has more than {LONGEST_NUMBER} characters"
            return fault, text.count("\n", 0, token.start) + 1
        if token.kind != "sign":
            continue
        if token.text == ".":
            names += 1
        else:
            names = 0
            depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(token.text, 0)
        if max(depth, names) > MOST_NESTED:
            fault = f"lists, tables or names are nested more than {MOST_NESTED} deep"
            return fault, text.count("\n", 0, token.start) + 1
    return None


ORIGIN_KINDS = ("paper", "source", "computed", "assumption")
LARGEST_FILE = 4_000_000
# Characters of a line in a message.
LONGEST_SHOWN = 160
_PLACE = re.compile(r"\((?:at line (\d+), column (\d+)|at end of document)\)\Z")


@dataclass(frozen=True, slots=True)
class Origin:
    """Origin of a value: its kind (paper, source, computed, assumption) and a text."""

    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class TomlFile:
    """The content of a TOML file.

    Parameters
    ----------
    data : dict
        Tables of the document, nested as written.
    origins : dict
        Origin comments by the key path they stand at: a table, a key, or an item of an array
        (its number from 0 as the last part).
    source : str
        Name of the file in messages.
    folder : Path or None
        Base of relative paths in the file.
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
        data = load_toml(text)
    except ValueError as error:
        raise FileError(_syntax(str(error), text, source)) from None
    return TomlFile(data, _origins(text), source, folder)


def load_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text; ValueError when it is not valid or exceeds a limit.

    Examples
    --------
    >>> load_toml("a.b = [1, 2]")
    {'a': {'b': [1, 2]}}
    """
    if fault := beyond_limits(text):
        message = f"{fault[0]} (at line {fault[1]}, column 1)"
        raise ValueError(message)
    return tomllib.loads(text)


def _syntax(message: str, text: str, source: str) -> str:
    lines = text.splitlines()
    place = _PLACE.search(message)
    if place is None:
        return f"{source}: not valid TOML: {shortened(message, LONGEST_SHOWN)}"
    reason = shortened(message[: place.start()].rstrip(), LONGEST_SHOWN)
    if place[1] is None:
        last = shortened(lines[-1].strip(), LONGEST_SHOWN) if lines else ""
        return f"{source}: not valid TOML: {reason} (the file ends too early, after: {last})"
    line = int(place[1])
    shown = shortened(lines[line - 1].strip(), LONGEST_SHOWN) if line <= len(lines) else ""
    return f"{source}: not valid TOML: {reason} at line {line}, column {place[2]}: {shown}"


@dataclass(slots=True)
class _Scan:
    """State of the comment scanner; the text is known to be valid TOML."""

    table: tuple[str, ...] = ()
    key: tuple[str, ...] = ()
    depth: int = 0
    list_depth: int = 0
    # Items of the list that are complete: at the start of the line, and now; another one began.
    item_before: int = 0
    item: int = 0
    pending: bool = False
    first_line: bool = True
    # Entries of each array of tables so far.
    entries: dict[tuple[str, ...], int] = field(default_factory=dict)
    origins: dict[tuple[str, ...], Origin] = field(default_factory=dict)


def _origins(text: str) -> dict[tuple[str, ...], Origin]:
    """Return the origin comments of a text that is valid TOML."""
    scan, stream = _Scan(), tokens(text)
    for token in stream:
        if token.kind == "comment" or token.text == "\n":
            continue
        if token.text == "[":
            scan.table, comment = _header(stream, scan.entries)
            _note(scan, scan.table, comment)
        else:
            scan.key = (*scan.table, *_key(token, stream))
            _value(scan, stream)
    return scan.origins


def _header(
    stream: Iterator[Token], entries: dict[tuple[str, ...], int]
) -> tuple[tuple[str, ...], str]:
    """Return the path in the header of a table, of which one bracket was read, and its comment.

    The path of an entry of an array of tables ends with its number, from 0.
    """
    path: list[str] = []
    comment, brackets = "", 1
    for token in stream:
        if token.text == "\n":
            break
        if token.kind == "comment":
            comment = token.text
        elif token.kind != "sign":
            path.append(key_name(token))
        else:
            brackets += token.text == "["
    if brackets > 1:
        number = entries[tuple(path)] = entries.get(tuple(path), -1) + 1
        path.append(str(number))
    return tuple(path), comment


def _key(first: Token, stream: Iterator[Token]) -> list[str]:
    """Return the parts of a (dotted, quoted) key of which the first was read."""
    path = [key_name(first)]
    for token in stream:
        if token.text == "=":
            break
        if token.kind != "sign":
            path.append(key_name(token))
    return path


def _value(scan: _Scan, stream: Iterator[Token]) -> None:
    """Read a value to the end of its last line, and note the comments of its lines."""
    scan.list_depth = scan.item = scan.item_before = 0
    scan.pending, scan.first_line = False, True
    for token in stream:
        if token.kind == "comment":
            _line_comment(scan, token.text)
        elif token.text == "\n":
            if not scan.depth:
                return
            scan.item_before, scan.pending, scan.first_line = scan.item, False, False
        else:
            _value_token(scan, token)
            if token.kind == "string" and "\n" in token.text:
                scan.item_before, scan.first_line = scan.item, False


def _value_token(scan: _Scan, token: Token) -> None:
    if token.kind != "sign":
        scan.pending = True
    elif token.text in "[{":
        scan.depth += 1
        if token.text == "[" and not scan.list_depth:
            scan.list_depth = scan.depth
    elif token.text in "]}":
        scan.depth -= 1
    elif token.text == "," and scan.depth == scan.list_depth:
        scan.item, scan.pending = scan.item + 1, False


def _line_comment(scan: _Scan, comment: str) -> None:
    if scan.first_line or not scan.depth:
        _note(scan, scan.key, comment)
    elif scan.list_depth:
        for item in range(scan.item_before, scan.item + scan.pending):
            _note(scan, (*scan.key, str(item)), comment)


def _note(scan: _Scan, path: tuple[str, ...], comment: str) -> None:
    kind, _, text = comment.removeprefix("#").partition(":")
    if kind.strip() in ORIGIN_KINDS and text.strip():
        scan.origins.setdefault(path, Origin(kind.strip(), text.strip()))
