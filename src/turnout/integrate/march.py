"""The time loop: steps, halved steps, stored instants.

Kernels change `State` in place and return an outcome code; they never raise and never print.
"""

from typing import NamedTuple

from turnout.integrate.accuracy import DRIFTS, correct, equilibrium_residual, is_inaccurate
from turnout.integrate.columns import REBUILD_AFTER, rebuild, refresh_inverse
from turnout.integrate.energy import (
    account_friction,
    account_laws,
    account_modal,
    stored_energy,
    switch_laws,
)
from turnout.integrate.follow import follow_path, start_of_path
from turnout.integrate.solve import (
    CONVERGED,
    NOT_CONVERGED,
    STOPPED,
    Tolerances,
    Work,
    restore_set,
    settle,
    update_marked,
)
from turnout.integrate.system import COUNT_HALVED, COUNT_RECENT, Floats, State, System
from turnout.law.compiled import compiled
from turnout.law.table import LawTable

MEASURE_EVERY = 100
"""After so many steps a solution is measured whatever has happened."""


class Stepping(NamedTuple):
    """Step size and generalised-alpha coefficients."""

    step: float
    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    halvings: int
    follow_path: bool
    stride: int


class Record(NamedTuple):
    """Stored instants, one row each, and the running checks."""

    q: Floats
    g: Floats
    friction: Floats
    law: Floats
    stored: Floats
    ledger: Floats
    residual: Floats


@compiled
def coefficients(stepping: Stepping, h: float) -> tuple[float, float]:
    """Return what multiplies identity and damping in the matrix of the implicit step."""
    kappa = (1.0 - stepping.alpha_f) / (1.0 - stepping.alpha_m)
    return 1.0 / (h * h * stepping.beta * kappa), stepping.gamma / (h * stepping.beta)


@compiled
def _predict(system: System, state: State, work: Work, stepping: Stepping, h: float) -> None:
    """Save the state and write the right side of the implicit step."""
    inertia, viscosity = coefficients(stepping, h)
    share = 1.0 / (1.0 - stepping.alpha_m)
    n_modes = state.q.size
    for i in range(n_modes):
        work.q[i] = state.q[i]
        work.v[i] = state.v[i]
        work.a[i] = state.a[i]
        work.acceleration[i] = state.acceleration[i]
        known = share * (stepping.alpha_f * state.acceleration[i] - stepping.alpha_m * state.a[i])
        work.predicted[i] = (
            state.q[i]
            + h * state.v[i]
            + h * h * ((0.5 - stepping.beta) * state.a[i] + stepping.beta * known)
        )
        work.velocity[i] = state.v[i] + h * (
            (1.0 - stepping.gamma) * state.a[i] + stepping.gamma * known
        )
    for i in range(n_modes):
        total = inertia * work.predicted[i] + system.load[i]
        row = system.damping[i]
        for j in range(n_modes):
            total += row[j] * (viscosity * work.predicted[j] - work.velocity[j])
        work.right_side[i] = total


@compiled
def _correct(state: State, work: Work, stepping: Stepping, h: float) -> None:
    """Complete velocity and accelerations from the solved coordinates."""
    inertia, viscosity = coefficients(stepping, h)
    share = 1.0 / (1.0 - stepping.alpha_m)
    for i in range(state.q.size):
        change = state.q[i] - work.predicted[i]
        state.v[i] = work.velocity[i] + viscosity * change
        state.acceleration[i] = inertia * change
        state.a[i] = share * (
            (1.0 - stepping.alpha_f) * state.acceleration[i]
            + stepping.alpha_f * work.acceleration[i]
            - stepping.alpha_m * work.a[i]
        )


