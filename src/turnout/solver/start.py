"""Start of a run: static equilibrium without friction, or the state that a motion leaves.

Friction at rest is history: any force between the limits of its foot holds. Without a prior motion
the feet are free of it. A prior motion is integrated with the laws and modes of the run, from an
equilibrium without friction, with steps and dissipation of its own; nothing of it is stored. What a
foot has done before it slides is of little effect, so the last part of the motion serves for all of
it. Cycles in the steps of the run, until they repeat, leave out nothing.
Contact set, friction branches and anchors are kept, and the run starts from the static equilibrium
that they allow, with an energy balance of its own.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

from turnout.core.lru_cache import LRUCache
from turnout.core.scheme import Scheme
from turnout.kernels.shared_record import SharedRecord, clone_record
from turnout.law.friction import SLIP_FORWARD
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism
from turnout.solver.arrange import Arrangement
from turnout.solver.columns import rebuild
from turnout.solver.equilibrium import (
    anchor_at_rest,
    equilibrium,
    equilibrium_segments,
    settle,
    start_energy_balance,
)
from turnout.solver.levels import Frame
from turnout.solver.march import march
from turnout.solver.obstruct import freeze
from turnout.solver.outcome import Code
from turnout.solver.prepared_run import (
    PreparedRun,
    prepare,
    present_at_start,
    set_up_run,
)
from turnout.solver.state import LEVEL, set_home_segments, set_segments

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

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


@dataclass(frozen=True, slots=True, eq=False)
class _StateLeft:
    """State that a prior motion leaves; `frame` is held so that its identity stays its own."""

    frame: Frame
    segment: Ints
    friction: Floats
    anchor: Floats
    friction_force: Floats
    friction_beyond: Floats
    q: Floats
    g: Floats
    friction_coefficient: Floats


_cache = LRUCache[_StateLeft](MOST_KEPT)


@dataclass(frozen=True, slots=True, eq=False)
class StartPlan:
    """A motion before the start, ready to be integrated.

    Attributes
    ----------
    laws : tuple of LawTable
        As they are before the start, and the same for the kernels.
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

    laws: tuple[LawTable, LawTable]
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
    laws = arrangement.laws._replace(**{name: getattr(table, name) for name in _FROZEN})
    # Objects that are absent move nothing: their places share the motion as they share a frame.
    courses = arrangement.mechanism.courses
    has_values = courses.friction.size or courses.has_curves
    values = [part.tobytes() for part in courses] if has_values else []
    of_laws = cast("SharedRecord", table).memory.tobytes()
    key = (id(arrangement.frame), scheme, positions.tobytes(), of_laws, *values)
    return StartPlan((laws, table), scheme, positions, of_laws, key, prior.cyclic)


