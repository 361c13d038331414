r"""Time loop of the kernels: generalised-alpha steps, halved steps, stored instants.

.. math:: (1-\alpha_m)\,a_{n+1} + \alpha_m\,a_n
          = (1-\alpha_f)\,\ddot q_{n+1} + \alpha_f\,\ddot q_n

relates the algorithmic acceleration `a`, which Newmark's formulas with :math:`\beta, \gamma` update
`q` and `v` by, to the acceleration :math:`\ddot q` of the equations of motion
(`State.acceleration`). Source: Chung and Hulbert, Journal of Applied Mechanics 60(2), 1993,
doi:10.1115/1.2900803, in the form of Arnold and Bruels, Multibody System Dynamics 18, 2007,
doi:10.1007/s11044-007-9084-0. With the mass equal to the identity and each coordinate damped by
itself, the right side of the implicit step

.. math:: p = \iota \tilde q + f + c\,(\nu\tilde q - \tilde v), \qquad
          \iota = \frac{1-\alpha_m}{h^2 \beta\,(1-\alpha_f)}, \quad \nu = \frac{\gamma}{h \beta}

follows from the predicted coordinates :math:`\tilde q` and velocities :math:`\tilde v`, those of a
step without new acceleration, one by one.

Kernels change `State` in place and return an outcome code; they never raise and never print.
"""

from typing import NamedTuple

import numpy as np

from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import (
    LANES,
    absolute,
    any_true,
    broadcast,
    gather,
    greater_or_nan,
    horizontal_sum,
    load,
    logical_or,
    store,
    store_nontemporal,
)
from turnout.kernels.vector import copy
from turnout.solver.columns import REBUILD_AFTER, assemble_level, rebuild, update_marked
from turnout.solver.energy import (
    ALGORITHMIC,
    DAMPING,
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
    iterate_rods,
    meet_rods,
    move_rods,
    repeat_rods,
    rods_may_stay,
    store_rods,
)
from turnout.solver.schedule import schedule_ends
from turnout.solver.solve import (
    CONVERGED,
    DRIFTS,
    NOT_CONVERGED,
    blocks_of,
    equilibrium_residual,
    evaluate,
    is_inaccurate,
    iterate_contact_set,
    measure_residual,
    refine,
    restore_start,
    save_contact_set,
)
from turnout.solver.state import (
    COUNT_HALVED,
    COUNT_JOINING,
    COUNT_RECENT,
    COUPLED,
    LEVEL,
    UNSOLVED,
    Options,
    Run,
    State,
)
from turnout.solver.system import Floats, Ints

REST_TIME = 0.01
"""Time, or a step where that is longer, within which a rail at rest moves by no more than a
tolerance [s]; it does not depend on the step, as a mode that turns round hardly moves in a short
one."""
STILL = 1e-12
"""Largest motion within this time that is taken for none, of modes of unit mass [kg^0.5 m]."""


class Factors(NamedTuple):
    """Factors of a step of length ``h`` [s], whose matrix is ``inertia I + viscosity C + K``.

    ``inertia`` [1/s2] and ``viscosity`` [1/s] are iota and nu of the module's formulas;
    ``inverse_alpha_m`` is 1 / (1 - alpha_m) [-].
    """

    h: float
    inertia: float
    viscosity: float
    inverse_alpha_m: float


@compiled
def step_factors(options: Options, h: float) -> Factors:
    """Return the factors of a step of length `h` [s]."""
    kappa = (1.0 - options.alpha_f) / (1.0 - options.alpha_m)
    inertia, viscosity = 1.0 / (h * h * options.beta * kappa), options.gamma / (h * options.beta)
    return Factors(h, inertia, viscosity, 1.0 / (1.0 - options.alpha_m))


@compiled_part
def predict(run: Run, state: State, factors: Factors) -> None:
    """Save the coordinates; predict the step without new acceleration, and write its right side.

    Blocks that hardly move are stopped, and their displacements stay those of the last solution.
    """
    system, work = run.system, run.work
    state.counters[UNSOLVED] |= _stop_blocks(run, state, factors.h)
    motion = (state.q, state.v, state.a, state.acceleration)
    predicted = (work.q_start, work.q_pred, work.v_pred, work.right_side)
    _predict_modes(run.options, factors, motion, system.damping, system.load, predicted)


