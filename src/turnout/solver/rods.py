"""The machines of drives in the implicit step: their rod ends are inputs that follow from the step.

The rod ends are first taken to go on as they move, and the rails are solved with that. The machines
then meet the rails where they have come to, the rails the rod ends, and so on until no rod end
moves any more: rod ends and rails then hold at once, as in one large implicit step. A machine has
so much inertia and yields so little that its rod end mostly is where it was expected; each
correction takes the change down to a hundredth.
"""

import math
from typing import NamedTuple

from turnout.kernels.compiled import compiled, compiled_part
from turnout.kernels.vector import copy
from turnout.machine.compute import places as at
from turnout.machine.compute.couple import (
    Machines,
    Room,
    accept_machines,
    machines_repeat,
    try_machines,
)
from turnout.solver.record import give_place
from turnout.solver.solve import CONVERGED, NOT_CONVERGED, iterate_contact_set
from turnout.solver.state import Run, State
from turnout.solver.system import Floats, Ints

ROD_TOLERANCE = 1e-8
"""Movement of a rod end or its rail from one correction to the next that is overlooked [m]."""
CORRECTIONS = 12


class Rods(NamedTuple):
    """Machines of a run, one row each; `state` to `given` change as it goes on.

    Attributes
    ----------
    constants, tables, commands, shared_resistance
        See `turnout.machine.compute.couple.Machines`; the last as an array of one.
    rails, work, log, plain
        See `turnout.machine.compute.couple.Room`.
    place, law, input : ndarray of int, shape (n,)
        Place of each rod's row, its law, its input.
    shift : ndarray, shape (n,)
        Input less the rod position of the machine [m].
    lock_gap : ndarray, shape (n,)
        The limit contact acts in closing only with the rail so near to home [m].
    state, trial : ndarray, shape (n, STATES)
        Of the machines; at the end of the step that is tried.
    start, speed, free : ndarray, shape (n,)
        Of the rails at the rods: position and speed at the start of the step, position at its end.
    compliance : ndarray, shape (n, n)
        Zero: what a rod's force does to the rails is found by solving them.
    before, rod_before : ndarray, shape (2, n)
        Positions of rails and rods one and two steps ago [m].
    lengths : ndarray, shape (2,)
        Of these steps [s].
    force, given : ndarray, shape (n,)
        Force of each law at the last instant [N]; work of the rod ends on the rods so far [J].
    left : ndarray, shape (1,)
        Largest movement of a rod end that was left over when a step was accepted [m].
    kept : ndarray, shape (n, n_kept, n_stored)
        The first states over the stored instants; all of them but in a watched run.
    booked, booked_given : ndarray, shapes (n_booked, n, STATES), (n_booked, n)
        States, without rows where `kept` has them all, and work of the rod ends [J], where the
        energies of the rails are stored.
    stood : ndarray of int, shape (n,)
        1 where a machine has come to rest since it was on.
    schedule, stops, stop_times, pauses, ends
        Of `turnout.solver.schedule`: where it is; its stops, shape (n_stops, 3), and the onsets
        after them [s]; begin and length of the pause at each, shape (n_stops, 2) [s]; the ends of
        the movements of markers by the schedule, at which a watched run is kept whole [s].
    planned : ndarray, shape (n, n_commands, 2)
        Commands by the schedule without pauses.
    markers : ndarray, shape (n_steps + 1, n_inputs)
        The same of the inputs; no rows where all drives are machines [m].
    """

    constants: Floats
    tables: Floats
    commands: Floats
    shared_resistance: Floats
    rails: Floats
    work: Floats
    log: Floats
    plain: Floats
    place: Ints
    law: Ints
    input: Ints
    shift: Floats
    lock_gap: Floats
    state: Floats
    trial: Floats
    start: Floats
    speed: Floats
    free: Floats
    compliance: Floats
    before: Floats
    rod_before: Floats
    lengths: Floats
    force: Floats
    given: Floats
    left: Floats
    kept: Floats
    booked: Floats
    booked_given: Floats
    stood: Ints
    schedule: Ints
    stops: Ints
    stop_times: Floats
    pauses: Floats
    ends: Floats
    planned: Floats
    markers: Floats


@compiled_part
def _machines_of(rods: Rods) -> tuple[Machines, Room]:
    shared: float = rods.shared_resistance[0]
    machines = Machines(rods.constants, rods.tables, rods.commands, shared)
    return machines, Room(rods.rails, rods.work, rods.log, rods.plain)


