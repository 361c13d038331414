"""Values taken of a run while it goes on, where its whole instants would be more than is wanted.

Labels and features need the forces of a few laws at every instant and the displacements of a few
points at some; a whole instant is fifty times as much, and most of it would go to memory and back
for nothing. A record may therefore hold whole instants at some times alone, and beside them forces
of *watched* laws at all stored instants and *seen* displacements at those that are *kept*.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.kernels.lanes import empty_in_lines
from turnout.kernels.shared_record import clone_record, shared_record
from turnout.solver.condense import CondensedRails
from turnout.solver.seen import SeenRows, SeenWeights, StepRecord
from turnout.solver.system import Floats, Ints

TIME_TOLERANCE = 1e-9
BALANCE_EVERY = 8
"""Kept instants of a watched run from one check of its energy balance to the next."""


@dataclass(frozen=True, slots=True, eq=False)
class Watch:
    """Wanted values of a run.

    Attributes
    ----------
    laws : sequence of int
        Whose forces are wanted at every stored instant.
    stride : int
        Every so many stored instants one is kept, with displacements; every `BALANCE_EVERY` of
        these with energies.
    whole : sequence of float
        The first stored instants from these times on are stored whole, and the last one [s].
    rests : sequence of float
        The last stored instants before these times are seen too, as the last one of all is [s].
    taken : sequence of float
        Those of `rests` that no wait for machines postpones; the others are onsets of movements.
    count : int
        Number of rows that are to be seen.
    seen : callable
        Takes the condensed rails and returns the weights of these rows.
    """

    laws: Sequence[int]
    stride: int
    whole: Sequence[float]
    rests: Sequence[float]
    count: int
    seen: Callable[[CondensedRails], SeenRows]
    taken: Sequence[float] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """Values of instants that a watched run does not store whole; n is the number of them all.

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
    rests : ndarray of int, shape (n_rests,)
        Numbers of the last instants before given times, and of the last one.
    seen_rests : ndarray, shape (n_rests, n_seen)
        Displacements at these [m].
    laws : sequence of int
        The watched laws.
    effort : ndarray, shape (n_watched, n)
        Their forces [N].
    """

    time: Floats
    inputs: Floats
    law_first: Floats
    law_placed: Floats
    stride: int
    seen: Floats
    rests: Ints
    seen_rests: Floats
    laws: Sequence[int]
    effort: Floats


@dataclass(frozen=True, slots=True, eq=False)
class WatchPlan:
    """Which stored instants have which place in a record.

    `places` are those of `StepRecord`; of what is seen the instants that are wanted regularly come
    first. `counts` of instants are stored whole, seen, and stored with
    energies, as the last one is; a run with machines has places for `further` ones, which it gives
    as it goes on. `rests` are the numbers of the instants of `Watched.rests`, by the schedule.
    """

    watch: Watch
    places: Ints
    counts: tuple[int, int, int]
    rests: Ints
    further: int = 0

    def whole(self, count: int) -> Ints:
        """Return which of the first `count` instants are stored whole."""
        return np.flatnonzero(self.places[:count, 0] >= 0)

    def places_of(self, column: int, count: int) -> Ints:
        """Return the places in a column of those of the first `count` instants that have one."""
        rows = self.places[:count, column]
        return rows[rows >= 0]


def plan_watch(watch: Watch, interval: float, count: int, *, further: int = 0) -> WatchPlan:
    """Choose the places of stored instants in the record of a watched run.

    Parameters
    ----------
    watch : Watch
        What is wanted.
    interval : float
        Time between stored instants [s].
    count : int
        Of stored instants.
    further : int
        Instants that may be given places during the run, with `give_place`.

    Examples
    --------
    >>> watch = Watch([0], 2, [0.3], [], 0, lambda rails: SeenRows(*[np.zeros((0, 0))] * 4))
    >>> plan = plan_watch(watch, 0.1, 7)
    >>> whole, seen, balanced = plan.places.T.tolist()
    >>> whole, seen
    ([-1, -1, -1, 0, -1, -1, 1], [0, -1, 1, 4, 2, -1, 3])
    >>> balanced
    [0, -1, -1, 1, -1, -1, 2]
    """
    times = tuple(watch.whole), tuple(watch.rests)
    places, counts, rests = _places(*times, watch.stride, interval, count)
    return WatchPlan(watch, places.copy() if further else places, counts, rests, further)


@lru_cache(maxsize=16)
def _places(
    wanted: tuple[float, ...], rests: tuple[float, ...], stride: int, interval: float, count: int
) -> tuple[Ints, tuple[int, int, int], Ints]:
    """Return all of a `WatchPlan` but what is wanted."""
    times = interval * np.arange(count, dtype=np.float64)
    first = np.searchsorted(times, np.array(wanted, dtype=np.float64) - TIME_TOLERANCE)
    whole = np.array(sorted({*first[first < count].tolist(), count - 1}))
    regular, rest = np.arange(0, count, stride), rest_instants(times, rests)
    further = sorted({*whole.tolist(), *rest.tolist()})
    seen = np.append(regular, np.array([at for at in further if at % stride], dtype=np.int64))
    is_balanced = np.zeros(count, dtype=bool)
    is_balanced[:: stride * BALANCE_EVERY] = is_balanced[whole] = True
    balanced = np.flatnonzero(is_balanced)
    places = np.full((count, 3), -1, dtype=np.int64)
    for column, chosen in enumerate((whole, seen, balanced)):
        places[chosen, column] = np.arange(chosen.size)
    for part in (places, rest):
        part.flags.writeable = False
    return places, (whole.size, seen.size, balanced.size), rest


def rest_instants(time: Floats, rests: Sequence[float]) -> Ints:
    """Return the numbers of the last instants before some times, and of the last one.

    Examples
    --------
    >>> rest_instants(np.array([0.0, 0.1, 0.2, 0.3]), [0.2]).tolist()
    [1, 3]
    """
    before = np.searchsorted(time, np.array(rests, dtype=np.float64) - TIME_TOLERANCE) - 1
    return np.append(np.maximum(before, 0), time.size - 1)


# Throws that share rails share what their records hold before they begin. It is named by identity,
# and kept beside so that nothing else takes its place.
_templates = LRUCache[tuple[StepRecord | None, object]](128)  # some 2 kB each


def watched_record(
    arrays: dict[str, NDArray[Any]], plan: WatchPlan, weights: SeenWeights
) -> StepRecord:
    """Return the record of a watched run, copied from one of the same plan if there are more.

    Parameters
    ----------
    arrays : dict of str to ndarray
        Those of a record that have a row for each instant that is stored whole, or balanced; the
        others are added.
    plan : WatchPlan
        Which instants these are.
    weights : SeenWeights
        Of what is seen.
    """
    arrays["effort"] = np.empty((len(plan.watch.laws), plan.places.shape[0]))
    arrays["seen"] = empty_in_lines(plan.counts[1] + plan.further, weights.seen_load.size)
    shared = {name: part for name, part in weights._asdict().items() if part.ndim > 1}
    shared["places"] = plan.places
    key = (id(weights), plan.counts, tuple(plan.watch.laws))
    kept = _templates.get(key)
    if kept is not None and kept[0] is not None:
        return clone_record(kept[0], **arrays, **shared)
    nothing: dict[str, NDArray[Any]] = dict.fromkeys(arrays, np.zeros((0, 0)))
    template = StepRecord(
        **(arrays if kept is None else nothing),
        **weights._asdict(),
        residual=np.zeros(1),
        places=plan.places,
        given=np.array(plan.counts),
        watched=np.asarray(plan.watch.laws, dtype=np.int64),
        picked=np.zeros(max(part.size for part in weights if part.ndim == 1)),
    )
    made = shared_record(template)
    _templates.put(key, (None if kept is None else made, weights))
    return made if kept is None else clone_record(made, **arrays, **shared)


def trim_watched(
    record: StepRecord,
    plan: WatchPlan,
    *,
    time: Floats,
    inputs: Floats,
    rests: Ints,
    law_first: Floats,
    law_placed: Floats,
) -> Watched:
    """Return what a run to its last instant left; of all its instants, as of `Watched`."""
    count, regular = plan.watch.count, -(-time.size // plan.watch.stride)
    return Watched(
        time=time,
        inputs=inputs,
        law_first=law_first,
        law_placed=law_placed,
        stride=plan.watch.stride,
        seen=record.seen[:regular, :count],
        rests=rests,
        seen_rests=record.seen[plan.places[rests, 1], :count],
        laws=tuple(plan.watch.laws),
        effort=record.effort[:, : time.size],
    )
