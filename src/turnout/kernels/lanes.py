"""SIMD operations on eight floats at a time, for kernels whose loops are short.

A compiler vectorises long loops well, but a rail has a few lanes of most things, and such a loop
then consists of its prologue and its remainder. Here a kernel states the vector operations itself.
Reductions keep eight partial sums and add them in one order, and products are rounded before they
are added, so that results have the same bits on every processor.

Store-to-load forwarding works only where a load lies within one earlier store: eight floats of
which one was written alone have to wait for the cache. Kernels therefore write eight at once what
they read eight at once.

Vectors must be padded to whole cache lines, as those of `turnout.kernels.shared_record` are, since
the last eight may reach beyond the end. In Python the same functions work on padded vectors; what
they are in machine code is in `turnout.kernels.lane_code`.
"""

import math
from ctypes import addressof, c_char
from fractions import Fraction
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.int64] | NDArray[np.uint64]

LANES = 8
"""Floats of one SIMD operation; they fill a cache line."""

Count = TypeVar("Count", int, NDArray[np.int64])


def whole_lines(count: Count) -> Count:
    """Round numbers of floats up to whole cache lines.

    Examples
    --------
    >>> whole_lines(9), whole_lines(np.array([1, 8, 9])).tolist()
    (16, [8, 8, 16])
    """
    return -(-count // LANES) * LANES


def zeros_in_lines(*shape: int) -> Floats:
    """Return zeros that begin at a cache line and end with one.

    Examples
    --------
    >>> zeros_in_lines(2, 3).ctypes.data % (8 * LANES)
    0
    """
    found = empty_in_lines(*shape)
    found.fill(0.0)
    return found


def copy_in_lines(values: Floats) -> Floats:
    """Return a copy that begins at a cache line and ends with one."""
    found = empty_in_lines(*values.shape)
    found[...] = values
    return found


def empty_in_lines(*shape: int) -> Floats:
    """Return uninitialised floats that begin at a cache line and end with one."""
    count = math.prod(shape)
    memory = np.empty(whole_lines(count) + LANES)
    first = -(addressof(c_char.from_buffer(memory.data)) // 8) % LANES
    return memory[first : first + count].reshape(shape)


def load(values: Floats, at: int) -> Floats:
    """Load eight neighbouring floats from index `at`.

    Examples
    --------
    >>> load(np.arange(20.0), 8).tolist()
    [8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0]
    """
    return values[at : at + LANES].copy()


def store(eight: Floats, to: Floats, at: int) -> None:
    """Store eight floats from index `at`."""
    to[at : at + LANES] = eight


def store_nontemporal(eight: Floats, to: Floats, at: int) -> None:
    """Store eight floats, aligned to a cache line, past the caches: for values not read soon."""
    to[at : at + LANES] = eight


def gather(values: Floats, places: Indices, at: int) -> Floats:
    """Load ``values[places[at]]`` and the seven that follow."""
    found: Floats = values[places[at : at + LANES]]
    return found


def turn(values: Floats, step: int, to: Floats, to_step: int) -> None:
    """Write eight rows of eight neighbours as eight columns.

    Parameters
    ----------
    values : ndarray, shape (7 step + 8,) or more
        Row i begins at ``i step``.
    to : ndarray, shape (7 to_step + 8,) or more
        What comes k-th in its row is written from ``k to_step`` on.

    Examples
    --------
    >>> found = np.empty((8, 10))
    >>> turn(np.arange(100.0), 12, found.ravel(), 10)
    >>> found[0, :8].tolist(), found[7, :4].tolist()
    ([0.0, 12.0, 24.0, 36.0, 48.0, 60.0, 72.0, 84.0], [7.0, 19.0, 31.0, 43.0])
    """
    for k in range(LANES):
        to[k * to_step :][:LANES] = values[k:][: 7 * step + 1 : step]


def broadcast(value: float) -> Floats:
    """Return eight floats of one value."""
    return np.full(LANES, float(value))


def horizontal_sum(eight: Floats) -> float:
    """Return the sum of eight floats; the halves are added first.

    Examples
    --------
    >>> horizontal_sum(np.arange(8.0))
    28.0
    """
    part = eight
    for half in (4, 2, 1):
        part = part[:half] + part[half : 2 * half]
    return float(part[0])


def multiply_add(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return ``a b + c`` of eight by eight floats, rounded once (IEEE 754 fusedMultiplyAdd).

    Examples
    --------
    >>> a, b = np.full(8, 1.0 + 2.0**-30), np.full(8, 1.0 - 2.0**-30)
    >>> float(multiply_add(a, b, np.full(8, -1.0))[0]) == -(2.0**-60)  # a product rounds to 1
    True
    """
    return np.array(list(map(_multiply_add_one, a.tolist(), b.tolist(), c.tolist())))


def _multiply_add_one(a: float, b: float, c: float) -> float:
    rounded = a * b + c
    return float(Fraction(a) * Fraction(b) + Fraction(c)) if math.isfinite(rounded) else rounded


def absolute(eight: Floats) -> Floats:
    """Return eight magnitudes."""
    return np.abs(eight)


def greater(a: Floats, b: Floats) -> Bools:
    """Compare eight by eight floats, ``a > b``; false if one is NaN."""
    return a > b


def greater_or_nan(a: Floats, b: Floats) -> Bools:
    """Compare eight by eight floats, ``a > b``; true if one is NaN."""
    return ~(a <= b)


def logical_or(one: Bools, other: Bools) -> Bools:
    """Combine eight by eight flags."""
    return one | other


def select(where: Bools, yes: Floats, no: Floats) -> Floats:
    """Return `yes` for flags that are true, else `no`."""
    return np.where(where, yes, no)


def any_true(flags: Bools) -> bool:
    """Return True if any of eight flags is true."""
    return bool(flags.any())
