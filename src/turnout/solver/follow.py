"""Path following, event by event: the last resort of a step, and runs without inertia.

Right side and inputs of a step move in a straight line from values for which the last instant is
the solution to those of the new instant. With piecewise-linear laws the solution is piecewise
linear too, with a kink where a law leaves its segment or a foot its branch; that law is changed,
and the path is followed further. Without guesses the iteration cannot cycle, except where the path
itself turns back; that ends with an outcome code.

A run without inertia is a sequence of equilibria along such paths, each between two positions of
the markers. At each event work is added up and the anchors of slipping feet are moved. The step
only sets how finely the path of the markers is resolved. With a friction limit that follows the
momentary normal force a path of equilibria can end: a foot can neither stick nor slip. The laws
then change without progress along the path, and the run ends with an outcome code.
"""

from turnout.kernels.compiled import compiled
from turnout.kernels.vector import add_scaled, copy, dot
from turnout.law.friction import branch_event, friction_limit, trial_force
from turnout.law.kernel import any_not_finite, share_until_zero
from turnout.solver.columns import mark_law, mark_row, update_marked
from turnout.solver.energy import account_friction, account_laws
from turnout.solver.solve import (
    CONVERGED,
    NOT_CONVERGED,
    NOT_FINITE,
    evaluate,
    evaluate_deviation_forces,
    gather_modes,
    save_contact_set,
    solve_displacements,
)
from turnout.solver.state import COUNT_ITERATIONS, UNSOLVED, Run, State, set_segment
from turnout.solver.system import Floats

EVENTS, EVENTS_AT_ONE_PLACE = 2000, 400
"""Most events of a path, in all and without progress; it is given up beyond."""