@compiled_loop
def _predict_modes(
    options: Options,
    factors: Factors,
    motion: tuple[Floats, Floats, Floats, Floats],
    damping: Floats,
    constant: Floats,
    predicted: tuple[Floats, Floats, Floats, Floats],
) -> None:
    inertia, viscosity = broadcast(factors.inertia), broadcast(factors.viscosity)
    inverse = factors.inverse_alpha_m
    alpha_f = broadcast(inverse * options.alpha_f)
    minus_alpha_m = broadcast(-inverse * options.alpha_m)
    half_minus_beta, beta = broadcast(0.5 - options.beta), broadcast(options.beta)
    one_minus_gamma, gamma = broadcast(1.0 - options.gamma), broadcast(options.gamma)
    h_1, h_2 = broadcast(factors.h), broadcast(factors.h * factors.h)
    q, v, a, acceleration = motion
    q_start, q_pred, v_pred, right_side = predicted
    for i in range(0, right_side.size, LANES):
        q_n, v_n, a_n = load(q, i), load(v, i), load(a, i)
        a_new = alpha_f * load(acceleration, i) + minus_alpha_m * a_n
        q_new = q_n + h_1 * v_n + h_2 * (half_minus_beta * a_n + beta * a_new)
        v_new = v_n + h_1 * (one_minus_gamma * a_n + gamma * a_new)
        store(q_n, q_start, i)
        store(q_new, q_pred, i)
        store(v_new, v_pred, i)
        damping_force = load(damping, i) * (viscosity * q_new - v_new)
        store(inertia * q_new + load(constant, i) + damping_force, right_side, i)


@compiled_part
def correct(run: Run, state: State, factors: Factors) -> None:
    """Correct velocities and accelerations by the solved coordinates.

    The work of damping and the numerical dissipation of the scheme are added to the ledger,
    `turnout.solver.energy`.
    """
    work, motion = run.work, (state.q, state.v, state.a, state.acceleration)
    start = (work.q_start, work.q_pred, work.v_pred)
    of_damping, of_scheme = _correct_modes(run.options, factors, start, run.system.damping, motion)
    state.ledger[DAMPING] += of_damping
    state.ledger[ALGORITHMIC] += of_scheme


@compiled_loop
def _correct_modes(
    options: Options,
    factors: Factors,
    start: tuple[Floats, Floats, Floats],
    damping: Floats,
    motion: tuple[Floats, Floats, Floats, Floats],
) -> tuple[float, float]:
    inertia, viscosity = broadcast(factors.inertia), broadcast(factors.viscosity)
    inverse, half = broadcast(factors.inverse_alpha_m), broadcast(0.5)
    one_minus_alpha_f = broadcast(1.0 - options.alpha_f)
    alpha_f, alpha_m = broadcast(options.alpha_f), broadcast(options.alpha_m)
    (q_start, q_pred, v_pred), (q, v, a, acceleration) = start, motion
    damped, dissipated = broadcast(0.0), broadcast(0.0)
    for i in range(0, q.size, LANES):
        q_new, v_n, acceleration_n = load(q, i), load(v, i), load(acceleration, i)
        correction, delta_q = q_new - load(q_pred, i), q_new - load(q_start, i)
        v_new, acceleration_new = load(v_pred, i) + viscosity * correction, inertia * correction
        v_mean = half * (v_new + v_n)
        damped = damped + load(damping, i) * v_mean * delta_q
        dissipated = dissipated + (
            half * (acceleration_new + acceleration_n) * delta_q - v_mean * (v_new - v_n)
        )
        a_new = one_minus_alpha_f * acceleration_new + alpha_f * acceleration_n
        store(inverse * (a_new - alpha_m * load(a, i)), a, i)
        store(v_new, v, i)
        store(acceleration_new, acceleration, i)
    return horizontal_sum(damped), horizontal_sum(dissipated)


@compiled_part
def is_at_rest(state: State, h: float, gap: float) -> bool:
    """Return whether no mode moves further within `REST_TIME` than the tolerance of gaps [m].

    The step is of length `h` [s]. `gap` is taken as that of modal coordinates too, which move their
    rails by less: a mode of unit mass displaces a rail of 600 kg by some 0.06 of its coordinate.
    """
    return not _moves((state.v, state.a, state.acceleration), 0, state.v.size, h, gap)


@compiled_part
def _stop_blocks(run: Run, state: State, h: float) -> int:
    """Stop blocks that move by less than `STILL`; return a bit for each of the others.

    Blocks on which inputs or joining rows act go on, as these forces may change.
    """
    system, moving = run.system, 0
    motion = (state.v, state.a, state.acceleration)
    for block in range(system.mode_start.size - 1):
        first, last = system.mode_start[block], system.mode_start[block + 1]
        if _moves(motion, first, last, h, STILL) or _is_acted_on(run, state, block):
            moving |= 1 << block
        else:
            _stop(motion, first, last)
    return moving


@compiled
def _is_acted_on(run: Run, state: State, block: int) -> bool:
    for end in run.system.input_end:
        if run.system.block_of_end[end] == block:
            return True
    for row in state.joining[: state.counters[COUNT_JOINING]]:
        if blocks_of(run.system, row) & (1 << block):
            return True
    return False


