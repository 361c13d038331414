"""Numbers as people and instruments write them: signs, decimal marks, thousands, overload."""

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

EMPTY = frozenset(("", "nan", "na", "n/a", "null", "-nan", "none", "#n/a", "#nv", "nil"))
"""Cells without a sample, in small letters."""
_OVERLOAD = re.compile(
    r"[*#+_xX/?]{2,}|-{2,}|[+\-<>±]?(?:ovl|ovr|ovrld|over|overload|overld|overflow|overrange|"
    r"ofl|ol|o\.l\.?|o/l|under|underflow|underrange|inf|infinity|infinite|∞|invalid|inval|err|"
    r"error|bad|sat|saturated|clip|clipped|burnout|open|no ?data|no ?value|missing|"
    r"(?:i/o ?)?timeout|k\. ?a\.|1[.,]#inf\d*|#wert!?|#value!?|#div/0!?|#ref!?)[+\-!]?",
    re.IGNORECASE,
)
_NO_NUMBER = re.compile(r"[+\-]?1[.,]#(?:ind|qnan|snan)\d*", re.IGNORECASE)
"""A result that is none (NaN), as programs of Windows write it."""
_MINUS = str.maketrans({"−": "-", "–": "-", "‒": "-", "﹣": "-", "－": "-", "＋": "+"})
_BLANKS = "\u00a0\u202f\u2009 "
_CELL = re.compile(r"(.*\d[.,]?)\s?((?:[^\W\d_]|[%‰°])[^\d\s]{0,6})")
"""A number with its unit behind it."""
_LONGEST = 60
"""Characters of a number; what is longer is none."""


def number_pattern(decimal: str, *, thousands: bool) -> re.Pattern[str]:
    """Return the pattern of a number with a decimal mark, and marks between thousands if allowed.

    With an exponent there are no thousands: "4.000E-02" has a decimal point.

    Examples
    --------
    >>> [bool(number_pattern(",", thousands=True).fullmatch(text)) for text in ("1.234,5", "3.5")]
    [True, False]
    """
    point, other = re.escape(decimal), re.escape("," if decimal == "." else ".")
    group = rf"[{other}{_BLANKS}'’]"
    grouped = rf"[1-9]\d{{0,2}}(?P<mark>{group})\d{{3}}(?:(?P=mark)\d{{3}})*(?:{point}\d*)?|"
    return re.compile(
        rf"[+\-]?\s?(?:{grouped if thousands else ''}"
        rf"(?:\d+(?:{point}\d*)?|{point}\d+)(?:\s?[eEdD][+\-]?\d{{1,5}})?)"
    )


PLAIN = {mark: number_pattern(mark, thousands=False) for mark in ".,"}
GROUPED = {mark: number_pattern(mark, thousands=True) for mark in ".,"}
_MARKS = {
    mark: str.maketrans({key: None for key in f"{_BLANKS}'’{other}"} | {"D": "e", "d": "e"})
    for mark, other in ((".", ","), (",", "."))
}


def plain_sign(text: str) -> str:
    """Return a text without blanks around it, and with the plain signs of a number."""
    return text.strip(" \t\u00a0\u202f\u2009").translate(_MINUS)


def is_number(text: str, decimal: str, *, thousands: bool = True) -> bool:
    """Return True if a text is a number."""
    if len(text) > _LONGEST:
        return False
    pattern = (GROUPED if thousands else PLAIN)[decimal]
    return pattern.fullmatch(plain_sign(text)) is not None


def is_missing(text: str) -> bool:
    """Return True for a text in place of a sample: missing, or an overload."""
    text = text.strip()
    return _is_empty(text) or (len(text) < 16 and _OVERLOAD.fullmatch(text) is not None)


def _is_empty(text: str) -> bool:
    return text.lower() in EMPTY or (len(text) < 16 and _NO_NUMBER.fullmatch(text) is not None)


def numbers(texts: Sequence[str], decimal: str) -> tuple[NDArray[np.float64], list[int], set[str]]:
    """Return texts as numbers.

    Parameters
    ----------
    texts : sequence of str
        Cells of a column.
    decimal : str
        Its decimal mark.

    Returns
    -------
    values : ndarray, shape (n,)
        NaN for an empty cell, an overload and a text.
    wrong : list of int
        Places of the texts that are none of these.
    overload : set of str
        Overloads as the file writes them.

    Examples
    --------
    >>> numbers(["\u22120,5", "1.234,5", "OVL", "", "x"], ",")
    (array([-5.0000e-01,  1.2345e+03,         nan,         nan,         nan]), [4], {'OVL'})
    """
    pattern, marks = GROUPED[decimal], _MARKS[decimal]
    values = np.full(len(texts), np.nan)
    wrong: list[int] = []
    overload: set[str] = set()
    for place, text in enumerate(texts):
        plain = plain_sign(text)
        if len(plain) <= _LONGEST and pattern.fullmatch(plain):
            values[place] = float(plain.translate(marks).replace(",", "."))
        elif _is_empty(plain) or plain == "-":
            continue
        elif is_missing(text):
            overload.add(text.strip())
        else:
            wrong.append(place)
    return values, wrong, overload


def numbers_with_unit(
    texts: Sequence[str], decimal: str
) -> tuple[NDArray[np.float64], list[str]] | None:
    """Return cells with a unit behind each number as numbers and units; None if one has none.

    Examples
    --------
    >>> numbers_with_unit(["0,5 kN", "", "-1 kN"], ",")
    (array([ 0.5,  nan, -1. ]), ['kN'])
    """
    parts = [_CELL.fullmatch(text.strip()) for text in texts]
    filled = [text for text in texts if not is_missing(text)]
    found = [part for part in parts if part is not None]
    if not filled or len(found) < len(filled):
        return None
    values, wrong, _ = numbers([part[1] if part else "" for part in parts], decimal)
    return None if wrong else (values, list(dict.fromkeys(part[2] for part in found)))


def unclear_mark(text: str, decimal: str) -> list[str]:
    """Return a remark if the decimal mark might part thousands instead, by all numbers of a text.

    Examples
    --------
    >>> len(unclear_mark("7,000;6,250", ",")), len(unclear_mark("7,000;0,250", ","))
    (1, 0)
    """
    mark = re.escape(decimal)
    plain = rf"(?:(?<![\d{mark}])(?:0\d*|\d{{4,}}|){mark}\d|{mark}(?:\d{{0,2}}|\d{{4,}})(?!\d))"
    if not re.search(rf"\d{mark}\d", text) or re.search(plain, text):
        return []
    return [
        f"check the values: all have three digits behind '{decimal}', which is taken for the "
        "decimal mark"
    ]


LEAST_CURVE = 4
"""Numbers of a list that make it a curve."""


def curve_parts(text: str, decimal: str) -> list[str]:
    """Return the numbers of a curve in one cell; empty if it holds none.

    Examples
    --------
    >>> curve_parts("[1.5, 2, 2.5, 3]", "."), curve_parts("1,5;2;2,5;3", ",")
    (['1.5', '2', '2.5', '3'], ['1,5', '2', '2,5', '3'])
    """
    inner = text.strip().strip("[](){}").strip()
    mark = next((mark for mark in ";|" if mark in inner), None)
    mark = mark or ("," if "," in inner and decimal != "," else None)
    parts = [part.strip() for part in inner.split(mark) if part.strip()]
    if len(parts) < LEAST_CURVE:
        return []
    return parts if all(is_number(part, decimal, thousands=False) for part in parts) else []
