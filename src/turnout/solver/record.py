r"""The record of a run: which of its instants are kept, and what of these.

Labels and features need the forces of a few laws at every instant and the displacements of a few
points at some; a whole instant is fifty times as much, and most of it would go to memory and back
for nothing. A record may therefore hold whole instants at some times alone, and beside them forces
of *watched* laws at all stored instants and *seen* displacements at those that are *kept*.

A seen displacement is, with the displacements of rows g and the modes and static shapes of its own
(`turnout.throw.recovery`),

.. math:: s = A g + \Phi_s q + R_s \lambda + r_s

where the forces beyond the linear system are those of laws, less their stiffness in that system
times their displacement, and those of frictions, both with the other sign. Where a few rows give it
the rest is zero; what no seen displacement depends on has no weight.

Between the steps modal coordinates follow the cubic through coordinates and velocities at both
ends of their step,

.. math:: q = (1-\theta)\,q_0 + \theta\,q_1 + \theta(1-\theta)
          \bigl[(1-\theta)(h v_0 - \Delta) - \theta\,(h v_1 - \Delta)\bigr],
          \qquad \Delta = q_1 - q_0,

which is of fourth order. The static share above the cut-off is interpolated linearly, as are
friction and energies. The laws that act all the time are evaluated at the new displacements, so
that they hold between the steps too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import (
    LANES,
    broadcast,
    copy_in_lines,
    empty_in_lines,
    gather,
    load,
    store,
    whole_lines,
    zeros_in_lines,
)
from turnout.kernels.shared_record import clone_record, shared_record
from turnout.kernels.vector import copy, gather_all
from turnout.law.obstruction import Obstructions
from turnout.law.table import LawTable, segments_at
from turnout.solver.condense import CondensedRails
from turnout.solver.energy import LEDGER, STORED
from turnout.solver.state import Run, State, StepRecord, lines_from_buffer
from turnout.solver.system import Floats, Ints, System, as_unsigned


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
    of_objects : ndarray, shape (n_seen, n_objects)
        As `shapes`, of the last rows, which stand in another place with each throw; there `shapes`
        are zero.
    """

    stored: Floats
    modes: Floats
    shapes: Floats
    load: Floats
    of_objects: Floats = field(default_factory=lambda: np.zeros((0, 0)))


@cache
def _unweighted() -> "SeenWeights":
    """Return a record of no instant, of which those of all instants are clones."""
    record = shared_record(StepRecord(**_no_instants(), residual=np.zeros(1)))
    return SeenWeights(record, record.law_rows)


def _no_instants() -> dict[str, NDArray[Any]]:
    names = ("q", "g", "friction", "law", "stored", "ledger", "v")
    return dict.fromkeys(names, np.zeros((0, 0)))


class SeenWeights(NamedTuple):
    """A record of no instant with the weights of what is seen, and those of forces of laws."""

    record: StepRecord
    law_rows: Floats


# Rails and rows of laws are shared by many throws.
_weights = LRUCache[tuple[StepRecord, Ints, object]](64)  # some 10 kB each


def seen_weights(
    seen: SeenRows, laws: LawTable, row_place: Ints, watched: Sequence[int]
) -> SeenWeights:
    """Return the weights of what is seen; but for those of objects found once for the same.

    Parameters
    ----------
    seen : SeenRows
        What is wanted.
    laws : LawTable
        By rows of the mechanism.
    row_place : ndarray of int, shape (n_rows,)
        Place of each row in the vector of displacements.
    watched : sequence of int
        Laws whose forces are wanted at every stored instant.
    """
    parts, places = (seen.stored, seen.modes, seen.shapes, seen.load), row_place.tobytes()
    key = (*map(id, parts), laws.row.tobytes(), laws.friction_row.tobytes(), places, *watched)
    kept = _weights.get(key)
    if kept is None:
        kept = (*_weights_without_objects(seen, laws, row_place, watched), parts)
        if not any(part.flags.writeable for part in parts):
            _weights.put(key, kept)
    record, of_object, _ = kept
    law_rows = record.law_rows
    if of_object.size:
        law_rows = copy_in_lines(law_rows)
        rows = laws.row[record.law_list[of_object]] - seen.shapes.shape[1]
        law_rows[of_object, : seen.load.size] = -seen.of_objects.T[rows]
    return SeenWeights(record, law_rows)


