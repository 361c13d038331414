"""A compiled banded program for SB1: full finite elements, average acceleration, exact sets.

The laws are piecewise linear, so a step is solved by guessing the segment of every law, one banded
solution, and a check of the guess. A factor is kept for each of the last sets and used again where
the set returns. No pivots: the matrix is diagonally strong.
"""

import numpy as np
from numba import njit

from benchmarks.sb1 import (
    Answer,
    Floats,
    LinearSystem,
    at_rest,
    evaluate,
    full_system,
    lateral_system,
    markers_of,
)
from turnout.panel.load import load_panel

KEPT_FACTORS = 16
ITERATIONS = 60
FAST = {"reassoc", "contract"}


def banded(matrix: object, width: int) -> Floats:
    """Return a sparse matrix by rows of its band: entry (i, j) stands at [i, j - i + width]."""
    found = matrix.tocoo()  # type: ignore[attr-defined]
    band = np.zeros((found.shape[0], 2 * width + 1))
    band[found.row, found.col - found.row + width] = found.data
    return band


@njit(cache=True, fastmath=FAST)  # type: ignore[untyped-decorator]
def factorise(band, width):  # type: ignore[no-untyped-def]
    """Overwrite a band with its factors L (unit diagonal) and U; the diagonal holds 1 / U."""
    n = band.shape[0]
    for k in range(n):
        pivot = 1.0 / band[k, width]
        band[k, width] = pivot
        for i in range(k + 1, min(k + width + 1, n)):
            share = band[i, k - i + width] * pivot
            if share != 0.0:
                band[i, k - i + width] = share
                shift = k - i + width
                for j in range(1, width + 1):
                    band[i, shift + j] -= share * band[k, width + j]


@njit(cache=True, fastmath=FAST)  # type: ignore[untyped-decorator]
def solve(band, width, x):  # type: ignore[no-untyped-def]
    """Solve in place with the factors."""
    n = band.shape[0]
    for i in range(n):
        total = x[i]
        for j in range(max(0, width - i), width):
            total -= band[i, j] * x[i - width + j]
        x[i] = total
    for i in range(n - 1, -1, -1):
        total = x[i]
        for j in range(width + 1, min(2 * width + 1, n - i + width)):
            total -= band[i, j] * x[i - width + j]
        x[i] = total * band[i, width]


@njit(cache=True, fastmath=FAST)  # type: ignore[untyped-decorator]
def multiply(band, width, x, out):  # type: ignore[no-untyped-def]
    """Multiply a band with a vector."""
    n = band.shape[0]
    for i in range(n):
        total = 0.0
        for j in range(max(0, width - i), min(2 * width + 1, n - i + width)):
            total += band[i, j] * x[i - width + j]
        out[i] = total


@njit(cache=True)  # type: ignore[untyped-decorator]
def _factor_of(signs, sets, factors, used, linear, width, places, out, now):  # type: ignore[no-untyped-def]
    """Return the place of the factor of a set and True if it had to be made."""
    oldest = 0
    for at in range(sets.shape[0]):
        if used[at] >= 0:
            same = True
            for s in range(signs.size):
                if sets[at, s] != signs.flat[s]:
                    same = False
                    break
            if same:
                used[at] = now
                return at, 0
        if used[at] < used[oldest]:
            oldest = at
    sets[oldest] = signs.ravel()
    used[oldest] = now
    band = factors[oldest]
    band[:] = linear
    for s in range(places.shape[1]):
        y, z = places[0, s], places[1, s]
        band[y, width] += out[2, s]
        if z >= 0:
            band[z, width] += out[4, s]
            band[y, z - y + width] += out[3, s]
    factorise(band, width)
    return oldest, 1


@njit(cache=True)  # type: ignore[untyped-decorator]
def _load_of(damping, mass, load, width, u, v, a, step, work, out):  # type: ignore[no-untyped-def]
    """Form the right side of the linear part of a step, by average acceleration."""
    for i in range(u.size):
        work[i] = 2.0 / step * u[i] + v[i]
    multiply(damping, width, work, out)
    for i in range(u.size):
        out[i] += load[i] + mass[i] * (4.0 / step**2 * u[i] + 4.0 / step * v[i] + a[i])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _solve_set(factor, width, places, out, y, z, total, new):  # type: ignore[no-untyped-def]
    """Solve with all laws on their segments; put displacements into y and z."""
    new[:] = total
    for s in range(y.size):
        row, down = places[0, s], places[1, s]
        new[row] -= out[0, s] - out[2, s] * y[s]
        if down >= 0:
            new[row] += out[3, s] * z[s]
            new[down] -= out[1, s] - out[4, s] * z[s]
    solve(factor, width, new)
    for s in range(y.size):
        y[s] = new[places[0, s]]
        z[s] = new[max(places[1, s], 0)]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _store(places, out, record, t):  # type: ignore[no-untyped-def]
    """Keep the forces on the rail at an instant."""
    count = places.shape[1]
    for s in range(count):
        record[s, t] = -out[5, s]
        if places[2, s] >= 0:
            record[count + places[2, s], t] = out[6, s]
        record[count + 2, t] += out[7, s]


