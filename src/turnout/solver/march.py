"""Time loop of the kernels: steps, halved steps, stored instants.

Kernels change `State` in place and return an outcome code; they never raise and never print.
"""

import numpy as np

from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import LANES, gather_neighbours, load, store, store_nontemporal
from turnout.kernels.vector import copy
from turnout.solver.accuracy import (
    DRIFTS,
    equilibrium_residual,
    is_inaccurate,
    measure_residual,
    refine,
)
from turnout.solver.columns import REBUILD_AFTER, assemble_level, rebuild
from turnout.solver.energy import (
    account_friction,
    account_laws,
    store_energy,
    switch_laws,
)
from turnout.solver.follow import advance_static, follow_path
from turnout.solver.obstruct import (
    has_just_broken,
    passes_failure,
    update_courses,
    update_obstructions,
)
from turnout.solver.record import store_seen
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
from turnout.solver.solve import (
    CONVERGED,
    NOT_CONVERGED,
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
    Options,
    Run,
    State,
)
from turnout.solver.step import (
    Factors,
    correct,
    is_at_rest,
    predict,
    step_factors,
)
from turnout.solver.system import Floats, Ints

MEASURE_EVERY = 400
"""Steps after which the residual of a solution is measured in any case."""
PASSED = -1
"""Outcome of a step on whose way an obstruction fails."""
SHORTEST_PIECE = 15e-6
"""In which a failure is located [s]; the rounding of accelerations, which the energy residual
shows, grows with one over the square of the length."""


@compiled
def switch_level(run: Run, state: State, level: int) -> Factors:
    """Assemble the columns of a step that has been halved `level` times; return its factors."""
    factors = step_factors(run.options, run.options.step / (1 << level))
    assemble_level(run, state, level, factors.inertia, factors.viscosity)
    rebuild(run, state, level)
    return factors


@compiled_part
def _try_step(
    run: Run,
    state: State,
    factors: Factors,
    inputs: tuple[Floats, Floats],
    last: bool,
    rods: Rods | None = None,
    time: float = 0.0,
) -> int:
    """Take one step of the length of `factors`; on failure restore the state, except its inputs.

    A `last` attempt follows the solution path where the contact set does not converge; others end
    with PASSED where an obstruction fails on the way.
    """
    work, options = run.work, run.options
    inertia, viscosity, span = factors.inertia, factors.viscosity, (time, factors.h)
    predict(run, state, factors)
    save_contact_set(run, state)
    code = iterate_contact_set(run, state)
    if rods is not None:  # noqa: SIM102, this alone is left out where there are none
        if code == CONVERGED:
            code = iterate_rods(run, state, rods, span)
    if code == NOT_CONVERGED and last:
        copy(work.q_start, state.q)
        copy(work.g_start, state.g)
        copy(inputs[0], state.inputs)
        restore_contact_set(run, state)
        rebuild(run, state, options.halvings)
        code = follow_path(run, state, inputs, inertia, viscosity)
        if rods is not None:  # noqa: SIM102, as above
            if code == CONVERGED:
                code = meet_rods(rods, state, span)
    if code == CONVERGED and (
        is_inaccurate(run, state, inertia, viscosity)
        or state.counters[COUNT_RECENT] >= REBUILD_AFTER
    ):
        if state.counters[COUNT_RECENT] > 0:
            # the contact set is known; solve again with columns that carry no rounding of updates
            rebuild(run, state, state.counters[LEVEL])
            code = iterate_contact_set(run, state)
        if code == CONVERGED and measure_residual(run, state, inertia, viscosity):
            refine(run, state)
            evaluate(run, state)
            state.drift[0] = DRIFTS
    if code == CONVERGED and _can_locate(options, state.counters[LEVEL]):  # noqa: SIM102, as above
        if passes_failure(run, state):
            code = PASSED
    if code == CONVERGED:
        correct(run, state, factors)
        return code
    copy(work.q_start, state.q)
    copy(work.g_start, state.g)
    restore_contact_set(run, state)
    return code


@compiled
def _can_locate(options: Options, level: int) -> bool:
    """Return whether the pieces of a level may be halved to locate a failure."""
    return level < options.halvings and options.step >= SHORTEST_PIECE * (2 << level)


