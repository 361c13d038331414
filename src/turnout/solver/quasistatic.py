"""The quasi-static integrator: a sequence of equilibria, event by event, without inertia.

Between two instants the markers move in straight lines, and with piecewise-linear laws so do the
rails, until a law leaves its segment or a foot its branch. At each such event work is added up, the
anchors of slipping feet are moved, the law is changed, and the path continues from that place.
There is no iteration, and the step only sets how finely the path of the markers is resolved.

With a friction limit that follows the momentary normal force a path of equilibria can end: a foot
can neither stick nor slip. The laws then change without progress along the path, and the run ends
with an outcome code.
"""

from turnout.kernels.compiled import compiled
from turnout.kernels.vector import copy
from turnout.law.kernel import any_not_finite
from turnout.solver.energy import account_friction, account_laws
from turnout.solver.follow import EVENTS_AT_ONE_PLACE, apply_event, find_next_event
from turnout.solver.solution import gather_modes, solve_displacements
from turnout.solver.solve import (
    CONVERGED,
    NOT_FINITE,
    evaluate,
    save_contact_set,
)
from turnout.solver.state import COUNT_ITERATIONS, UNSOLVED, Run, State
from turnout.solver.system import Floats

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
    inputs_start, inputs_end = work.inputs_start, work.inputs_end
    copy(inputs[0], inputs_start)
    copy(inputs[1], inputs_end)
    copy(system.load, work.right_side)
    state.counters[UNSOLVED] = -1
    progress, stalled = 0.0, 0
    save_contact_set(run, state)
    while stalled < EVENTS_AT_ONE_PLACE:
        _solve_at(run, state, inputs_end, inputs_end, 1.0)
        copy(state.g, work.g_end)
        _solve_at(run, state, inputs_start, inputs_end, 0.0)
        state.counters[COUNT_ITERATIONS] += 1
        if any_not_finite(work.g_end):
            return NOT_FINITE
        share, which, to = find_next_event(run, state, (work.g_end, inputs_end))
        _solve_at(run, state, inputs_start, inputs_end, share)
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


@compiled
def _solve_at(
    run: Run, state: State, inputs_start: Floats, inputs_end: Floats, share: float
) -> None:
    """Solve for the equilibrium of the present contact set at a share of the piece [0 to 1]."""
    for k in range(state.inputs.size):
        state.inputs[k] = inputs_start[k] + share * (inputs_end[k] - inputs_start[k])
    solve_displacements(run, state)
