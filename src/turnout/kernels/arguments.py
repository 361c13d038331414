"""Arguments and results of kernels, as words of eight bytes.

Machine code reads its arguments from words in memory and writes there what it returns: numbers as
they are, arrays as their address with shape and strides, records as the address of their words
(`turnout.kernels.shared_record`), tuples as what is in them. The kinds of all arguments say which
machine code fits them.
"""

from collections.abc import Sequence
from functools import cache
from importlib import import_module
from operator import attrgetter
from typing import Any

import numpy as np

from turnout.kernels.shared_record import SharedRecord, address_of

NUMBER, WHOLE, LOGICAL, NOTHING = "float", "int", "bool", "none"
ARRAY, TUPLE = "array", "tuple"
C_CONTIGUOUS, F_CONTIGUOUS, ALIGNED, WRITEABLE = 0x1, 0x2, 0x100, 0x400
"""As NumPy numbers them in its flags."""
Kind = Any
"""`NUMBER`, `WHOLE`, `LOGICAL`, `NOTHING`, the kind of a record, or a tuple.

The tuple begins with `ARRAY`, then dtype, number of dimensions, order and whether it may be
written; or with `TUPLE`, then its class or None, and the kinds of what is in it."""


def add_argument(value: Any, words: list[Any], kinds: list[Kind]) -> None:
    """Append the words of an argument, and its kind.

    Raises
    ------
    TypeError
        When a kernel cannot take such an argument.

    Examples
    --------
    >>> words, kinds = [], []
    >>> add_argument((2.0, None, True), words, kinds)
    >>> words, kinds
    ([2.0, 1], [('tuple', None, 'float', 'none', 'bool')])
    """
    kind: Any = type(value)
    if kind is SharedRecord:
        words.append(value.address)
        kinds.append(value.kind)
    elif kind is float:
        words.append(value)
        kinds.append(NUMBER)
    elif kind is int:
        words.append(value)
        kinds.append(WHOLE)
    elif kind is np.ndarray:
        words += (address_of(value), *value.shape, *value.strides)
        kinds.append(_array_kind(value.dtype, value.ndim, value.flags.num))
    elif value is None:
        kinds.append(NOTHING)
    elif isinstance(value, bool | np.bool_):
        words.append(int(value))
        kinds.append(LOGICAL)
    elif isinstance(value, tuple):
        inner: list[Kind] = []
        for item in value:
            add_argument(item, words, inner)
        kinds.append((TUPLE, kind if hasattr(kind, "_fields") else None, *inner))
    elif isinstance(value, int | np.integer):
        words.append(int(value))
        kinds.append(WHOLE)
    elif isinstance(value, float | np.floating):
        words.append(float(value))
        kinds.append(NUMBER)
    else:
        msg = f"a kernel takes numbers, arrays, records and tuples of them, not {kind.__name__}"
        raise TypeError(msg)


@cache
def _array_kind(dtype: np.dtype[Any], ndim: int, flags: int) -> Kind:
    """Return the kind of an array; `flags` are those of NumPy as a number."""
    if not flags & ALIGNED:
        msg = "a kernel takes arrays at aligned addresses only; pass a copy"
        raise TypeError(msg)
    order = "C" if flags & C_CONTIGUOUS else "F" if flags & F_CONTIGUOUS else "A"
    return (ARRAY, dtype.str, ndim, order, bool(flags & WRITEABLE))


def struct_format(kinds: Sequence[Kind]) -> str:
    """Return the words of some kinds as a format of `struct`: floats are d, all others q.

    Examples
    --------
    >>> struct_format(["float", ("array", "<f8", 2, "C", True), ("tuple", None, "int", "none")])
    'dqqqqqq'
    """
    text = ""
    for kind in kinds:
        if kind == NUMBER:
            text += "d"
        elif isinstance(kind, tuple | list) and kind[0] == TUPLE:
            text += struct_format(kind[2:])
        elif isinstance(kind, tuple) and kind[0] == ARRAY:
            text += "q" * (1 + 2 * kind[2])
        elif kind != NOTHING:
            text += "q"
    return text


def describe(kind: Kind) -> str:
    """Return a kind as text that is the same in each process."""
    if isinstance(kind, tuple) and kind[0] == TUPLE:
        named = kind[1]
        of = "" if named is None else f"{named.__module__}.{named.__qualname__}{named._fields}"
        return f"{of}({', '.join(describe(item) for item in kind[2:])})"
    return str(kind)


def result_from(words: Sequence[Any], kind: Kind) -> Any:
    """Return the result of a kernel; the class of a named tuple is "module:name" here.

    Examples
    --------
    >>> result_from([1.5, 1, 7], ["tuple", None, "float", ["tuple", None, "bool", "int"]])
    (1.5, (True, 7))
    """
    return _taken(iter(words), kind)


@cache
def _class_at(place: str) -> Any:
    module, _, name = place.partition(":")
    return attrgetter(name)(import_module(module))


def _taken(words: Any, kind: Kind) -> Any:
    if kind == NOTHING:
        return None
    if isinstance(kind, tuple | list):
        values = [_taken(words, item) for item in kind[2:]]
        return tuple(values) if kind[1] is None else _class_at(kind[1])(*values)
    word = next(words)
    return bool(word) if kind == LOGICAL else word
