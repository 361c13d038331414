"""One implicit step: predict, solve, check every law, flip what changed, until nothing changes.

With an unchanged contact set a solution is a few small matrix-vector products. A set change costs
one rank-one update a row. Modal coordinates are found once the set has settled. Law checks compare
the solution with the segment or friction branch that it was computed with; the last solution of a
converged step satisfies every law.
"""

from typing import NamedTuple

import numpy as np

from turnout.integrate.columns import update_row
from turnout.integrate.scratch import Work
from turnout.integrate.solution import set_modes, solve_set
from turnout.integrate.state import COUNT_ITERATIONS, State, set_segment
from turnout.integrate.system import Floats, Ints, System
from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import (
    LANES,
    absolute,
    any_true,
    broadcast,
    gather,
    greater,
    load,
    logical_or,
    select,
    store,
)
from turnout.kernels.vector import copy
from turnout.law.kernel import (
    STICK,
    any_not_finite,
    friction_state,
    segment_for,
)
from turnout.law.table import LawTable

CONVERGED, NOT_CONVERGED, NOT_FINITE, STOPPED = 0, 1, 2, 4


class Tolerances(NamedTuple):
    """Violations that are overlooked, and the iterations a step may take."""

    gap: float
    force: float
    iterations: int


@compiled
def mark_row(work: Work, count: int, row: int) -> int:
    """Add a row to the list of rows to be updated, once; its laws have changed."""
    work.changed[0] = 1
    if work.dirty[row]:
        return count
    work.dirty[row] = 1
    work.dirty_list[count] = row
    return count + 1


@compiled
def mark_law(
    system: System, table: LawTable, state: State, work: Work, count: int, law: int
) -> int:
    """Mark the row of a law and the rows of slipping frictions that it limits."""
    count = mark_row(work, count, table.row[law])
    for i in range(system.normal_friction_start[law], system.normal_friction_start[law + 1]):
        friction = system.normal_friction_list[i]
        if state.friction[friction] != STICK:
            count = mark_row(work, count, table.friction_row[friction])
    return count


@compiled
def update_marked(system: System, table: LawTable, state: State, work: Work, count: int) -> None:
    """Bring every marked row to the present law states."""
    for i in range(count):
        row = work.dirty_list[i]
        work.dirty[row] = 0
        update_row(system, table, state, row, work.row)


@compiled_part
def evaluate_laws(table: LawTable, state: State, work: Work, gap: float) -> bool:
    """Write the displacement of every law's row, less its input [m], and what it resists with [N].

    The force is that of the present segment, as in the solution: a contact that ends within the
    overlooked gap pulls by a trace. Returns whether any has left its segment by more than that.
    """
    line = (state.slope, state.constant)
    bounds = (state.lower, state.upper)
    return _try_laws(
        state.g, table.row, work.law_input, line, bounds, gap, work.argument, work.force
    )


