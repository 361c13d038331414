"""Inner loops of the kernels on contiguous vectors: products, weighted sums, gathers.

Short loops that run often take eight floats at a time, `turnout.kernels.lanes`. Callers pass views:
a loop over ``array[first + j]`` is slow, since an index could be negative.
"""

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled_loop
from turnout.kernels.lanes import (
    LANES,
    broadcast,
    gather,
    horizontal_sum,
    load,
    multiply_add,
    store,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROWS_TOGETHER = 16
"""Rows of a weighted sum that are added one after the other."""


@compiled_loop
def dot(a: Floats, b: Floats) -> float:
    """Return the scalar product of two vectors; the second may be longer.

    Examples
    --------
    >>> import numpy as np
    >>> dot(np.array([1.0, 2.0]), np.array([3.0, 4.0, 5.0]))
    11.0
    """
    n = a.size
    whole = n - n % LANES
    parts, rest = broadcast(0.0), 0.0
    for i in range(0, whole, LANES):
        parts = parts + load(a, i) * load(b, i)
    for i in range(whole, n):
        rest += a[i] * b[i]
    return horizontal_sum(parts) + rest


@compiled_loop
def add_scaled(weight: float, a: Floats, to: Floats) -> None:
    """Add a multiple of a vector to another; the added one may be longer.

    Examples
    --------
    >>> import numpy as np
    >>> total = np.ones(2)
    >>> add_scaled(2.0, np.array([1.0, 3.0, 5.0]), total)
    >>> total.tolist()
    [3.0, 7.0]
    """
    for i in range(to.size):
        to[i] += weight * a[i]


@compiled_loop
def add_multiple(weight: float, a: Floats, to: Floats) -> None:
    """Add a multiple of a vector to one that fills whole cache lines, rounded once.

    Examples
    --------
    >>> import numpy as np
    >>> total = np.ones(8)
    >>> add_multiple(2.0, np.arange(8.0), total)
    >>> total[:3].tolist()
    [1.0, 3.0, 5.0]
    """
    eight = broadcast(weight)
    for i in range(0, to.size, LANES):
        store(multiply_add(eight, load(a, i), load(to, i)), to, i)


@compiled_loop
def scale_into(factor: float, a: Floats, to: Floats) -> None:
    """Write a multiple of a vector to one that fills whole cache lines.

    Examples
    --------
    >>> import numpy as np
    >>> twice = np.zeros(8)
    >>> scale_into(2.0, np.arange(8.0), twice)
    >>> twice[:3].tolist()
    [0.0, 2.0, 4.0]
    """
    eight = broadcast(factor)
    for i in range(0, to.size, LANES):
        store(eight * load(a, i), to, i)


@compiled_loop
def add_weighted_rows(weights: Floats, rows: Floats, to: Floats) -> None:
    """Add a weighted sum of the rows of a matrix, which may be wider, to a vector.

    Four rows at a time, so that the sum is read and written a quarter as often.

    Examples
    --------
    >>> import numpy as np
    >>> total = np.zeros(2)
    >>> add_weighted_rows(np.arange(1.0, 6.0), np.arange(15.0).reshape(5, 3), total)
    >>> total.tolist()
    [120.0, 135.0]
    """
    n, width = weights.size, to.size
    whole = width - width % LANES
    r = 0
    while r + 4 <= n:
        a, b, c, d = weights[r], weights[r + 1], weights[r + 2], weights[r + 3]
        first, second, third, fourth = rows[r], rows[r + 1], rows[r + 2], rows[r + 3]
        a8, b8, c8, d8 = broadcast(a), broadcast(b), broadcast(c), broadcast(d)
        for i in range(0, whole, LANES):
            pair = a8 * load(first, i) + b8 * load(second, i)
            other = c8 * load(third, i) + d8 * load(fourth, i)
            store(load(to, i) + (pair + other), to, i)
        for i in range(whole, width):
            to[i] += (a * first[i] + b * second[i]) + (c * third[i] + d * fourth[i])
        r += 4
    while r < n:
        add_scaled(weights[r], rows[r], to)
        r += 1


@compiled_loop
def sum_weighted_rows(start: Floats, weights: Floats, rows: Floats, to: Floats) -> None:
    """Write a vector plus a weighted sum of the rows of a matrix, which may be wider, to another.

    Vectors fill whole cache lines. Six or seven lines stay in registers while `ROWS_TOGETHER` rows
    are added in turn, each rounded once; so many sums hide that one waits for the one before.
    Further rows have a sum of their own, so that rounding grows less with their number.

    Examples
    --------
    >>> import numpy as np
    >>> total = np.zeros(8)
    >>> sum_weighted_rows(np.ones(8), np.arange(1.0, 6.0), np.arange(40.0).reshape(5, 8), total)
    >>> total[:2].tolist()
    [321.0, 336.0]
    """
    last = min(ROWS_TOGETHER, weights.size)
    _sum_some_rows(start, weights[:last], rows[:last], to, True)
    while last < weights.size:
        first, last = last, min(last + ROWS_TOGETHER, weights.size)
        _sum_some_rows(start, weights[first:last], rows[first:last], to, False)


@compiled_loop
def _sum_some_rows(start: Floats, weights: Floats, rows: Floats, to: Floats, fresh: bool) -> None:
    """Write a start and a sum of rows, or add the sum to earlier values."""
    at, lines = 0, to.size // LANES
    while lines >= 6:
        count = 6 if lines % 6 == 0 else 7
        if count == 6:
            _sum_lines(start, weights, rows, to, at, fresh, False)
        else:
            _sum_lines(start, weights, rows, to, at, fresh, True)
        at, lines = at + count * LANES, lines - count
    while at < to.size:
        total = _begin(start, at, fresh)
        for r in range(weights.size):
            total = multiply_add(broadcast(weights[r]), load(rows[r], at), total)
        _end(total, to, at, fresh)
        at += LANES


@compiled_loop
def _begin(start: Floats, at: int, fresh: bool) -> Floats:
    if fresh:
        return load(start, at)
    return broadcast(0.0)


@compiled_loop
def _end(total: Floats, to: Floats, at: int, fresh: bool) -> None:
    if fresh:
        store(total, to, at)
    else:
        store(load(to, at) + total, to, at)


@compiled_loop
def _sum_lines(
    start: Floats, weights: Floats, rows: Floats, to: Floats, at: int, fresh: bool, seven: bool
) -> None:
    """Sum six or seven lines; LLVM leaves the seventh out where it is not wanted."""
    second, third, fourth = at + LANES, at + 2 * LANES, at + 3 * LANES
    fifth, sixth, seventh = at + 4 * LANES, at + 5 * LANES, at + 6 * LANES
    a, b, c = _begin(start, at, fresh), _begin(start, second, fresh), _begin(start, third, fresh)
    d, e, f = _begin(start, fourth, fresh), _begin(start, fifth, fresh), _begin(start, sixth, fresh)
    g = _begin(start, seventh, fresh) if seven else a
    for r in range(weights.size):
        weight, row = broadcast(weights[r]), rows[r]
        a = multiply_add(weight, load(row, at), a)
        b = multiply_add(weight, load(row, second), b)
        c = multiply_add(weight, load(row, third), c)
        d = multiply_add(weight, load(row, fourth), d)
        e = multiply_add(weight, load(row, fifth), e)
        f = multiply_add(weight, load(row, sixth), f)
        if seven:
            g = multiply_add(weight, load(row, seventh), g)
    _end(a, to, at, fresh)
    _end(b, to, second, fresh)
    _end(c, to, third, fresh)
    _end(d, to, fourth, fresh)
    _end(e, to, fifth, fresh)
    _end(f, to, sixth, fresh)
    if seven:
        _end(g, to, seventh, fresh)


@compiled_loop
def update_rank_one(change: Floats, at: Ints, pivot: Floats, rows: Floats) -> None:
    """Update a matrix by ``rows += (rows[:, at] @ change) pivot^T``; it may be wider.

    The pivot fills whole cache lines.

    Examples
    --------
    >>> import numpy as np
    >>> rows = np.arange(24.0).reshape(3, 8)
    >>> update_rank_one(np.array([10.0]), np.array([1], dtype=np.uint64), np.eye(8)[0], rows)
    >>> rows[:, :2].tolist()
    [[10.0, 1.0], [98.0, 9.0], [186.0, 17.0]]
    """
    n, width = rows.shape[0], pivot.size
    r = 0
    while r + 2 <= n:
        first, second = rows[r], rows[r + 1]
        a, b = 0.0, 0.0
        for k in range(change.size):
            a += change[k] * first[at[k]]
            b += change[k] * second[at[k]]
        if a != 0.0 or b != 0.0:
            a8, b8 = broadcast(a), broadcast(b)
            for i in range(0, width, LANES):
                moved = load(pivot, i)
                store(multiply_add(a8, moved, load(first, i)), first, i)
                store(multiply_add(b8, moved, load(second, i)), second, i)
        r += 2
    if r < n:
        a = 0.0
        for k in range(change.size):
            a += change[k] * rows[r, at[k]]
        add_multiple(a, pivot, rows[r][:width])


@compiled_loop
def gather_all(values: Floats, places: Ints, to: Floats) -> None:
    """Write ``values[places]`` to a vector; places and result fill whole cache lines.

    Examples
    --------
    >>> import numpy as np
    >>> chosen = np.zeros(8)
    >>> gather_all(np.arange(5.0), np.array([3, 1, 0, 0, 0, 0, 0, 0]), chosen)
    >>> chosen[:3].tolist()
    [3.0, 1.0, 0.0]
    """
    for i in range(0, places.size, LANES):
        store(gather(values, places, i), to, i)


@compiled_loop
def copy(a: Floats | Ints, to: Floats | Ints) -> None:
    """Copy a vector, which may be longer or fill the same cache lines, to another."""
    for i in range(to.size):
        to[i] = a[i]
