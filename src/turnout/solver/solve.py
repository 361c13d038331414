r"""Contact-set iteration of one implicit step: solve, check every law, flip those that changed.

With an unchanged contact set a solution is a few small matrix-vector products; each row that
changes costs one rank-one update. The check compares the solution with the segment or friction
branch of every law that it was computed with, so the last solution of a converged step satisfies
every law. Modal coordinates are gathered once the set has converged.

Rows that join two blocks (links, stops against a rail that bends, objects) are solved last. With
the compliance :math:`H` between them, assembled from the columns of their ends
(`turnout.solver.columns`),

.. math:: (I - D H)\,\lambda = D g_0 + b

where :math:`g_0` are the joining displacements without the joining forces. This small dense matrix
is factorised by rows with partial pivoting, and kept until a column of an end changes.

Each rank-one update multiplies the rounding errors of the columns by about its divisor or the
inverse, whichever is larger: a stiff stop that closes leaves small differences of large numbers,
one that opens amplifies them. `State.drift` is the product since the residual was last measured;
beyond `DRIFTS` the solution is put into the equations

.. math:: e = \Phi q + R\lambda + r, \qquad A q = p + \Phi^T\lambda

with the deviations :math:`\lambda` from the law table. The columns must be rebuilt if the error of
an end exceeds `LARGEST_ERROR`, or if the modal residual does so much work in the step that the
energy balance would show it, `LARGEST_LEAK`.
"""

import numpy as np

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
from turnout.kernels.vector import (
    add_multiple,
    add_scaled,
    add_weighted_rows,
    copy,
    dot,
    gather_all,
    sum_weighted_rows,
)
from turnout.law.friction import friction_state, trials_and_limits
from turnout.law.kernel import any_not_finite, segment_for
from turnout.solver.columns import force_from, mark_law, mark_row, update_marked
from turnout.solver.energy import MARKERS
from turnout.solver.state import (
    COUNT_ITERATIONS,
    COUNT_JOINING,
    COUPLED,
    FRICTIONS,
    LAWS,
    UNSOLVED,
    Run,
    State,
    set_segment,
)
from turnout.solver.system import Floats, Ints, System


@compiled
def solve_displacements(run: Run, state: State) -> None:
    """Solve for all displacements of the present contact set from ``work.right_side``.

    Blocks whose columns and right side are the same (`UNSOLVED`) move as in the last solution but
    for the forces of inputs and joining rows.
    """
    system, work = run.system, run.work
    end_start, mode_start = system.end_start, system.mode_start
    force, g, columns = work.right_side, state.g, state.mode_columns
    constant = state.constant_column
    for block in range(end_start.size - 1):
        first, last = mode_start[block], mode_start[block + 1]
        start, stop = end_start[block], end_start[block + 1]
        free = work.free[start:stop]
        if state.counters[UNSOLVED] >> block & 1:
            sum_weighted_rows(constant[start:stop], force[first:last], columns[first:last], free)
        copy(free, g[start:stop])
    state.counters[UNSOLVED] = 0
    _evaluate_inputs(run, state)
    gather_all(work.input_force, system.input_end, work.input_end_force)
    _apply_end_forces(run, state, system.input_end, work.input_end_force)
    if state.counters[COUNT_JOINING]:
        apply_joining_forces(run, state, 1.0)
    else:
        state.counters[COUPLED] = 1
    expand_displacements(run, state)


@compiled_part
def _evaluate_inputs(run: Run, state: State) -> None:
    """Write the inputs of all laws [m] and their forces on the rows [N]; a row may have several."""
    system, table, work = run.system, run.table, run.work
    force = work.input_force
    for k in range(system.input_row.size):
        force[system.input_row[k]] = 0.0
    for k in range(system.input_law.size):
        law = system.input_law[k]
        work.law_input[law] = state.inputs[table.input_index[law]]
        force[table.row[law]] += state.slope[law] * work.law_input[law]


@compiled_part
def expand_displacements(run: Run, state: State) -> None:
    """Write the displacements of following ends and joining rows from those of the leading ends."""
    system = run.system
    leaders, weights = system.follower_list, system.follower_weight
    _expand_followers(state.g, leaders, weights, state.g[system.follower_start[0] :])
    _sum_joining_ends(state.g, system.joining_ends, state.g[system.follower_start[-1] :])


