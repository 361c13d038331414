"""Start of a run: static equilibrium without friction, or the state that a motion leaves.

Without friction the equilibrium is the minimum of the potential energy. `equilibrium` iterates the
contact set of the condensed system. Where that cycles, `equilibrium_segments` finds the segments of
the laws first, on all coordinates: the force of every law never falls with its argument, so the
energy is convex, and a Newton iteration with line search finds the minimum from any start.

Friction at rest is history: any force between the limits of its foot holds. Without a prior motion
the feet are free of it. A prior motion is integrated with the laws and modes of the run, from an
equilibrium without friction, with steps and dissipation of its own; nothing of it is stored. What a
foot has done before it slides is of little effect, so the last part of the motion serves for all of
it. Cycles in the steps of the run, until they repeat, leave out nothing.
Contact set, friction branches and anchors are kept, and the run starts from the static equilibrium
that they allow (`settle`), with an energy balance of its own.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.core.scheme import Scheme
from turnout.kernels.compiled import compiled
from turnout.kernels.shared_record import SharedRecord, clone_record
from turnout.kernels.vector import copy
from turnout.law.friction import SLIP_FORWARD, STICK
from turnout.law.kernel import any_not_finite
from turnout.law.table import LawTable, segments_at
from turnout.mechanism.mechanism import Mechanism
from turnout.solver.arrange import Arrangement, Frame, give_back, prepare, set_up_run
from turnout.solver.columns import assemble_level, rebuild, update_marked
from turnout.solver.energy import account_friction, account_laws, set_energy_reference
from turnout.solver.follow import follow_path
from turnout.solver.march import march
from turnout.solver.obstruct import freeze
from turnout.solver.outcome import Code
from turnout.solver.record import SavePlan
from turnout.solver.solve import (
    CONVERGED,
    NOT_CONVERGED,
    NOT_FINITE,
    evaluate,
    gather_modes,
    iterate_contact_set,
    measure_residual,
    refine,
    restore_start,
    save_contact_set,
    solve_displacements,
    update_contact_set,
)
from turnout.solver.state import LEVEL, Run, State, set_home_segments, set_segments
from turnout.solver.system import Floats, Ints

ITERATIONS = 100
"""Most Newton steps; some ten are usual."""
REFINEMENTS = 8
"""Most refinements of a static solution that change its contact set."""


def equilibrium_segments(mechanism: Mechanism, *, inputs: Floats, present: Ints) -> Ints:
    """Return the segment of every law at the minimum of the energy, by a Newton iteration.

    Parameters
    ----------
    mechanism : Mechanism
        Its laws are evaluated without friction.
    inputs : ndarray, shape (n_inputs,)
        Marker positions [m].
    present : ndarray of int, shape (n_laws,)
        1 where a law acts, else 0.
    """
    table, rows = mechanism.laws, mechanism.rows
    at_input = np.where(table.input_index >= 0, inputs[table.input_index] if inputs.size else 0, 0)
    zero = table.offset + at_input
    u = np.zeros(rows.shape[1])

    def energy(u: Floats) -> float:
        _, potential, _ = _evaluate_laws(table, (rows @ u)[table.row] - zero)
        return float(u @ (0.5 * (mechanism.stiffness @ u) - mechanism.load) + present @ potential)

    for _ in range(ITERATIONS):
        e = (rows @ u)[table.row] - zero
        force, _, slope = _evaluate_laws(table, e)
        residual = mechanism.stiffness @ u - mechanism.load
        residual += np.bincount(table.row, present * force, rows.shape[0]) @ rows
        tangent = (
            mechanism.stiffness
            + (rows.T * np.bincount(table.row, present * slope, rows.shape[0])) @ rows
        )
        if not np.isfinite(residual).all():
            break
        direction = -np.linalg.lstsq(tangent, residual)[0]
        energy_u, descent, share = energy(u), float(residual @ direction), 1.0
        while energy(u + share * direction) > energy_u + 1e-4 * share * descent and share > 1e-9:
            share *= 0.5
        u = u + share * direction
        segments = _segments(table, (rows @ u)[table.row] - zero)
        if share == 1.0 and np.array_equal(segments, _segments(table, e)):
            break  # a whole step within them ends at the minimum
    return _segments(table, (rows @ u)[table.row] - zero) - table.segment_start[:-1]


def _segments(table: LawTable, e: Floats) -> Ints:
    """Return the place in the table of the segment of every law."""
    return np.array([segments_at(table, law, value) for law, value in enumerate(e)], dtype=np.int64)


def _evaluate_laws(table: LawTable, e: Floats) -> tuple[Floats, Floats, Floats]:
    """Return force [N], energy [J] and slope [N/m] of every law at its argument."""
    at = _segments(table, e)
    force = table.slope[at] * e + table.intercept[at]
    energy = (0.5 * table.slope[at] * e + table.intercept[at]) * e + table.potential[at]
    return force, energy, table.slope[at]


@compiled
def equilibrium(run: Run, state: State) -> int:
    """Find the static equilibrium for the present inputs by iterating the contact set.

    The solution is refined, so that a rail at rest does not move in its first step.
    """
    _rebuild_static(run, state)
    code = iterate_contact_set(run, state)
    if code == CONVERGED:
        _refine_contact_set(run, state)
        if any_not_finite(state.g):  # an infinite one may lie in the last segment of its law
            return NOT_FINITE
    return code


@compiled
def _rebuild_static(run: Run, state: State) -> None:
    """Rebuild the columns of a level without inertia and viscosity, the last one, with its load."""
    static = state.level_ready.size - 1
    assemble_level(run, state, static, 0.0, 0.0)
    rebuild(run, state, static)
    copy(run.system.load, run.work.right_side)


@compiled
def _refine_contact_set(run: Run, state: State) -> None:
    """Refine the static solution, and the contact set where the refined solution violates it.

    Where chairs lie metres below their rails a refinement moves contacts by more than their
    tolerance, which is that of rails in the range of a switch. If rounding undoes every change, the
    last solution stays, which violates its laws by that rounding.
    """
    for attempt in range(REFINEMENTS + 1):
        measure_residual(run, state, 0.0, 0.0)
        refine(run, state)
        if attempt == REFINEMENTS:
            return
        count = update_contact_set(run, state, one_at_a_time=False)
        if count == 0:
            return
        update_marked(run, state, count)
        solve_displacements(run, state)
        gather_modes(run, state)


@compiled
def anchor_at_rest(run: Run, state: State) -> None:
    """Anchor every foot at its present place, and start the energy balance from here."""
    state.friction[:] = STICK
    for friction in range(state.anchor.size):
        state.anchor[friction] = state.g[run.table.friction_row[friction]]
    start_energy_balance(run, state)


@compiled
def start_energy_balance(run: Run, state: State) -> None:
    """Start the energy balance from the present solution; anchors of slipping feet follow it."""
    evaluate(run, state)
    account_laws(run, state, state.inputs, 0.0)
    account_friction(run, state)
    state.ledger[:] = 0.0
    run.work.unconverged[:] = 0
    set_energy_reference(run, state)


@compiled
def settle(run: Run, state: State) -> int:
    """Bring a state in motion to rest under friction, and start the energy balance from there.

    Returns CONVERGED or what prevented it.

    The contact set is iterated from the present one with the anchors as they are. Where that does
    not converge, the forces of inertia and dampers, without which the present state would not be
    one of equilibrium, are taken away along a straight path, event by event.
    """
    work = run.work
    _rebuild_static(run, state)
    copy(state.q, work.q_start)
    work.changed[:] = 1
    save_contact_set(run, state)
    code = iterate_contact_set(run, state)
    if code == NOT_CONVERGED:
        restore_start(run, state)
        _rebuild_static(run, state)
        copy(state.inputs, work.inputs_start)
        copy(state.inputs, work.inputs_end)
        inputs = (work.inputs_start, work.inputs_end)
        code = follow_path(run, state, inputs, 0.0, 0.0)
    if code == CONVERGED:
        _refine_contact_set(run, state)
        start_energy_balance(run, state)
    return code


PRIOR_STEP = 6e-3
"""Step of a prior motion, or that of the run where it is longer or without inertia [s]."""
PRIOR_SHARE = 0.6
"""Of its way in time the last part that is integrated, where each foot slides in it [-]."""
PRIOR_RADIUS = 0.0
"""Spectral radius of its scheme: what its steps cannot resolve is damped at once [-]."""
PRIOR_REST = 0.25
"""Time at rest after a prior motion, a period of the rails' lowest mode [s]."""
CYCLE_FORCE = 0.5
"""Largest change of an input's force from cycle to cycle that is taken for none [N]."""
MOST_CYCLES = 10
"""Cycles before a start; of the library none takes more than four."""
MOST_KEPT = 64
"""States left by prior motions in the cache, the latest used."""