@compiled
def _assemble_path_start(run: Run, state: State, inertia: float, viscosity: float) -> None:
    """Assemble the right side for which the present state solves the step."""
    system, work = run.system, run.work
    evaluate_deviation_forces(run, state)
    for block in range(system.mode_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        q, side = state.q[first:last], work.right_side_start[first:last]
        for i in range(last - first):
            mode = first + i
            side[i] = (inertia + viscosity * system.damping[mode]) * q[i]
            side[i] += dot(q, system.stiffness[mode])
        start = system.slot_start[block]
        for slot in range(start, start + state.slots[block]):
            add_scaled(-work.slot_force[slot], system.end_modes[state.end_of_slot[slot]], side)


@compiled
def _solve_at(run: Run, state: State, inputs: tuple[Floats, Floats], share: float) -> None:
    """Solve for the displacements of the present contact set at a share of a path [0 to 1]."""
    for k in range(state.inputs.size):
        state.inputs[k] = inputs[0][k] + share * (inputs[1][k] - inputs[0][k])
    solve_displacements(run, state)


@compiled
def _solve_step_at(run: Run, state: State, inputs: tuple[Floats, Floats], share: float) -> None:
    """Solve as `_solve_at`, with the right side of a step at the same share."""
    work = run.work
    start, end = work.right_side_start, work.right_side_end
    for i in range(work.right_side.size):
        work.right_side[i] = start[i] + share * (end[i] - start[i])
    state.counters[UNSOLVED] = -1
    _solve_at(run, state, inputs, share)


@compiled
def _law_event(
    run: Run, state: State, law: int, end: tuple[Floats, Floats], gap: float
) -> tuple[float, int]:
    """Return where on the path a law leaves its segment [share, 2 for never], and to which side."""
    table = run.table
    row, index = table.row[law], table.input_index[law]
    argument, argument_end = state.g[row], end[0][row]
    if index >= 0:
        argument -= state.inputs[index]
        argument_end -= end[1][index]
    if argument_end > state.upper[law] + gap:
        return share_until_zero(state.upper[law] - argument, state.upper[law] - argument_end), 1
    if argument_end < state.lower[law] - gap:
        return share_until_zero(argument - state.lower[law], argument_end - state.lower[law]), -1
    return 2.0, 0


@compiled
def _friction_event(
    run: Run, state: State, friction: int, end: Floats, force: float
) -> tuple[float, int]:
    """Return where on the path a friction leaves its branch [share, 2 for never], and to which."""
    table = run.table
    normal, row = table.friction_normal[friction], table.friction_row[friction]
    slope, constant = state.slope[normal], state.constant[normal]
    normal_row, stiffness = table.row[normal], table.stick_stiffness[friction]
    coefficient, anchor = table.friction_coefficient[friction], state.anchor[friction]
    beyond = state.friction_beyond[friction]
    limit = friction_limit(coefficient, slope * state.g[normal_row] + constant) + beyond
    limit_end = friction_limit(coefficient, slope * end[normal_row] + constant) + beyond
    trial = trial_force(stiffness, state.g[row], anchor)
    trial_end = trial_force(stiffness, end[row], anchor)
    branch = int(state.friction[friction])
    return branch_event(branch, (trial, trial_end), (limit, limit_end), force)


@compiled
def find_next_event(run: Run, state: State, end: tuple[Floats, Floats]) -> tuple[float, int, int]:
    """Find the first event on the straight path from the present state to `end`.

    Parameters
    ----------
    end : tuple of two ndarray
        Displacements and inputs at the end of the path, for the present contact set [m].

    Returns
    -------
    share, which, to : float, int, int
        Position as a share of the path; the law, or beyond the laws the friction, -1 for none; and
        the side to which a law, or the branch to which a friction changes.
    """
    table, options = run.table, run.options
    share, which, to = 1.0, -1, 0
    n_laws = table.row.size
    for law in range(n_laws):
        candidate, side = _law_event(run, state, law, end, options.gap)
        if candidate < share:
            share, which, to = candidate, law, side
    for friction in range(table.friction_row.size):
        candidate, branch = _friction_event(run, state, friction, end[0], options.force)
        if candidate < share:
            share, which, to = candidate, n_laws + friction, branch
    return share, which, to


@compiled
def apply_event(run: Run, state: State, which: int, to: int) -> None:
    """Change the law or friction of an event and flag its row as unconverged."""
    table, work = run.table, run.work
    n_laws = table.row.size
    if which < n_laws:
        set_segment(table, state, which, state.segment[which] + to)
        count = mark_law(run, state, 0, which)
    else:
        state.friction[which - n_laws] = to
        count = mark_row(work, 0, table.friction_row[which - n_laws])
    for i in range(count):
        work.unconverged[work.dirty_list[i]] = 1
    update_marked(run, state, count)


@compiled
def follow_path(
    run: Run, state: State, inputs: tuple[Floats, Floats], inertia: float, viscosity: float
) -> int:
    """Follow the path from the present state to its end; return CONVERGED or what prevented it.

    Parameters
    ----------
    inputs : tuple of two ndarray, shape (n_inputs,)
        Marker positions at the start and at the end [m].
    inertia, viscosity : float
        Factors of identity [1/s2] and damping [1/s] in the matrix of the step.
    """
    work = run.work
    copy(work.right_side, work.right_side_end)
    _assemble_path_start(run, state, inertia, viscosity)
    share, stalled = 0.0, 0
    for _ in range(EVENTS):
        if stalled >= EVENTS_AT_ONE_PLACE:
            break
        _solve_step_at(run, state, inputs, 1.0)
        copy(state.g, work.g_end)
        _solve_step_at(run, state, inputs, share)
        advance, which, to = find_next_event(run, state, (work.g_end, inputs[1]))
        if which < 0:
            _solve_step_at(run, state, inputs, 1.0)
            gather_modes(run, state)
            evaluate(run, state)
            return CONVERGED
        stalled = stalled + 1 if advance * (1.0 - share) < 1e-12 else 0
        share += advance * (1.0 - share)
        work.unconverged[:] = 0
        apply_event(run, state, which, to)
    return NOT_CONVERGED


NO_CONTINUATION = 6
LEAST_SHARE = 1e-12
"""Events closer than this share of a straight piece count as one place [-]."""


@compiled
def advance_static(
    run: Run, state: State, inputs: tuple[Floats, Floats], times: tuple[float, float]
) -> int:
    """Follow one straight piece of the markers' path; return CONVERGED or what prevented it.

    Parameters
    ----------
    inputs : tuple of two ndarray, shape (n_inputs,)
        Marker positions at the start and at the end [m].
    times : tuple of two float
        Times of the start and the end [s].
    """
    system, work = run.system, run.work
    inputs_start, inputs_end = ends = work.inputs_start, work.inputs_end
    copy(inputs[0], inputs_start)
    copy(inputs[1], inputs_end)
    copy(system.load, work.right_side)
    state.counters[UNSOLVED] = -1
    progress, stalled = 0.0, 0
    save_contact_set(run, state)
    while stalled < EVENTS_AT_ONE_PLACE:
        _solve_at(run, state, (inputs_end, inputs_end), 1.0)
        copy(state.g, work.g_end)
        _solve_at(run, state, ends, 0.0)
        state.counters[COUNT_ITERATIONS] += 1
        if any_not_finite(work.g_end):
            return NOT_FINITE
        share, which, to = find_next_event(run, state, (work.g_end, inputs_end))
        _solve_at(run, state, ends, share)
        gather_modes(run, state)
        progress += share * (1.0 - progress)
        evaluate(run, state)
        time = times[0] + progress * (times[1] - times[0])
        account_laws(run, state, inputs_start, time)
        account_friction(run, state)
        copy(state.inputs, inputs_start)
        if share > LEAST_SHARE:
            stalled = 0
            work.unconverged[:] = 0
        else:
            stalled += 1
        if which < 0:
            return CONVERGED
        save_contact_set(run, state)  # of the work added up so far
        apply_event(run, state, which, to)
    return NO_CONTINUATION