@compiled_loop
def _expand_followers(g: Floats, leaders: Ints, weights: Floats, following: Floats) -> None:
    for i in range(0, leaders.shape[1], LANES):
        sums = broadcast(0.0)
        for term in range(leaders.shape[0]):
            sums = sums + load(weights[term], i) * gather(g, leaders[term], i)
        store(sums, following, i)


@compiled_loop
def _sum_joining_ends(g: Floats, ends: Ints, joining: Floats) -> None:
    for i in range(0, ends.shape[1], LANES):
        store(gather(g, ends[0], i) + gather(g, ends[1], i), joining, i)


@compiled_part
def _apply_end_forces(run: Run, state: State, ends: Ints, force: Floats) -> None:
    """Add the displacements from forces on active ends."""
    system = run.system
    for k in range(force.size):
        block = system.block_of_end[ends[k]]
        block_g = state.g[system.end_start[block] : system.end_start[block + 1]]
        add_multiple(force[k], state.columns[state.slot_of_end[ends[k]]], block_g)


@compiled
def apply_joining_forces(run: Run, state: State, constant: float) -> None:
    """Solve for the forces of the joining rows, and add the displacements from them.

    `constant` is 1 for a solution; 0 for a correction, which leaves out the forces that do not
    depend on displacements.
    """
    system, work = run.system, run.work
    count = state.counters[COUNT_JOINING]
    if state.counters[COUPLED] != 1:
        assemble_coupling(run, state)
    force = work.joining[:count]
    for i in range(count):
        row = state.joining[i]
        gap = 0.0
        for side in range(2):
            end = system.row_ends[row, side]
            first = system.end_start[system.block_of_end[end]]
            gap += value_at_end(system, state.g[first:], end)
        entry = state.entries[system.pattern_start[row]]
        force[i] = constant * (state.shift[row] + work.input_force[row]) + entry * gap
    solve_coupling(state.coupling, state.pivots, force)
    for side in range(2):
        for i in range(count):
            work.coupled_end[i] = system.row_ends[state.joining[i], side]
        _apply_end_forces(run, state, work.coupled_end, force)


@compiled
def evaluate_deviation_forces(run: Run, state: State) -> None:
    """Write the deviation force of every active end to ``work.slot_force`` [N]."""
    system, work = run.system, run.work
    row_of_slot, shift = state.row_of_slot, state.shift
    slot_force, input_force = work.slot_force, work.input_force
    pattern_start, pattern_list, entries = system.pattern_start, system.pattern_list, state.entries
    g = state.g
    _evaluate_inputs(run, state)
    for block in range(system.end_start.size - 1):
        first = system.slot_start[block]
        for slot in range(first, first + state.slots[block]):
            row = row_of_slot[slot]
            force = shift[row] + input_force[row]
            for k in range(pattern_start[row], pattern_start[row + 1]):
                force += entries[k] * g[pattern_list[k]]
            slot_force[slot] = force


@compiled_part
def gather_modes(run: Run, state: State) -> None:
    """Gather the modal coordinates from the displacements."""
    system = run.system
    gather_all(state.g, system.mode_place, state.q)


@compiled
def assemble_coupling(run: Run, state: State) -> None:
    """Assemble and factorise the matrix of the joining rows."""
    system, matrix = run.system, state.coupling
    count = state.counters[COUNT_JOINING]
    for i in range(count):
        row = state.joining[i]
        entry = state.entries[system.pattern_start[row]]
        for j in range(count):
            total = _compliance_between(run, state, row, state.joining[j])
            matrix[i, j] = (1.0 if i == j else 0.0) - entry * total
    _factorise(matrix, state.pivots, count)
    state.counters[COUPLED] = 1


@compiled
def blocks_of(system: System, row: int) -> int:
    """Return the blocks that a row joins, a bit each."""
    one, other = system.row_ends[row, 0], system.row_ends[row, 1]
    bits: int = (1 << system.block_of_end[one]) | (1 << system.block_of_end[other])
    return bits


@compiled
def _compliance_between(run: Run, state: State, row: int, other: int) -> float:
    """Return the displacement of a joining row under a unit force on another one [m/N]."""
    system = run.system
    total = 0.0
    for side in range(2):
        end = system.row_ends[row, side]
        block = system.block_of_end[end]
        for other_side in range(2):
            other_end = system.row_ends[other, other_side]
            if system.block_of_end[other_end] == block:
                total += value_at_end(system, state.columns[state.slot_of_end[other_end]], end)
    return total


