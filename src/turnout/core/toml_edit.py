"""Change single values in a TOML text and keep everything else, comments included."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from turnout.core.toml import Token, key_name, tokens

Path = tuple[str, ...]


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


def with_value(text: str, path: Path, literal: str, *, comment: str = "") -> str:
    r"""Return a TOML text in which one value is another.

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
        if comment and rest.lstrip().startswith("#"):
            rest = note
        elif comment and not rest.strip():
            rest += note
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


def read_layout(text: str) -> TomlLayout:
    r"""Find values and tables in a TOML text.

    Examples
    --------
    >>> read_layout("[a]\nb = 12\n").values
    {('a', 'b'): (8, 10)}
    """
    layout = TomlLayout()
    table: Path = ()
    stream = tokens(text)
    for token in stream:
        if token.kind == "comment" or token.text == "\n":
            continue
        if token.text == "[":
            table, end = _header(stream, len(text))
            layout.headers[table] = end
        else:
            _value(stream, (*table, *_key(token, stream)), layout)
    return layout


def _header(stream: Iterator[Token], length: int) -> tuple[Path, int]:
    path: list[str] = []
    for token in stream:
        if token.text == "\n":
            return tuple(path), token.start + 1
        if token.kind in ("plain", "string"):
            path.append(key_name(token))
    return tuple(path), length


def _key(first: Token, stream: Iterator[Token]) -> Path:
    path = [key_name(first)]
    for token in stream:
        if token.text == "=":
            break
        if token.kind != "sign":
            path.append(key_name(token))
    return tuple(path)


def _value(stream: Iterator[Token], path: Path, layout: TomlLayout) -> None:
    """Note a value and, in an inline table, the values one level below."""
    found: list[Token] = []
    depth = 0
    for token in stream:
        if token.text == "\n" and not depth:
            break
        if token.kind == "sign":
            depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(token.text, 0)
        if token.kind != "comment" and token.text != "\n":
            found.append(token)
    if not found:
        return
    layout.values[path] = (found[0].start, _end(found[-1]))
    if found[0].text == "{":
        _inline(found[1:-1], path, layout)


def _inline(inner: list[Token], path: Path, layout: TomlLayout) -> None:
    stream = iter(inner)
    for token in stream:
        key = _key(token, stream)
        found: list[Token] = []
        depth = 0
        for part in stream:
            if part.text == "," and not depth:
                break
            if part.kind == "sign":
                depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(part.text, 0)
            found.append(part)
        if found:
            layout.values[(*path, *key)] = (found[0].start, _end(found[-1]))


def _end(token: Token) -> int:
    return token.start + len(token.text)
