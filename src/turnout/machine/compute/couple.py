"""Machines in the step of a larger mechanism that answers to their rod forces.

For one step the mechanism is condensed to the rod ends: without the forces that the rods have at
the end of the step its points are at `free`, and a force there moves them by `compliance`, so that
at the end of the step

    y = free + compliance F,    F = k_r (x - y)

holds for all machines at once: the same answer as one large implicit step. In between, the points
are taken along the parabola through their position and speed at the start. Nothing here changes the
state: a step may be tried as often as it takes the mechanism to settle, and is then accepted.
"""

from typing import NamedTuple

from turnout.kernels.compiled import compiled_part
from turnout.kernels.vector import copy
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.circuit import (
    accept_plain_step,
    advance,
    repeats_step,
    try_plain_step,
)
from turnout.machine.compute.machine_step import SECOND, MachineArrays
from turnout.machine.compute.motor import supply_current

SWEEPS = 40
FORCE_ROUNDING = 1e-9
"""Error of a rod force that is overlooked, as a share of it and 1 N together."""
VOLTAGE_ROUNDING = 1e-9
"""Error of what the others take from a shared supply, as a share of its voltage."""


class Machines(NamedTuple):
    """Machines of a mechanism, one row each; nothing changes during a run.

    Attributes
    ----------
    constants : ndarray, shape (n, CONSTANTS)
    tables : ndarray, shape (n, n_rows, 5)
        Of their strokes, see `turnout.machine.compute.machine_step.rod_position`.
    commands : ndarray, shape (n, n_commands, 2)
        Time [s], inf where there are fewer, and direction.
    shared_resistance : float
        Of the supply that all share [ohm]; `constants` hold it too, for the own current.
    """

    constants: Floats
    tables: Floats
    commands: Floats
    shared_resistance: float


class Room(NamedTuple):
    """Room for a step, a row each machine.

    Attributes
    ----------
    rails : ndarray, shape (n, RAIL_CONSTANTS)
        As seen from the rods.
    work : ndarray, shape (n, WORK_ROWS, ROD_FORCE + 1)
        Stages.
    log : ndarray, shape (n, n_events, 2)
        Time and event.
    plain : ndarray, shape (n,)
        1 where the step was solved without its end being worked out: of `trial` only rod position
        and force are those at its end. 0 once something has switched at its end.
    """

    rails: Floats
    work: Floats
    log: Floats
    plain: Floats


@compiled_part
def _arrays_of(machines: Machines, room: Room, number: int) -> MachineArrays:
    """Return the arrays of one machine."""
    return MachineArrays(
        machines.constants[number],
        room.rails[number],
        machines.tables[number],
        machines.commands[number],
        room.work[number],
        room.log[number],
    )


@compiled_part
def _others_move(compliance: Floats, trial: Floats, number: int) -> float:
    """Return by how much the other machines' forces move a rod's end [m]."""
    moved = 0.0
    for other in range(trial.shape[0]):
        if other != number:
            moved += compliance[number, other] * trial[other, at.ROD_FORCE]
    return moved


@compiled_part
def _others_current(machines: Machines, trial: Floats, number: int) -> tuple[float, float]:
    """Return the current that the other machines take from the supply [A].

    Of induction motors, peak, along and across the supply's voltage as this machine's direction
    sees it: exchanging two phases mirrors the phasors.
    """
    current, across = 0.0, 0.0
    for other in range(trial.shape[0]):
        if other == number or not trial[other, at.ENERGISED] > 0.0:
            continue
        along, ahead = supply_current(machines.constants[other], trial[other])
        current += along
        across += ahead * trial[other, at.DIRECTION] * trial[number, at.DIRECTION]
    return current, across


