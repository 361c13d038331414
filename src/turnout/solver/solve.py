"""Contact-set iteration of one implicit step: solve, check every law, flip those that changed.

With an unchanged contact set a solution is a few small matrix-vector products; each row that
changes costs one rank-one update. The check compares the solution with the segment or friction
branch of every law that it was computed with, so the last solution of a converged step satisfies
every law. Modal coordinates are gathered once the set has converged.
"""

from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import (
    LANES,
    any_true,
    broadcast,
    gather,
    greater,
    greater_or_nan,
    load,
    logical_or,
    store,
)
from turnout.kernels.vector import copy
from turnout.law.friction import STICK, branch_violated, friction_state, trials_and_limits
from turnout.law.kernel import any_not_finite, segment_for
from turnout.solver.columns import finish_pending, update_row
from turnout.solver.solution import gather_modes, solve_displacements
from turnout.solver.state import COUNT_ITERATIONS, FRICTIONS, LAWS, Run, State, Work, set_segment
from turnout.solver.system import Floats, Ints

CONVERGED, NOT_CONVERGED, NOT_FINITE = 0, 1, 2

NO_NUMBERS = -1
"""In place of a number of rows: displacements are NaN or infinite."""

ALL_AT_ONCE = 8
"""Share of the iterations, one in so many, in which every violated law changes; then one law does.

Of the 40 of a step these are the first five, and nearly all sets settle within four. What has not
done so goes in a cycle, in which several laws undo each other.
"""


@compiled
def mark_row(work: Work, count: int, row: int) -> int:
    """Add a row to the list of rows to be updated, once; its laws have changed."""
    work.changed[FRICTIONS] = 1  # or laws, as `mark_law` says
    if work.dirty[row]:
        return count
    work.dirty[row] = 1
    work.dirty_list[count] = row
    return count + 1


@compiled
def mark_law(run: Run, state: State, count: int, law: int) -> int:
    """Mark the row of a law and the rows of slipping frictions that it limits."""
    system, table, work = run.system, run.table, run.work
    work.changed[LAWS] = 1
    count = mark_row(work, count, table.row[law])
    for i in range(system.normal_friction_start[law], system.normal_friction_start[law + 1]):
        friction = system.normal_friction_list[i]
        if state.friction[friction] != STICK:
            count = mark_row(work, count, table.friction_row[friction])
    return count


@compiled
def update_marked(run: Run, state: State, count: int) -> None:
    """Update every marked row to the present states of its laws."""
    work = run.work
    for i in range(count):
        row = work.dirty_list[i]
        work.dirty[row] = 0
        update_row(run, state, row, defer=True)
    finish_pending(run, state)


@compiled_part
def evaluate_laws(run: Run, state: State, gap: float) -> bool:
    """Evaluate argument [m] (row displacement less input) and force [N] of every law.

    The force is that of the present segment, as in the solution: a contact that ends within the
    tolerance pulls slightly. Returns whether any law has left its segment by more than `gap`, or
    has no number as its argument.
    """
    table, work = run.table, run.work
    line = (state.slope, state.constant)
    bounds = (state.lower, state.upper)
    return _evaluate_laws(
        state.g, table.row, work.law_input, line, bounds, gap, work.argument, work.force
    )


@compiled_loop
def _evaluate_laws(
    g: Floats,
    row: Ints,
    inputs: Floats,
    line: tuple[Floats, Floats],
    bounds: tuple[Floats, Floats],
    gap: float,
    arguments: Floats,
    forces: Floats,
) -> bool:
    slope, constant = line
    lower, upper = bounds
    tolerance = broadcast(gap)
    outside = greater(tolerance, tolerance)
    for i in range(0, forces.size, LANES):
        argument = gather(g, row, i) - load(inputs, i)
        store(argument, arguments, i)
        store(load(slope, i) * argument + load(constant, i), forces, i)
        above = greater_or_nan(argument, load(upper, i) + tolerance)
        outside = logical_or(
            outside, logical_or(above, greater_or_nan(load(lower, i) - tolerance, argument))
        )
    return any_true(outside)


@compiled_part
def evaluate_frictions(run: Run, state: State, force: float) -> bool:
    """Evaluate the trial force of every friction and its limit from the normal law [N].

    ``work.force`` is that of the solution. Returns whether any friction violates its branch by more
    than `force` [N], or has no number as its force.
    """
    table, work = run.table, run.work
    of_normals = (work.force, table.friction_normal, table.friction_coefficient)
    springs = (state.anchor, table.stick_stiffness)
    return trials_and_limits(
        of_normals, state.g, table.friction_row, springs, state.friction_beyond, state.friction,
        force, work.trial, work.limit,
    )  # fmt: skip


@compiled
def evaluate(run: Run, state: State) -> None:
    """Evaluate all laws and frictions at the displacements last solved for."""
    evaluate_laws(run, state, 0.0)
    evaluate_frictions(run, state, 0.0)