@dataclass(frozen=True, slots=True, eq=False)
class PriorMotion:
    """The motion of the markers that ends where a run starts.

    Attributes
    ----------
    duration : float
        [s].
    inputs : callable
        Marker positions, shape (n_inputs, n), for times of shape (n,) from 0 to `duration` [m]. The
        last are those with which the run starts.
    cyclic : bool
        Whether it ends where it begins, and is repeated by the scheme of the run until the forces
        of the inputs repeat too, in place of its last part in longer steps.
    """

    duration: float
    inputs: Callable[[Floats], Floats]
    cyclic: bool = False


_LEFT = ("segment", "friction", "anchor", "friction_force", "friction_beyond", "q", "g")
"""Fields of the state that a prior motion leaves."""


@dataclass(frozen=True, slots=True, eq=False)
class _StateLeft:
    """State that a prior motion leaves; `frame` is held so that its identity stays its own."""

    frame: Frame
    state: dict[str, NDArray[Any]]
    friction_coefficient: Floats


_cache = LRUCache[_StateLeft](MOST_KEPT)


@dataclass(frozen=True, slots=True, eq=False)
class StartPlan:
    """A motion before the start, ready to be integrated.

    Attributes
    ----------
    table : LawTable
        Laws as they are before the start, by places.
    scheme : Scheme
        Numerical choices of the motion.
    positions : ndarray, shape (n_steps + 1, n_inputs)
        Marker positions at the ends of its steps [m].
    of_laws : bytes
        What is in the table of laws before anything moves.
    key : hashable
        What the state depends on that it leaves.
    cyclic : bool
        Whether it is repeated.
    """

    table: LawTable
    scheme: Scheme
    positions: Floats
    of_laws: bytes
    key: Hashable
    cyclic: bool


