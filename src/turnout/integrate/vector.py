"""The inner loops of the kernels, on vectors that lie next to each other in memory.

Sums run in eight parts, since a processor adds faster than it waits for one sum.
A loop over ``array[first + j]`` stays slow, since an index could be negative; views do not.
"""

from turnout.integrate.system import Floats, Ints
from turnout.law.compiled import compiled, compiled_loop


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
    s0, s1, s2, s3, s4, s5, s6, s7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    i = 0
    while i + 8 <= n:
        s0 += a[i] * b[i]
        s1 += a[i + 1] * b[i + 1]
        s2 += a[i + 2] * b[i + 2]
        s3 += a[i + 3] * b[i + 3]
        s4 += a[i + 4] * b[i + 4]
        s5 += a[i + 5] * b[i + 5]
        s6 += a[i + 6] * b[i + 6]
        s7 += a[i + 7] * b[i + 7]
        i += 8
    while i < n:
        s0 += a[i] * b[i]
        i += 1
    return ((s0 + s4) + (s1 + s5)) + ((s2 + s6) + (s3 + s7))


@compiled_loop
def total(values: Floats) -> float:
    """Return the sum of a vector.

    Examples
    --------
    >>> import numpy as np
    >>> total(np.arange(6.0))
    15.0
    """
    n = values.size
    s0, s1, s2, s3, s4, s5, s6, s7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    i = 0
    while i + 8 <= n:
        s0 += values[i]
        s1 += values[i + 1]
        s2 += values[i + 2]
        s3 += values[i + 3]
        s4 += values[i + 4]
        s5 += values[i + 5]
        s6 += values[i + 6]
        s7 += values[i + 7]
        i += 8
    while i < n:
        s0 += values[i]
        i += 1
    return ((s0 + s4) + (s1 + s5)) + ((s2 + s6) + (s3 + s7))


@compiled_loop
def two_totals(a: Floats, b: Floats) -> tuple[float, float]:
    """Return the sums of two vectors; the second may be longer.

    Examples
    --------
    >>> import numpy as np
    >>> two_totals(np.arange(9.0), np.ones(9))
    (36.0, 9.0)
    """
    n = a.size
    a0, a1, a2, a3, a4, a5, a6, a7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    b0, b1, b2, b3, b4, b5, b6, b7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    i = 0
    while i + 8 <= n:
        a0, b0 = a0 + a[i], b0 + b[i]
        a1, b1 = a1 + a[i + 1], b1 + b[i + 1]
        a2, b2 = a2 + a[i + 2], b2 + b[i + 2]
        a3, b3 = a3 + a[i + 3], b3 + b[i + 3]
        a4, b4 = a4 + a[i + 4], b4 + b[i + 4]
        a5, b5 = a5 + a[i + 5], b5 + b[i + 5]
        a6, b6 = a6 + a[i + 6], b6 + b[i + 6]
        a7, b7 = a7 + a[i + 7], b7 + b[i + 7]
        i += 8
    while i < n:
        a0, b0 = a0 + a[i], b0 + b[i]
        i += 1
    of_a = ((a0 + a4) + (a1 + a5)) + ((a2 + a6) + (a3 + a7))
    return of_a, ((b0 + b4) + (b1 + b5)) + ((b2 + b6) + (b3 + b7))


@compiled_loop
def add(weight: float, a: Floats, to: Floats) -> None:
    """Add a multiple of a vector to another; the added one may be longer.

    Examples
    --------
    >>> import numpy as np
    >>> total = np.ones(2)
    >>> add(2.0, np.array([1.0, 3.0, 5.0]), total)
    >>> total.tolist()
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
    >>> total = np.ones(2)
    >>> add_two(2.0, np.array([1.0, 3.0, 5.0]), 1.0, np.ones(2), total)
    >>> total.tolist()
    [4.0, 8.0]
    """
    for i in range(to.size):
        to[i] += one * a[i] + other * b[i]


@compiled
def add_rows(weights: Floats, rows: Floats, to: Floats) -> None:
    """Add a weighted sum of the rows of a matrix, which may be wider, to a vector.

    Four rows at a time, so that the sum is read and written a quarter as often.

    Examples
    --------
    >>> import numpy as np
    >>> total = np.zeros(2)
    >>> add_rows(np.arange(1.0, 6.0), np.arange(15.0).reshape(5, 3), total)
    >>> total.tolist()
    [120.0, 135.0]
    """
    n, width = weights.size, to.size
    r = 0
    while r + 4 <= n:
        a, b, c, d = weights[r], weights[r + 1], weights[r + 2], weights[r + 3]
        first, second, third, fourth = rows[r], rows[r + 1], rows[r + 2], rows[r + 3]
        for i in range(width):
            to[i] += (a * first[i] + b * second[i]) + (c * third[i] + d * fourth[i])
        r += 4
    while r < n:
        add(weights[r], rows[r], to)
        r += 1


@compiled
def spread(change: Floats, at: Ints, pivot: Floats, rows: Floats) -> None:
    """Add to each row of a matrix, which may be wider, what it makes of a change times a pivot.

    Examples
    --------
    >>> import numpy as np
    >>> rows = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    >>> spread(np.array([10.0]), np.array([1]), np.array([1.0, 0.0]), rows)
    >>> rows.tolist()
    [[21.0, 2.0], [43.0, 4.0], [65.0, 6.0]]
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
            for i in range(width):
                first[i] += a * pivot[i]
                second[i] += b * pivot[i]
        r += 2
    if r < n:
        a = 0.0
        for k in range(change.size):
            a += change[k] * rows[r, at[k]]
        add(a, pivot, rows[r])


@compiled_loop
def gather(a: Floats, at: Ints, to: Floats) -> None:
    """Write chosen entries of a vector to another.

    Examples
    --------
    >>> import numpy as np
    >>> chosen = np.zeros(2)
    >>> gather(np.arange(5.0), np.array([3, 1]), chosen)
    >>> chosen.tolist()
    [3.0, 1.0]
    """
    for i in range(to.size):
        to[i] = a[at[i]]


@compiled_loop
def copy(a: Floats | Ints, to: Floats | Ints) -> None:
    """Write a vector, which may be longer, to another."""
    for i in range(to.size):
        to[i] = a[i]