def _weights_without_objects(
    seen: SeenRows, laws: LawTable, row_place: Ints, watched: Sequence[int]
) -> tuple[StepRecord, Ints]:
    """Return weights without those of the laws of objects, and where these are in their list."""
    count, n_objects = seen.load.size, seen.of_objects.shape[1]
    width = int(whole_lines(count))
    seen_load, forces = np.zeros(width), -seen.shapes
    seen_load[:count] = seen.load
    forces[:, forces.shape[1] - n_objects :] = np.nan  # which counts as a weight
    made: dict[str, NDArray[Any]] = {"seen_load": seen_load}
    for name, weights, of in (
        ("stored", seen.stored, None),
        ("mode", seen.modes, None),
        ("law", forces, laws.row),
        ("friction", forces, laws.friction_row),
    ):
        made[f"{name}_list"], made[f"{name}_rows"] = _listed(weights, of, width)
    of_laws = laws.row[made["law_list"]]
    made["law_places"] = as_unsigned(row_place[of_laws].astype(np.int64))
    made["stored_list"] = as_unsigned(row_place[made["stored_list"]].astype(np.int64))
    template = StepRecord(
        **_no_instants(),
        **made,
        residual=np.zeros(1),
        watched=np.array(watched, dtype=np.int64),
        picked=np.zeros(max(part.size for part in made.values() if part.ndim == 1)),
    )
    return shared_record(template), np.flatnonzero(of_laws >= forces.shape[1] - n_objects)


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
        held = gather(slope, laws, i) * gather(g, places, i)
        store(gather(forces, laws, i) - held, to, i)


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
def store_seen(run: Run, state: State, kept: int) -> None:
    """Write the seen displacements of the present instant to a row of the record."""
    record, g, slope = run.record, state.g, run.system.base_slope
    to = record.seen[kept]
    copy(record.seen_load, to)
    picked = record.picked[: record.stored_list.size]
    gather_all(g, record.stored_list, picked)
    _add_rows(picked, record.stored_rows, to)
    picked = record.picked[: record.mode_list.size]
    gather_all(state.q, record.mode_list, picked)
    _add_rows(picked, record.mode_rows, to)
    picked = record.picked[: record.law_list.size]
    _pick_deviations(g, slope, run.work.force, record.law_list, record.law_places, picked)
    _add_rows(picked, record.law_rows, to)
    picked = record.picked[: record.friction_list.size]
    gather_all(state.friction_force, record.friction_list, picked)
    _add_rows(picked, record.friction_rows, to)


def _nothing_seen(rails: CondensedRails) -> SeenRows:
    """Return the weights of no rows."""
    none = np.zeros((0, rails.row_stiffness.size))
    return SeenRows(none, np.zeros((0, 0)), none, np.zeros(0))


TIME_TOLERANCE = 1e-9
"""Instants nearer to an onset or an end than this are at it [s]."""
BALANCE_EVERY = 8
"""Kept instants of a watched run from one check of its energy balance to the next."""


@dataclass(frozen=True, slots=True, eq=False)
class SaveAt:
    """Instants of a run that are saved, and what of them, if not all are wanted whole.

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
    count : int
        Number of rows that are to be seen.
    seen : callable
        Takes the condensed rails and returns the weights of these rows; default none.
    taken : sequence of float
        Those of `rests` that no wait for machines postpones; the others are onsets of movements.
    traced : bool
        Whether all is kept of machines that their channels follow from, else what their movements
        and the currents of motors do.
    """

    laws: Sequence[int] = ()
    stride: int = 1
    whole: Sequence[float] = ()
    rests: Sequence[float] = ()
    count: int = 0
    seen: Callable[[CondensedRails], SeenRows] = _nothing_seen
    taken: Sequence[float] = ()
    traced: bool = True


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
class SavePlan:
    """Which stored instants have which place in a record; by default each has its own.

    There are `count` of them, with velocities if these are wanted. `save_at` says what is kept,
    `weights` are those of seen displacements. `places` are those of `StepRecord`; of what is
    seen the instants that are wanted regularly come first. `counts` of instants are stored whole,
    seen, and stored with energies, as the last one is; a run with machines has places for `further`
    ones, which it gives as it goes on. `rests` are the numbers of the instants of `Watched.rests`,
    by the schedule.
    """

    count: int
    velocity: bool = False
    save_at: SaveAt = field(default_factory=SaveAt)
    weights: SeenWeights = field(default_factory=_unweighted)
    places: Ints = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    counts: tuple[int, int, int] = (0, 0, 0)
    rests: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    further: int = 0

    @property
    def watches(self) -> bool:
        """True if some instants are not stored whole."""
        return self.places.size > 0

    def whole(self, count: int) -> Ints | slice:
        """Return which of the first `count` instants are stored whole."""
        return np.flatnonzero(self.places[:count, 0] >= 0) if self.watches else slice(count)

    def rows(self, column: int, count: int) -> Ints | slice:
        """Return the rows of those of the first `count` instants with a place in a column."""
        rows = self.places[:count, column]
        return rows[rows >= 0] if self.watches else slice(count)


