"""The record of a run: its memory, and what is left of it at the end."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.lanes import LANES, empty_in_lines, whole_lines
from turnout.kernels.shared_record import address_of, clone_record, shared_record
from turnout.law.obstruction import Obstructions, no_obstructions
from turnout.law.table import LawTable
from turnout.solver.energy import LEDGER
from turnout.solver.scratch import acquire_buffer
from turnout.solver.seen import SeenWeights, StepRecord
from turnout.solver.system import Floats, System
from turnout.solver.watch import WatchPlan, watched_record

Ints = NDArray[np.int64]

LEAST_CACHED, MOST_CACHED = 4 * 2**20, 16 * 2**20
"""Records of these sizes are stored through the processor's caches, from which they are read in two
thirds of the time; smaller and larger ones would evict what the steps need [bytes]."""


def empty_record(
    system: System,
    laws: LawTable,
    count: int,
    *,
    velocity: bool,
    watched: tuple[WatchPlan, SeenWeights] | None,
) -> StepRecord:
    """Allocate a record in one piece of memory.

    Parameters
    ----------
    system : System
        Of the run.
    laws : LawTable
        All laws.
    count : int
        Number of stored instants.
    velocity : bool
        Whether velocities are stored too.
    watched : tuple of WatchPlan and SeenWeights, optional
        Which instants are stored whole and kept, and what is seen of these; default all of them.
    """
    plan = None if watched is None else watched[0]
    widths = {
        "q": whole_lines(system.load.size),
        "g": whole_lines(system.row_place.size),
        "friction": whole_lines(laws.friction_row.size),
        "law": whole_lines(laws.row.size),
        "stored": 4,
        "ledger": LEDGER,
    }
    counts = dict.fromkeys(widths, count)
    if plan is not None:
        whole, _, balanced = (rows + plan.further for rows in plan.counts)
        counts |= dict.fromkeys(("q", "g", "friction", "law"), whole)
        counts |= dict.fromkeys(("stored", "ledger"), balanced)
    total = sum(counts[name] * width for name, width in widths.items())
    memory = _from_buffer(total) if plan is None else empty_in_lines(total)
    at, arrays = 0, dict[str, NDArray[Any]]()
    for name, width in widths.items():
        size = counts[name] * width
        arrays[name] = memory[at : at + size].reshape(counts[name], width)
        at += size
    arrays["v"] = np.zeros((count if velocity else 1, arrays["q"].shape[1]))
    if watched is not None:
        return watched_record(arrays, *watched)
    record = clone_record(_empty_record(), **arrays)
    record.cached[0] = LEAST_CACHED <= 8 * total <= MOST_CACHED
    return record


@cache
def _empty_record() -> StepRecord:
    """Return a record of no instant, of which those of all instants are clones."""
    names = ("q", "g", "friction", "law", "stored", "ledger", "v")
    nothing: dict[str, Any] = dict.fromkeys(names, np.zeros((0, 0)))
    return shared_record(StepRecord(**nothing, residual=np.zeros(1)))


def _from_buffer(count: int) -> Floats:
    """Return an uninitialised array from `acquire_buffer` that begins at a cache line."""
    memory = acquire_buffer(count + LANES)
    return memory[-(address_of(memory) // 8) % LANES :]


def trim_record(
    record: StepRecord, system: System, laws: LawTable, count: int, plan: WatchPlan | None
) -> StepRecord:
    """Return what is stored whole of the first `count` instants, without padding."""
    n_modes = system.load.size
    at: slice | Ints = slice(count)
    energies = at
    if plan is not None:
        at = plan.places_of(0, count)
        energies = plan.places[plan.whole(count), 2]
    return StepRecord(
        q=record.q[at, :n_modes],
        g=record.g[at, : system.row_place.size],
        friction=record.friction[at, : laws.friction_row.size],
        law=record.law[at, : laws.row.size],
        stored=record.stored[energies],
        ledger=record.ledger[energies],
        residual=record.residual,
        v=record.v[:count, :n_modes],
    )


_NO_OBSTRUCTIONS = no_obstructions()


def kept_obstructions(found: Obstructions) -> Obstructions:
    """Return obstructions apart from the memory of their run; all runs share those of none."""
    if found.law.size == 0:
        return _NO_OBSTRUCTIONS
    return Obstructions(**{name: getattr(found, name).copy() for name in Obstructions._fields})