@compiled
def value_at_end(system: System, column: Floats, end: int) -> float:
    """Return the value of a column of a block at one of its ends."""
    start, follower = system.end_start[system.block_of_end[end]], end - system.follower_start[0]
    if follower < 0:
        value: float = column[end - start]
        return value
    total = 0.0
    for term in range(system.follower_list.shape[0]):
        weight = system.follower_weight[term, follower]
        if weight != 0.0:
            total += weight * column[np.int64(system.follower_list[term, follower]) - start]
    return total


@compiled
def _factorise(matrix: Floats, exchange: Ints, count: int) -> None:
    """Factorise a matrix in place, with reciprocals of the pivots on the diagonal.

    A singular one becomes NaN or infinite.
    """
    for k in range(count):
        pivot = k
        for i in range(k + 1, count):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        exchange[k] = pivot
        if pivot != k:
            for j in range(count):
                saved = matrix[k, j]
                matrix[k, j] = matrix[pivot, j]
                matrix[pivot, j] = saved
        matrix[k, k] = 1.0 / matrix[k, k]
        for i in range(k + 1, count):
            factor = matrix[i, k] * matrix[k, k]
            matrix[i, k] = factor
            if factor != 0.0:
                for j in range(k + 1, count):
                    matrix[i, j] -= factor * matrix[k, j]


@compiled
def solve_coupling(matrix: Floats, exchange: Ints, force: Floats) -> None:
    """Solve the factorised system for the right side `force`, in place."""
    count = force.size
    for k in range(count):
        pivot = exchange[k]
        if pivot != k:
            saved = force[k]
            force[k] = force[pivot]
            force[pivot] = saved
    for i in range(count):
        total = force[i]
        for j in range(i):
            total -= matrix[i, j] * force[j]
        force[i] = total
    for i in range(count - 1, -1, -1):
        total = force[i]
        for j in range(i + 1, count):
            total -= matrix[i, j] * force[j]
        force[i] = total * matrix[i, i]


CONVERGED, NOT_CONVERGED, NOT_FINITE = 0, 1, 2

NO_NUMBERS = -1
"""In place of a number of rows: displacements are NaN or infinite."""

ALL_AT_ONCE = 8
"""Share of the iterations, one in so many, in which every violated law changes; then one law does.

Of the 40 of a step these are the first five, and nearly all sets settle within four. What has not
done so goes in a cycle, in which several laws undo each other.
"""


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
    for law in range(argument.size):
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
    for friction in range(trial.size):
        positive_limit = max(limit[friction], 0.0)
        branch = friction_state(trial[friction], positive_limit, branches[friction], force)
        if branch != branches[friction]:
            branches[friction] = branch
            count = mark_row(work, count, table.friction_row[friction])
            if one_at_a_time:
                return count
    return count


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
def restore_start(run: Run, state: State) -> None:
    """Restore modal coordinates, displacements and contact set saved in `work`."""
    table, work, count = run.table, run.work, 0
    copy(work.q_start, state.q)
    copy(work.g_start, state.g)
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


DRIFTS = 1e7
"""Growth of rounding errors beyond which the residual is measured [-].

This bound is far above what happens: where it was 1e9, errors were 2e-15 m at most in 256 throws.
"""
LARGEST_ERROR = 1e-12
"""Largest accepted error of an end [m]."""
LARGEST_LEAK = 1e-10
"""Largest accepted work of the modal residual in a step, per 1 J and per work so far [-]."""


@compiled
def _end_errors(run: Run, state: State, force: Floats, error: Floats) -> float:
    """Write the displacement errors of the leading ends under forces [m]; return the largest."""
    system = run.system
    worst = 0.0
    for block in range(system.end_stop.size):
        first, last = system.end_start[block], system.end_stop[block]
        of_block = error[first:last]
        for end in range(first, last):
            error[end] = system.end_load[end] - state.g[end]
        start, stop = system.mode_start[block], system.mode_start[block + 1]
        add_weighted_rows(state.q[start:stop], system.mode_ends[start:stop], of_block)
        for end in range(first, last):
            if force[end] != 0.0:  # beyond the ends rows are zero
                add_multiple(force[end], system.flexibility[end], of_block)
        for end in range(first, last):
            worst = max(worst, abs(error[end]))
    return worst


