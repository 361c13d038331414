r"""Displacements of a few points that are written while a run goes on, as weighted sums.

A seen displacement is, with the displacements of rows g and the modes and static shapes of its own
(`turnout.throw.recovery`),

.. math:: s = A g + \Phi_s q + R_s \lambda + r_s

where the forces beyond the linear system are those of laws, less their stiffness in that system
times their displacement, and those of frictions, both with the other sign. Where a few rows give it
the rest is zero; what no seen displacement depends on has no weight.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import (
    LANES,
    broadcast,
    gather_neighbours,
    load,
    store,
    whole_lines,
    zeros_in_lines,
)
from turnout.kernels.vector import copy, gather_all
from turnout.law.table import LawTable
from turnout.solver.numbering import as_unsigned
from turnout.solver.system import Floats, Ints, System


@dataclass(frozen=True, slots=True, eq=False)
class SeenRows:
    """Weights of displacements that are to be seen.

    Attributes
    ----------
    stored : ndarray, shape (n_seen, n_rows)
        Of the displacements of the rows of the mechanism [-].
    modes : ndarray, shape (n_seen, n_modes)
        Of modal coordinates.
    shapes : ndarray, shape (n_seen, n_rows)
        Of forces along the rows beyond the linear system [m/N].
    load : ndarray, shape (n_seen,)
        Displacements under the constant load alone [m].
    """

    stored: Floats
    modes: Floats
    shapes: Floats
    load: Floats


class SeenWeights(NamedTuple):
    """Weights of seen displacements as the kernel takes them, see `StepRecord`."""

    seen_load: Floats
    stored_list: Ints
    stored_rows: Floats
    mode_list: Ints
    mode_rows: Floats
    law_list: Ints
    law_places: Ints
    law_rows: Floats
    friction_list: Ints
    friction_rows: Floats


# Unsigned as those of watched runs: other kinds of arrays are other kernels.
_NO_PLACES = as_unsigned(np.zeros(0, dtype=np.int64))


class StepRecord(NamedTuple):
    """Stored instants, one row each, and the largest equilibrium residual so far [m].

    `q` and `v` are modal coordinates and velocities, `g` the displacements of the rows [m],
    `friction` and `law` forces [N], `stored` and `ledger` energies and work [J]
    (`turnout.solver.energy`). Rows of `q`, `g`, `friction`, `law` and `v` fill whole cache
    lines; those of the first four begin at one.

    Of a watched run `places` are, of each stored instant, the row of `q`, `g`, `friction` and `law`
    in which it is stored whole, that of `seen`, and that of `stored` and `ledger`, -1 for none;
    without entries every instant has its own. So many rows of each are `given` (`give_place`).
    `effort` are the forces of the laws `watched` at all instants [N]; `seen` displacements [m] are
    `seen_load` under the constant load and the sum over the places, modes, laws and frictions of
    ``..._list`` with a row of weights in ``..._rows`` for each. The lists fill whole cache lines;
    `picked` is scratch for the longest.

    `cached` is 1 if the first four are stored through the processor's caches, 0 if past them.
    """

    q: Floats
    g: Floats
    friction: Floats
    law: Floats
    stored: Floats
    ledger: Floats
    residual: Floats
    v: Floats
    places: Ints = np.zeros((0, 3), dtype=np.int64)
    given: Ints = np.zeros(3, dtype=np.int64)
    watched: Ints = np.zeros(0, dtype=np.int64)
    effort: Floats = np.zeros((0, 0))
    seen: Floats = np.zeros((0, 0))
    seen_load: Floats = np.zeros(0)
    stored_list: Ints = _NO_PLACES
    stored_rows: Floats = np.zeros((0, 0))
    mode_list: Ints = _NO_PLACES
    mode_rows: Floats = np.zeros((0, 0))
    law_list: Ints = _NO_PLACES
    law_places: Ints = _NO_PLACES
    law_rows: Floats = np.zeros((0, 0))
    friction_list: Ints = _NO_PLACES
    friction_rows: Floats = np.zeros((0, 0))
    picked: Floats = np.zeros(0)
    cached: Ints = np.zeros(1, dtype=np.int64)


# Rails with their objects and rows of laws are shared by many throws.
_weights = LRUCache[tuple[SeenWeights, object]](128)  # some 10 kB each


def seen_weights(seen: SeenRows, laws: LawTable, row_place: Ints) -> SeenWeights:
    """Return the weights of what is seen; found once where what they are made of is the same.

    Parameters
    ----------
    seen : SeenRows
        What is wanted.
    laws : LawTable
        By rows of the mechanism.
    row_place : ndarray of int, shape (n_rows,)
        Place of each row in the vector of displacements.
    """
    parts, places = (seen.stored, seen.modes, seen.shapes, seen.load), row_place.tobytes()
    key = (*map(id, parts), laws.row.tobytes(), laws.friction_row.tobytes(), places)
    kept = _weights.get(key)
    if kept is not None:
        return kept[0]
    count = seen.load.size
    width = int(whole_lines(count))
    seen_load, forces = np.zeros(width), -seen.shapes
    seen_load[:count] = seen.load
    stored, mode = _listed(seen.stored, None, width), _listed(seen.modes, None, width)
    law, friction = _listed(forces, laws.row, width), _listed(forces, laws.friction_row, width)
    made = SeenWeights(
        seen_load,
        as_unsigned(row_place[stored[0]].astype(np.int64)),
        stored[1],
        *mode,
        law[0],
        as_unsigned(row_place[laws.row[law[0]]].astype(np.int64)),
        law[1],
        *friction,
    )
    if not any(part.flags.writeable for part in parts):
        _weights.put(key, (made, parts))
    return made


def _listed(weights: Floats, of: Ints | None, width: int) -> tuple[Ints, Floats]:
    """Return which columns have a weight, and these as padded rows; both fill whole cache lines.

    With `of` those of these columns in its order.
    """
    carries: NDArray[np.bool_] = np.asarray(weights.any(axis=0))
    used = np.flatnonzero(carries if of is None else carries[of])
    count = int(whole_lines(used.size))
    rows, listed = zeros_in_lines(count, width), np.zeros(count, dtype=np.int64)
    rows[: used.size, : weights.shape[0]] = weights.T[used if of is None else of[used]]
    listed[: used.size] = used
    return as_unsigned(listed), rows


@compiled
def give_place(record: StepRecord, at: int) -> None:
    """Let a stored instant that is still to come be stored whole, seen, and with its energies."""
    rooms = (record.q.shape[0], record.seen.shape[0], record.stored.shape[0])
    for column in range(3):
        if record.places[at, column] < 0 and record.given[column] < rooms[column]:
            record.places[at, column] = record.given[column]
            record.given[column] += 1


@compiled_loop
def _pick_deviations(
    g: Floats, slope: Floats, forces: Floats, laws: Ints, places: Ints, to: Floats
) -> None:
    """Write by how much the forces of some laws differ from those in the linear system [N]."""
    for i in range(0, to.size, LANES):
        held = gather_neighbours(slope, laws, i) * gather_neighbours(g, places, i)
        store(gather_neighbours(forces, laws, i) - held, to, i)


@compiled_loop
def _add_rows(weights: Floats, rows: Floats, to: Floats) -> None:
    """Add a weighted sum of rows that fill whole cache lines; four sums keep the processor busy."""
    n = weights.size
    for i in range(0, to.size, LANES):
        a, b, c, d = broadcast(0.0), broadcast(0.0), broadcast(0.0), broadcast(0.0)
        r = 0
        while r + 4 <= n:
            a = a + broadcast(weights[r]) * load(rows[r], i)
            b = b + broadcast(weights[r + 1]) * load(rows[r + 1], i)
            c = c + broadcast(weights[r + 2]) * load(rows[r + 2], i)
            d = d + broadcast(weights[r + 3]) * load(rows[r + 3], i)
            r += 4
        while r < n:
            a = a + broadcast(weights[r]) * load(rows[r], i)
            r += 1
        store(load(to, i) + ((a + b) + (c + d)), to, i)


@compiled_part
def store_seen(
    system: System,
    motion: tuple[Floats, Floats],
    forces: tuple[Floats, Floats],
    record: StepRecord,
    kept: int,
) -> None:
    """Write the seen displacements of the present instant.

    Parameters
    ----------
    motion, forces : tuple of ndarray
        Modal coordinates and displacements; forces of laws and of frictions.
    """
    q, g = motion
    to = record.seen[kept]
    copy(record.seen_load, to)
    picked = record.picked[: record.stored_list.size]
    gather_all(g, record.stored_list, picked)
    _add_rows(picked, record.stored_rows, to)
    picked = record.picked[: record.mode_list.size]
    gather_all(q, record.mode_list, picked)
    _add_rows(picked, record.mode_rows, to)
    picked = record.picked[: record.law_list.size]
    _pick_deviations(g, system.base_slope, forces[0], record.law_list, record.law_places, picked)
    _add_rows(picked, record.law_rows, to)
    picked = record.picked[: record.friction_list.size]
    gather_all(forces[1], record.friction_list, picked)
    _add_rows(picked, record.friction_rows, to)
