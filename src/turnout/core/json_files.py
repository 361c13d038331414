"""Records as JSON and back, exactly, in files with a checksum of their content.

Every number keeps its bits. A damaged file is detected before anything of it is used, and reading
creates only the types that a record declares, so a file cannot run code.
"""

import json
import math
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from turnout.core.problems import show_value
from turnout.core.provenance import content_hash
from turnout.core.toml import read_bytes

T = TypeVar("T")
_TYPES: dict[str, type] = {"float": float, "str": str, "bool": bool}
"""Types that can be values, by the name that stands for them in a file."""
_PLAIN = {float, int, str, bool, type(None)}
_NAMES = {float: "a number", int: "an integer", str: "a text", bool: "true or false"}


def to_plain(value: Any, *, nonfinite: Callable[[float], Any] = str) -> Any:
    """Turn records and arrays into nested plain data.

    Parameters
    ----------
    value : object
        Dataclass, mapping, sequence, array or number.
    nonfinite : callable
        Replaces NaN and infinite numbers, by default with texts.

    Examples
    --------
    >>> to_plain((1.0, float("-inf"), np.eye(2)))
    [1.0, '-inf', [[1.0, 0.0], [0.0, 1.0]]]
    """
    if isinstance(value, type):
        return value.__name__
    if is_dataclass(value):
        items = {item.name: getattr(value, item.name) for item in fields(value)}
        return to_plain(items, nonfinite=nonfinite)
    if isinstance(value, Mapping):
        return {str(key): to_plain(item, nonfinite=nonfinite) for key, item in value.items()}
    if isinstance(value, list | tuple) and _is_plain(value):
        return list(value)
    if isinstance(value, np.ndarray | list | tuple):
        return [to_plain(item, nonfinite=nonfinite) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else nonfinite(float(value))
    return value.item() if isinstance(value, np.generic) else value


def _is_plain(values: Sequence[Any]) -> bool:
    """Return True if all values of a list are plain already, such as a row of a table."""
    kinds = set(map(type, values))
    if not kinds <= _PLAIN:
        return False
    numbers = values if kinds == {float} else [v for v in values if type(v) is float]
    return all(map(math.isfinite, numbers))


def from_plain(kind: type[T], value: object, *, where: str = "") -> T:
    """Build a record from plain data, with a check of every key and type.

    Parameters
    ----------
    kind : type
        A dataclass; nested types are read from its annotations.
    value : object
        From `to_plain`, or from a file.
    where : str
        Name of the place in messages.

    Raises
    ------
    ValueError
        With the first place where the data differ from what the record declares.

    Examples
    --------
    >>> from turnout.core.units import LENGTH, Dimension
    >>> from_plain(Dimension, to_plain(LENGTH)) == LENGTH
    True
    """
    made: T = _read(kind, value, where)
    return made


def _read(kind: Any, value: Any, where: str) -> Any:
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return _one_of(inner, value, where)
    if kind is type:
        _expect(isinstance(value, str) and value in _TYPES, "the name of a type", value, where)
        return _TYPES[value]
    if is_dataclass(kind):
        return _record(kind, value, where)
    if origin is tuple:
        _expect(isinstance(value, list), "a list", value, where)
        if set(map(type, value)) <= _plain_types(inner[0]):
            return tuple(value)
        return tuple(_read(inner[0], item, f"{where} {n}") for n, item in enumerate(value, 1))
    if origin is np.ndarray:
        return _array(value, where)
    if origin is not None:
        _expect(isinstance(value, dict), "a table", value, where)
        return {key: _read(inner[1], item, _place(where, key)) for key, item in value.items()}
    return _single(kind, value, where)


@cache
def _plain_types(kind: Any) -> frozenset[type]:
    """Return the types of values that are of a kind as they are; none of records and lists."""
    inner = typing.get_args(kind)
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return frozenset().union(*map(_plain_types, inner))
    if kind is float:
        return frozenset((float, int))
    return frozenset((kind,)) if kind in _NAMES else frozenset()


def _single(kind: type, value: Any, where: str) -> Any:
    """Return a number, text or logical value of the kind declared; an integer may be a float."""
    if kind is float:
        if value in ("inf", "-inf", "nan"):
            return float(value)
        fits = isinstance(value, int | float) and not isinstance(value, bool)
    else:
        fits = type(value) is kind
    _expect(fits, _NAMES.get(kind, kind.__name__), value, where)
    return value


def _one_of(kinds: tuple[Any, ...], value: Any, where: str) -> Any:
    """Read a value as the first type of a union that fits; "inf" is a text before a number."""
    reasons = []
    for kind in sorted(kinds, key=lambda kind: kind is float):
        try:
            return _read(kind, value, where)
        except ValueError as error:
            reasons.append(error)
    raise reasons[0]


def _array(value: Any, where: str) -> Any:
    _expect(isinstance(value, list), "an array of numbers", value, where)
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        message = f"{where}: must be an array of numbers"
        raise ValueError(message) from None


def _record(kind: Any, value: Any, where: str) -> Any:
    _expect(isinstance(value, dict), "a table", value, where)
    names = [item.name for item in fields(kind) if item.init]
    for name in [*(name for name in names if name not in value), *value.keys() - set(names)]:
        message = f"{_place(where, name)} is {'missing' if name in names else 'not known'}"
        raise ValueError(message)
    hints = typing.get_type_hints(kind)
    return kind(**{name: _read(hints[name], value[name], _place(where, name)) for name in names})


def _place(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name


def _expect(fits: bool, wanted: str, value: Any, where: str) -> None:
    if not fits:
        message = f"{where or 'the content'} = {show_value(value)}: must be {wanted}"
        raise ValueError(message)


CHECKSUM = "checksum"


def sealed_json(content: Mapping[str, Any]) -> str:
    """Return plain data as JSON text with a checksum beside the other keys, a key in a line.

    Raises
    ------
    TypeError, ValueError
        When the content is not plain data, or a number is not finite.
    """
    whole = {**content, CHECKSUM: content_hash(dict(content))}
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in whole.items()]
    return "{\n" + ",\n".join(lines) + "\n}"


def read_sealed(path: Path, *, largest: int) -> tuple[dict[str, Any], str]:
    """Read a JSON file that should have a checksum.

    Parameters
    ----------
    path : Path
        Of an existing file.
    largest : int
        Largest size of the file [bytes].

    Returns
    -------
    content : dict
        Without the checksum; empty where the file is not a JSON table.
    fault : str
        Fault of the file; empty for none.

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