@compiled_part
def update_segments(run: Run, state: State, one_at_a_time: bool) -> int:
    """Move laws whose argument has left its segment; return how many rows are marked.

    Their forces become those of the new segment. Returns `NO_NUMBERS` where there is no solution.
    """
    table, work, gap = run.table, run.work, run.options.gap
    if not evaluate_laws(run, state, gap):
        return 0
    if any_not_finite(state.g):
        return NO_NUMBERS
    argument, lower, upper = work.argument, state.lower, state.upper
    count = 0
    for first in range(0, argument.size, LANES):
        if not _any_outside(argument, lower, upper, gap, first):
            continue
        for law in range(first, min(first + LANES, argument.size)):
            if argument[law] > upper[law] + gap or argument[law] < lower[law] - gap:
                e = argument[law] - table.offset[law]
                present = state.segment[law]
                segment = segment_for(table, law, e, present, gap)
                # to the neighbour only: a jump over a segment can go back and forth for ever
                segment = min(max(segment, present - 1), present + 1)
                set_segment(table, state, law, segment)
                work.force[law] = state.slope[law] * argument[law] + state.constant[law]
                count = mark_law(run, state, count, law)
                if one_at_a_time:
                    return count
    return count


@compiled_loop
def _any_outside(argument: Floats, lower: Floats, upper: Floats, gap: float, at: int) -> bool:
    """Return whether one of eight laws has left its segment."""
    tolerance, value = broadcast(gap), load(argument, at)
    above = greater(value, load(upper, at) + tolerance)
    return any_true(logical_or(above, greater(load(lower, at) - tolerance, value)))


@compiled_part
def update_branches(run: Run, state: State, count: int, one_at_a_time: bool) -> int:
    """Move frictions between stick and slip; return how many rows are marked in all.

    Returns `NO_NUMBERS` where there is no solution.
    """
    table, work, force = run.table, run.work, run.options.force
    if not evaluate_frictions(run, state, force):
        return count
    if count == 0 and any_not_finite(state.g):
        return NO_NUMBERS
    trial, limit, branches = work.trial, work.limit, state.friction
    for first in range(0, trial.size, LANES):
        if not _any_violated(trial, limit, branches, force, first):
            continue
        for friction in range(first, min(first + LANES, trial.size)):
            positive_limit = max(limit[friction], 0.0)
            branch = friction_state(trial[friction], positive_limit, branches[friction], force)
            if branch != branches[friction]:
                branches[friction] = branch
                count = mark_row(work, count, table.friction_row[friction])
                if one_at_a_time:
                    return count
    return count


@compiled_loop
def _any_violated(
    trials: Floats, limits: Floats, branches: Floats, tolerance: float, at: int
) -> bool:
    """Return whether one of eight frictions violates its branch by more than a force [N]."""
    branch = load(branches, at)
    return any_true(
        branch_violated(load(trials, at), load(limits, at), branch, broadcast(tolerance))
    )


@compiled_part
def update_contact_set(run: Run, state: State, one_at_a_time: bool) -> int:
    """Move every law (or the first) that the solution violates; return how many rows are marked.

    Returns `NO_NUMBERS` where there is no solution.
    """
    count = update_segments(run, state, one_at_a_time)
    if count < 0 or (one_at_a_time and count > 0):
        return count
    return update_branches(run, state, count, one_at_a_time)


@compiled
def iterate_contact_set(run: Run, state: State) -> int:
    """Iterate the contact set of one step; return CONVERGED or what prevented it.

    After the first of them laws change one at a time, which breaks cycles, see `ALL_AT_ONCE`.
    """
    work, options = run.work, run.options
    for iteration in range(options.iterations):
        solve_displacements(run, state)
        state.counters[COUNT_ITERATIONS] += 1
        one_at_a_time = ALL_AT_ONCE * iteration >= options.iterations
        count = update_contact_set(run, state, one_at_a_time)
        if count == 0:
            gather_modes(run, state)
            return CONVERGED
        if count == NO_NUMBERS:
            return NOT_FINITE
        if iteration == options.iterations - 1:
            copy(work.dirty, work.unconverged)
        update_marked(run, state, count)
    return NOT_CONVERGED


@compiled_part
def save_contact_set(run: Run, state: State) -> None:
    """Save the displacements, and the contact set if it has changed since it was saved."""
    work = run.work
    copy(state.g, work.g_start)
    if work.changed[LAWS]:
        copy(state.segment, work.saved_segment)
        work.changed[LAWS] = 0
    if work.changed[FRICTIONS]:
        copy(state.friction, work.saved_friction)
        work.changed[FRICTIONS] = 0


@compiled
def restore_contact_set(run: Run, state: State) -> None:
    """Restore the contact set saved in `work`."""
    table, work = run.table, run.work
    count = 0
    for law in range(table.row.size):
        if state.segment[law] != work.saved_segment[law]:
            set_segment(table, state, law, work.saved_segment[law])
            count = mark_law(run, state, count, law)
    for friction in range(table.friction_row.size):
        if state.friction[friction] != work.saved_friction[friction]:
            state.friction[friction] = work.saved_friction[friction]
            count = mark_row(work, count, table.friction_row[friction])
    # a friction that returned to slip after its normal law was handled still needs its row
    for friction in range(table.friction_row.size):
        count = mark_row(work, count, table.friction_row[friction])
    update_marked(run, state, count)


@compiled
def evaluate_row_forces(run: Run, state: State, force: Floats) -> None:
    """Evaluate the deviation force of every row from the forces of its laws [N]."""
    system, table = run.system, run.table
    force[:] = 0.0
    for law in range(table.row.size):
        row = table.row[law]
        deviation = system.base_slope[law] - state.slope[law]
        force[row] += deviation * state.g[row] - state.constant[law]
    for k in range(system.input_law.size):
        law = system.input_law[k]
        force[table.row[law]] += state.slope[law] * state.inputs[table.input_index[law]]
    for friction in range(table.friction_row.size):
        force[table.friction_row[friction]] -= state.friction_force[friction]
