"""The inner loops of the kernels, on vectors that lie next to each other in memory.

What is short and often run takes eight numbers at a time, see `turnout.kernels.lanes`. A loop over
``array[first + j]`` stays slow, since an index could be negative; views do not.
"""

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled_loop
from turnout.kernels.lanes import LANES, broadcast, horizontal_sum, load, store

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@compiled_loop
def dot(a: Floats, b: Floats) -> float:
    """Return the product of two vectors; the second may be longer.

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
def add(weight: float, a: Floats, to: Floats) -> None:
    """Add a multiple of a vector to another; the added one may be longer.

    Examples
    --------
    >>> import numpy as np
    >>> horizontal_sum = np.ones(2)
    >>> add(2.0, np.array([1.0, 3.0, 5.0]), horizontal_sum)
    >>> horizontal_sum.tolist()
    [3.0, 7.0]
    """
    for i in range(to.size):
        to[i] += weight * a[i]


@compiled_loop
def add_two(one: float, a: Floats, other: float, b: Floats, to: Floats) -> None:
    """Add multiples of two vectors to a third; the added ones may be longer.

    Examples
    --------
    >>> import numpy as np
    >>> horizontal_sum = np.ones(2)
    >>> add_two(2.0, np.array([1.0, 3.0, 5.0]), 1.0, np.ones(2), horizontal_sum)
    >>> horizontal_sum.tolist()
    [4.0, 8.0]
    """
    for i in range(to.size):
        to[i] += one * a[i] + other * b[i]


@compiled_loop
def add_rows(weights: Floats, rows: Floats, to: Floats) -> None:
    """Add a weighted sum of the rows of a matrix, which may be wider, to a vector.

    Four rows at a time, so that the sum is read and written a quarter as often.

    Examples
    --------
    >>> import numpy as np
    >>> horizontal_sum = np.zeros(2)
    >>> add_rows(np.arange(1.0, 6.0), np.arange(15.0).reshape(5, 3), horizontal_sum)
    >>> horizontal_sum.tolist()
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
        add(weights[r], rows[r], to)
        r += 1


@compiled_loop
def sum_rows(start: Floats, weights: Floats, rows: Floats, to: Floats) -> None:
    """Write a vector plus a weighted sum of the rows of a matrix, which may be wider, to another.

    Vectors fill whole lines of memory.

    Examples
    --------
    >>> import numpy as np
    >>> horizontal_sum = np.zeros(8)
    >>> sum_rows(np.ones(8), np.arange(1.0, 6.0), np.arange(40.0).reshape(5, 8), horizontal_sum)
    >>> horizontal_sum[:2].tolist()
    [321.0, 336.0]
    """
    n, width, present = weights.size, to.size, start
    r = 0
    while r + 4 <= n:
        a, b = broadcast(weights[r]), broadcast(weights[r + 1])
        c, d = broadcast(weights[r + 2]), broadcast(weights[r + 3])
        first, second, third, fourth = rows[r], rows[r + 1], rows[r + 2], rows[r + 3]
        for i in range(0, width, LANES):
            pair = a * load(first, i) + b * load(second, i)
            other = c * load(third, i) + d * load(fourth, i)
            store(load(present, i) + (pair + other), to, i)
        present = to
        r += 4
    while r < n:
        a, row = broadcast(weights[r]), rows[r]
        for i in range(0, width, LANES):
            store(load(present, i) + a * load(row, i), to, i)
        present = to
        r += 1
    if n == 0:
        copy(start, to)


@compiled_loop
def spread(change: Floats, at: Ints, pivot: Floats, rows: Floats) -> None:
    """Add to each row of a matrix, which may be wider, what it makes of a change times a pivot.

    The pivot fills whole lines of memory.

    Examples
    --------
    >>> import numpy as np
    >>> rows = np.arange(24.0).reshape(3, 8)
    >>> spread(np.array([10.0]), np.array([1], dtype=np.uint64), np.eye(8)[0], rows)
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
                store(load(first, i) + a8 * moved, first, i)
                store(load(second, i) + b8 * moved, second, i)
        r += 2
    if r < n:
        a = 0.0
        for k in range(change.size):
            a += change[k] * rows[r, at[k]]
        add(a, pivot, rows[r][:width])


@compiled_loop
def gather_all(a: Floats, at: Ints, to: Floats) -> None:
    """Write chosen entries of a vector to another.

    Examples
    --------
    >>> import numpy as np
    >>> chosen = np.zeros(2)
    >>> gather_all(np.arange(5.0), np.array([3, 1]), chosen)
    >>> chosen.tolist()
    [3.0, 1.0]
    """
    for i in range(to.size):
        to[i] = a[at[i]]


@compiled_loop
def copy(a: Floats | Ints, to: Floats | Ints) -> None:
    """Write a vector, which may be longer or fill the same lines of memory, to another."""
    for i in range(to.size):
        to[i] = a[i]