@compiled
def _scatter_to_leaders(system: System, force: Floats) -> None:
    """Scatter forces on following ends and joining rows to the leading ends (in place)."""
    ends = system.joining_ends
    for row in range(ends.shape[1]):
        for side in range(2):
            force[ends[side, row]] += force[system.follower_start[-1] + row]
    leaders, weights = system.follower_list, system.follower_weight
    for term in range(leaders.shape[0]):
        for end in range(leaders.shape[1]):
            force[leaders[term, end]] += weights[term, end] * force[system.follower_start[0] + end]


@compiled
def _modal_errors(run: Run, state: State, force: Floats, inertia: float, viscosity: float) -> float:
    """Write the residual of the modal equations to ``work.modal_error``.

    Returns its work in the step [J].
    """
    system, work = run.system, run.work
    leak = 0.0
    for block in range(system.end_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        q, error = state.q[first:last], work.modal_error[first:last]
        for i in range(last - first):
            mode = first + i
            total = (inertia + viscosity * system.damping[mode]) * q[i]
            total += dot(q, system.stiffness[mode])
            error[i] = work.right_side[mode] - total
        for end in range(system.end_start[block], system.end_stop[block]):
            if force[end] != 0.0:
                add_scaled(force[end], system.end_modes[end], error)
    for mode in range(state.q.size):
        leak += abs(work.modal_error[mode] * (state.q[mode] - work.q_start[mode]))
    return leak


@compiled
def refine(run: Run, state: State) -> None:
    """Refine the solution by the errors from `measure_residual`, with the same columns."""
    system, work = run.system, run.work
    copy(state.g, work.end_scratch)
    _expand_end_errors(run, state)
    for block in range(system.end_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        solved = state.g[system.end_start[block] : system.end_start[block + 1]]
        add_weighted_rows(work.modal_error[first:last], state.mode_columns[first:last], solved)
    if state.counters[COUNT_JOINING]:
        apply_joining_forces(run, state, 0.0)
    add_scaled(1.0, work.end_scratch, state.g)
    gather_modes(run, state)
    expand_displacements(run, state)


@compiled
def _expand_end_errors(run: Run, state: State) -> None:
    """Write the response of uncoupled blocks to the free displacements ``work.end_error``."""
    system, work = run.system, run.work
    copy(work.end_error, state.g)
    for block in range(system.end_start.size - 1):
        first, last = system.end_start[block], system.end_start[block + 1]
        free, solved = work.end_error[first:last], state.g[first:last]
        start = system.slot_start[block]
        for slot in range(start, start + state.slots[block]):
            row = state.row_of_slot[slot]
            if system.row_ends[row, 1] >= 0:
                continue
            add_scaled(force_from(system, state, row, free), state.columns[slot], solved)


@compiled_part
def is_inaccurate(run: Run, state: State, inertia: float, viscosity: float) -> bool:
    """Return whether the columns are too inaccurate for the present solution.

    The residual is measured only where rounding errors may have grown since the last time.

    Parameters
    ----------
    inertia, viscosity : float
        Factors of identity [1/s2] and damping [1/s] in the matrix of the step.
    """
    if state.drift[0] < DRIFTS:
        return False
    return measure_residual(run, state, inertia, viscosity)


@compiled
def measure_residual(run: Run, state: State, inertia: float, viscosity: float) -> bool:
    """Put the solution into the equations; return whether the residual is too large.

    Errors are written to ``work.end_error`` and ``work.modal_error``; the drift is reset to 1.
    """
    system, work = run.system, run.work
    state.drift[0] = 1.0
    evaluate_deviation_forces(run, state)
    force = work.end_force
    force[:] = 0.0
    for block in range(system.end_stop.size):
        first = system.slot_start[block]
        for slot in range(first, first + state.slots[block]):
            force[state.end_of_slot[slot]] = work.slot_force[slot]
    _scatter_to_leaders(system, force)
    error = _end_errors(run, state, force, work.end_error)
    leak = _modal_errors(run, state, force, inertia, viscosity)
    allowed = LARGEST_LEAK * (1.0 + abs(float(state.ledger[MARKERS])))
    return error > LARGEST_ERROR or leak > allowed


@compiled
def equilibrium_residual(run: Run, state: State) -> float:
    """Return the largest displacement error of the leading ends under the law forces [m].

    It does not use the columns, so that their drift shows.
    """
    system, work = run.system, run.work
    evaluate_row_forces(run, state, work.end_force)
    _scatter_to_leaders(system, work.end_force)
    return _end_errors(run, state, work.end_force, work.end_error)
