"""Prepare a run of a condensed mechanism: numbers and laws first, memory when it begins.

What needs no memory of its own is set up with the plans of other throws, while what Python needs
for it is in the processor's caches; state and scratch arrays are those of the run before.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MechanicsError, SolverError
from turnout.core.scheme import Scheme
from turnout.kernels.lanes import whole_lines, zeros_in_lines
from turnout.kernels.shared_record import clone_record, copy_vectors, shared_record
from turnout.law.friction import FrictionCourses, no_courses
from turnout.law.obstruction import Obstructions, no_obstructions, remember
from turnout.law.table import LawTable
from turnout.mechanism.mechanism import Mechanism, Wait
from turnout.solver.arrange import Arrangement, Frame, give_back_memory, take_memory
from turnout.solver.record import SeenWeights, WatchPlan, empty_record
from turnout.solver.state import (
    Options,
    Run,
    State,
    StepRecord,
    Work,
    fresh_copy,
    fresh_state,
    new_work,
    refill_state,
)
from turnout.solver.system import System, as_unsigned

Floats = NDArray[np.float64]

# Most memory of a history [bytes], and most steps.
MOST_MEMORY = 2e9
MOST_STEPS = 2_000_000
CHECK_INTERVAL = 0.02
"""At which a run that waits for machines checks whether they still move [s]."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Waits of a run for machines; the last one is at its end.

    Attributes
    ----------
    time : float
        As of `Wait` [s].
    step : int
        The last stored instant before the onset of the next movement, or the last of all.
    rest, longest : int
        Steps of rest once all machines stand, and of the longest wait before it.
    """

    time: float
    step: int
    rest: int
    longest: int


@dataclass(frozen=True, slots=True)
class Grid:
    """Numbers of steps and stored instants.

    Attributes
    ----------
    n_steps : int
        Of the schedule.
    stride : int
        Steps from one stored instant to the next.
    filled_in : bool
        Whether instants between the steps are wanted.
    last : float
        The last instant that is wanted, by the schedule [s].
    stops : tuple of Stop
        Where it may wait, and its end.
    room : int
        Steps that there is memory for, those of the waits among them.
    check : int
        Steps from one check whether machines still move to the next.
    """

    n_steps: int
    stride: int
    filled_in: bool
    last: float
    stops: tuple[Stop, ...]
    room: int
    check: int

    @property
    def n_stored(self) -> int:
        """Stored instants that there is memory for."""
        return self.room // self.stride + 1


def choose_grid(
    mechanism: Mechanism, scheme: Scheme, end: float, waits: Sequence[Wait] = ()
) -> Grid:
    """Choose the steps; refuse a run with too many of them, or too large for the memory.

    Waits take what memory there is beyond that of the schedule.
    """
    for interval, what in ((scheme.step, "steps"), (scheme.output_interval, "stored instants")):
        if end / interval > MOST_STEPS:
            msg = (
                f"end = {end:g} s with {what} every {interval:g} s makes {end / interval:.3g} of "
                f"them, at most {MOST_STEPS} are made; end sooner (schedule.end) or less often"
            )
            raise SolverError(msg)
    n_out = round(end / scheme.output_interval) + 1
    if n_out < 2:
        msg = f"end = {end:g} s is shorter than one output interval"
        raise SolverError(msg)
    stride, filled_in = max(scheme.stride, 1), scheme.stride == 0
    last = (n_out - 1) * scheme.output_interval
    share = last / scheme.step
    n_steps = math.ceil(share - 1e-6) if filled_in else (n_out - 1) * stride
    a_row = 8 * (mechanism.n_rows + mechanism.laws.row.size + mechanism.core.shape[1])
    most = max(n_steps // stride + 1, n_out)
    if most * a_row > MOST_MEMORY:
        msg = (
            f"end = {end:g} s with an output interval of {scheme.output_interval:g} s makes "
            f"{most:.3g} instants, too many to hold; end sooner or store less often"
        )
        raise SolverError(msg)
    check = stride * max(1, round(CHECK_INTERVAL / (stride * scheme.step)))
    stops = _choose_stops(waits or [Wait(end, 0.0, 0.0)], scheme.step, (stride, check, n_steps))
    room = n_steps + sum(stop.longest + stop.rest for stop in stops)
    fits = min(MOST_STEPS, int(MOST_MEMORY / a_row / most * n_steps))
    return Grid(n_steps, stride, filled_in, last, stops, max(n_steps, min(room, fits)), check)


def _choose_stops(
    waits: Sequence[Wait], step: float, counts: tuple[int, int, int]
) -> tuple[Stop, ...]:
    """Return waits in steps; lengths are whole stored intervals, and a rest is one at least."""
    stride, check, n_steps = counts

    def whole(time: float) -> int:
        return stride * math.ceil(time / (stride * step) - 1e-6)

    return tuple(
        Stop(
            wait.time,
            n_steps if number == len(waits) else whole(wait.time) - stride,
            max(whole(wait.rest), check) if wait.longest else 0,
            whole(wait.longest),
        )
        for number, wait in enumerate(waits, 1)
    )


@dataclass(frozen=True, slots=True, eq=False)
class RunSetup:
    """All of a run but the memory of its state; it can be prepared once.

    Attributes
    ----------
    arrangement : Arrangement
        The condensed mechanism.
    table : LawTable
        Its laws by places, or others there; changed by the run.
    options : Options
        Lengths of steps, tolerances.
    positions : ndarray, shape (n_steps + 1, n_inputs)
        Marker positions at the ends of the steps [m].
    n_stored : int
        Instants of the record.
    velocity : bool
        Whether velocities are stored too.
    obstructions : Obstructions
        Laws with memory.
    courses : FrictionCourses
        Friction along the stroke.
    record : StepRecord, optional
        Of a watched run, which is small; others get theirs when they begin.
    """

    arrangement: Arrangement
    table: LawTable
    options: Options
    positions: Floats
    n_stored: int
    velocity: bool
    obstructions: Obstructions
    courses: FrictionCourses
    record: StepRecord | None


def set_up_run(
    arrangement: Arrangement,
    scheme: Scheme,
    positions: Floats,
    n_stored: int,
    *,
    filled_in: bool = False,
    watched: tuple[WatchPlan, SeenWeights] | None = None,
    table: LawTable | None = None,
) -> RunSetup:
    """Set up a run.

    Parameters
    ----------
    arrangement : Arrangement
        From `arrange`.
    scheme : Scheme
        Step [s], spectral radius, tolerances and halvings.
    positions : ndarray, shape (n_steps + 1, n_inputs)
        Marker positions at the ends of the steps [m].
    n_stored : int
        Instants of the record.
    filled_in : bool
        Whether instants between the steps are wanted, which needs velocities.
    watched : tuple of WatchPlan and SeenWeights, optional
        Which instants are stored whole and kept, and what is seen of these; default all of them.
    table : LawTable, optional
        Laws by places, in place of those of the arrangement.
    """
    table = arrangement.table if table is None else table
    mechanism, velocity = arrangement.mechanism, filled_in and scheme.inertia
    record = None
    if watched is not None:
        system = arrangement.system
        record = empty_record(system, table, n_stored, velocity=velocity, watched=watched)
    return RunSetup(
        arrangement=arrangement,
        table=table,
        options=Options.of(scheme),
        positions=positions,
        n_stored=n_stored,
        velocity=velocity,
        obstructions=_set_up_obstructions(mechanism.obstructions, table),
        courses=_set_up_courses(mechanism.courses, arrangement.frame, table),
        record=record,
    )


def prepare(setup: RunSetup) -> tuple[Run, State]:
    """Give a run that was set up its state, scratch arrays and record; nothing has moved yet."""
    system, table, count = setup.arrangement.system, setup.table, setup.n_stored
    state, work, record = _copy_templates(setup)
    state.inputs[:] = setup.positions[0]
    if setup.record is not None:
        record = setup.record
    elif record is None or record.q.shape[0] != count or setup.velocity:
        record = empty_record(system, table, count, velocity=setup.velocity, watched=None)
    record.residual[:] = 0.0
    given = setup.options, setup.positions, record, setup.obstructions, setup.courses
    return Run(system, table, work, *given), state


def give_back(arrangement: Arrangement, run: Run, state: State, *, record: bool = False) -> None:
    """Give back, at its end, what another run of these rails can use; maybe its record too."""
    if arrangement.known:
        memory = (state, run.work, run.record if record else None)
        give_back_memory(arrangement.frame, run.system, run.options, *memory)


def _set_up_obstructions(given: Obstructions, table: LawTable) -> Obstructions:
    """Return the obstructions of a run; their laws get the dents that they have already."""
    if given.law.size == 0:
        return _without_obstructions()
    obstructions = shared_record(given)
    remember(table, obstructions)
    return obstructions


@cache
def _without_obstructions() -> Obstructions:
    return shared_record(no_obstructions())


def _set_up_courses(courses: FrictionCourses, frame: Frame, table: LawTable) -> FrictionCourses:
    """Return the courses of a run; without any, all runs share them."""
    if courses.has_curves:
        rows = table.friction_row.tobytes()
        feet = frame.feet.get(rows)
        if feet is None:
            feet = frame.feet[rows] = _foot_modes(frame.system, table)
        width = feet["modes"].shape[1]
        courses = courses._replace(**feet, speed=np.zeros(feet["feet"].size * width))
    elif not courses.friction.size:
        return _without_courses()
    return shared_record(courses)


def _foot_modes(system: System, table: LawTable) -> dict[str, NDArray[Any]]:
    """Return the modes at the feet, block by block, and which speed is that of each friction."""
    feet, number = np.unique(table.friction_row.astype(np.int64), return_inverse=True)
    if (system.row_ends[feet, 1] >= 0).any():
        message = "friction that follows speed acts on one rail, not between two"
        raise MechanicsError(message)
    if feet[-1] >= system.end_start[-1]:
        message = "friction that follows speed acts at rows that lead, not at one that follows"
        raise MechanicsError(message)
    start = np.searchsorted(feet, system.end_start)
    count = np.diff(start)
    width = int(whole_lines(count.max()))
    modes = zeros_in_lines(system.load.size + 1, width)
    for block in np.flatnonzero(count):
        own, rows = feet[start[block] :][: count[block]], slice(*system.mode_start[block:][:2])
        modes[rows, : own.size] = system.mode_ends[rows, own - system.end_start[block]]
    block_of = system.block_of_end[feet]
    place = block_of * width + np.arange(feet.size) - start[block_of]
    return {
        "feet": count,
        "modes": modes,
        "speed_of": as_unsigned(place[number]),
    }


@cache
def _without_courses() -> FrictionCourses:
    return shared_record(no_courses())


def _copy_templates(setup: RunSetup) -> tuple[State, Work, StepRecord | None]:
    """Return a state at rest and scratch arrays, copied from the templates.

    Their memory is that of a run before, where there is one, and the record that one left.
    """
    arrangement, table, options = setup.arrangement, setup.table, setup.options
    sizes = setup.positions.shape[1], options.halvings + 2  # levels: halvings, and no inertia
    frame = arrangement.frame
    template = frame.templates.get(sizes)
    if template is None:
        n_inputs, levels = sizes
        fresh = fresh_state(arrangement.system, table, n_inputs=n_inputs, levels=levels)
        template = frame.templates[sizes] = fresh, new_work(arrangement.system, table)
    state, work = template
    memory = take_memory(frame, options, sizes)
    if memory is None:
        return fresh_copy(state), clone_record(work), None
    refill_state(memory.state, state, memory.ready_for(arrangement.system, frame))
    copy_vectors(work, memory.work)
    return memory.state, memory.work, memory.record