def plan_start(arrangement: Arrangement, scheme: Scheme, prior: PriorMotion) -> StartPlan:
    """Prepare a motion before the start of a run with a scheme; what is trapped comes later."""
    scheme = _prior_scheme(scheme, prior.duration, cyclic=prior.cyclic)
    times = _prior_times(scheme, prior.duration)
    positions = np.ascontiguousarray(prior.inputs(times).T)
    table = _without_timed_laws(arrangement)
    # Objects that are absent move nothing: their places share the motion as they share a frame.
    courses = arrangement.mechanism.courses
    has_values = courses.friction.size or courses.has_curves
    values = [part.tobytes() for part in courses] if has_values else []
    of_laws = cast("SharedRecord", table).memory.tobytes()
    key = (id(arrangement.frame), scheme, positions.tobytes(), of_laws, *values)
    return StartPlan(table, scheme, positions, of_laws, key, prior.cyclic)


def find_start(run: Run, state: State, arrangement: Arrangement, plan: StartPlan | None) -> Code:
    """Put the state of a run where it starts.

    Parameters
    ----------
    run, state : Run, State
        From `prepare`; nothing has moved yet.
    arrangement : Arrangement
        What it was prepared from.
    plan : StartPlan, optional
        The motion before the start, from `plan_start`.

    Returns
    -------
    Code
        `COMPLETE`, or why there is no start.
    """
    if plan is None:
        code = start_at_rest(run, state, arrangement.mechanism)
    else:
        code = _start_after(run, state, arrangement, plan)
    if run.obstructions.law.size:
        freeze(run, state)
    return code


def _start_after(run: Run, state: State, arrangement: Arrangement, plan: StartPlan) -> Code:
    """Start from where a prior motion leaves the rails; what is trapped or frozen comes later."""
    left = _cache.get(plan.key)
    if left is None:
        motion = _prepare_last(arrangement, plan, 1.0 if plan.cyclic else PRIOR_SHARE)
        most = MOST_CYCLES if plan.cyclic else 1
        code, slid = _move(*motion, arrangement.mechanism, most)
        if not slid and not plan.cyclic:
            give_back(arrangement, *motion, record=True)
            motion = _prepare_last(arrangement, plan, 1.0)
            code, _ = _move(*motion, arrangement.mechanism)
        if code != Code.COMPLETE:
            run.work.unconverged[:] = motion[0].work.unconverged
            return code
        left = _cache.put(plan.key, _state_left(*motion, arrangement.frame))
        give_back(arrangement, *motion, record=True)  # what it left has been copied
    return _start_from(run, state, left)


def _prepare_last(arrangement: Arrangement, plan: StartPlan, share: float) -> tuple[Run, State]:
    """Prepare the last share of the motion; a part before has changed laws."""
    memory = cast("SharedRecord", plan.table).memory
    memory[:] = np.frombuffer(plan.of_laws, dtype=memory.dtype)
    part = plan.positions[int((1.0 - share) * plan.positions.shape[0]) :]
    return prepare(set_up_run(arrangement, plan.scheme, part, SavePlan(2), table=plan.table))


def clear_starts() -> None:
    """Clear the cache of the states that prior motions left."""
    _cache.clear()


@lru_cache(maxsize=MOST_KEPT)
def _prior_scheme(scheme: Scheme, duration: float, *, cyclic: bool) -> Scheme:
    """Return the scheme of a prior motion, which stores its last instant alone."""
    step, rest, radius = scheme.step, 0.0, scheme.spectral_radius
    if scheme.inertia and not cyclic:
        step, rest, radius = max(step, PRIOR_STEP), PRIOR_REST, PRIOR_RADIUS
    count = max(1, int(np.ceil((duration + rest) / step - 1e-9)))
    return replace(scheme, step=step, output_interval=count * step, spectral_radius=radius)


