"""What a machine's circuit switches and when: contactor, cut-off, time-out, relay, hand, log."""

import math

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.induction import drop_fluxes
from turnout.machine.compute.lost_phase import lose_phase

INSTANT = 1e-12
"""Times nearer to each other are one instant [s]."""


@compiled_part
def log_event(state: Floats, log: Floats, time: float, event: int) -> None:
    """Write an event into the log where there is room; count it in any case."""
    row = int(state[at.EVENTS])
    if row < log.shape[0]:
        log[row, 0], log[row, 1] = time, event
    state[at.EVENTS] = row + 1


@compiled
def switch_on(constants: Floats, state: Floats, time: float, direction: float) -> None:
    """Close the contactor, or begin to crank: the lock and the brake open."""
    state[at.ENERGISED], state[at.DIRECTION] = 1.0, direction
    state[at.LOCKED], state[at.STILL_TORQUE] = 0.0, constants[at.LOSS_TORQUE]
    state[at.CONTACTOR_TIME], state[at.CUTOFF_TIME] = time, math.inf
    state[at.OVERLOAD_SINCE] = math.inf
    if constants[at.HAND_GAIN] > 0.0:
        state[at.HAND_ON], state[at.HAND_SINCE], state[at.ARMATURE_OPEN] = 1.0, time, 1.0
        state[at.SUPPLIED] = 0.0
        return
    state[at.ARMATURE_OPEN] = 0.0
    reversed_voltage = direction < 0.0 and constants[at.SERIES] + constants[at.THREE_PHASE] == 0.0
    state[at.SUPPLIED] = -constants[at.VOLTAGE] if reversed_voltage else constants[at.VOLTAGE]
    state[at.CIRCUIT_RESISTANCE] = constants[at.RESISTANCE] + constants[at.LINE_RESISTANCE]


@compiled
def switch_off(constants: Floats, state: Floats) -> None:
    """Open the contactor: snubbing or an open armature, and the brake."""
    state[at.ENERGISED], state[at.SUPPLIED] = 0.0, 0.0
    state[at.HAND_ON] *= constants[at.HAND_STAYS]
    state[at.CUTOFF_TIME] = math.inf
    state[at.STILL_TORQUE] = constants[at.LOSS_TORQUE] + constants[at.BRAKE_TORQUE]
    state[at.CIRCUIT_RESISTANCE] = constants[at.RESISTANCE] + constants[at.SNUB_RESISTANCE]
    if constants[at.OPEN_AFTER] > 0.0 or constants[at.HAND_GAIN] > 0.0:
        state[at.ARMATURE_OPEN] = 1.0
        # the arc takes what the coil holds
        coil = 0.5 * constants[at.INDUCTANCE] * state[at.CURRENT] ** 2
        state[at.ENERGIES + at.SNUB] += coil
        state[at.ENERGIES + at.INTO_STORES] -= coil
        state[at.CURRENT] = 0.0
        if constants[at.THREE_PHASE] > 0.0:
            drop_fluxes(constants, state)


@compiled_part
def next_instant(constants: Floats, state: Floats, commands: Floats, time: float) -> float:
    """Return the next known switching instant, inf if there is none [s]."""
    instant = math.inf
    row = int(state[at.NEXT_COMMAND])
    if row < commands.shape[0]:
        instant = commands[row, 0] + constants[at.CONTACTOR_DELAY]
    if state[at.ENERGISED] > 0.0:
        instant = min(
            instant, state[at.CONTACTOR_TIME] + constants[at.TIME_OUT], state[at.CUTOFF_TIME]
        )
        instant = min(instant, state[at.OVERLOAD_SINCE] + constants[at.OVERLOAD_TIME])
    if state[at.HAND_ON] > 0.0:
        corner = state[at.HAND_SINCE] + constants[at.HAND_RAMP]
        if corner > time + INSTANT:
            instant = min(instant, corner)
    if state[at.PHASE_LOST] == 0.0:
        instant = min(instant, constants[at.PHASE_LOST_TIME])
    return float(instant)


@compiled_part
def switch_due(
    constants: Floats, state: Floats, commands: Floats, time: float, log: Floats
) -> None:
    """Switch what is due at an instant; a command while energised reverses the motor at once."""
    now = time + INSTANT
    if state[at.PHASE_LOST] == 0.0 and now >= constants[at.PHASE_LOST_TIME]:
        lose_phase(constants, state)
        log_event(state, log, time, at.EVENT_PHASE_LOST)
    if state[at.ENERGISED] > 0.0:
        if now >= state[at.CUTOFF_TIME]:
            switch_off(constants, state)
            log_event(state, log, time, at.EVENT_OFF_LIMIT)
        elif now >= state[at.CONTACTOR_TIME] + constants[at.TIME_OUT]:
            switch_off(constants, state)
            log_event(state, log, time, at.EVENT_OFF_TIME_OUT)
        elif now >= state[at.OVERLOAD_SINCE] + constants[at.OVERLOAD_TIME]:
            switch_off(constants, state)
            log_event(state, log, time, at.EVENT_OFF_OVERLOAD)
    row = int(state[at.NEXT_COMMAND])
    if row < commands.shape[0] and now >= commands[row, 0] + constants[at.CONTACTOR_DELAY]:
        if state[at.ENERGISED] > 0.0:
            switch_off(constants, state)
        switch_on(constants, state, time, commands[row, 1])
        state[at.NEXT_COMMAND] = row + 1
        log_event(state, log, time, at.EVENT_ON)


@compiled_part
def _lock_standing(constants: Floats, state: Floats, log: Floats, time: float) -> None:
    """Lock at once what stands when the contactor opens."""
    free = state[at.ENERGISED] == 0.0 and state[at.LOCKED] == 0.0 and constants[at.HOLDS] > 0.0
    if free and state[at.GEAR_SPEED] == 0.0:
        state[at.LOCKED] = 1.0
        log_event(state, log, time, at.EVENT_LOCKED)


@compiled_part
def switch_all_due(
    constants: Floats, state: Floats, commands: Floats, time: float, log: Floats
) -> float:
    """Switch all that is due at an instant, and return the next one [s]."""
    instant = next_instant(constants, state, commands, time)
    while instant <= time + INSTANT:
        switch_due(constants, state, commands, time, log)
        _lock_standing(constants, state, log, time)
        instant = next_instant(constants, state, commands, time)
    return instant
