r"""The generalised-alpha step: prediction, and correction once the coordinates are solved for.

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
"""

from typing import NamedTuple

from turnout.kernels.compiled import compiled, compiled_loop, compiled_part
from turnout.kernels.lanes import (
    LANES,
    absolute,
    any_true,
    broadcast,
    greater_or_nan,
    horizontal_sum,
    load,
    logical_or,
    store,
)
from turnout.solver.energy import ALGORITHMIC, DAMPING
from turnout.solver.solution import blocks_of
from turnout.solver.state import COUNT_JOINING, UNSOLVED, Options, Run, State
from turnout.solver.system import Floats

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
    system, work, options = run.system, run.work, run.options
    state.counters[UNSOLVED] |= _stop_blocks(run, state, factors.h)
    _predict_modes(
        options,
        factors,
        (state.q, state.v, state.a, state.acceleration),
        system.damping,
        system.load,
        work.q_start,
        work.q_pred,
        work.v_pred,
        work.right_side,
    )


@compiled_loop
def _predict_modes(
    options: Options,
    factors: Factors,
    motion: tuple[Floats, Floats, Floats, Floats],
    damping: Floats,
    constant: Floats,
    q_start: Floats,
    q_pred: Floats,
    v_pred: Floats,
    right_side: Floats,
) -> None:
    inertia, viscosity = broadcast(factors.inertia), broadcast(factors.viscosity)
    inverse = factors.inverse_alpha_m
    alpha_f = broadcast(inverse * options.alpha_f)
    minus_alpha_m = broadcast(-inverse * options.alpha_m)
    half_minus_beta, beta = broadcast(0.5 - options.beta), broadcast(options.beta)
    one_minus_gamma, gamma = broadcast(1.0 - options.gamma), broadcast(options.gamma)
    h_1, h_2 = broadcast(factors.h), broadcast(factors.h * factors.h)
    q, v, a, acceleration = motion
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
    system, work, options = run.system, run.work, run.options
    start = (work.q_start, work.q_pred, work.v_pred)
    of_damping, of_scheme = _correct_modes(
        options, factors, start, system.damping, state.q, state.v, state.a, state.acceleration
    )
    state.ledger[DAMPING] += of_damping
    state.ledger[ALGORITHMIC] += of_scheme


@compiled_loop
def _correct_modes(
    options: Options,
    factors: Factors,
    start: tuple[Floats, Floats, Floats],
    damping: Floats,
    q: Floats,
    v: Floats,
    a: Floats,
    acceleration: Floats,
) -> tuple[float, float]:
    inertia, viscosity, half = (
        broadcast(factors.inertia),
        broadcast(factors.viscosity),
        broadcast(0.5),
    )
    inverse, one_minus_alpha_f = (
        broadcast(factors.inverse_alpha_m),
        broadcast(1.0 - options.alpha_f),
    )
    alpha_f, alpha_m = broadcast(options.alpha_f), broadcast(options.alpha_m)
    q_start, q_pred, v_pred = start
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