@compiled
def _try_rods(
    rods: Rods, state: State, span: tuple[float, float], overlooked: float
) -> tuple[int, float]:
    """Take the machines over a step; return how far the farthest rod end has moved.

    Inputs are written if that is more than is overlooked [m].
    """
    machines, room = _machines_of(rods)
    ends = (rods.start, rods.speed, rods.free, rods.compliance)
    if try_machines(machines, rods.state, rods.trial, ends, span, room) != CONVERGED:
        return NOT_CONVERGED, 0.0
    farthest = 0.0
    for k in range(rods.input.size):
        x = rods.trial[k, at.ROD_POSITION] + rods.shift[k]
        farthest = max(farthest, abs(x - state.inputs[rods.input[k]]))
    if farthest > overlooked:
        for k in range(rods.input.size):
            state.inputs[rods.input[k]] = rods.trial[k, at.ROD_POSITION] + rods.shift[k]
    return CONVERGED, farthest


@compiled_part
def move_rods(rods: Rods, state: State, inputs: Floats, span: tuple[float, float]) -> None:
    """Predict the rod ends at the end of a step: they go on with speed and acceleration.

    Parameters
    ----------
    inputs : ndarray, shape (n_inputs,)
        At the end of the step; those of the rods are written, here and in the state [m].
    span : tuple of float
        Start and length of the step [s].
    """
    before, rod_before, lengths, h = rods.before, rods.rod_before, rods.lengths, span[1]
    for k in range(rods.input.size):
        y, x = state.g[rods.place[k]] - rods.shift[k], rods.state[k, at.ROD_POSITION]
        rods.start[k] = y
        rods.speed[k], _ = _speed_and_bend(y, before[0, k], before[1, k], lengths)
        speed, bend = _speed_and_bend(x, rod_before[0, k], rod_before[1, k], lengths)
        predicted = x + h * (speed + h * bend)
        state.inputs[rods.input[k]] = predicted + rods.shift[k]
        inputs[rods.input[k]] = state.inputs[rods.input[k]]
        near = rods.state[k, at.DIRECTION] < 0.0 or y >= -rods.lock_gap[k]
        rods.state[k, at.LOCK_ALLOWED] = 1.0 if near else 0.0


@compiled_part
def _speed_and_bend(now: float, one: float, two: float, lengths: Floats) -> tuple[float, float]:
    """Return speed and half the acceleration of the parabola through three positions in time.

    Parameters
    ----------
    now, one, two : float
        Positions now, and one and two steps ago [m].
    lengths : ndarray, shape (2,)
        Of these steps [s].
    """
    last = (now - one) / lengths[0]
    bend = (last - (one - two) / lengths[1]) / (lengths[0] + lengths[1])
    return last + bend * lengths[0], bend


@compiled
def iterate_rods(run: Run, state: State, rods: Rods, span: tuple[float, float]) -> int:
    """Correct rod ends and rails in turn until they hold at once."""
    for number in range(CORRECTIONS):
        off = 0.0
        for k in range(rods.input.size):
            y = state.g[rods.place[k]] - rods.shift[k]
            off = max(off, abs(y - rods.free[k]))
            rods.free[k] = y
        if number > 0 and off <= ROD_TOLERANCE:  # a rod end moves by less than its rail
            return CONVERGED
        code, moved = _try_rods(rods, state, span, ROD_TOLERANCE)
        if code != CONVERGED:
            return code
        if moved <= ROD_TOLERANCE:
            rods.left[0] = max(rods.left[0], moved)
            return CONVERGED
        code = iterate_contact_set(run, state)
        if code != CONVERGED:
            return code
    return NOT_CONVERGED


@compiled
def meet_rods(rods: Rods, state: State, span: tuple[float, float]) -> int:
    """Take the machines to where the rails have come to, which stay there."""
    for k in range(rods.input.size):
        rods.free[k] = state.g[rods.place[k]] - rods.shift[k]
    code, moved = _try_rods(rods, state, span, math.inf)
    rods.left[0] = max(rods.left[0], moved)
    return code


@compiled_part
def accept_rods(
    run: Run, state: State, rods: Rods, begin: Floats, span: tuple[float, float]
) -> None:
    """Accept the end of a step as the machines' state, and add their work on the rods.

    Parameters
    ----------
    begin : ndarray, shape (n_inputs,)
        Inputs at the start of the step [m].
    span : tuple of float
        Its start and length [s].
    """
    work = run.work
    rod_before = rods.rod_before
    for k in range(rods.input.size):
        rod_before[1, k], rod_before[0, k] = rod_before[0, k], rods.state[k, at.ROD_POSITION]
    machines, room = _machines_of(rods)
    accept_machines(machines, rods.state, rods.trial, span, room)
    rods.lengths[1], rods.lengths[0] = rods.lengths[0], span[1]
    for k in range(rods.input.size):
        force, number = work.force[rods.law[k]], rods.input[k]
        rods.given[k] -= 0.5 * (force + rods.force[k]) * (state.inputs[number] - begin[number])
        rods.force[k] = force
        rods.before[1, k], rods.before[0, k] = rods.before[0, k], rods.start[k]