@compiled
def _try_step(
    system: System,
    table: LawTable,
    state: State,
    work: Work,
    tolerances: Tolerances,
    stepping: Stepping,
    h: float,
    inputs: tuple[Floats, Floats],
    last: bool,
) -> int:
    """Take one step of length `h`; on failure leave the state as it was, bar its inputs.

    A `last` attempt follows the path where the contact set does not settle.
    """
    _predict(system, state, work, stepping, h)
    work.g_start[:] = state.g
    work.old_segment[:] = state.segment
    work.old_friction[:] = state.friction
    code = settle(system, table, state, work, tolerances)
    inertia, viscosity = coefficients(stepping, h)
    if code == NOT_CONVERGED and last:
        state.q[:] = work.q
        state.inputs[:] = inputs[0]
        restore_set(system, table, state, work)
        rebuild(system, table, state, inertia, viscosity, work.row)
        aim = work.right_side.copy()
        start = start_of_path(system, table, state, inertia, viscosity)
        code = follow_path(system, table, state, work, tolerances, (start, aim), inputs)
    if code == CONVERGED and (
        is_inaccurate(system, table, state, work, inertia, viscosity)
        or state.counters[COUNT_RECENT] >= REBUILD_AFTER
    ):
        if state.counters[COUNT_RECENT] > 0:
            # the set is found; its solution is taken from columns without a history
            rebuild(system, table, state, inertia, viscosity, work.row)
            code = settle(system, table, state, work, tolerances)
            state.drift[0] = DRIFTS
        if code == CONVERGED and is_inaccurate(system, table, state, work, inertia, viscosity):
            correct(system, state, work)
            state.drift[0] = DRIFTS
    if code == CONVERGED:
        _correct(state, work, stepping, h)
        return code
    state.q[:] = work.q
    state.g[:] = work.g_start
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
    inputs: tuple[Floats, Floats],
    time: float,
) -> int:
    """Cover one nominal step from `time`, in one piece or in halved pieces."""
    old, new = inputs
    marks = 1 << stepping.halvings
    position, level = 0, 0
    begin = state.inputs.copy()
    while position < marks:
        size = marks >> level
        h = stepping.step * size / marks
        share = (position + size) / marks
        begin[:] = state.inputs
        for k in range(new.size):
            state.inputs[k] = old[k] + share * (new[k] - old[k])
        last = stepping.follow_path and level == stepping.halvings
        pair = (begin, state.inputs.copy())
        code = _try_step(system, table, state, work, tolerances, stepping, h, pair, last)
        if code != CONVERGED:
            state.inputs[:] = begin
            level += 1
            if level > stepping.halvings or code == STOPPED:
                return code
            state.counters[COUNT_HALVED] += 1
            inertia, viscosity = coefficients(stepping, stepping.step / (1 << level))
            rebuild(system, table, state, inertia, viscosity, work.row)
            continue
        work.unsettled[:] = 0
        account_modal(system, state, work)
        account_laws(table, state, begin, time + share * stepping.step)
        account_friction(table, state)
        position += size
    if level > 0:
        inertia, viscosity = coefficients(stepping, stepping.step)
        refresh_inverse(system, state, inertia, viscosity)
    return CONVERGED


@compiled
def store(
    system: System, table: LawTable, state: State, work: Work, record: Record, at: int
) -> None:
    """Store the present instant."""
    record.q[at] = state.q
    record.g[at] = state.g
    record.friction[at] = state.friction_force
    record.law[at] = state.law_force
    stored_energy(system, table, state, work, record.stored[at])
    record.ledger[at] = state.ledger


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
) -> tuple[int, int]:
    """Step from instant `first` to instant `last`; return the outcome code and the instant reached.

    Parameters
    ----------
    inputs : ndarray, shape (n_steps + 1, n_inputs)
        Marker positions at the ends of the steps [m].
    first, last : int
        Indices into `inputs`; the state is that of instant `first`, its modal inverse that of the
        nominal step. Where a march is cut into several does not change a bit of the result.
    """
    for n in range(first, last):
        time = n * stepping.step
        count = switch_laws(system, table, state, work, time + stepping.step)
        update_marked(system, table, state, work, count)
        pair = (inputs[n], inputs[n + 1])
        code = _advance(system, table, state, work, tolerances, stepping, pair, time)
        if code != CONVERGED:
            return code, n
        if (n + 1) % stepping.stride == 0:
            store(system, table, state, work, record, (n + 1) // stepping.stride)
            if (n + 1) % (MEASURE_EVERY * stepping.stride) == 0:
                residual = equilibrium_residual(system, table, state, work)
                record.residual[0] = max(record.residual[0], residual)
        if (n + 1) % MEASURE_EVERY == 0:
            state.drift[0] = max(state.drift[0], DRIFTS)  # what was small at rest may have grown
    return CONVERGED, last
