"""The time loop: steps, halved steps, stored instants.

Kernels change `State` in place and return an outcome code; they never raise and never print.
"""

from typing import NamedTuple

from turnout.integrate.accuracy import DRIFTS, correct, equilibrium_residual, is_inaccurate, measure
from turnout.integrate.columns import REBUILD_AFTER, make_level, rebuild
from turnout.integrate.energy import (
    account_friction,
    account_laws,
    store_energy,
    switch_laws,
)
from turnout.integrate.follow import follow_path
from turnout.integrate.quasistatic import advance_static
from turnout.integrate.rods import Rods, accept_rods, move_rods, settle_rods, store_rods
from turnout.integrate.scratch import Work
from turnout.integrate.solve import (
    CONVERGED,
    NOT_CONVERGED,
    STOPPED,
    Tolerances,
    evaluate,
    restore_set,
    save_set,
    settle,
    update_marked,
)
from turnout.integrate.state import COUNT_HALVED, COUNT_RECENT, LEVEL, State
from turnout.integrate.step import Factors, Stepping, begin_step, complete_step, factors_of
from turnout.integrate.system import Floats, Ints, System
from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import LANES, gather, load, store_nontemporal
from turnout.kernels.vector import copy
from turnout.law.table import LawTable

MEASURE_EVERY = 100
"""After so many steps a solution is measured whatever has happened."""


class Record(NamedTuple):
    """Stored instants, one row each, and the running checks.

    Rows of `q`, `g`, `friction`, `law` and `v` fill whole lines of memory; the first four begin
    with one.
    """

    q: Floats
    g: Floats
    friction: Floats
    law: Floats
    stored: Floats
    ledger: Floats
    residual: Floats
    v: Floats


@compiled
def change_level(
    system: System, table: LawTable, state: State, work: Work, stepping: Stepping, level: int
) -> None:
    """Make the columns of a step that is halved so many times."""
    factors = factors_of(stepping, stepping.step / (1 << level))
    make_level(system, state, level, factors.inertia, factors.viscosity)
    rebuild(system, table, state, level, work.row)


@compiled
def _try_step(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    stepping: Stepping,
    h: float,
    factors: Factors,
    inputs: tuple[Floats, Floats],
    last: bool,
    rods: Rods | None = None,
    time: float = 0.0,
) -> int:
    """Take and book one step of length `h`; on failure leave the state as it was, bar its inputs.

    A `last` attempt follows the path where the contact set does not settle.
    """
    inertia, viscosity = factors.inertia, factors.viscosity
    begin_step(system, state, work, stepping, h, factors)
    save_set(state, work)
    code = settle(system, table, state, work, tolerances)
    if rods is not None:  # noqa: SIM102, this alone is left out where there are none
        if code == CONVERGED:
            code = settle_rods(rods, system, table, state, work, tolerances, (time, h))
    if code == NOT_CONVERGED and last:
        copy(work.q, state.q)
        copy(work.g_start, state.g)
        copy(inputs[0], state.inputs)
        restore_set(system, table, state, work)
        rebuild(system, table, state, stepping.halvings, work.row)
        code = follow_path(system, table, state, work, tolerances, inputs, inertia, viscosity)
    if code == CONVERGED and (
        is_inaccurate(system, table, state, work, inertia, viscosity)
        or state.counters[COUNT_RECENT] >= REBUILD_AFTER
    ):
        if state.counters[COUNT_RECENT] > 0:
            # the set is found; its solution is taken from columns without a history
            rebuild(system, table, state, state.counters[LEVEL], work.row)
            code = settle(system, table, state, work, tolerances)
        if code == CONVERGED and measure(system, table, state, work, inertia, viscosity):
            correct(system, state, work)
            evaluate(table, state, work)
            state.drift[0] = DRIFTS
    if code == CONVERGED:
        complete_step(system, state, work, stepping, factors)
        return code
    copy(work.q, state.q)
    copy(work.g_start, state.g)
    restore_set(system, table, state, work)
    return code


