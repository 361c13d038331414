"""Peak, slip, last rise and work of the effort of drives over a movement.

Each row is walked through a few times while it lies in the processor's nearest cache, where NumPy
would write a dozen arrays of all rows.
"""

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import LANES, any_true, broadcast, greater, horizontal_sum, load

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PEAK, SLIP, MOVING = range(3)
"""Columns of `find_places`."""
FIRST, LAST = range(2)
"""Columns of `find_rises`."""


@compiled
def find_places(
    effort: Floats, travel: Floats | None, limits: Floats, arrived: float, places: Ints
) -> None:
    """Find the places at which each row is largest, slips first, and has last not arrived.

    Parameters
    ----------
    effort : ndarray, shape (n_rows, n_times)
        Places where it is not finite count for nothing [N].
    travel : ndarray, shape (n, n_times), optional
        Of the marker; the n rows repeat until there is one for each row of effort [m].
    limits : ndarray, shape (n_rows,)
        Effort above which a row slips: the number below that at which it does [N].
    arrived : float
        A marker no further than this from its last place has arrived [m].
    places : ndarray of int, shape (n_rows, 3)
        Written: columns `PEAK`, 0 where nothing is finite, `SLIP` and `MOVING`, -1 for nowhere.
    """
    count = effort.shape[1]
    for r in range(effort.shape[0]):
        row = effort[r]
        places[r, PEAK] = _largest(row)
        places[r, SLIP] = _first_above(row, limits[r])
        places[r, MOVING] = -1
        if travel is not None:
            path, i = travel[r % travel.shape[0]], count - 1
            while i >= 0 and not abs(path[i] - path[count - 1]) > arrived:
                i -= 1
            places[r, MOVING] = i


@compiled_part
def _largest(row: Floats) -> int:
    """Return the place of the largest finite value of a row; 0 if it has none."""
    found, largest, whole = 0, -np.inf, row.size - row.size % LANES
    for begin in range(0, row.size, LANES):
        # Most of eight neighbours are none of them larger.
        if begin < whole and not any_true(greater(load(row, begin), broadcast(largest))):
            continue
        for i in range(begin, min(begin + LANES, row.size)):
            if largest < row[i] < np.inf:
                found, largest = i, row[i]
    return found


@compiled_part
def _first_above(row: Floats, limit: float) -> int:
    """Return the first place at which a row is above a limit; -1 if there is none."""
    whole = row.size - row.size % LANES
    for begin in range(0, row.size, LANES):
        if begin < whole and not any_true(greater(load(row, begin), broadcast(limit))):
            continue
        for i in range(begin, min(begin + LANES, row.size)):
            if row[i] > limit:
                return i
    return -1


@compiled
def integrate_work(effort: Floats, travel: Floats, work: Floats) -> None:
    """Write the work of each row by the trapezoidal rule.

    Parameters
    ----------
    effort, travel : ndarray, shapes (n_rows, n_times), (n, n_times)
        As of `find_places` [N], [m].
    work : ndarray, shape (n_rows,)
        [J]
    """
    count = effort.shape[1] - 1
    whole = count - count % LANES
    for r in range(effort.shape[0]):
        row, path = effort[r], travel[r % travel.shape[0]]
        parts, rest = broadcast(0.0), 0.0
        for i in range(0, whole, LANES):
            moved = load(path, i + 1) - load(path, i)
            parts = parts + moved * (load(row, i + 1) + load(row, i))
        for i in range(whole, count):
            rest += (path[i + 1] - path[i]) * (row[i + 1] + row[i])
        work[r] = 0.5 * (horizontal_sum(parts) + rest)


@compiled
def find_rises(
    effort: Floats,
    level: Floats,
    plateau: Floats,
    half: int,
    smallest: float,
    bounds: tuple[float, float],
    scratch: Floats,
    places: Ints,
    heights: Floats,
) -> None:
    """Find the last rise of each row, filtered, from its plateau to its largest value.

    Parameters
    ----------
    effort : ndarray, shape (n_rows, n_times)
        NaN is a missing sample [N].
    level, plateau : ndarray, shape (n_rows,)
        Mean, about which a row is filtered as `turnout.core.moving_average` does, and the effort
        from which the rise counts [N].
    half : int
        Samples on each side of the one that the filter's window is about.
    smallest : float
        A rise below it is none [N].
    bounds : tuple of float
        Shares of the rise from which and up to which it is taken.
    scratch : ndarray, shape (3, n_times)
        Memory.
    places : ndarray of int, shape (n_rows, 2)
        Written: where the filtered row is last below the first bound, and first above the other
        one, columns `FIRST` and `LAST`; -1 where there is no rise.
    heights : ndarray, shape (n_rows, 2)
        Written: its values there.
    """
    low, high = bounds
    smooth = scratch[2]
    for r in range(effort.shape[0]):
        places[r, FIRST], places[r, LAST] = -1, -1
        _average(effort[r], level[r], half, scratch)
        top, largest = 0, smooth[0]
        for i in range(smooth.size):
            if not smooth[i] <= largest:
                top, largest = i, smooth[i]
                if np.isnan(largest):
                    break
        rise, first = largest - plateau[r], top
        while first >= 0 and not smooth[first] <= plateau[r] + low * rise:
            first -= 1
        if first < 0 or not rise >= smallest:
            continue
        last = first
        while not smooth[last] >= plateau[r] + high * rise:
            last += 1
        places[r, FIRST], places[r, LAST] = first, last
        heights[r, FIRST], heights[r, LAST] = smooth[first], smooth[last]


@compiled_part
def _average(row: Floats, level: float, half: int, scratch: Floats) -> None:
    """Write the centred moving average of a row to the last row of the scratch memory."""
    total, number, smooth = scratch[0], scratch[1], scratch[2]
    added, known, count = 0.0, 0.0, row.size
    for i in range(count):
        if np.isfinite(row[i]):
            added += row[i] - level
            known += 1.0
        total[i], number[i] = added, known
    # The window begins before the row, then lies within it, then ends beyond it.
    inner, outer = min(half + 1, count - half), max(half + 1, count - half)
    for i in range(inner):
        smooth[i] = total[i + half] / number[i + half] + level
    if inner == half + 1:
        _average_inside(total, number, half, level, smooth[half + 1 : count - half])
    for i in range(inner, half + 1):
        smooth[i] = total[count - 1] / number[count - 1] + level
    for i in range(outer, count):
        before = i - half - 1
        samples = number[count - 1] - number[before]
        smooth[i] = (total[count - 1] - total[before]) / samples + level


@compiled_loop
def _average_inside(total: Floats, number: Floats, half: int, level: float, to: Floats) -> None:
    """Write the averages of windows that lie within a row, NaN for windows without a sample."""
    for i in range(to.size):
        end = i + 2 * half + 1
        to[i] = (total[end] - total[i]) / (number[end] - number[i]) + level