@compiled_loop
def _moves(
    motion: tuple[Floats, Floats, Floats], first: int, last: int, h: float, tolerance: float
) -> bool:
    """Return whether some mode moves further than a tolerance within `REST_TIME`, or is NaN."""
    v, a, acceleration = motion
    span = max(h, REST_TIME)
    fastest, largest = tolerance / span, tolerance / (span * span)
    v_8, a_8 = broadcast(fastest), broadcast(largest)
    i, moves = first, False
    while i + LANES <= last and not moves:
        of_v = greater_or_nan(absolute(load(v, i)), v_8)
        of_a = greater_or_nan(absolute(load(a, i)), a_8)
        further = greater_or_nan(absolute(load(acceleration, i)), a_8)
        moves = any_true(logical_or(of_v, logical_or(of_a, further)))
        i += LANES
    while i < last and not moves:
        rests = abs(v[i]) <= fastest and abs(a[i]) <= largest
        moves = not (rests and abs(acceleration[i]) <= largest)
        i += 1
    return moves


@compiled_loop
def _stop(motion: tuple[Floats, Floats, Floats], first: int, last: int) -> None:
    v, a, acceleration = motion
    for i in range(first, last):
        v[i] = 0.0
        a[i] = 0.0
        acceleration[i] = 0.0


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
    options = run.options
    inertia, viscosity, span = factors.inertia, factors.viscosity, (time, factors.h)
    predict(run, state, factors)
    save_contact_set(run, state)
    code = iterate_contact_set(run, state)
    if rods is not None:  # noqa: SIM102, this alone is left out where there are none
        if code == CONVERGED:
            code = iterate_rods(run, state, rods, span)
    if code == NOT_CONVERGED and last:
        copy(inputs[0], state.inputs)
        restore_start(run, state)
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
    restore_start(run, state)
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
def _gather_to(g: Floats, places: Ints, to: Floats) -> None:
    for i in range(0, places.size, LANES):
        store_nontemporal(gather(g, places, i), to, i)


@compiled_loop
def _copy_to(values: Floats, to: Floats) -> None:
    for i in range(0, values.size, LANES):
        store_nontemporal(load(values, i), to, i)


@compiled_part
def store_instant(run: Run, state: State, at: int) -> None:
    """Write the present instant to its places in the record."""
    system, work, record = run.system, run.work, run.record
    listed = record.places.shape[0] > 0
    whole = record.places[at, 0] if listed else at
    if whole >= 0:
        _copy_to(state.q, record.q[whole])
        _gather_to(state.g, system.row_place, record.g[whole])
        if whole < record.v.shape[0]:
            copy(state.v, record.v[whole])
        _copy_to(state.friction_force, record.friction[whole])
        _copy_to(work.force, record.law[whole])
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


@compiled_part
def step(run: Run, state: State, nominal: Factors, n: int, rods: Rods | None) -> int:
    """Step from instant `n` to the next one; return CONVERGED or what prevented it.

    `nominal` are the factors of a step in one piece.
    """
    options, time, free = run.options, n * run.options.step, True
    inputs, span = (run.positions[n], run.positions[n + 1]), (time, options.step)
    if not options.inertia:
        return advance_static(run, state, inputs, (time, time + options.step))
    if rods is not None:
        free = rods_may_stay(rods, inputs, span)
    if not free or not _stands_still(run, state, inputs):
        return _advance(run, state, nominal, inputs, time, rods)
    if rods is not None:
        repeat_rods(rods, span)
    return CONVERGED


@compiled
def march(
    run: Run, state: State, first: int, last: int, rods: Rods | None = None
) -> tuple[int, int]:
    """Step from instant `first` to instant `last`; return the outcome code and the instant reached.

    It ends early where the schedule of machines does.

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
    if rods is not None:  # noqa: SIM102, this alone is left out where there are none
        if schedule_ends(run, rods, first):
            return CONVERGED, first
    for n in range(first, last):
        time = n * options.step
        if options.inertia and state.counters[LEVEL] != 0:
            switch_level(run, state, whole)
        count = switch_laws(run, state, time + options.step)
        update_marked(run, state, count)
        code = step(run, state, nominal, n, rods)
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
            if schedule_ends(run, rods, n + 1):
                return CONVERGED, n + 1
    return CONVERGED, last


@compiled
def march_with_machines(
    run: Run, state: State, first: int, last: int, rods: Rods
) -> tuple[int, int]:
    """Step as `march` with drives that are machines, as a kernel with a cache of its own."""
    return march(run, state, first, last, rods)