def plan_saving(
    save_at: SaveAt, weights: SeenWeights, interval: float, count: int, *, further: int = 0
) -> SavePlan:
    """Choose the places of stored instants in the record of a watched run.

    Parameters
    ----------
    save_at : SaveAt
        What is wanted.
    weights : SeenWeights
        From `seen_weights`.
    interval : float
        Time between stored instants [s].
    count : int
        Of stored instants.
    further : int
        Instants that may be given places during the run, with `give_place`.

    Examples
    --------
    >>> plan = plan_saving(SaveAt([0], 2, [0.3]), SavePlan(0).weights, 0.1, 7)
    >>> whole, seen, balanced = plan.places.T.tolist()
    >>> whole, seen
    ([-1, -1, -1, 0, -1, -1, 1], [0, -1, 1, 4, 2, -1, 3])
    >>> balanced
    [0, -1, -1, 1, -1, -1, 2]
    """
    times = tuple(save_at.whole), tuple(save_at.rests)
    places, counts, rests = _places(*times, save_at.stride, interval, count)
    places = places.copy() if further else places
    return SavePlan(count, False, save_at, weights, places, counts, rests, further)


@lru_cache(maxsize=16)
def _places(
    wanted: tuple[float, ...], rests: tuple[float, ...], stride: int, interval: float, count: int
) -> tuple[Ints, tuple[int, int, int], Ints]:
    """Return places, counts and rests of a `SavePlan`."""
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


