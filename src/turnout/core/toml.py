"""TOML files with origin comments: one clear message for whatever is wrong, and single changes.

A trailing comment `# kind: text` states where a number comes from. A comment on a table's header,
or on the first or last line of an array, covers its items unless they have their own. Comments are
found by a scanner of one pass, in time proportional to the text; it splits any text, and `tomllib`
decides whether that is valid TOML.
"""

import re
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any, NamedTuple

from turnout.core.errors import FileError
from turnout.core.files import read_fault, require_regular_file, user_path
from turnout.core.problems import shortened

Path = tuple[str, ...]

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
            depth += _DEPTH.get(token.text, 0)
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
    origins: dict[Path, Origin]
    source: str
    folder: FilePath | None = None

    def path_of(self, name: str) -> FilePath:
        """Return a path that the file names; one that is not absolute starts at its folder."""
        path = user_path(name)
        return path if path.is_absolute() or self.folder is None else self.folder / path


def read_toml(path: FilePath | str) -> TomlFile:
    """Read a TOML file; every failure is a FileError that names the file and the remedy."""
    path = FilePath(path)
    text = decode(read_bytes(path), source=str(path))
    return parse_toml(text, source=str(path), folder=path.resolve().parent)


def read_bytes(path: FilePath, *, largest: int = LARGEST_FILE) -> bytes:
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


def parse_toml(text: str, *, source: str, folder: FilePath | None = None) -> TomlFile:
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


class Statement(NamedTuple):
    """A header of a table, or a key with its value, of a text that is valid TOML.

    Attributes
    ----------
    path : tuple of str
        Key path; that of an entry of an array of tables ends with its number, from 0.
    header : bool
        Whether it is a header.
    parts : list of Token
        Of the header, or of the value, with the comments and line ends within them.
    end : int
        First character behind the line end of a header.
    """

    path: Path
    header: bool
    parts: list[Token]
    end: int

    @property
    def span(self) -> tuple[int, int]:
        """First character of a value and the one behind it."""
        return _span(self.parts)


def statements(text: str) -> Iterator[Statement]:
    r"""Yield headers and values of a text that is valid TOML.

    Examples
    --------
    >>> [(item.path, item.header) for item in statements("a = 1\n[[b]]\nc.d = [\n2]")]
    [(('a',), False), (('b', '0'), True), (('b', '0', 'c', 'd'), False)]
    """
    table: Path = ()
    entries: dict[Path, int] = {}
    parts: list[Token] = []
    depth = 0
    for token in (*tokens(text), Token("sign", "\n", len(text))):
        if token.kind == "sign":
            depth += _DEPTH.get(token.text, 0)
        if token.text != "\n" or depth:
            parts.append(token)
            continue
        if parts and parts[0].text == "[":
            table = _names(parts)
            if len(parts) > 1 and parts[1].text == "[":
                entries[table] = entries.get(table, -1) + 1
                table = (*table, str(entries[table]))
            yield Statement(table, True, parts, min(token.start + 1, len(text)))
        elif parts and parts[0].kind != "comment":
            equals = next(n for n, part in enumerate(parts) if part.text == "=")
            path = (*table, *_names(parts[:equals]))
            yield Statement(path, False, parts[equals + 1 :], 0)
        parts = []


_DEPTH = {"[": 1, "{": 1, "]": -1, "}": -1}


def _names(parts: Iterable[Token]) -> Path:
    return tuple(key_name(part) for part in parts if part.kind in ("plain", "string"))


def _span(parts: list[Token]) -> tuple[int, int]:
    found = [part for part in parts if part.kind != "comment" and part.text != "\n"]
    return found[0].start, found[-1].start + len(found[-1].text)


def _origins(text: str) -> dict[Path, Origin]:
    """Return the origin comments of a text that is valid TOML."""
    origins: dict[Path, Origin] = {}
    for item in statements(text):
        for path, comment in _header_comment(item) if item.header else _value_comments(item):
            kind, _, said = comment.removeprefix("#").partition(":")
            if kind.strip() in ORIGIN_KINDS and said.strip():
                origins.setdefault(path, Origin(kind.strip(), said.strip()))
    return origins


def _header_comment(item: Statement) -> Iterator[tuple[Path, str]]:
    yield from ((item.path, part.text) for part in item.parts if part.kind == "comment")


