"""The condensed system and the state of a run, as arrays for the kernels.

Rows are the places where laws act. The linear system (beams, linear supports, and the base segment
of every law) is solved once; a law away from its base segment adds a *deviation*
``lambda = D g + b`` on its row. ``D`` has few entries a row: the row itself and, for friction, the
rows of the normal laws. See `turnout.integrate.columns` for what is done with it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from turnout.errors import MechanicsError
from turnout.law.compiled import compiled
from turnout.law.table import LawTable
from turnout.mechanism.condense import ModalModel, base_stiffness

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class System(NamedTuple):
    """What does not change during a run.

    ``base`` holds, row by row, the residual flexibility followed by the modes at the row. The
    pairs ``..._start`` / ``..._list`` are ragged lists in compressed form.
    """

    eigenvalues: Floats
    damping: Floats
    load: Floats
    row_load: Floats
    base: Floats
    pattern_start: Ints
    pattern_list: Ints
    row_law_start: Ints
    row_law_list: Ints
    row_friction_start: Ints
    row_friction_list: Ints
    normal_friction_start: Ints
    normal_friction_list: Ints
    base_slope: Floats
    pinned: Ints
    input_law: Ints


class State(NamedTuple):
    """What a run changes, in place, and nothing else does.

    On its present segment a law resists with ``slope * (g - input) + constant`` for ``g - input``
    between ``lower`` and ``upper``; `set_segment` keeps these five together. ``columns`` holds
    solved columns of length rows + modes: the modes, the constant, then one for each active row.
    ``counters``: active rows, flips since the last rebuild, flips in all, iterations in all, steps
    halved, rebuilds. ``drift`` is the growth of rounding since it was last measured.
    """

    segment: Ints
    present: Ints
    slope: Floats
    constant: Floats
    lower: Floats
    upper: Floats
    friction: Ints
    anchor: Floats
    friction_force: Floats
    law_force: Floats
    law_energy: Floats
    law_argument: Floats
    entries: Floats
    shift: Floats
    slot_of_row: Ints
    row_of_slot: Ints
    columns: Floats
    inverse: Floats
    q: Floats
    v: Floats
    a: Floats
    acceleration: Floats
    g: Floats
    inputs: Floats
    ledger: Floats
    counters: Ints
    drift: Floats
    law_placed: Floats
    law_first: Floats
    law_peak: Floats


@compiled
def set_segment(table: LawTable, state: State, law: int, segment: int) -> None:
    """Put a law on a segment; an absent law keeps the segment but has no force and no bounds."""
    state.segment[law] = segment
    if state.present[law] == 0:
        state.slope[law] = 0.0
        state.constant[law] = 0.0
        state.lower[law] = -np.inf
        state.upper[law] = np.inf
        return
    at = table.segment_start[law] + segment
    state.slope[law] = table.slope[at]
    state.constant[law] = table.intercept[at] - table.slope[at] * table.offset[law]
    state.lower[law] = table.segment_lower[at] + table.offset[law]
    state.upper[law] = table.segment_upper[at] + table.offset[law]


COUNT_ACTIVE, COUNT_RECENT, COUNT_FLIPS, COUNT_ITERATIONS, COUNT_HALVED, COUNT_REBUILDS = range(6)


def condensed_system(model: ModalModel, table: LawTable) -> System:
    """Arrange a modal model and its laws for the kernels.

    Parameters
    ----------
    model : ModalModel
        Of the linear system with the base segments of the laws.
    table : LawTable
        The laws.

    Returns
    -------
    System
    """
    n_rows = model.row_modes.shape[0]
    n_laws, n_frictions = table.row.size, table.friction_row.size
    normals = table.friction_normal
    if np.any(table.input_index[normals] >= 0):
        msg = "the normal law of a friction row cannot be driven by a marker"
        raise MechanicsError(msg)
    lowest = table.segment_start[normals]
    if np.any(table.slope[lowest] != 0) or np.any(table.intercept[lowest] != 0):
        msg = "the normal law of a friction row must be a contact, which never pulls"
        raise MechanicsError(msg)
    pattern: list[list[int]] = [[r] for r in range(n_rows)]
    for friction in range(n_frictions):
        columns = pattern[table.friction_row[friction]]
        normal_row = int(table.row[normals[friction]])
        if normal_row not in columns:
            columns.append(normal_row)
    pattern_start, pattern_list = _ragged(pattern)
    row_law = _ragged(_inverted(table.row, n_rows))
    row_friction = _ragged(_inverted(table.friction_row, n_rows))
    normal_friction = _ragged(_inverted(normals, n_laws))
    pinned = np.zeros(n_rows, dtype=np.int64)
    driven = np.flatnonzero(table.input_index >= 0)
    pinned[table.row[driven]] = 1
    return System(
        eigenvalues=model.eigenvalues,
        damping=np.ascontiguousarray(model.damping),
        load=model.load,
        row_load=model.row_load,
        base=np.ascontiguousarray(np.hstack((model.flexibility, model.row_modes))),
        pattern_start=pattern_start,
        pattern_list=pattern_list,
        row_law_start=row_law[0],
        row_law_list=row_law[1],
        row_friction_start=row_friction[0],
        row_friction_list=row_friction[1],
        normal_friction_start=normal_friction[0],
        normal_friction_list=normal_friction[1],
        base_slope=base_stiffness(table),
        pinned=pinned,
        input_law=driven.astype(np.int64),
    )


def fresh_state(system: System, table: LawTable, *, n_inputs: int) -> State:
    """Return a state at rest with every law on its base segment (or where its argument is 0)."""
    n_rows, n_modes = system.row_load.size, system.eigenvalues.size
    n_laws, n_frictions = table.row.size, table.friction_row.size
    segment = np.zeros(n_laws, dtype=np.int64)
    for law in range(n_laws):
        if table.base_segment[law] >= 0:
            segment[law] = table.base_segment[law]
        else:
            first, last = table.segment_start[law], table.segment_start[law + 1]
            segment[law] = np.searchsorted(table.segment_upper[first : last - 1], 0.0)
    state = State(
        segment=segment,
        present=np.ones(n_laws, dtype=np.int64),
        slope=np.zeros(n_laws),
        constant=np.zeros(n_laws),
        lower=np.zeros(n_laws),
        upper=np.zeros(n_laws),
        friction=np.zeros(n_frictions, dtype=np.int64),
        anchor=np.zeros(n_frictions),
        friction_force=np.zeros(n_frictions),
        law_force=np.zeros(n_laws),
        law_energy=np.zeros(n_laws),
        law_argument=np.zeros(n_laws),
        entries=np.zeros(system.pattern_list.size),
        shift=np.zeros(n_rows),
        slot_of_row=np.full(n_rows, -1, dtype=np.int64),
        row_of_slot=np.full(n_rows, -1, dtype=np.int64),
        columns=np.zeros((n_modes + 1 + n_rows, n_rows + n_modes)),
        inverse=np.zeros((n_modes, n_modes)),
        q=np.zeros(n_modes),
        v=np.zeros(n_modes),
        a=np.zeros(n_modes),
        acceleration=np.zeros(n_modes),
        g=np.zeros(n_rows),
        inputs=np.zeros(n_inputs),
        ledger=np.zeros(6),
        counters=np.zeros(6, dtype=np.int64),
        drift=np.ones(1),
        law_placed=np.full(n_laws, np.nan),
        law_first=np.full(n_laws, np.nan),
        law_peak=np.zeros(n_laws),
    )
    for law in range(n_laws):
        set_segment(table, state, law, segment[law])
    return state


def _inverted(targets: Ints, count: int) -> list[list[int]]:
    lists: list[list[int]] = [[] for _ in range(count)]
    for index, target in enumerate(targets):
        lists[target].append(index)
    return lists


def _ragged(lists: list[list[int]]) -> tuple[Ints, Ints]:
    start = np.concatenate(([0], np.cumsum([len(x) for x in lists]))).astype(np.int64)
    return start, np.array([i for x in lists for i in x], dtype=np.int64)
