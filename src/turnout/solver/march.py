"""Time loop of the kernels: steps, halved steps, stored instants.

Kernels change `State` in place and return an outcome code; they never raise and never print.
"""

import numpy as np

from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import LANES, gather_neighbours, load, store, store_nontemporal
from turnout.kernels.vector import copy
from turnout.law.friction import FrictionCourses
from turnout.law.obstruction import Obstructions
from turnout.law.table import LawTable
from turnout.solver.accuracy import (
    DRIFTS,
    equilibrium_residual,
    is_inaccurate,
    measure_residual,
    refine,
)
from turnout.solver.columns import REBUILD_AFTER, rebuild
from turnout.solver.compliance import assemble_level
from turnout.solver.energy import (
    account_friction,
    account_laws,
    store_energy,
    switch_laws,
)
from turnout.solver.follow import follow_path
from turnout.solver.obstruct import (
    has_just_broken,
    passes_failure,
    update_courses,
    update_obstructions,
)
from turnout.solver.quasistatic import advance_static
from turnout.solver.rods import (
    Rods,
    accept_rods,
    have_arrived,
    iterate_rods,
    meet_rods,
    move_rods,
    repeat_rods,
    rods_may_stay,
    store_rods,
)
from turnout.solver.scratch import Work
from turnout.solver.seen import StepRecord, store_seen
from turnout.solver.solve import (
    CONVERGED,
    NOT_CONVERGED,
    Tolerances,
    evaluate,
    iterate_contact_set,
    restore_contact_set,
    save_contact_set,
    update_marked,
)
from turnout.solver.state import (
    COUNT_HALVED,
    COUNT_RECENT,
    COUPLED,
    LEVEL,
    UNSOLVED,
    State,
)
from turnout.solver.step import (
    Factors,
    Stepping,
    correct,
    is_at_rest,
    predict,
    step_factors,
)
from turnout.solver.system import Floats, Ints, System

MEASURE_EVERY = 400
"""Steps after which the residual of a solution is measured in any case."""
PASSED = -1
"""Outcome of a step on whose way an obstruction fails."""
SHORTEST_PIECE = 15e-6
"""In which a failure is located [s]; the rounding of accelerations, which the energy residual
shows, grows with one over the square of the length."""


@compiled
def switch_level(
    system: System, table: LawTable, state: State, work: Work, stepping: Stepping, level: int
) -> None:
    """Assemble the columns of a step that has been halved `level` times."""
    factors = step_factors(stepping, stepping.step / (1 << level))
    assemble_level(system, state, level, factors.inertia, factors.viscosity)
    rebuild(system, table, state, level, work.row)


@compiled_part
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
    obstructions: Obstructions,
    rods: Rods | None = None,
    time: float = 0.0,
) -> int:
    """Take one step of length `h` [s]; on failure restore the state, except its inputs.

    A `last` attempt follows the solution path where the contact set does not converge; others end
    with PASSED where an obstruction fails on the way.
    """
    inertia, viscosity = factors.inertia, factors.viscosity
    predict(system, state, work, stepping, h, factors)
    save_contact_set(state, work)
    code = iterate_contact_set(system, table, state, work, tolerances)
    if rods is not None:  # noqa: SIM102, this alone is left out where there are none
        if code == CONVERGED:
            code = iterate_rods(rods, system, table, state, work, tolerances, (time, h))
    if code == NOT_CONVERGED and last:
        copy(work.q_start, state.q)
        copy(work.g_start, state.g)
        copy(inputs[0], state.inputs)
        restore_contact_set(system, table, state, work)
        rebuild(system, table, state, stepping.halvings, work.row)
        code = follow_path(system, table, state, work, tolerances, inputs, inertia, viscosity)
        if rods is not None:  # noqa: SIM102, as above
            if code == CONVERGED:
                code = meet_rods(rods, state, (time, h))
    if code == CONVERGED and (
        is_inaccurate(system, table, state, work, inertia, viscosity)
        or state.counters[COUNT_RECENT] >= REBUILD_AFTER
    ):
        if state.counters[COUNT_RECENT] > 0:
            # the contact set is known; solve again with columns that carry no rounding of updates
            rebuild(system, table, state, state.counters[LEVEL], work.row)
            code = iterate_contact_set(system, table, state, work, tolerances)
        if code == CONVERGED and measure_residual(system, table, state, work, inertia, viscosity):
            refine(system, state, work)
            evaluate(table, state, work)
            state.drift[0] = DRIFTS
    if code == CONVERGED and _can_locate(stepping, state.counters[LEVEL]):  # noqa: SIM102, as above
        if passes_failure(table, state, obstructions):
            code = PASSED
    if code == CONVERGED:
        correct(system, state, work, stepping, factors)
        return code
    copy(work.q_start, state.q)
    copy(work.g_start, state.g)
    restore_contact_set(system, table, state, work)
    return code


