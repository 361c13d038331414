r"""What is taken of a run while it goes on, where its whole instants would be more than is wanted.

Labels and features need the forces of a few laws at every instant and the displacements of a few
points at some; a whole instant is fifty times as much, and most of it would go to memory and back
for nothing. A record may therefore hold whole instants at some times alone, and beside them forces
of *watched* laws at all stored instants and *seen* displacements at those that are *kept*.

A seen displacement is, with the displacements of rows g and the modes and static shapes of its own
(`turnout.response.recovery`),

.. math:: s = A g + \Phi_s q + R_s \lambda + r_s

where the forces beyond the linear system are those of laws, less their stiffness in that system
times their displacement, and those of frictions, both with the other sign. Where a few rows give it
the rest is zero; what no seen displacement depends on has no weight.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np

from turnout.condense.condense import CondensedRails
from turnout.core.lru_cache import LRUCache
from turnout.integrate.numbering import as_unsigned
from turnout.integrate.system import Floats, Ints, System
from turnout.kernels.compiled import compiled_loop, compiled_part
from turnout.kernels.lanes import (
    LANES,
    broadcast,
    empty_in_lines,
    gather_neighbours,
    load,
    store,
    whole_lines,
    zeros_in_lines,
)
from turnout.kernels.vector import copy, gather_all
from turnout.law.table import LawTable

TIME_TOLERANCE = 1e-9
BALANCE_EVERY = 8
"""Kept instants of a watched run from one check of its energy balance to the next."""
MOST_WEIGHTS = 128
"""Weights of seen displacements in memory, the latest used; some 20 kB each."""


class StepRecord(NamedTuple):
    """Stored instants, one row each, and the largest equilibrium residual so far [m].

    `q` and `v` are modal coordinates and velocities, `g` the displacements of the rows [m],
    `friction` and `law` forces [N], `stored` and `ledger` energies and work [J]
    (`turnout.integrate.energy`). Rows of `q`, `g`, `friction`, `law` and `v` fill whole cache
    lines; those of the first four begin at one.

    Of a watched run `whole` is the row of `q`, `g`, `friction` and `law` in which a stored instant
    has its place, `kept` that of `seen` and `balanced` that of `stored` and `ledger`, -1 for none;
    without entries every instant has its own. `effort` are the forces of the laws `watched` at all
    instants [N]; `seen` displacements [m] are `seen_load` under the constant load and the sum over
    the places, modes, laws and frictions of ``..._list`` with a row of weights in ``..._rows`` for
    each. The lists fill whole cache lines; `picked` is scratch for the longest.
    """

    q: Floats
    g: Floats
    friction: Floats
    law: Floats
    stored: Floats
    ledger: Floats
    residual: Floats
    v: Floats
    whole: Ints = np.zeros(0, dtype=np.int64)
    kept: Ints = np.zeros(0, dtype=np.int64)
    watched: Ints = np.zeros(0, dtype=np.int64)
    effort: Floats = np.zeros((0, 0))
    seen: Floats = np.zeros((0, 0))
    seen_load: Floats = np.zeros(0)
    stored_list: Ints = np.zeros(0, dtype=np.int64)
    stored_rows: Floats = np.zeros((0, 0))
    mode_list: Ints = np.zeros(0, dtype=np.int64)
    mode_rows: Floats = np.zeros((0, 0))
    law_list: Ints = np.zeros(0, dtype=np.int64)
    law_places: Ints = np.zeros(0, dtype=np.int64)
    law_rows: Floats = np.zeros((0, 0))
    friction_list: Ints = np.zeros(0, dtype=np.int64)
    friction_rows: Floats = np.zeros((0, 0))
    picked: Floats = np.zeros(0)
    balanced: Ints = np.zeros(0, dtype=np.int64)


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


@dataclass(frozen=True, slots=True, eq=False)
class Watch:
    """What is wanted of a run.

    Attributes
    ----------
    laws : sequence of int
        Whose forces are wanted at every stored instant.
    stride : int
        Every so many stored instants one is kept, with displacements; every `BALANCE_EVERY` of
        these with energies.
    whole : sequence of float
        The first stored instants from these times on are stored whole, and the last one [s].
    count : int
        Number of rows that are to be seen.
    seen : callable
        Takes the condensed rails and returns the weights of these rows.
    """

    laws: Sequence[int]
    stride: int
    whole: Sequence[float]
    count: int
    seen: Callable[[CondensedRails], "SeenRows"]


class Instants(Protocol):
    """What a history and what was watched of one have in common."""

    @property
    def time(self) -> Floats:
        """Stored instants, shape (n,) [s]."""

    @property
    def inputs(self) -> Floats:
        """Marker positions, shape (n, n_inputs) [m]."""

    @property
    def law_first(self) -> Floats:
        """When each law that does not always act first had a force [s]."""

    @property
    def law_placed(self) -> Floats:
        """When each of them appeared [s]."""

    def forces(self, laws: Sequence[int]) -> Floats:
        """Return the forces of some laws, shape (n, n_laws) [N]."""


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """What a watched run leaves of instants that are not stored whole; n is the number of them all.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Stored instants [s].
    inputs : ndarray, shape (n, n_inputs)
        Marker positions [m].
    law_first, law_placed : ndarray, shape (n_laws,)
        As of `History`.
    stride : int
        Of the instants that are kept.
    seen : ndarray, shape (n_kept, n_seen)
        Displacements every `stride` instants [m].
    seen_last : ndarray, shape (1, n_seen)
        At the last instant [m].
    laws : sequence of int
        The watched laws.
    effort : ndarray, shape (n, n_watched)
        Their forces [N].
    """

    time: Floats
    inputs: Floats
    law_first: Floats
    law_placed: Floats
    stride: int
    seen: Floats
    seen_last: Floats
    laws: Sequence[int]
    effort: Floats

    def forces(self, laws: Sequence[int]) -> Floats:
        """Return the forces of some of the watched laws, shape (n, n_laws) [N].

        Neighbours in their order are not copied.
        """
        columns = [self.laws.index(law) for law in laws]
        first = columns[0] if columns else 0
        if columns == [*range(first, first + len(columns))]:
            return self.effort[:, first : first + len(columns)]
        return self.effort[:, columns]


@dataclass(frozen=True, slots=True, eq=False)
class WatchPlan:
    """Which stored instants have which place in a record.

    `whole`, `kept` and `balanced` have the place of each instant, -1 for none; `whole_instants` and
    `balanced_instants` are the numbers of the instants that have one. The last one has all.
    `regular` are the places in `kept` of every so many instants as are wanted, `whole_balanced` the
    places of energies of whole instants.
    """

    watch: Watch
    whole: Ints
    kept: Ints
    balanced: Ints
    whole_instants: Ints
    balanced_instants: Ints
    regular: Ints
    whole_balanced: Ints

    def whole_before(self, count: int) -> int:
        """Return how many of the first `count` stored instants are stored whole."""
        return int(self.whole_instants.searchsorted(count))

    def balanced_before(self, count: int) -> int:
        """Return of how many of the first `count` stored instants the energies are stored."""
        return int(self.balanced_instants.searchsorted(count))


def plan_watch(watch: Watch, interval: float, count: int) -> WatchPlan:
    """Choose the places of stored instants in the record of a watched run.

    Parameters
    ----------
    watch : Watch
        What is wanted.
    interval : float
        Time between stored instants [s].
    count : int
        Of stored instants.

    Examples
    --------
    >>> watch = Watch([0], 2, [0.3], 0, lambda rails: SeenRows(*[np.zeros((0, 0))] * 4))
    >>> plan = plan_watch(watch, 0.1, 7)
    >>> plan.whole.tolist(), plan.kept.tolist()
    ([-1, -1, -1, 0, -1, -1, 1], [0, -1, 1, 2, 3, -1, 4])
    >>> plan.balanced.tolist()
    [0, -1, -1, 1, -1, -1, 2]
    """
    return WatchPlan(watch, *_places(tuple(watch.whole), watch.stride, interval, count))


@lru_cache(maxsize=16)
def _places(
    wanted: tuple[float, ...], stride: int, interval: float, count: int
) -> tuple[Ints, ...]:
    """Return all of a `WatchPlan` but what is wanted."""
    times = interval * np.arange(count, dtype=np.float64)
    first = np.searchsorted(times, np.array(wanted, dtype=np.float64) - TIME_TOLERANCE)
    whole = np.unique(np.append(first[first < count], count - 1))
    kept = np.union1d(np.arange(0, count, stride), whole)
    balanced = np.union1d(np.arange(0, count, stride * BALANCE_EVERY), whole)
    of_instant = _numbered(whole, count), _numbered(kept, count), _numbered(balanced, count)
    places = (*of_instant, whole, balanced, of_instant[1][::stride].copy(), of_instant[2][whole])
    for found in places:
        found.flags.writeable = False
    return places


def _numbered(chosen: Ints, count: int) -> Ints:
    found = np.full(count, -1, dtype=np.int64)
    found[chosen] = np.arange(chosen.size)
    return found


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


# Rails with their objects and rows of laws are shared by many throws.
_weights = LRUCache[tuple[SeenWeights, object]](MOST_WEIGHTS)


def seen_weights(
    watch: Watch, rails: CondensedRails, laws: LawTable, row_place: Ints
) -> SeenWeights:
    """Return the weights of what is seen; found once where what they are made of is the same.

    Parameters
    ----------
    watch : Watch
        What is wanted.
    rails : CondensedRails
        Of the run.
    laws : LawTable
        By rows of the mechanism.
    row_place : ndarray of int, shape (n_rows,)
        Place of each row in the vector of displacements.
    """
    seen = watch.seen(rails)
    parts, places = (seen.stored, seen.modes, seen.shapes, seen.load), row_place.tobytes()
    key = (*map(id, parts), laws.row.tobytes(), laws.friction_row.tobytes(), places)
    kept = _weights.get(key)
    if kept is not None:
        return kept[0]
    width = int(whole_lines(watch.count))
    stored, mode, law, friction = (
        _listed(weights, width)
        for weights in (
            seen.stored,
            seen.modes,
            -seen.shapes[:, laws.row],
            -seen.shapes[:, laws.friction_row],
        )
    )
    made = SeenWeights(
        np.pad(seen.load, (0, width - watch.count)),
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


def _listed(weights: Floats, width: int) -> tuple[Ints, Floats]:
    """Return which columns have a weight, and these as padded rows; both fill whole cache lines."""
    used = np.flatnonzero(weights.any(axis=0))
    count = int(whole_lines(used.size))
    rows = zeros_in_lines(count, width)
    rows[: used.size, : weights.shape[0]] = weights[:, used].T
    return as_unsigned(np.pad(used, (0, count - used.size))), rows


def watch_record(record: StepRecord, plan: WatchPlan, weights: SeenWeights) -> StepRecord:
    """Return a record of plain arrays with those of a watched run."""
    return record._replace(
        whole=plan.whole,
        kept=plan.kept,
        balanced=plan.balanced,
        watched=np.asarray(plan.watch.laws, dtype=np.int64),
        effort=np.empty((plan.whole.size, len(plan.watch.laws))),
        seen=empty_in_lines(int(plan.kept[-1]) + 1, weights.seen_load.size),
        picked=np.zeros(max(part.size for part in weights if part.ndim == 1)),
        **weights._asdict(),
    )


def trim_watched(
    record: StepRecord,
    plan: WatchPlan,
    *,
    time: Floats,
    inputs: Floats,
    law_first: Floats,
    law_placed: Floats,
) -> Watched:
    """Return what a run to its last instant left; of all its instants, as of `Watched`."""
    count = plan.watch.count
    return Watched(
        time=time,
        inputs=inputs,
        law_first=law_first,
        law_placed=law_placed,
        stride=plan.watch.stride,
        seen=record.seen.take(plan.regular, axis=0)[:, :count],
        seen_last=record.seen[plan.kept[-1] :][:1, :count],
        laws=tuple(plan.watch.laws),
        effort=record.effort,
    )


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
    slope, laws = system.base_slope, (record.law_list, record.law_places)
    _pick_deviations(g, slope, forces[0], laws[0], laws[1], picked)
    _add_rows(picked, record.law_rows, to)
    picked = record.picked[: record.friction_list.size]
    gather_all(forces[1], record.friction_list, picked)
    _add_rows(picked, record.friction_rows, to)
