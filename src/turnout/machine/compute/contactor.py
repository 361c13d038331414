"""What a machine's circuit switches and when: contactor, cut-off, time-out, relay, hand, log."""

import math

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute.induction import drop_fluxes
from turnout.machine.compute.lost_phase import lose_phase
from turnout.machine.compute.places import (
    ARMATURE_OPEN,
    BRAKE_TORQUE,
    CIRCUIT_RESISTANCE,
    CONTACTOR_DELAY,
    CONTACTOR_TIME,
    CURRENT,
    CUTOFF_TIME,
    DIRECTION,
    ENERGIES,
    ENERGISED,
    EVENT_LOCKED,
    EVENT_OFF_LIMIT,
    EVENT_OFF_OVERLOAD,
    EVENT_OFF_TIME_OUT,
    EVENT_ON,
    EVENT_PHASE_LOST,
    EVENTS,
    GEAR_SPEED,
    HAND_GAIN,
    HAND_ON,
    HAND_RAMP,
    HAND_SINCE,
    HAND_STAYS,
    HOLDS,
    INDUCTANCE,
    INTO_STORES,
    LINE_RESISTANCE,
    LOCKED,
    LOSS_TORQUE,
    NEXT_COMMAND,
    OPEN_AFTER,
    OVERLOAD_SINCE,
    OVERLOAD_TIME,
    PHASE_LOST,
    PHASE_LOST_TIME,
    RESISTANCE,
    SERIES,
    SNUB,
    SNUB_RESISTANCE,
    STILL_TORQUE,
    SUPPLIED,
    THREE_PHASE,
    TIME_OUT,
    VOLTAGE,
)

INSTANT = 1e-12
"""Times nearer to each other are one instant [s]."""


@compiled_part
def log_event(state: Floats, log: Floats, time: float, event: int) -> None:
    """Write an event into the log where there is room; count it in any case."""
    at = int(state[EVENTS])
    if at < log.shape[0]:
        log[at, 0], log[at, 1] = time, event
    state[EVENTS] = at + 1


@compiled
def switch_on(constants: Floats, state: Floats, time: float, direction: float) -> None:
    """Close the contactor, or begin to crank: the lock and the brake open."""
    state[ENERGISED], state[DIRECTION] = 1.0, direction
    state[LOCKED], state[STILL_TORQUE] = 0.0, constants[LOSS_TORQUE]
    state[CONTACTOR_TIME], state[CUTOFF_TIME] = time, math.inf
    state[OVERLOAD_SINCE] = math.inf
    if constants[HAND_GAIN] > 0.0:
        state[HAND_ON], state[HAND_SINCE], state[ARMATURE_OPEN] = 1.0, time, 1.0
        state[SUPPLIED] = 0.0
        return
    state[ARMATURE_OPEN] = 0.0
    reversed_voltage = direction < 0.0 and constants[SERIES] + constants[THREE_PHASE] == 0.0
    state[SUPPLIED] = -constants[VOLTAGE] if reversed_voltage else constants[VOLTAGE]
    state[CIRCUIT_RESISTANCE] = constants[RESISTANCE] + constants[LINE_RESISTANCE]


@compiled
def switch_off(constants: Floats, state: Floats) -> None:
    """Open the contactor: snubbing or an open armature, and the brake."""
    state[ENERGISED], state[SUPPLIED] = 0.0, 0.0
    state[HAND_ON] *= constants[HAND_STAYS]
    state[CUTOFF_TIME] = math.inf
    state[STILL_TORQUE] = constants[LOSS_TORQUE] + constants[BRAKE_TORQUE]
    state[CIRCUIT_RESISTANCE] = constants[RESISTANCE] + constants[SNUB_RESISTANCE]
    if constants[OPEN_AFTER] > 0.0 or constants[HAND_GAIN] > 0.0:
        state[ARMATURE_OPEN] = 1.0
        # the arc takes what the coil holds
        coil = 0.5 * constants[INDUCTANCE] * state[CURRENT] ** 2
        state[ENERGIES + SNUB] += coil
        state[ENERGIES + INTO_STORES] -= coil
        state[CURRENT] = 0.0
        if constants[THREE_PHASE] > 0.0:
            drop_fluxes(constants, state)


@compiled_part
def next_instant(constants: Floats, state: Floats, commands: Floats, time: float) -> float:
    """Return the next known switching instant, inf if there is none [s]."""
    instant = math.inf
    at = int(state[NEXT_COMMAND])
    if at < commands.shape[0]:
        instant = commands[at, 0] + constants[CONTACTOR_DELAY]
    if state[ENERGISED] > 0.0:
        instant = min(instant, state[CONTACTOR_TIME] + constants[TIME_OUT], state[CUTOFF_TIME])
        instant = min(instant, state[OVERLOAD_SINCE] + constants[OVERLOAD_TIME])
    if state[HAND_ON] > 0.0:
        corner = state[HAND_SINCE] + constants[HAND_RAMP]
        if corner > time + INSTANT:
            instant = min(instant, corner)
    if state[PHASE_LOST] == 0.0:
        instant = min(instant, constants[PHASE_LOST_TIME])
    return float(instant)


@compiled_part
def switch_due(
    constants: Floats, state: Floats, commands: Floats, time: float, log: Floats
) -> None:
    """Switch what is due at an instant; a command while energised reverses the motor at once."""
    now = time + INSTANT
    if state[PHASE_LOST] == 0.0 and now >= constants[PHASE_LOST_TIME]:
        lose_phase(constants, state)
        log_event(state, log, time, EVENT_PHASE_LOST)
    if state[ENERGISED] > 0.0:
        if now >= state[CUTOFF_TIME]:
            switch_off(constants, state)
            log_event(state, log, time, EVENT_OFF_LIMIT)
        elif now >= state[CONTACTOR_TIME] + constants[TIME_OUT]:
            switch_off(constants, state)
            log_event(state, log, time, EVENT_OFF_TIME_OUT)
        elif now >= state[OVERLOAD_SINCE] + constants[OVERLOAD_TIME]:
            switch_off(constants, state)
            log_event(state, log, time, EVENT_OFF_OVERLOAD)
    at = int(state[NEXT_COMMAND])
    if at < commands.shape[0] and now >= commands[at, 0] + constants[CONTACTOR_DELAY]:
        if state[ENERGISED] > 0.0:
            switch_off(constants, state)
        switch_on(constants, state, time, commands[at, 1])
        state[NEXT_COMMAND] = at + 1
        log_event(state, log, time, EVENT_ON)


@compiled_part
def _lock_standing(constants: Floats, state: Floats, log: Floats, time: float) -> None:
    """Lock at once what stands when the contactor opens."""
    free = state[ENERGISED] == 0.0 and state[LOCKED] == 0.0 and constants[HOLDS] > 0.0
    if free and state[GEAR_SPEED] == 0.0:
        state[LOCKED] = 1.0
        log_event(state, log, time, EVENT_LOCKED)


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