@compiled_loop
def _try_laws(
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
    overlooked = broadcast(gap)
    outside = greater(overlooked, overlooked)
    for i in range(0, forces.size, LANES):
        at = gather(g, row, i) - load(inputs, i)
        store(at, arguments, i)
        store(load(slope, i) * at + load(constant, i), forces, i)
        above = greater(at, load(upper, i) + overlooked)
        outside = logical_or(outside, logical_or(above, greater(load(lower, i) - overlooked, at)))
    return any_true(outside)


@compiled_part
def evaluate_frictions(table: LawTable, state: State, work: Work, force: float) -> bool:
    """Write the elastic force of every friction and the limit from its normal law [N].

    ``work.force`` is that of the solution. Returns whether any contradicts its branch by more than
    a force that is overlooked [N].
    """
    of_normals = (work.force, table.friction_normal, table.friction_coefficient)
    springs = (state.anchor, table.stick_stiffness)
    return _try_frictions(
        of_normals, state.g, table.friction_row, springs, state.friction, force,
        work.trial, work.limit,
    )  # fmt: skip


@compiled_loop
def _try_frictions(
    of_normals: tuple[Floats, Ints, Floats],
    g: Floats,
    row: Ints,
    springs: tuple[Floats, Floats],
    branches: Floats,
    overlooked: float,
    trials: Floats,
    limits: Floats,
) -> bool:
    force, normal, coefficient = of_normals
    anchor, stiffness = springs
    zero, never, trace = broadcast(0.0), broadcast(-np.inf), broadcast(overlooked)
    contradicted = greater(zero, zero)
    for i in range(0, trials.size, LANES):
        limit = load(coefficient, i) * gather(force, normal, i)
        trial = load(stiffness, i) * (gather(g, row, i) - load(anchor, i))
        store(limit, limits, i)
        store(trial, trials, i)
        branch = load(branches, i)
        slips, presses = greater(absolute(branch), zero), greater(limit, zero)
        most = select(presses, limit, zero)
        # who sticks contradicts by holding too much, who slips by being held by less than the limit
        more = select(slips, select(presses, most - trace, never), absolute(trial))
        contradicted = logical_or(
            contradicted, greater(more, select(slips, branch * trial, most + trace))
        )
    return any_true(contradicted)


@compiled
def evaluate(table: LawTable, state: State, work: Work) -> None:
    """Write what laws and frictions make of the displacements last solved for."""
    evaluate_laws(table, state, work, 0.0)
    evaluate_frictions(table, state, work, 0.0)


@compiled_part
def check_segments(
    system: System, table: LawTable, state: State, work: Work, gap: float, one_at_a_time: bool
) -> int:
    """Move laws whose argument has left its segment; return how many rows are marked.

    Their forces become those of the new segment.
    """
    if not evaluate_laws(table, state, work, gap):
        return 0
    at, lower, upper = work.argument, state.lower, state.upper
    count = 0
    for law in range(at.size):
        if at[law] > upper[law] + gap or at[law] < lower[law] - gap:
            e = at[law] - table.offset[law]
            present = state.segment[law]
            segment = segment_for(table, law, e, present, gap)
            # to the neighbour only: a jump over a segment can go back and forth for ever
            segment = min(max(segment, present - 1), present + 1)
            set_segment(table, state, law, segment)
            work.force[law] = state.slope[law] * at[law] + state.constant[law]
            count = mark_law(system, table, state, work, count, law)
            if one_at_a_time:
                return count
    return count


@compiled_part
def check_frictions(
    table: LawTable, state: State, work: Work, count: int, force: float, one_at_a_time: bool
) -> int:
    """Move friction laws between stick and slip; return how many rows are marked in all."""
    if not evaluate_frictions(table, state, work, force):
        return count
    trial, limit, branches = work.trial, work.limit, state.friction
    for friction in range(trial.size):
        most = max(limit[friction], 0.0)
        branch = friction_state(trial[friction], most, branches[friction], force)
        if branch != branches[friction]:
            branches[friction] = branch
            count = mark_row(work, count, table.friction_row[friction])
            if one_at_a_time:
                return count
    return count


@compiled_part
def check_laws(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    one_at_a_time: bool,
) -> int:
    """Move every law (or the first) that its solution contradicts; return how many rows changed."""
    count = check_segments(system, table, state, work, tolerances.gap, one_at_a_time)
    if one_at_a_time and count > 0:
        return count
    return check_frictions(table, state, work, count, tolerances.force, one_at_a_time)


@compiled
def settle(
    system: System, table: LawTable, state: State, work: Work, tolerances: Tolerances
) -> int:
    """Iterate the contact set of one step; return CONVERGED or what kept it from that.

    After half of the iterations laws change one at a time, which breaks cycles in which several
    laws undo each other.
    """
    for iteration in range(tolerances.iterations):
        solve_set(system, table, state, work)
        state.counters[COUNT_ITERATIONS] += 1
        if any_not_finite(state.g):
            return NOT_FINITE
        if work.stop[0]:
            return STOPPED
        one_at_a_time = 2 * iteration > tolerances.iterations
        count = check_laws(system, table, state, work, tolerances, one_at_a_time)
        if count == 0:
            set_modes(system, state)
            return CONVERGED
        if iteration == tolerances.iterations - 1:
            copy(work.dirty, work.unsettled)
        update_marked(system, table, state, work, count)
    return NOT_CONVERGED


@compiled_part
def save_set(state: State, work: Work) -> None:
    """Save the displacements, and the contact set if it has changed since it was saved."""
    copy(state.g, work.g_start)
    if work.changed[0]:
        copy(state.segment, work.old_segment)
        copy(state.friction, work.old_friction)
        work.changed[0] = 0


@compiled
def restore_set(system: System, table: LawTable, state: State, work: Work) -> None:
    """Go back to the contact set saved in `work`."""
    count = 0
    for law in range(table.row.size):
        if state.segment[law] != work.old_segment[law]:
            set_segment(table, state, law, work.old_segment[law])
            count = mark_law(system, table, state, work, count, law)
    for friction in range(table.friction_row.size):
        if state.friction[friction] != work.old_friction[friction]:
            state.friction[friction] = work.old_friction[friction]
            count = mark_row(work, count, table.friction_row[friction])
    # a friction that returned to slip after its normal law was handled still needs its row
    for friction in range(table.friction_row.size):
        count = mark_row(work, count, table.friction_row[friction])
    update_marked(system, table, state, work, count)


@compiled
def row_forces(system: System, table: LawTable, state: State, force: Floats) -> None:
    """Write the deviation force of every row from the laws' own forces [N]."""
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