@compiled
def _can_locate(stepping: Stepping, level: int) -> bool:
    """Return whether the pieces of a level may be halved to locate a failure."""
    return level < stepping.halvings and stepping.step >= SHORTEST_PIECE * (2 << level)


@compiled_part
def _advance(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    stepping: Stepping,
    nominal: Factors,
    inputs: tuple[Floats, Floats],
    time: float,
    obstructions: Obstructions,
    rods: Rods | None,
) -> int:
    """Advance by one nominal step from `time` [s], in one piece or in halved pieces.

    `nominal` are the factors of a step in one piece. Where an obstruction fails, the smallest piece
    ends there, and so small are those that follow.
    """
    first, last = inputs
    n_pieces = 1 << stepping.halvings
    position, level, fails = 0, 0, False
    h, factors = stepping.step, nominal
    if has_just_broken(state, obstructions):
        while _can_locate(stepping, level):
            level += 1
        h = stepping.step / (1 << level)
        factors = step_factors(stepping, h)
        switch_level(system, table, state, work, stepping, level)
    begin, end = work.inputs_start, work.inputs_end
    while position < n_pieces:
        size = n_pieces >> level
        share = 1.0 if position + size == n_pieces else (position + size) / n_pieces
        for k in range(last.size):
            begin[k] = state.inputs[k]
            state.inputs[k] = first[k] + share * (last[k] - first[k])
            end[k] = state.inputs[k]
        begun = time + position / n_pieces * stepping.step
        if rods is not None:
            move_rods(rods, state, end, (begun, h))
        last_attempt = stepping.follow_path and level == stepping.halvings
        code = _try_step(
            system, table, state, work, tolerances, stepping, h, factors, (begin, end),
            last_attempt, obstructions, rods, begun,
        )  # fmt: skip
        if code != CONVERGED:
            copy(begin, state.inputs)
            fails |= code == PASSED
            level += 1
            if level > stepping.halvings:
                return code
            state.counters[COUNT_HALVED] += 1
            h = stepping.step / (1 << level)
            factors = step_factors(stepping, h)
            switch_level(system, table, state, work, stepping, level)
            continue
        if level > 0 or last_attempt:
            work.unconverged[:] = 0
        if rods is not None:
            accept_rods(rods, state, work, begin, (begun, h))
        account_laws(system, table, state, work, begin, time + share * stepping.step)
        account_friction(system, state, work)
        position += size
        if fails and position < n_pieces:
            now = time + share * stepping.step
            count = update_obstructions(system, table, state, work, obstructions, now)
            update_marked(system, table, state, work, count)
    return CONVERGED


@compiled_loop
def _gather_to(g: Floats, places: Ints, to: Floats, cached: int) -> None:
    for i in range(0, places.size, LANES):
        if cached:
            store(gather_neighbours(g, places, i), to, i)
        else:
            store_nontemporal(gather_neighbours(g, places, i), to, i)


@compiled_loop
def _copy_to(values: Floats, to: Floats, cached: int) -> None:
    for i in range(0, values.size, LANES):
        if cached:
            store(load(values, i), to, i)
        else:
            store_nontemporal(load(values, i), to, i)


@compiled_part
def store_instant(
    system: System, table: LawTable, state: State, work: Work, record: StepRecord, at: int
) -> None:
    """Write the present instant to its places in the record."""
    listed = record.places.shape[0] > 0
    whole = record.places[at, 0] if listed else at
    if whole >= 0:
        cached = record.cached[0]
        _copy_to(state.q, record.q[whole], cached)
        _gather_to(state.g, system.row_place, record.g[whole], cached)
        if whole < record.v.shape[0]:
            copy(state.v, record.v[whole])
        _copy_to(state.friction_force, record.friction[whole], cached)
        _copy_to(work.force, record.law[whole], cached)
    kept = record.places[at, 1] if listed else at
    if kept >= 0 and record.seen.shape[1] > 0:
        forces = (work.force, state.friction_force)
        store_seen(system, (state.q, state.g), forces, record, kept)
    balanced = record.places[at, 2] if listed else at
    if balanced >= 0:
        store_energy(system, table, state, work, record.stored[balanced])
        for column in range(state.ledger.size):
            record.ledger[balanced, column] = state.ledger[column]
    for k in range(record.watched.size):
        record.effort[k, at] = work.force[record.watched[k]]