def _value_comments(item: Statement) -> Iterator[tuple[Path, str]]:
    """Yield the comments of a value: of all of it, or of the items on a line of a list."""
    depth = of_list = number = before = 0  # items that are complete: now, and when the line began
    pending, first_line = False, True  # whether another item began
    for part in item.parts:
        if part.kind == "comment":
            if first_line or not depth:
                yield item.path, part.text
            elif of_list:
                items = range(before, number + pending)
                yield from (((*item.path, str(n)), part.text) for n in items)
        elif part.text == "\n":
            before, pending, first_line = number, False, False
        elif part.kind != "sign":
            pending = True
            if "\n" in part.text:
                before, first_line = number, False
        elif part.text in _DEPTH:
            depth += _DEPTH[part.text]
            of_list = of_list or (depth if part.text == "[" else 0)
        elif part.text == "," and depth == of_list:
            number, pending = number + 1, False


@dataclass(slots=True)
class TomlLayout:
    """Positions of values and tables in a text.

    Attributes
    ----------
    values : dict
        First character of each value and the one behind it, by key path, inline tables included.
    headers : dict
        First character behind the line of each table's header, by key path.
    """

    values: dict[Path, tuple[int, int]] = field(default_factory=dict)
    headers: dict[Path, int] = field(default_factory=dict)


def read_layout(text: str) -> TomlLayout:
    r"""Find values and tables in a TOML text.

    Examples
    --------
    >>> read_layout("[a]\nb = 12\n").values
    {('a', 'b'): (8, 10)}
    """
    layout = TomlLayout()
    for item in statements(text):
        if item.header:
            layout.headers[item.path] = item.end
            continue
        layout.values[item.path] = item.span
        if item.parts[0].text == "{":
            layout.values |= {(*item.path, *key): span for key, span in _inline(item.parts[1:])}
    return layout


def _inline(parts: list[Token]) -> Iterator[tuple[Path, tuple[int, int]]]:
    """Yield keys and spans of the values of an inline table, of which one bracket was read."""
    depth, begin = 0, 0
    for number, part in enumerate(parts):
        depth += _DEPTH.get(part.text, 0) if part.kind == "sign" else 0
        if depth < 0 or (part.text == "," and not depth):
            inner = parts[begin:number]
            equals = next((n for n, each in enumerate(inner) if each.text == "="), None)
            if equals is not None:
                yield _names(inner[:equals]), _span(inner[equals + 1 :])
            begin = number + 1


def with_value(text: str, path: Path, literal: str, *, comment: str = "") -> str:
    r"""Return a TOML text in which one value is another, with all else as it was.

    Parameters
    ----------
    text : str
        Valid TOML.
    path : tuple of str
        Of the value. Where there is none it is added to its table, where there is no such table
        a new one is put at the end.
    literal : str
        The value as TOML writes it.
    comment : str
        Takes the place of a comment behind the value, which was about the former one.

    Examples
    --------
    >>> with_value('[a]\nb = 1  # source: x\n', ("a", "b"), "2", comment="assumption: y")
    '[a]\nb = 2  # assumption: y\n'
    >>> with_value("[a]\nb = { c = 1, d = 2 }\n", ("a", "b", "c"), '"3 m"')
    '[a]\nb = { c = "3 m", d = 2 }\n'
    >>> with_value("[a]\n", ("a", "b"), "2")
    '[a]\nb = 2\n'
    """
    layout = read_layout(text)
    note = f"  # {comment}" if comment else ""
    if path in layout.values:
        start, end = layout.values[path]
        line = text.find("\n", end)
        line = len(text) if line < 0 else line
        rest = text[end:line]
        if comment and (not rest.strip() or rest.lstrip().startswith("#")):
            rest = note if rest.strip() else rest + note
        return f"{text[:start]}{literal}{rest}{text[line:]}"
    table, row = path[:-1], f"{_written(path[-1:])} = {literal}{note}\n"
    if table in layout.headers:
        at = layout.headers[table]
        return f"{text[:at]}{row}{text[at:]}"
    return f"{text.rstrip(chr(10))}\n\n[{_written(table)}]\n{row}"


def _written(path: Path) -> str:
    plain = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-"
    quoted = (part.replace("\\", "\\\\").replace('"', '\\"') for part in path)
    return ".".join(part if part and not part.strip(plain) else f'"{part}"' for part in quoted)
