"""Features of the effort of drives over movements, each row of a length of its own.

Each row is walked through a few times while it lies in the processor's nearest cache, where NumPy
would write a dozen arrays of all rows.
"""

import math

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import LANES, any_true, broadcast, greater, horizontal_sum, load

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

(ONSET, SLOPE, PEAK, PEAK_TIME, PLATEAU, END, WORK, DURATION, SLIP_TIME, VIBRATION, COUNT) = range(
    11
)
"""Columns of features, and how many there are."""
FEWEST = 3
"""Instants in a movement that has features."""
(SIGN, ARRIVED, LEAST_RISE, LOW, HIGH, MIDDLE_FROM, MIDDLE_TO) = range(7)
"""Places in the `choices` of `measure_movements`: 1 or -1, by which force becomes effort; how near
a marker is to its last place once it has arrived [m]; the smallest rise [N]; shares of a rise from
and up to which its slope is taken; shares of a movement between which the plateau is."""
(AVERAGED, VIBRATING, HELD) = range(3)
"""Places in its `samples`: half a window of the filter of rises, half a window of the means that
vibration is about, and of the window at the end."""
SCRATCH_ROWS = 5
"""Rows of its memory, which are one longer than those of the forces."""


@compiled
def measure_movements(
    time: Floats,
    force: Floats,
    travel: Floats | None,
    windows: Ints,
    limits: Floats,
    onsets: Floats,
    lengths: Floats,
    choices: Floats,
    samples: Ints,
    scratch: Floats,
    found: Floats,
) -> None:
    """Write the features of one movement of each row.

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        Evenly sampled [s].
    force : ndarray, shape (n_rows, n_times)
        NaN is a missing sample [N].
    travel : ndarray, shape (n, n_times), optional
        Of the marker; the n rows repeat until there is one for each row of forces [m].
    windows : ndarray of int, shape (n_rows, 2)
        First instant of the movement of each row, and that after its last one.
    limits : ndarray, shape (n_rows,)
        Effort above which a row slips: the number below that at which it does [N].
    onsets, lengths : ndarray, shape (n_rows,)
        Onset of each movement, and its time where there is no travel [s].
    choices, samples : ndarray
        By the places above.
    scratch : ndarray, shape (SCRATCH_ROWS, n_times + 1)
        Memory.
    found : ndarray, shape (n_rows, COUNT)
        Written, by the columns above; NaN for what there is not.
    """
    for r in range(force.shape[0]):
        for i in range(COUNT):
            found[r, i] = np.nan
        first, last = windows[r, 0], windows[r, 1]
        count = last - first
        if count < FEWEST:
            continue
        t, effort = time[first:last], scratch[0, :count]
        for i in range(count):
            effort[i] = choices[SIGN] * force[r, first + i]
        top, slip = _largest(effort), _first_above(effort, limits[r])
        if not math.isfinite(effort[top]):
            continue
        duration, onset, row = lengths[r], onsets[r], found[r]
        if travel is not None:
            path = travel[r % travel.shape[0], first:last]
            row[WORK] = _work(force[r, first:last], path)
            i = count - 1
            while i >= 0 and not abs(path[i] - path[count - 1]) > choices[ARRIVED]:
                i -= 1
            duration = t[min(i + 1, count - 1)] - onset if i >= 0 else 0.0
        row[PEAK], row[PEAK_TIME], row[DURATION] = effort[top], t[top] - onset, duration
        held = min(samples[HELD], count)
        row[END] = _sum(effort[count - held :], scratch[4]) / held
        if slip >= 0:
            row[SLIP_TIME] = t[slip] - onset
        low = _first_from(t, onset, duration * choices[MIDDLE_FROM])
        high = _first_from(t, onset, duration * choices[MIDDLE_TO])
        half = samples[VIBRATING]
        if high > low:
            row[PLATEAU] = _median(effort[low:high], scratch[1, : high - low])
            if half > 0 and low >= half and high + half <= count:
                row[VIBRATION] = _swing(effort[low - half : high + half], half, scratch)
        _measure_rise(t, effort, onset, (choices, samples), scratch, row)


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


@compiled_part
def _first_from(time: Floats, onset: float, elapsed: float) -> int:
    """Return the first place at which so much time has elapsed since an onset."""
    low, high = 0, time.size
    while low < high:
        middle = (low + high) // 2
        if time[middle] - onset < elapsed:
            low = middle + 1
        else:
            high = middle
    return low


@compiled_part
def _work(force: Floats, path: Floats) -> float:
    """Return the work of a force along a path by the trapezoidal rule."""
    count = force.size - 1
    whole = count - count % LANES
    parts, rest = broadcast(0.0), 0.0
    for i in range(0, whole, LANES):
        moved = load(path, i + 1) - load(path, i)
        parts = parts + moved * (load(force, i + 1) + load(force, i))
    for i in range(whole, count):
        rest += (path[i + 1] - path[i]) * (force[i + 1] + force[i])
    return 0.5 * (horizontal_sum(parts) + rest)


SUMMED_AT_ONCE = 128
"""Numbers of which sums are added in pairs, as `numpy.sum` does."""