@lru_cache(maxsize=MOST_KEPT)
def _prior_times(scheme: Scheme, duration: float) -> Floats:
    """Return the ends of the steps of a prior motion, read-only, as throws share them [s]."""
    count = round(scheme.output_interval / scheme.step)
    times: Floats = np.minimum(scheme.step * np.arange(count + 1), duration)
    times.flags.writeable = False
    return times


def _without_timed_laws(arrangement: Arrangement) -> LawTable:
    """Return laws of which those that are absent at the start never appear; they have no values."""
    table = clone_record(arrangement.table)
    absent = np.flatnonzero(~present_at_start(arrangement.laws))
    table.appears[:] = -np.inf
    table.appears[absent] = np.inf
    table.disappears[:] = np.inf
    table.offset[absent] = 0.0
    start = table.segment_start
    for law in absent:
        segments = slice(start[law], start[law + 1])
        table.slope[segments] = table.intercept[segments] = table.potential[segments] = 0.0
    return table


def _move(run: Run, state: State, mechanism: Mechanism, most: int = 1) -> tuple[Code, bool]:
    """Move the rails as before a start, from equilibrium without friction.

    A motion of which there may be more than one is repeated until the forces of the inputs repeat.
    Returns also whether every foot has slid.
    """
    if start_at_rest(run, state, mechanism) != Code.COMPLETE:
        return Code.NO_EQUILIBRIUM, False
    anchors = state.anchor.copy()
    repeats = False
    for _ in range(most):
        forces = state.input_law_force.copy()
        # without None it would be another signature, and the loop compiled once more
        code, _ = march(run, state, 0, run.positions.shape[0] - 1, None)
        if code != Code.COMPLETE:
            return Code.NO_LOADED_START, False
        change = np.abs(state.input_law_force - forces)
        repeats = most == 1 or bool(np.all(change < CYCLE_FORCE))
        if repeats:
            break
    slid = bool(np.all(state.anchor != anchors))
    return (Code.COMPLETE, slid) if repeats else (Code.NO_LOADED_START, False)


def _state_left(run: Run, state: State, frame: Frame) -> _StateLeft:
    found = {name: getattr(state, name).copy() for name in _LEFT}
    return _StateLeft(frame, found, run.table.friction_coefficient.copy())


def _start_from(run: Run, state: State, left: _StateLeft) -> Code:
    """Bring the rails to rest with the contact set and the anchors that a motion left."""
    _set_present(run, state)
    for name, values in left.state.items():
        getattr(state, name)[:] = values
    set_segments(run.table, state, left.state["segment"])
    run.table.friction_coefficient[:] = left.friction_coefficient
    if settle(_patient(run, 100), state) != Code.COMPLETE:
        return Code.NO_LOADED_START
    if not run.options.inertia:
        rebuild(run, state, state.counters[LEVEL])
    return Code.COMPLETE


def start_at_rest(run: Run, state: State, mechanism: Mechanism) -> Code:
    """Find the static equilibrium without friction, then anchor the feet at their places."""
    table, patient = run.table, _patient(run, 400)
    _set_present(run, state)
    set_home_segments(table, state)
    state.friction[:] = SLIP_FORWARD
    coefficients = table.friction_coefficient.copy()
    table.friction_coefficient[:] = 0.0
    try:
        if equilibrium(patient, state) != Code.COMPLETE:
            segments = equilibrium_segments(mechanism, inputs=state.inputs, present=state.present)
            set_segments(table, state, segments)
            if equilibrium(patient, state) != Code.COMPLETE:
                return Code.NO_EQUILIBRIUM
    finally:
        table.friction_coefficient[:] = coefficients
    anchor_at_rest(run, state)
    if not run.options.inertia:
        rebuild(run, state, state.counters[LEVEL])
    return Code.COMPLETE


def _set_present(run: Run, state: State) -> None:
    """Let the laws act that do so at the start."""
    present = present_at_start(run.table)
    state.present[:] = present
    state.law_placed[present] = 0.0


def present_at_start(laws: LawTable) -> NDArray[np.bool_]:
    """Return whether each law acts at the start, shape (n_laws,)."""
    present: NDArray[np.bool_] = (laws.appears <= 1e-9) & (laws.disappears >= -1e-9)
    return np.asarray(present & (laws.waits == 0))


def _patient(run: Run, iterations: int) -> Run:
    """Return a run with at least so many iterations of a step."""
    most = max(run.options.iterations, iterations)
    return run._replace(options=run.options._replace(iterations=most))
