"""The schedule of a run with machines, which pauses while these still move at one of its stops.

A stop lies before each movement but the first, and at the end. What follows from a pause, commands
and positions of markers, is written where it is known: first that they stand still, then by how
much they are late.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.kernels.compiled import compiled, compiled_part
from turnout.solver.record import give_place
from turnout.solver.rods import Rods, all_stand
from turnout.solver.state import Run
from turnout.solver.system import Ints

Floats = NDArray[np.float64]

(STEP, REST, LONGEST) = range(3)
"""Columns of `Rods.stops`: those of `turnout.solver.arrange.Stop`."""
(BEGIN, LENGTH) = range(2)
"""Columns of `Rods.pauses`."""
(NUMBER, PHASE, DUE, BEGUN, LATE, ROOM, CHECK, PLACES) = range(8)
"""Places in `Rods.schedule`: number of the stop that is next, phase on the way to it, step at which
that ends, step at which the pause began, steps by which the schedule is late, steps that there is
memory for, steps from one check whether machines stand to the next."""
(BEGINS, APPROACHES, WAITS, RESTS, ENDED) = range(5)
"""Phases of the schedule."""


@dataclass(frozen=True, slots=True)
class Pause:
    """When the schedule stands still for machines: from `begin` on, for a `length` [s]."""

    begin: float
    length: float


def schedule_time(time: Floats, pauses: Sequence[Pause]) -> Floats:
    """Return the time of the schedule at times of a run [s].

    Examples
    --------
    >>> schedule_time(np.array([1.0, 2.5, 4.0]), [Pause(2.0, 1.5)])
    array([1. , 2. , 2.5])
    """
    return time - sum(np.clip(time - item.begin, 0.0, item.length) for item in pauses)


def pauses_until(run: Run, rods: Rods, done: int) -> tuple[Pause, ...]:
    """Return a pause for each stop up to that which a run to a step has come to or was going to."""
    number, phase, *_ = rods.schedule.tolist()
    if phase in (WAITS, RESTS):  # it has ended early
        end_pause(run, rods, done)
    return tuple(Pause(*pause) for pause in rods.pauses[: number + 1].tolist())


@compiled_part
def schedule_ends(run: Run, rods: Rods, done: int) -> bool:
    """Follow the schedule at a step that is done; return whether the run ends with it."""
    schedule = rods.schedule
    if schedule[PHASE] == WAITS and (done - schedule[BEGUN]) % schedule[CHECK] == 0:  # noqa: SIM102
        if all_stand(rods):
            schedule[DUE] = done
    if done >= schedule[DUE]:
        _end_phases(run, rods, done)
    return bool(schedule[PHASE] == ENDED)


@compiled
def _end_phases(run: Run, rods: Rods, done: int) -> None:
    """End the phases that are over at a step."""
    schedule = rods.schedule
    while schedule[PHASE] != ENDED and done >= schedule[DUE]:
        phase, number = schedule[PHASE], schedule[NUMBER]
        stop = rods.stops[max(number, 0)]
        if phase == APPROACHES and stop[LONGEST] > 0 and not all_stand(rods):
            schedule[PHASE], schedule[BEGUN] = WAITS, done
            schedule[DUE] = min(done + stop[LONGEST], schedule[ROOM])
            rods.pauses[number, LENGTH] = math.inf
            _postpone(run, rods, done)
            _keep_whole(run, schedule[DUE])
        elif phase == WAITS:
            schedule[PHASE], schedule[DUE] = RESTS, min(done + stop[REST], schedule[ROOM])
            _keep_whole(run, schedule[DUE])
        else:
            if phase == RESTS:
                end_pause(run, rods, done)
            _approach_next(run, rods, done)


@compiled
def end_pause(run: Run, rods: Rods, done: int) -> None:
    """End a pause at a step: all that follows is late by it."""
    schedule, step = rods.schedule, run.options.step
    number, length = schedule[NUMBER], done - schedule[BEGUN]
    rods.pauses[number, LENGTH] = length * step
    schedule[LATE] += length
    schedule[PHASE] = APPROACHES
    _postpone(run, rods, done)
    for end in rods.ends:
        if end > rods.stop_times[number]:
            _keep_whole(run, schedule[LATE] + end / step)


@compiled
def _approach_next(run: Run, rods: Rods, done: int) -> None:
    """Go on to the next stop; after the last one the schedule has ended."""
    schedule, step = rods.schedule, run.options.step
    number = schedule[NUMBER] + 1
    if number > 0 and done < schedule[ROOM] and not all_stand(rods):
        _keep_whole(run, done + run.options.stride)  # the end of an unfinished movement
    if number == rods.stops.shape[0]:
        schedule[PHASE] = ENDED
        return
    schedule[NUMBER], schedule[PHASE] = number, APPROACHES
    rods.pauses[number, BEGIN] = rods.stop_times[number] + schedule[LATE] * step
    schedule[DUE] = min(rods.stops[number, STEP] + schedule[LATE], schedule[ROOM])
    _keep_whole(run, schedule[DUE])


@compiled
def _keep_whole(run: Run, step: float) -> None:
    """Let a watched run keep the first stored instant from a step on whole."""
    row = math.ceil(step / run.options.stride - 1e-6)
    if row < run.record.places.shape[0]:
        give_place(run.record, row)


@compiled
def _postpone(run: Run, rods: Rods, done: int) -> None:
    """Write the commands, and the positions of markers after a step, that follow from the pauses.

    Markers stand during a pause, as they do at the instants before an onset.
    """
    schedule, total = rods.schedule, 0.0
    number, late = schedule[NUMBER], schedule[LATE]
    for pause in range(number + 1):
        total += rods.pauses[pause, LENGTH]
    for machine in range(rods.commands.shape[0]):
        for later in range(number + 1, rods.commands.shape[1]):
            rods.commands[machine, later, 0] = rods.planned[machine, later, 0] + total
    if rods.markers.shape[0] == 0:
        return
    last = rods.markers.shape[0] - 1
    if schedule[PHASE] == WAITS:
        last = math.floor(rods.stop_times[number] / run.options.step + 1e-6)
    for row in range(done + 1, rods.markers.shape[0]):
        for column in range(rods.markers.shape[1]):
            run.positions[row, column] = rods.markers[min(row - late, last), column]


def new_schedule(room: int, check: int) -> Ints:
    """Return `Rods.schedule` of a run that has not begun, with its memory and checks in steps."""
    found = np.zeros(PLACES, dtype=np.int64)
    found[[NUMBER, ROOM, CHECK]] = -1, room, check
    return found