def trim_watched(
    record: StepRecord,
    plan: SavePlan,
    onsets: Sequence[float] | None,
    *,
    time: Floats,
    inputs: Floats,
    law_first: Floats,
    law_placed: Floats,
) -> Watched:
    """Return what a run to its last instant left; of all its instants, as of `Watched`.

    `onsets` are those of movements that machines may have postponed [s].
    """
    rests = plan.rests
    if onsets is not None:
        rests = rest_instants(time, sorted({*plan.save_at.taken, *onsets}))
    count, regular = plan.save_at.count, -(-time.size // plan.save_at.stride)
    return Watched(
        time=time,
        inputs=inputs,
        law_first=law_first,
        law_placed=law_placed,
        stride=plan.save_at.stride,
        seen=record.seen[:regular, :count],
        rests=rests,
        seen_rests=record.seen[plan.places[rests, 1], :count],
        laws=tuple(plan.save_at.laws),
        effort=record.effort[:, : time.size],
    )


def empty_record(system: System, laws: LawTable, plan: SavePlan) -> StepRecord:
    """Allocate the record of a run in one piece of memory."""
    widths = {
        "q": whole_lines(system.load.size),
        "g": whole_lines(system.row_place.size),
        "friction": whole_lines(laws.friction_row.size),
        "law": whole_lines(laws.row.size),
        "stored": STORED,
        "ledger": LEDGER,
    }
    counts, (template, law_rows) = dict.fromkeys(widths, plan.count), plan.weights
    if plan.watches:
        whole, _, balanced = (rows + plan.further for rows in plan.counts)
        counts |= dict.fromkeys(("q", "g", "friction", "law"), whole)
        counts |= dict.fromkeys(("stored", "ledger"), balanced)
    total = sum(counts[name] * width for name, width in widths.items())
    memory = empty_in_lines(total) if plan.watches else lines_from_buffer(total)
    at, arrays = 0, dict[str, NDArray[Any]]()
    for name, width in widths.items():
        size = counts[name] * width
        arrays[name] = memory[at : at + size].reshape(counts[name], width)
        at += size
    arrays["v"] = np.zeros((plan.count if plan.velocity else 1, arrays["q"].shape[1]))
    if plan.watches:
        arrays["places"] = plan.places
        arrays["effort"] = np.empty((len(plan.save_at.laws), plan.places.shape[0]))
        count, width = plan.counts[1] + plan.further, template.seen_load.size
        arrays["seen"] = empty_in_lines(count, width)
        for name in ("stored_rows", "mode_rows", "friction_rows"):
            arrays[name] = getattr(template, name)
        arrays["law_rows"] = law_rows
    record = clone_record(template, **arrays)
    record.given[:] = plan.counts
    return record


def trim_record(run: Run, count: int, plan: SavePlan) -> StepRecord:
    """Return what is stored whole of the first `count` instants of a run, without padding."""
    record, n_modes, n_rows = run.record, run.system.load.size, run.system.row_place.size
    at, energies = plan.rows(0, count), plan.whole(count)
    if plan.watches:
        energies = plan.places[energies, 2]
    return StepRecord(
        q=record.q[at, :n_modes],
        g=record.g[at, :n_rows],
        friction=record.friction[at, : run.table.friction_row.size],
        law=record.law[at, : run.table.row.size],
        stored=record.stored[energies],
        ledger=record.ledger[energies],
        residual=record.residual,
        v=record.v[:count, :n_modes],
    )


def kept_obstructions(found: Obstructions) -> Obstructions:
    """Return obstructions apart from the memory of their run."""
    return Obstructions(*(getattr(found, name).copy() for name in Obstructions._fields))


def interpolate_record(
    record: StepRecord,
    *,
    step: float,
    instants: Floats,
    inputs: Floats,
    modes: Floats,
    laws: LawTable,
) -> StepRecord:
    """Interpolate a record of every step at other instants.

    Parameters
    ----------
    record : StepRecord
        Of every step; without velocities all of it is interpolated linearly.
    step : float
        Time between the rows of the record [s].
    instants : ndarray, shape (n,)
        Within the time of the record [s].
    inputs : ndarray, shape (n, n_inputs)
        Marker positions at the instants [m].
    modes : ndarray, shape (n_rows, n_modes)
        Modes at the rows [m per unit of `q`].
    laws : LawTable
        The laws as integrated, by rows of the mechanism.
    """
    last = record.q.shape[0] - 1
    at = np.clip((instants / step + 1e-9).astype(np.int64), 0, max(last - 1, 0))
    share = np.clip(instants / step - at, 0.0, 1.0)[:, np.newaxis]
    after = np.minimum(at + 1, last)

    def interpolate_linearly(values: Floats) -> Floats:
        found: Floats = (1.0 - share) * values[at] + share * values[after]
        return found

    q, g = interpolate_linearly(record.q), interpolate_linearly(record.g)
    if record.v.shape[0] == record.q.shape[0]:
        change = record.q[after] - record.q[at]
        bend = (1.0 - share) * (step * record.v[at] - change)
        bend -= share * (step * record.v[after] - change)
        bend *= share * (1.0 - share)
        q += bend
        g += bend @ modes.T
    return record._replace(
        q=q,
        g=g,
        v=record.v[:1],
        friction=interpolate_linearly(record.friction),
        law=_law_forces(laws, g, inputs, interpolate_linearly(record.law)),
        stored=interpolate_linearly(record.stored),
        ledger=interpolate_linearly(record.ledger),
    )


def _law_forces(laws: LawTable, g: Floats, inputs: Floats, interpolated: Floats) -> Floats:
    """Return the forces of all laws [N]; interpolated ones for laws that appear or disappear."""
    force = interpolated.copy()
    always = np.isinf(laws.appears) & np.isinf(laws.disappears) & (laws.waits == 0)
    for law in np.flatnonzero(always).tolist():
        e = g[:, laws.row[law]] - laws.offset[law]
        if laws.input_index[law] >= 0:
            e = e - inputs[:, laws.input_index[law]]
        at = segments_at(laws, law, e)
        force[:, law] = laws.slope[at] * e + laws.intercept[at]
    return force