@compiled_part
def _stands_still(
    state: State, stepping: Stepping, tolerances: Tolerances, inputs: tuple[Floats, Floats]
) -> bool:
    """Return whether a step between two positions of the markers would change nothing.

    Then neither columns nor rows have changed since the last solution, and everything is at rest.
    """
    first, last = inputs
    unchanged = state.counters[UNSOLVED] == 0 and state.counters[COUPLED] == 1
    for k in range(first.size):
        unchanged = unchanged and first[k] == last[k]
    return unchanged and is_at_rest(state, stepping.step, tolerances.gap)


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
    record: StepRecord,
    obstructions: Obstructions,
    courses: FrictionCourses,
    rods: Rods | None = None,
) -> tuple[int, int]:
    """Step from instant `first` to instant `last`; return the outcome code and the instant reached.

    It ends early where machines that it waits for have arrived.

    Parameters
    ----------
    inputs : ndarray, shape (n_steps + 1, n_inputs)
        Marker positions at the ends of the steps [m].
    first, last : int
        Indices into `inputs`; the state is that of instant `first`, its columns those of the
        nominal step. Splitting a march into several changes no bit of the result.
    obstructions : Obstructions
        Laws that remember what was done to them.
    courses : FrictionCourses
        Friction that differs along the stroke.
    rods : Rods, optional
        Of drives that are machines; their inputs are written as they come to be.
    """
    nominal = step_factors(stepping, stepping.step)
    whole = int(np.int64(0))  # a literal is another type: all it reaches would compile once more
    row, remaining = first // stepping.stride, stepping.stride - first % stepping.stride
    for n in range(first, last):
        time = n * stepping.step
        if stepping.inertia and state.counters[LEVEL] != 0:
            switch_level(system, table, state, work, stepping, whole)
        count = switch_laws(system, table, state, work, time + stepping.step)
        update_marked(system, table, state, work, count)
        pair, free = (inputs[n], inputs[n + 1]), True
        if rods is not None:
            free = rods_may_stay(rods, pair, (time, stepping.step))
        if free and stepping.inertia and _stands_still(state, stepping, tolerances, pair):
            code = CONVERGED
            if rods is not None:
                repeat_rods(rods, (time, stepping.step))
        elif stepping.inertia:
            code = _advance(
                system, table, state, work, tolerances, stepping, nominal, pair, time,
                obstructions, rods,
            )  # fmt: skip
        else:
            span = (time, time + stepping.step)
            code = advance_static(system, table, state, work, tolerances, pair, span)
        if code != CONVERGED:
            return code, n
        remaining -= 1
        if rods is not None:
            store_rods(rods, state, record, inputs[n + 1], row + 1 if remaining == 0 else -1)
        if remaining == 0:
            row, remaining = row + 1, stepping.stride
            store_instant(system, table, state, work, record, row)
            if row % MEASURE_EVERY == 0:
                residual = equilibrium_residual(system, table, state, work)
                record.residual[0] = max(record.residual[0], residual)
        now = time + stepping.step
        count = update_obstructions(system, table, state, work, obstructions, now)
        if courses.friction.size or courses.excess.size:
            count = update_courses(system, table, state, work, courses, stepping.step, n, count)
        update_marked(system, table, state, work, count)
        if stepping.inertia and (n + 1) % MEASURE_EVERY == 0:
            state.drift[0] = max(state.drift[0], DRIFTS)  # errors at rest may have grown
        if rods is not None:  # noqa: SIM102, as above
            if have_arrived(rods, n + 1):
                return CONVERGED, n + 1
    return CONVERGED, last


@compiled
def march_with_machines(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    stepping: Stepping,
    inputs: Floats,
    first: int,
    last: int,
    record: StepRecord,
    obstructions: Obstructions,
    courses: FrictionCourses,
    rods: Rods,
) -> tuple[int, int]:
    """Step as `march` with drives that are machines, as a kernel with a cache of its own."""
    return march(
        system,
        table,
        state,
        work,
        tolerances,
        stepping,
        inputs,
        first,
        last,
        record,
        obstructions,
        courses,
        rods,
    )