@compiled_part
def _advance(
    run: Run,
    state: State,
    nominal: Factors,
    inputs: tuple[Floats, Floats],
    time: float,
    rods: Rods | None,
) -> int:
    """Advance by one nominal step from `time` [s], in one piece or in halved pieces.

    `nominal` are the factors of a step in one piece. Where an obstruction fails, the smallest piece
    ends there, and so small are those that follow.
    """
    work, options = run.work, run.options
    first, last = inputs
    n_pieces = 1 << options.halvings
    position, level, fails = 0, 0, False
    factors = nominal
    if has_just_broken(run, state):
        while _can_locate(options, level):
            level += 1
        factors = switch_level(run, state, level)
    begin, end = work.inputs_start, work.inputs_end
    while position < n_pieces:
        size = n_pieces >> level
        share = 1.0 if position + size == n_pieces else (position + size) / n_pieces
        for k in range(last.size):
            begin[k] = state.inputs[k]
            state.inputs[k] = first[k] + share * (last[k] - first[k])
            end[k] = state.inputs[k]
        begun = time + position / n_pieces * options.step
        if rods is not None:
            move_rods(rods, state, end, (begun, factors.h))
        last_attempt = options.follow_path and level == options.halvings
        code = _try_step(run, state, factors, (begin, end), last_attempt, rods, begun)
        if code != CONVERGED:
            copy(begin, state.inputs)
            fails |= code == PASSED
            level += 1
            if level > options.halvings:
                return code
            state.counters[COUNT_HALVED] += 1
            factors = switch_level(run, state, level)
            continue
        if level > 0 or last_attempt:
            work.unconverged[:] = 0
        if rods is not None:
            accept_rods(run, state, rods, begin, (begun, factors.h))
        account_laws(run, state, begin, time + share * options.step)
        account_friction(run, state)
        position += size
        if fails and position < n_pieces:
            now = time + share * options.step
            count = update_obstructions(run, state, now)
            update_marked(run, state, count)
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
def store_instant(run: Run, state: State, at: int) -> None:
    """Write the present instant to its places in the record."""
    system, work, record = run.system, run.work, run.record
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
        store_seen(run, state, kept)
    balanced = record.places[at, 2] if listed else at
    if balanced >= 0:
        store_energy(run, state, record.stored[balanced])
        for column in range(state.ledger.size):
            record.ledger[balanced, column] = state.ledger[column]
    for k in range(record.watched.size):
        record.effort[k, at] = work.force[record.watched[k]]


@compiled_part
def _stands_still(run: Run, state: State, inputs: tuple[Floats, Floats]) -> bool:
    """Return whether a step between two positions of the markers would change nothing.

    Then neither columns nor rows have changed since the last solution, and everything is at rest.
    """
    first, last = inputs
    unchanged = state.counters[UNSOLVED] == 0 and state.counters[COUPLED] == 1
    for k in range(first.size):
        unchanged = unchanged and first[k] == last[k]
    return unchanged and is_at_rest(state, run.options.step, run.options.gap)


@compiled
def march(
    run: Run, state: State, first: int, last: int, rods: Rods | None = None
) -> tuple[int, int]:
    """Step from instant `first` to instant `last`; return the outcome code and the instant reached.

    It ends early where machines that it waits for have arrived.

    Parameters
    ----------
    first, last : int
        Rows of ``run.positions``; the state is that of instant `first`, its columns those of the
        nominal step. Splitting a march into several changes no bit of the result.
    rods : Rods, optional
        Of drives that are machines; their inputs are written as they come to be.
    """
    options, inputs, record, courses = run.options, run.positions, run.record, run.courses
    nominal = step_factors(options, options.step)
    whole = int(np.int64(0))  # a literal is another type: all it reaches would compile once more
    row, remaining = first // options.stride, options.stride - first % options.stride
    for n in range(first, last):
        time = n * options.step
        if options.inertia and state.counters[LEVEL] != 0:
            switch_level(run, state, whole)
        count = switch_laws(run, state, time + options.step)
        update_marked(run, state, count)
        pair, free = (inputs[n], inputs[n + 1]), True
        if rods is not None:
            free = rods_may_stay(rods, pair, (time, options.step))
        if free and options.inertia and _stands_still(run, state, pair):
            code = CONVERGED
            if rods is not None:
                repeat_rods(rods, (time, options.step))
        elif options.inertia:
            code = _advance(run, state, nominal, pair, time, rods)
        else:
            span = (time, time + options.step)
            code = advance_static(run, state, pair, span)
        if code != CONVERGED:
            return code, n
        remaining -= 1
        if rods is not None:
            store_rods(run, state, rods, inputs[n + 1], row + 1 if remaining == 0 else -1)
        if remaining == 0:
            row, remaining = row + 1, options.stride
            store_instant(run, state, row)
            if row % MEASURE_EVERY == 0:
                residual = equilibrium_residual(run, state)
                record.residual[0] = max(record.residual[0], residual)
        now = time + options.step
        count = update_obstructions(run, state, now)
        if courses.friction.size or courses.excess.size:
            count = update_courses(run, state, n, count)
        update_marked(run, state, count)
        if options.inertia and (n + 1) % MEASURE_EVERY == 0:
            state.drift[0] = max(state.drift[0], DRIFTS)  # errors at rest may have grown
        if rods is not None:  # noqa: SIM102, as above
            if have_arrived(rods, n + 1):
                return CONVERGED, n + 1
    return CONVERGED, last


@compiled
def march_with_machines(
    run: Run, state: State, first: int, last: int, rods: Rods
) -> tuple[int, int]:
    """Step as `march` with drives that are machines, as a kernel with a cache of its own."""
    return march(run, state, first, last, rods)