@compiled
def _advance(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    stepping: Stepping,
    whole: Factors,
    inputs: tuple[Floats, Floats],
    time: float,
    rods: Rods | None,
) -> int:
    """Cover one nominal step from `time`, in one piece or in halved pieces.

    `whole` are the factors of a step in one piece.
    """
    old, new = inputs
    marks = 1 << stepping.halvings
    position, level = 0, 0
    h, factors = stepping.step, whole
    begin, end = work.inputs, work.inputs_end
    while position < marks:
        size = marks >> level
        share = 1.0 if position + size == marks else (position + size) / marks
        for k in range(new.size):
            begin[k] = state.inputs[k]
            state.inputs[k] = old[k] + share * (new[k] - old[k])
            end[k] = state.inputs[k]
        moved = CONVERGED
        begun = time + position / marks * stepping.step
        if rods is not None:
            moved = move_rods(rods, state, end, (begun, h))
        last = stepping.follow_path and level == stepping.halvings
        code = moved
        if moved == CONVERGED:
            code = _try_step(
                system, table, state, work, tolerances, stepping, h, factors, (begin, end), last,
                rods, begun,
            )  # fmt: skip
        if code != CONVERGED:
            copy(begin, state.inputs)
            level += 1
            if level > stepping.halvings or code == STOPPED:
                return code
            state.counters[COUNT_HALVED] += 1
            h = stepping.step / (1 << level)
            factors = factors_of(stepping, h)
            change_level(system, table, state, work, stepping, level)
            continue
        if level > 0 or last:
            work.unsettled[:] = 0
        if rods is not None:
            accept_rods(rods, state, work, begin, h)
        account_laws(system, table, state, work, begin, time + share * stepping.step)
        account_friction(system, state, work)
        position += size
    return CONVERGED


@compiled_loop
def _gather(g: Floats, places: Ints, to: Floats) -> None:
    for i in range(0, places.size, LANES):
        store_nontemporal(gather(g, places, i), to, i)


@compiled_loop
def _write(values: Floats, to: Floats) -> None:
    for i in range(0, values.size, LANES):
        store_nontemporal(load(values, i), to, i)


@compiled_part
def store(
    system: System, table: LawTable, state: State, work: Work, record: Record, at: int
) -> None:
    """Store the present instant."""
    _write(state.q, record.q[at])
    _gather(state.g, system.row_place, record.g[at])
    if at < record.v.shape[0]:
        copy(state.v, record.v[at])
    _write(state.friction_force, record.friction[at])
    _write(work.force, record.law[at])
    store_energy(system, table, state, work, record.stored[at])
    for column in range(state.ledger.size):
        record.ledger[at, column] = state.ledger[column]


@compiled
def march(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    stepping: Stepping,
    inputs: Floats,
    first: int,
    last: int,
    record: Record,
    rods: Rods | None = None,
) -> tuple[int, int]:
    """Step from instant `first` to instant `last`; return the outcome code and the instant reached.

    Parameters
    ----------
    inputs : ndarray, shape (n_steps + 1, n_inputs)
        Marker positions at the ends of the steps [m].
    first, last : int
        Indices into `inputs`; the state is that of instant `first`, its columns those of the
        nominal step. Where a march is cut into several does not change a bit of the result.
    rods : Rods, optional
        Of drives that are machines; their inputs are written as they come to be.
    """
    whole = factors_of(stepping, stepping.step)
    row, left = first // stepping.stride, stepping.stride - first % stepping.stride
    for n in range(first, last):
        time = n * stepping.step
        if stepping.inertia and state.counters[LEVEL] != 0:
            change_level(system, table, state, work, stepping, 0)
        count = switch_laws(system, table, state, work, time + stepping.step)
        update_marked(system, table, state, work, count)
        pair = (inputs[n], inputs[n + 1])
        if stepping.inertia:
            code = _advance(
                system, table, state, work, tolerances, stepping, whole, pair, time, rods
            )
        else:
            span = (time, time + stepping.step)
            code = advance_static(system, table, state, work, tolerances, pair, span)
        if code != CONVERGED:
            return code, n
        left -= 1
        if rods is not None:
            store_rods(rods, state, inputs[n + 1], row + 1 if left == 0 else -1)
        if left == 0:
            row, left = row + 1, stepping.stride
            store(system, table, state, work, record, row)
            if row % MEASURE_EVERY == 0:
                residual = equilibrium_residual(system, table, state, work)
                record.residual[0] = max(record.residual[0], residual)
        if stepping.inertia and (n + 1) % MEASURE_EVERY == 0:
            state.drift[0] = max(state.drift[0], DRIFTS)  # what was small at rest may have grown
    return CONVERGED, last