@compiled
def all_stand(rods: Rods) -> bool:
    """Return whether all motors are off, and their gears at rest."""
    for k in range(rods.input.size):
        if rods.state[k, at.ENERGISED] != 0.0 or rods.state[k, at.GEAR_SPEED] != 0.0:
            return False
    return True


@compiled_part
def rods_may_stay(rods: Rods, inputs: tuple[Floats, Floats], span: tuple[float, float]) -> bool:
    """Return whether the machines may do again what they did in the last step, with standing rods.

    Parameters
    ----------
    inputs : tuple of ndarray, shape (n_inputs,)
        At the start and end of the step; those of the rods at its end are written if so [m].
    span : tuple of float
        Its start and length [s].
    """
    machines, room = _machines_of(rods)
    if not machines_repeat(machines, rods.state, span, room):
        return False
    for number in rods.input:
        inputs[1][number] = inputs[0][number]
    return True


@compiled_part
def repeat_rods(rods: Rods, span: tuple[float, float]) -> None:
    """Let the machines do again what they did in the last step."""
    machines, room = _machines_of(rods)
    accept_machines(machines, rods.state, rods.trial, span, room)


@compiled
def store_rods(run: Run, state: State, rods: Rods, inputs: Floats, row: int) -> None:
    """Write the inputs of the rods, and their machines where an instant is stored.

    A watched run keeps an instant whole at which a machine has come to rest.
    """
    record = run.record
    for k in range(rods.input.size):
        inputs[rods.input[k]] = state.inputs[rods.input[k]]
    if row < 0:
        return
    listed = record.places.shape[0] > 0
    for k in range(rods.input.size):
        if rods.state[k, at.ENERGISED] > 0.0:
            rods.stood[k] = 0
        elif rods.stood[k] == 0 and rods.state[k, at.GEAR_SPEED] == 0.0:
            rods.stood[k] = 1
            if listed:
                give_place(record, row)
        for place in range(rods.kept.shape[1]):
            rods.kept[k, place, row] = rods.state[k, place]
    booked = record.places[row, 2] if listed else row
    if booked >= 0:
        for k in range(rods.input.size):
            if rods.booked.shape[0] > 0:
                copy(rods.state[k], rods.booked[booked, k])
            rods.booked_given[booked, k] = rods.given[k]


@compiled
def start_rods(run: Run, state: State, rods: Rods) -> None:
    """Start the machines from the rails at rest, and store the first instant."""
    for k in range(rods.input.size):
        y, force = state.g[rods.place[k]] - rods.shift[k], run.work.force[rods.law[k]]
        rods.before[0, k] = rods.before[1, k] = y
        rods.rod_before[0, k] = rods.rod_before[1, k] = rods.state[k, at.ROD_POSITION]
        rods.force[k] = force
        rods.state[k, at.ROD_FORCE] = -force
    store_rods(run, state, rods, run.positions[0], 0)


@compiled
def find_slips(
    time: Floats,
    slip: Floats,
    ons: Floats,
    travel: Floats,
    overlooked: tuple[float, float],
    found: Ints,
) -> None:
    """Flag the instants at which clutches slip.

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        [s].
    slip : ndarray, shape (n, n_times)
        By which each clutch has slipped [rad].
    ons : ndarray, shape (n, n_ons)
        When each contactor closed, rising, filled up with inf [s].
    travel : ndarray, shape (n,)
        Of each rod per angle of the shaft [m/rad].
    overlooked : tuple of float
        Slip from one instant to the next [rad], and of the rod since the contactor closed [m].
    found : ndarray of int, shape (n, n_times)
        Written: 1 or 0.
    """
    step, least = overlooked
    for k in range(slip.shape[0]):
        own, number, before = slip[k], 0, 0.0
        for i in range(time.size):
            while number < ons.shape[1] and ons[k, number] <= time[i]:
                before = own[i] if ons[k, number] == time[i] else own[max(i - 1, 0)]
                number += 1
            moves = i > 0 and abs(own[i] - own[i - 1]) > step
            found[k, i] = 1 if moves and abs(own[i] - before) * travel[k] > least else 0
