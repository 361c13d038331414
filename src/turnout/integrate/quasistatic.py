"""The second integrator: from one equilibrium to the next, event by event, without inertia.

Between two instants the markers move in straight lines, and with piecewise-linear laws so do the
rails, until a law leaves its segment or a foot its branch. There the books are made, the anchors of
slipping feet are moved along, the law is changed, and the walk goes on from that very place.
Nothing is iterated and nothing depends on a step but how finely the path of the markers is drawn.

With a friction limit that follows the momentary normal force an equilibrium need not continue: a
foot may neither stick nor slip. The walk then changes laws without getting on, and ends with the
place and the time.
"""

from turnout.integrate.energy import account_friction, account_laws
from turnout.integrate.follow import EVENTS_AT_ONE_PLACE, next_event, take_event
from turnout.integrate.scratch import Work
from turnout.integrate.solution import set_modes, solve_set
from turnout.integrate.solve import (
    CONVERGED,
    NOT_FINITE,
    STOPPED,
    Tolerances,
    evaluate,
    save_set,
)
from turnout.integrate.state import COUNT_ITERATIONS, State
from turnout.integrate.system import Floats, System
from turnout.kernels.compiled import compiled
from turnout.kernels.vector import copy
from turnout.law.kernel import any_not_finite
from turnout.law.table import LawTable

NO_CONTINUATION = 6
LEAST_SHARE = 1e-12
"""An event nearer than this share of a straight piece is at the same place as the last one."""


@compiled
def advance_static(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    inputs: tuple[Floats, Floats],
    times: tuple[float, float],
) -> int:
    """Walk along one straight piece of the markers' path; return CONVERGED or what prevented it.

    Parameters
    ----------
    inputs : tuple of two ndarray, shape (n_inputs,)
        Marker positions at the start and at the end [m].
    times : tuple of two float
        The same for the time [s].
    """
    here, there = work.inputs, work.inputs_end
    copy(inputs[0], here)
    copy(inputs[1], there)
    copy(system.load, work.right_side)
    done, stalled = 0.0, 0
    save_set(state, work)
    while stalled < EVENTS_AT_ONE_PLACE:
        if work.stop[0]:
            return STOPPED
        _rest(system, table, state, work, there, there, 1.0)
        copy(state.g, work.g)
        _rest(system, table, state, work, here, there, 0.0)
        state.counters[COUNT_ITERATIONS] += 1
        if any_not_finite(work.g):
            return NOT_FINITE
        share, which, to = next_event(table, state, (work.g, there), tolerances)
        _rest(system, table, state, work, here, there, share)
        set_modes(system, state)
        done += share * (1.0 - done)
        evaluate(table, state, work)
        time = times[0] + done * (times[1] - times[0])
        account_laws(system, table, state, work, here, time)
        account_friction(system, state, work)
        copy(state.inputs, here)
        if share > LEAST_SHARE:
            stalled = 0
            work.unsettled[:] = 0
        else:
            stalled += 1
        if which < 0:
            return CONVERGED
        save_set(state, work)  # as it was booked
        take_event(system, table, state, work, which, to)
    return NO_CONTINUATION


@compiled
def _rest(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    here: Floats,
    there: Floats,
    share: float,
) -> None:
    """Find the equilibrium of the present contact set at a share of the way."""
    for k in range(state.inputs.size):
        state.inputs[k] = here[k] + share * (there[k] - here[k])
    solve_set(system, table, state, work)