@compiled
def _sum(values: Floats, stack: Floats) -> float:
    """Return the sum of some numbers, added in the order of `numpy.sum`.

    Numbers are halved until `SUMMED_AT_ONCE` are left; `stack` holds of each half that waits its
    size, the sum of the one before it, and whether that is known.
    """
    begin, size, depth, total = 0, values.size, 0, 0.0
    while True:
        while size > SUMMED_AT_ONCE:
            half = size // 2
            half -= half % 8
            stack[3 * depth], stack[3 * depth + 2] = size - half, 0.0
            depth, size = depth + 1, half
        total = _sum_few(values[begin : begin + size])
        begin += size
        while depth > 0 and stack[3 * depth - 1] > 0.0:
            total = stack[3 * depth - 2] + total
            depth -= 1
        if depth == 0:
            return total
        size = int(stack[3 * depth - 3])
        stack[3 * depth - 2], stack[3 * depth - 1] = total, 1.0


@compiled_part
def _sum_few(values: Floats) -> float:
    """Return the sum of a few numbers, added in eight partial sums from eight numbers on."""
    whole, total = values.size - values.size % 8, 0.0
    if whole > 0:
        a, b, c, d = values[0], values[1], values[2], values[3]
        e, f, g, h = values[4], values[5], values[6], values[7]
        for i in range(8, whole, 8):
            a, b, c, d = (
                a + values[i],
                b + values[i + 1],
                c + values[i + 2],
                d + values[i + 3],
            )
            e, f, g, h = (
                e + values[i + 4],
                f + values[i + 5],
                g + values[i + 6],
                h + values[i + 7],
            )
        total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(whole, values.size):
        total += values[i]
    return total


@compiled_part
def _median(values: Floats, sorted_part: Floats) -> float:
    """Return the median of some numbers, NaN if one of them is; `sorted_part` is memory."""
    for i in range(values.size):
        if math.isnan(values[i]):
            return math.nan
        sorted_part[i] = values[i]
    half = values.size // 2
    _select(sorted_part, half)
    if values.size % 2 == 1:
        return float(sorted_part[half])
    below = sorted_part[0]
    for i in range(1, half):
        below = max(below, sorted_part[i])
    return float(0.5 * (below + sorted_part[half]))


@compiled_part
def _select(values: Floats, place: int) -> None:
    """Reorder numbers so that the one at a place is as if sorted, none before it larger."""
    low, high = 0, values.size - 1
    while low < high:
        middle, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < middle:
                i += 1
            while values[j] > middle:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if place <= j:
            high = j
        elif place >= i:
            low = i
        else:
            return


@compiled_part
def _swing(values: Floats, half: int, scratch: Floats) -> float:
    """Return the root mean square of numbers about their means over ``2 half + 1`` of them.

    Half a window at either end serves the means alone.
    """
    sums, squares, width = scratch[1], scratch[2], 2 * half + 1
    level, added, count = values[half], 0.0, values.size - 2 * half
    sums[0] = 0.0
    for i in range(values.size):
        added += values[i] - level
        sums[i + 1] = added
    for i in range(count):
        away = values[half + i] - ((sums[i + width] - sums[i]) / width + level)
        squares[i] = away * away
    return math.sqrt(_sum(squares[:count], scratch[4]) / count)


@compiled_part
def _level(effort: Floats, scratch: Floats) -> float:
    """Return the mean of the finite samples of a row."""
    mean = _sum(effort, scratch[4]) / effort.size
    if math.isfinite(mean):
        return mean
    known, count = scratch[1, : effort.size], 0
    for i in range(effort.size):
        known[i] = effort[i] if math.isfinite(effort[i]) else 0.0
        count += 1 if math.isfinite(effort[i]) else 0
    return _sum(known, scratch[4]) / max(count, 1)


@compiled_part
def _measure_rise(
    time: Floats,
    effort: Floats,
    onset: float,
    given: tuple[Floats, Ints],
    scratch: Floats,
    row: Floats,
) -> None:
    """Write when the last rise of a row, filtered, to its largest value begins, and its slope.

    It begins where the row is last below the first bound, and ends where it is first above the
    other one.
    """
    choices, samples = given
    count, plateau = effort.size, row[PLATEAU]
    half = min(samples[AVERAGED], count - 1)
    smooth = scratch[3, :count]
    _average(effort, _level(effort, scratch), half, scratch[1], scratch[2], smooth)
    top, largest = 0, smooth[0]
    for i in range(count):
        if not smooth[i] <= largest:
            top, largest = i, smooth[i]
            if math.isnan(largest):
                break
    rise, first = largest - plateau, top
    while first >= 0 and not smooth[first] <= plateau + choices[LOW] * rise:
        first -= 1
    if first < 0 or not rise >= choices[LEAST_RISE]:
        return
    last = first
    while not smooth[last] >= plateau + choices[HIGH] * rise:
        last += 1
    row[ONSET] = time[first] - onset
    row[SLOPE] = (smooth[last] - smooth[first]) / (time[last] - time[first])


@compiled_part
def _average(
    row: Floats, level: float, half: int, total: Floats, number: Floats, smooth: Floats
) -> None:
    """Write the centred moving average of a row; `total` and `number` are memory."""
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
