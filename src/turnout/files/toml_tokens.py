"""The pieces of a TOML text, found in one pass whose work grows with the length of the text only.

What is not TOML falls into pieces too; that it is TOML is for `tomllib` to say.
"""

import re
import tomllib
from collections.abc import Iterator
from typing import NamedTuple

MOST_NESTED = 30
"""Lists and tables inside one another, and names of one key."""

LONGEST_NUMBER = 100
"""Characters of a number; a whole one may have any length in Python, but not everywhere in it."""

_DIGITS = "0123456789+-"

# Repetitions take all they can and give nothing back: a string without an end is read once.
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
    """A piece of TOML: its kind (string, comment, sign, plain), text, and place in the text."""

    kind: str
    text: str
    start: int


def tokens(text: str) -> Iterator[Token]:
    r"""Yield the pieces of a TOML text; blanks between them are left out, ends of lines are not.

    Examples
    --------
    >>> [token.text for token in tokens("a.b = ['#', 2] # c")]
    ['a', '.', 'b', '=', '[', "'#'", ',', '2', ']', '# c']
    """
    for match in _TOKEN.finditer(text):
        yield Token(match.lastgroup or "", match[0], match.start())


def key_name(token: Token) -> str:
    """Return the name that a piece of a key stands for.

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
    r"""Return what in a text is nested too deeply or too long, and its line; None if nothing is.

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