@compiled_part
def try_machines(
    machines: Machines,
    state: Floats,
    trial: Floats,
    ends: tuple[Floats, Floats, Floats, Floats],
    span: tuple[float, float],
    room: Room,
) -> int:
    """Take all machines over one step of the mechanism, from `state` to `trial`.

    Parameters
    ----------
    machines : Machines
    state : ndarray, shape (n, STATES)
        At the start of the step; not changed but for what only depends on it (local faults).
    trial : ndarray, shape (n, STATES)
        Receives the end of the step: ROD_POSITION is what the mechanism takes as its input,
        ROD_FORCE what it should find there. The rest follows at `accept_machines`.
    ends : tuple of ndarray
        Position and speed of the rod ends at the start [m], [m/s], shape (n,); position at the end
        of the step without the rod forces there [m], shape (n,); compliance [m/N], shape (n, n).
        All zeros for the compliance, and the predicted position, is the staggered step.
    span : tuple of float
        Start and length of the step [s].
    room : Room

    Returns
    -------
    int
        CONVERGED or NOT_CONVERGED.
    """
    start, speed, free, compliance = ends
    count = state.shape[0]
    shared = machines.shared_resistance > 0.0
    for number in range(count):
        trial[number, at.ROD_FORCE] = state[number, at.ROD_FORCE]
        if shared:
            copy(state[number], trial[number])
    for _ in range(SWEEPS):
        for number in range(count):
            machine, rail = _arrays_of(machines, room, number), room.rails[number]
            rail[at.RAIL_START], rail[at.RAIL_START_SPEED] = start[number], speed[number]
            rail[at.RAIL_FREE] = free[number] + _others_move(compliance, trial, number)
            rail[at.RAIL_COMPLIANCE] = compliance[number, number]
            rail[at.RAIL_TIME], rail[at.RAIL_STEP] = span
            room.plain[number] = 0.0
            if not shared and try_plain_step(machine, state[number], span):
                room.plain[number] = 1.0
                trial[number, at.ROD_POSITION] = machine.work[SECOND, at.ROD_POSITION]
                trial[number, at.ROD_FORCE] = machine.work[SECOND, at.ROD_FORCE]
                continue
            drop, across = 0.0, 0.0
            if shared:
                drop, across = _others_current(machines, trial, number)
            copy(state[number], trial[number])
            trial[number, at.SHARED_DROP] = machines.shared_resistance * drop
            trial[number, at.SHARED_DROP_ACROSS] = machines.shared_resistance * across
            code = advance(machine, trial[number], span)
            if code != at.CONVERGED:
                return code
        if _agree(machines, trial, free, compliance, room.rails):
            return at.CONVERGED
    return at.NOT_CONVERGED


@compiled_part
def _agree(
    machines: Machines, trial: Floats, free: Floats, compliance: Floats, rails: Floats
) -> bool:
    """Return whether each machine was solved with the final values of the others."""
    for number in range(trial.shape[0]):
        moved = free[number] + _others_move(compliance, trial, number) - rails[number, at.RAIL_FREE]
        error = machines.constants[number, at.ROD_STIFFNESS] * abs(moved)
        if not error <= FORCE_ROUNDING * (1.0 + abs(trial[number, at.ROD_FORCE])):
            return False
        if not machines.shared_resistance > 0.0:
            continue
        drop, across = _others_current(machines, trial, number)
        error = abs(machines.shared_resistance * drop - trial[number, at.SHARED_DROP])
        error += abs(machines.shared_resistance * across - trial[number, at.SHARED_DROP_ACROSS])
        if not error <= VOLTAGE_ROUNDING * machines.constants[number, at.VOLTAGE]:
            return False
    return True


@compiled_part
def accept_machines(
    machines: Machines, state: Floats, trial: Floats, span: tuple[float, float], room: Room
) -> None:
    """Make the end of a step that `try_machines` has tried last the state."""
    for number in range(state.shape[0]):
        if room.plain[number] == 0.0:
            copy(trial[number], state[number])
            continue
        logged = state[number, at.EVENTS]
        accept_plain_step(_arrays_of(machines, room, number), state[number], span)
        if state[number, at.EVENTS] > logged:
            room.plain[number] = 0.0


@compiled_part
def machines_repeat(
    machines: Machines, state: Floats, span: tuple[float, float], room: Room
) -> bool:
    """Return whether a step would be as the one accepted last, which may be accepted again."""
    for number in range(state.shape[0]):
        machine = _arrays_of(machines, room, number)
        if room.plain[number] == 0.0 or not repeats_step(machine, state[number], span):
            return False
    return True