@njit(cache=True)  # type: ignore[untyped-decorator]
def march(linear, damping, mass, load, width, laws, u, markers, there, step, kept, record):  # type: ignore[no-untyped-def]
    """Step from rest; return counts of iterations, factorisations and steps that did not settle."""
    places, stands, drives, numbers = laws
    n, count = u.size, places.shape[1]
    v, a, total, work, new = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    y, z, anchor = np.zeros(count), np.zeros(count), np.zeros(count)
    out, signs = np.zeros((9, count)), np.zeros((5, count), dtype=np.int64)
    before = np.zeros((5, count), dtype=np.int64)
    sets = np.zeros((kept, 5 * count), dtype=np.int64)
    used, factors = np.full(kept, -1), np.zeros((kept, n, 2 * width + 1))
    counts = np.zeros(3, dtype=np.int64)
    for s in range(count):
        y[s], z[s] = u[places[0, s]], u[max(places[1, s], 0)]
        anchor[s] = y[s]
    now = markers[:, 0]
    evaluate(places, stands, drives, numbers, y, z, anchor, now, there[0], out, signs)
    _store(places, out, record, 0)
    for t in range(1, markers.shape[1]):
        now = markers[:, t]
        _load_of(damping, mass, load, width, u, v, a, step, work, total)
        for iteration in range(ITERATIONS + 1):
            evaluate(places, stands, drives, numbers, y, z, anchor, now, there[t], out, signs)
            if iteration > 0 and np.array_equal(signs, before):
                break
            if iteration == ITERATIONS:
                counts[2] += 1
                break
            counts[0] += 1
            before[:] = signs
            at, made = _factor_of(signs, sets, factors, used, linear, width, places, out, counts[0])
            counts[1] += made
            _solve_set(factors[at], width, places, out, y, z, total, new)
        for i in range(n):
            speed = 2.0 / step * (new[i] - u[i]) - v[i]
            a[i] = 2.0 / step * (speed - v[i]) - a[i]
            v[i], u[i] = speed, new[i]
        for s in range(count):
            anchor[s] = y[s] - out[5, s] / numbers[2]
        _store(places, out, record, t)
    return counts


def prepare(case: str, *, lateral_only: bool = False) -> tuple[LinearSystem, Floats]:
    """Return the full system of a case, or its lateral part, and its coordinates at rest."""
    system = full_system(case)
    rest = at_rest(system)
    if not lateral_only:
        return system, rest
    stations = system.stations
    system = lateral_system(system, -stations.normal_stiffness * rest[stations.vertical])
    return system, np.zeros(system.load.size)


def run(system: LinearSystem, rest: Floats, *, case: str, step: float) -> Answer:
    """Throw the rail of a case once."""
    end = load_panel("sb1").schedule.end
    times = step * np.arange(round(end / step) + 1)
    markers, there = markers_of(case, times)
    pattern = system.stiffness.tocoo()
    width = int(np.max(np.abs(pattern.row - pattern.col)))
    mass = system.mass.diagonal()
    damping = banded(system.damping, width)
    linear = banded(system.stiffness, width) + 2.0 / step * damping
    linear[:, width] += 4.0 / step**2 * mass
    count = system.stations.lateral.size
    record = np.zeros((count + 3, times.size))
    iterations, factors, unconverged = march(
        linear, damping, mass, system.load, width, system.stations.arrays(),
        rest.copy(), markers, there, step, KEPT_FACTORS, record,
    )  # fmt: skip
    work = {
        "steps": times.size - 1,
        "iterations": int(iterations),
        "factorisations": int(factors),
        "unconverged": int(unconverged),
    }
    return Answer(times, record[count : count + 2], record[count + 2], record[:count], work)