def find_start(
    run: PreparedRun,
    arrangement: Arrangement,
    plan: StartPlan | None,
) -> Code:
    """Put the state of a run where it starts.

    Parameters
    ----------
    run : PreparedRun
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
        code = start_at_rest(run, arrangement.mechanism)
    else:
        code = _start_after(run, arrangement, plan)
    if run.obstructions.law.size:
        freeze(run.table, run.state, run.obstructions)
    return code


def _start_after(run: PreparedRun, arrangement: Arrangement, plan: StartPlan) -> Code:
    """Start from where a prior motion leaves the rails; what is trapped or frozen comes later."""
    left = _cache.get(plan.key)
    if left is None:
        motion = _prepare_last(arrangement, plan, 1.0 if plan.cyclic else PRIOR_SHARE)
        most = MOST_CYCLES if plan.cyclic else 1
        code, slid = _move(motion, arrangement.mechanism, most)
        if not slid and not plan.cyclic:
            motion.give_back(record=True)
            motion = _prepare_last(arrangement, plan, 1.0)
            code, _ = _move(motion, arrangement.mechanism)
        if code != Code.COMPLETE:
            run.work.unconverged[:] = motion.work.unconverged
            return code
        left = _cache.put(plan.key, _state_left(motion, arrangement.frame))
        motion.give_back(record=True)  # what it left has been copied
    return _start_from(run, left)


def _prepare_last(arrangement: Arrangement, plan: StartPlan, share: float) -> PreparedRun:
    """Prepare the last share of the motion; a part before has changed laws."""
    memory = cast("SharedRecord", plan.laws[1]).memory
    memory[:] = np.frombuffer(plan.of_laws, dtype=memory.dtype)
    part = plan.positions[int((1.0 - share) * plan.positions.shape[0]) :]
    return prepare(set_up_run(arrangement, plan.scheme, part, 2, laws=plan.laws))


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


_FROZEN = ("appears", "disappears", "offset", "slope", "intercept", "potential")
"""Fields in which laws differ that are absent at the start or appear later."""


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


def _move(motion: PreparedRun, mechanism: Mechanism, most: int = 1) -> tuple[Code, bool]:
    """Move the rails as before a start, from equilibrium without friction.

    A motion of which there may be more than one is repeated until the forces of the inputs repeat.
    Returns also whether every foot has slid.
    """
    if start_at_rest(motion, mechanism) != Code.COMPLETE:
        return Code.NO_EQUILIBRIUM, False
    anchors = motion.state.anchor.copy()
    last = motion.positions.shape[0] - 1
    repeats = False
    for _ in range(most):
        forces = motion.state.input_law_force.copy()
        code, _ = _call_march(motion, last)
        if code != Code.COMPLETE:
            return Code.NO_LOADED_START, False
        change = np.abs(motion.state.input_law_force - forces)
        repeats = most == 1 or bool(np.all(change < CYCLE_FORCE))
        if repeats:
            break
    slid = bool(np.all(motion.state.anchor != anchors))
    return (Code.COMPLETE, slid) if repeats else (Code.NO_LOADED_START, False)


def _call_march(motion: PreparedRun, last: int) -> tuple[int, int]:
    return march(
        motion.system,
        motion.table,
        motion.state,
        motion.work,
        motion.tolerances,
        motion.stepping,
        motion.positions,
        0,
        last,
        motion.record,
        motion.obstructions,
        motion.courses,
        None,  # left out it would be another signature, and the loop compiled once more
    )


def _state_left(motion: PreparedRun, frame: Frame) -> _StateLeft:
    state = motion.state
    return _StateLeft(
        frame,
        state.segment.copy(),
        state.friction.copy(),
        state.anchor.copy(),
        state.friction_force.copy(),
        state.friction_beyond.copy(),
        state.q.copy(),
        state.g.copy(),
        motion.table.friction_coefficient.copy(),
    )


def _start_from(run: PreparedRun, left: _StateLeft) -> Code:
    """Bring the rails to rest with the contact set and the anchors that a motion left."""
    system, table, state, work = run.system, run.table, run.state, run.work
    _set_present(run)
    set_segments(table, state, left.segment)
    for name in ("friction", "anchor", "friction_force", "friction_beyond", "q", "g"):
        getattr(state, name)[:] = getattr(left, name)
    table.friction_coefficient[:] = left.friction_coefficient
    patient = run.tolerances._replace(iterations=max(run.tolerances.iterations, 100))
    if settle(system, table, state, work, patient) != Code.COMPLETE:
        return Code.NO_LOADED_START
    start_energy_balance(system, table, state, work)
    if not run.stepping.inertia:
        rebuild(system, table, state, state.counters[LEVEL], work.row)
    return Code.COMPLETE


def start_at_rest(run: PreparedRun, mechanism: Mechanism) -> Code:
    """Find the static equilibrium without friction, then anchor the feet at their places."""
    system, laws, table, state, work = run.system, run.laws, run.table, run.state, run.work
    _set_present(run)
    set_home_segments(table, state)
    state.friction[:] = SLIP_FORWARD
    table.friction_coefficient[:] = 0.0
    try:
        if not _find_equilibrium(run):
            segments = equilibrium_segments(mechanism, inputs=state.inputs, present=state.present)
            set_segments(table, state, segments)
            if not _find_equilibrium(run):
                return Code.NO_EQUILIBRIUM
    finally:
        table.friction_coefficient[:] = laws.friction_coefficient
    anchor_at_rest(system, table, state, work)
    if not run.stepping.inertia:
        rebuild(system, table, state, state.counters[LEVEL], work.row)
    return Code.COMPLETE


def _set_present(run: PreparedRun) -> None:
    run.state.present[:] = run.present
    run.state.law_placed[run.present] = 0.0


def _find_equilibrium(run: PreparedRun) -> bool:
    """Iterate the contact set to static equilibrium from the present one; False if it fails."""
    patient = run.tolerances._replace(iterations=max(run.tolerances.iterations, 400))
    return bool(equilibrium(run.system, run.table, run.state, run.work, patient) == Code.COMPLETE)
