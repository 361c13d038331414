"""A machine over a span of time: steps between what switches, located where they must be.

`advance` covers a span with steps that end at every switching instant. The length of a step is cut
at known instants; the limit contact and the standstill of the lock are located inside a step, which
is then taken again up to there. A step that does not converge is taken in halves.

Within a step the clutch slips at one level. At the end of a step a sticking clutch that reached
its breakaway torque falls to its kinetic level: the twist gives the difference to the slip, and the
released energy becomes heat. It sticks again as soon as its torque falls below the kinetic level.
"""

import math

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.induction import lose_phase
from turnout.machine.compute.machine_step import (
    FIRST,
    SECOND,
    MachineArrays,
    accept_step,
    rail_at,
    rail_side,
    take_step,
)
from turnout.machine.compute.motor import drop_field, supplied_voltage

HALVINGS = 20
"""A step is halved at most so often before the run ends."""
LOCATE = 40
"""So many trials locate a switching instant within a step."""
ANGLE_ROUNDING = 1e-10
"""Shaft angle by which a limit contact may be missed [rad]."""
INSTANT = 1e-12
"""Times nearer to each other are one instant [s]."""
LEAST_LEVEL = 0.05
"""Share of the level of the new clutch that heat and wear leave at least."""
REACHED = 1e-12
"""Share of its level by which a clutch may be below it and count as slipping."""
REPEATED = 1e-6
"""Share of itself per time by which a state may still change in a step that is as the next [1/s].

The power by which the energy balance does not close then is that share of what is stored.
"""


# --- the clutch from step to step


@compiled
def kinetic_level(constants: Floats, state: Floats) -> float:
    """Return the torque of the slipping clutch at its temperature and wear [N m]."""
    share = 1.0 + constants[at.LEVEL_PER_KELVIN] * state[at.CLUTCH_TEMPERATURE]
    share -= constants[at.LEVEL_PER_JOULE] * state[at.ENERGIES + at.CLUTCH]
    return float(constants[at.CLUTCH_TORQUE] * max(share, LEAST_LEVEL))


@compiled_part
def update_clutch(constants: Floats, state: Floats, step: float) -> None:
    """Let breakaway, temperature and wear follow from the end of a step of a length [s]."""
    kinetic, stiffness = kinetic_level(constants, state), constants[at.CLUTCH_STIFFNESS]
    if constants[at.STATIC_RATIO] > 1.0:
        torque = stiffness * abs(state[at.TWIST])
        if state[at.SLIPPING] == 0.0 and torque >= state[at.LEVEL] * (1.0 - REACHED):
            twist = math.copysign(min(kinetic / stiffness, abs(state[at.TWIST])), state[at.TWIST])
            released = 0.5 * stiffness * (state[at.TWIST] ** 2 - twist**2)
            state[at.SLIP] += state[at.TWIST] - twist
            state[at.ENERGIES + at.CLUTCH] += released
            state[at.ENERGIES + at.INTO_STORES] -= released
            state[at.TWIST], state[at.SLIPPING] = twist, math.copysign(1.0, twist)
        elif state[at.SLIPPING] != 0.0 and torque < state[at.LEVEL] * (1.0 - REACHED):
            state[at.SLIPPING] = 0.0
    heat = state[at.ENERGIES + at.CLUTCH] - state[at.HEAT_COUNTED]
    state[at.HEAT_COUNTED] = state[at.ENERGIES + at.CLUTCH]
    state[at.CLUTCH_TEMPERATURE] += heat / constants[at.CLUTCH_HEAT_CAPACITY]
    state[at.LEVEL] = kinetic * (1.0 if state[at.SLIPPING] != 0.0 else constants[at.STATIC_RATIO])
    if constants[at.CLUTCH_COOLING] > 0.0:
        state[at.CLUTCH_TEMPERATURE] *= math.exp(-constants[at.CLUTCH_COOLING] * step)


# --- contactor, cut-off, time-out, relay, hand and log


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
    state[at.SUPPLIED] = supplied_voltage(constants, direction)
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
        drop_field(constants, state)


@compiled_part
def next_instant(machine: MachineArrays, state: Floats, time: float) -> float:
    """Return the next known switching instant, inf if there is none [s]."""
    constants, commands = machine.constants, machine.commands
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
def switch_due(machine: MachineArrays, state: Floats, time: float) -> None:
    """Switch what is due at an instant; a command while energised reverses the motor at once."""
    constants, commands, log = machine.constants, machine.commands, machine.log
    now = time + INSTANT
    if state[at.PHASE_LOST] == 0.0 and now >= constants[at.PHASE_LOST_TIME]:
        lose_phase(constants, state)
        log_event(state, log, time, at.EVENT_PHASE_LOST)
    if state[at.ENERGISED] > 0.0:
        off = at.EVENT_ON
        if now >= state[at.CUTOFF_TIME]:
            off = at.EVENT_OFF_LIMIT
        elif now >= state[at.CONTACTOR_TIME] + constants[at.TIME_OUT]:
            off = at.EVENT_OFF_TIME_OUT
        elif now >= state[at.OVERLOAD_SINCE] + constants[at.OVERLOAD_TIME]:
            off = at.EVENT_OFF_OVERLOAD
        if off != at.EVENT_ON:
            switch_off(constants, state)
            log_event(state, log, time, off)
    row = int(state[at.NEXT_COMMAND])
    if row < commands.shape[0] and now >= commands[row, 0] + constants[at.CONTACTOR_DELAY]:
        if state[at.ENERGISED] > 0.0:
            switch_off(constants, state)
        switch_on(constants, state, time, commands[row, 1])
        state[at.NEXT_COMMAND] = row + 1
        log_event(state, log, time, at.EVENT_ON)


@compiled_part
def _may_lock(constants: Floats, state: Floats) -> bool:
    """Return whether the lock holds the gear at its next standstill."""
    return bool(
        constants[at.HOLDS] > 0.0 and state[at.ENERGISED] == 0.0 and state[at.LOCKED] == 0.0
    )


@compiled_part
def _lock_standing(constants: Floats, state: Floats, log: Floats, time: float) -> None:
    """Lock at once what stands when the contactor opens."""
    if _may_lock(constants, state) and state[at.GEAR_SPEED] == 0.0:
        state[at.LOCKED] = 1.0
        log_event(state, log, time, at.EVENT_LOCKED)


@compiled_part
def switch_all_due(machine: MachineArrays, state: Floats, time: float) -> float:
    """Switch all that is due at an instant, and return the next one [s]."""
    instant = next_instant(machine, state, time)
    while instant <= time + INSTANT:
        switch_due(machine, state, time)
        _lock_standing(machine.constants, state, machine.log, time)
        instant = next_instant(machine, state, time)
    return instant


# --- over a span of time


@compiled_part
def beyond_limit(constants: Floats, state: Floats, angle: float) -> float:
    """Return how far the shaft is beyond its limit contact; -inf where that may not act [rad]."""
    if (
        state[at.ENERGISED] == 0.0
        or state[at.CUTOFF_TIME] < math.inf
        or state[at.LOCK_ALLOWED] == 0.0
    ):
        return -math.inf
    if state[at.DIRECTION] > 0.0:
        return float(angle - constants[at.LIMIT_CLOSING])
    return float(constants[at.LIMIT_OPENING] - angle)


@compiled_part
def _crosses_limit(constants: Floats, state: Floats, work: Floats) -> bool:
    """Return whether the limit contact opened within the step."""
    over = beyond_limit(constants, state, work[SECOND, at.GEAR_ANGLE])
    before = beyond_limit(constants, state, state[at.GEAR_ANGLE])
    return bool(over > ANGLE_ROUNDING and before < -ANGLE_ROUNDING)


@compiled
def _locate_limit(machine: MachineArrays, state: Floats, span: tuple[float, float]) -> float:
    """Return the length of the step that ends where the limit contact opens, and take it."""
    constants, work = machine.constants, machine.work
    time, step = span
    low, high = 0.0, step
    f_low = beyond_limit(constants, state, state[at.GEAR_ANGLE])
    f_high = beyond_limit(constants, state, work[SECOND, at.GEAR_ANGLE])
    h, side = step, 0
    for _ in range(LOCATE):
        h = low + (high - low) * f_low / (f_low - f_high)
        if not low < h < high:
            h = 0.5 * (low + high)
        if take_step(machine, state, time, h) != at.CONVERGED:
            return -1.0
        f = beyond_limit(constants, state, work[SECOND, at.GEAR_ANGLE])
        if abs(f) <= ANGLE_ROUNDING or high - low <= 1e-15:
            break
        if f > 0.0:
            high, f_high = h, f
            if side == 1:
                f_low *= 0.5
            side = 1
        else:
            low, f_low = h, f
            if side == -1:
                f_high *= 0.5
            side = -1
    return h


@compiled
def _locate_turn(machine: MachineArrays, state: Floats, span: tuple[float, float]) -> float:
    """Return the length of the step at whose end the gear stands, and take it."""
    work = machine.work
    time, step = span
    before = state[at.GEAR_SPEED]
    low, high = 0.0, step
    h = step
    for _ in range(LOCATE):
        h = 0.5 * (low + high)
        if take_step(machine, state, time, h) != at.CONVERGED:
            return -1.0
        w2 = work[SECOND, at.GEAR_SPEED]
        if abs(w2) <= 1e-9 * abs(before):
            break
        if w2 * before < 0.0:
            high = h
        else:
            low = h
    return h


@compiled_part
def _after_step(
    constants: Floats, state: Floats, log: Floats, times: tuple[float, float], x_before: float
) -> None:
    """Update contacts and relay from the state at the end of a step."""
    before, time = times
    x = state[at.ROD_POSITION]
    opened = x_before >= constants[at.DETECTION_CLOSED] > x
    opened = opened or x_before <= constants[at.DETECTION_OPEN] < x
    closed = x_before < constants[at.DETECTION_CLOSED] <= x
    closed = closed or x_before > constants[at.DETECTION_OPEN] >= x
    if opened:
        log_event(state, log, time, at.EVENT_DETECTION_OPENS)
    if closed:
        log_event(state, log, time, at.EVENT_DETECTION_CLOSES)
    if state[at.ENERGISED] == 0.0:
        return
    if abs(state[at.CURRENT]) < constants[at.OVERLOAD_CURRENT]:
        state[at.OVERLOAD_SINCE] = math.inf
    elif state[at.OVERLOAD_SINCE] == math.inf:
        state[at.OVERLOAD_SINCE] = before
    if beyond_limit(constants, state, state[at.GEAR_ANGLE]) >= -ANGLE_ROUNDING:
        state[at.CUTOFF_TIME] = time + constants[at.CUTOFF_DELAY]


@compiled_part
def set_local_faults(constants: Floats, state: Floats) -> None:
    """Set what depends on where gear and motor stand: dry teeth, lock bar, a brush.

    It holds for the whole step that begins there, so that each step is one of constant values.
    """
    state[at.GEAR_RATIO], state[at.BRUSH_RESISTANCE] = 1.0, 0.0
    if constants[at.DRY_FROM] <= state[at.ROD_POSITION] <= constants[at.DRY_TO]:
        state[at.GEAR_RATIO] = constants[at.DRY_RATIO]
    state[at.BAR_TORQUE] = 0.0
    if not constants[at.UNLOCKED_FROM] < state[at.GEAR_ANGLE] < constants[at.UNLOCKED_TO]:
        state[at.BAR_TORQUE] = constants[at.LOCK_TORQUE]
    if constants[at.CONTACT_LOSS] > 0.0:
        turns = (state[at.GEAR_ANGLE] + state[at.TWIST] + state[at.SLIP]) / (2.0 * math.pi)
        if turns - math.floor(turns) < constants[at.CONTACT_LOSS]:
            state[at.BRUSH_RESISTANCE] = constants[at.CONTACT_RESISTANCE]


@compiled
def _piece(machine: MachineArrays, state: Floats, span: tuple[float, float]) -> float:
    """Take one step of at most the given length and return its length; negative on failure."""
    constants, work = machine.constants, machine.work
    time, h = span
    set_local_faults(constants, state)
    halvings = 0
    while take_step(machine, state, time, h) != at.CONVERGED:
        halvings += 1
        if halvings > HALVINGS:
            return -1.0
        state[at.HALVED] += 1
        h *= 0.5
    if _crosses_limit(constants, state, work):
        h = _locate_limit(machine, state, (time, h))
    if h > 0.0 and _turns_round(constants, state, work):
        h = _locate_turn(machine, state, (time, h))
    if h > 0.0:
        _finish_step(machine, state, (time, h))
    return h


@compiled_part
def _turns_round(constants: Floats, state: Floats, work: Floats) -> bool:
    """Return whether the gear stood within the step and may be locked there."""
    return bool(
        _may_lock(constants, state) and work[SECOND, at.GEAR_SPEED] * state[at.GEAR_SPEED] < 0.0
    )


@compiled
def _finish_step(machine: MachineArrays, state: Floats, span: tuple[float, float]) -> None:
    """Make the end of a step the state, with what clutch, contacts, relay and lock do there."""
    constants, log = machine.constants, machine.log
    time, h = span
    locks = _may_lock(constants, state)
    x_before, w2_before = state[at.ROD_POSITION], state[at.GEAR_SPEED]
    accept_step(machine, state, time, h)
    update_clutch(constants, state, h)
    _after_step(constants, state, log, (time, time + h), x_before)
    if locks and abs(state[at.GEAR_SPEED]) <= 1e-9 * abs(w2_before):
        # what is left of the motion ends in the lock
        motion = 0.5 * constants[at.GEAR_INERTIA] * state[at.GEAR_SPEED] ** 2
        state[at.ENERGIES + at.GEAR] += motion
        state[at.ENERGIES + at.INTO_STORES] -= motion
        state[at.GEAR_SPEED], state[at.LOCKED] = 0.0, 1.0
        log_event(state, log, time + h, at.EVENT_LOCKED)


@compiled_part
def rests(constants: Floats, state: Floats) -> bool:
    """Return whether nothing in the machine can move until the next switching instant."""
    off = state[at.ENERGISED] == 0.0 and state[at.CURRENT] == 0.0 and state[at.SPEED] == 0.0
    held = abs(constants[at.CLUTCH_STIFFNESS] * state[at.TWIST]) <= state[at.STILL_TORQUE]
    return bool(off and held and state[at.LOCKED] > 0.0)


@compiled_part
def _hold(machine: MachineArrays, state: Floats, time: float) -> float:
    """Return the force of a rod that stands at a time [N]."""
    free, compliance = rail_at(machine.rail, time)
    return rail_side(machine.constants, free, compliance, state[at.ROD_POSITION])[0]


@compiled
def advance(machine: MachineArrays, state: Floats, span: tuple[float, float]) -> int:
    """Take a machine over a span of time.

    Parameters
    ----------
    machine : MachineArrays
    state : ndarray
        Changed to the end of the span.
    span : tuple of float
        Start and length [s]; the length is at most one step.

    Returns
    -------
    int
        CONVERGED or NOT_CONVERGED.
    """
    constants = machine.constants
    time, end = span[0], span[0] + span[1]
    if rests(constants, state) and next_instant(machine, state, time) > end:
        state[at.ROD_FORCE] = _hold(machine, state, end)
        return at.CONVERGED
    pieces = 0
    while True:
        instant = switch_all_due(machine, state, time)
        left = min(end, instant) - time
        if left <= INSTANT:
            return at.CONVERGED
        pieces += 1
        most = min(left, constants[at.LONGEST_STEP])
        h = _piece(machine, state, (time, most))
        if h <= 0.0 or pieces > 1 << HALVINGS:
            return at.NOT_CONVERGED
        time = min(end, instant) if h == left else time + h


@compiled_part
def try_plain_step(machine: MachineArrays, state: Floats, span: tuple[float, float]) -> bool:
    """Solve a span in which nothing switches, where that is one step or rest; False otherwise.

    Takes what `advance` takes. The state stays as it is but for `set_local_faults`, so that the
    span may be tried again; `accept_plain_step` makes the state of it that `advance` would.
    """
    constants, work = machine.constants, machine.work
    time, end = span[0], span[0] + span[1]
    h = end - time
    if next_instant(machine, state, time) <= end + INSTANT:
        return False
    if rests(constants, state):
        work[SECOND, at.ROD_POSITION] = state[at.ROD_POSITION]
        work[SECOND, at.ROD_FORCE] = _hold(machine, state, end)
        return True
    if h > constants[at.LONGEST_STEP]:
        return False
    set_local_faults(constants, state)
    if take_step(machine, state, time, h) != at.CONVERGED:
        return False
    return not (_crosses_limit(constants, state, work) or _turns_round(constants, state, work))


@compiled_part
def repeats_step(machine: MachineArrays, state: Floats, span: tuple[float, float]) -> bool:
    """Return whether a span would be as the one before, which was one step or rest.

    The gear stands, and motor and clutch, if they turn, do so as in both stages of that step;
    nothing switches, and nothing depends on angles or on heat.
    """
    constants = machine.constants
    time, end = span[0], span[0] + span[1]
    if state[at.GEAR_SPEED] != 0.0 or next_instant(machine, state, time) <= end + INSTANT:
        return False
    if rests(constants, state):
        return True
    varies = constants[at.LEVEL_PER_KELVIN] != 0.0 or constants[at.LEVEL_PER_JOULE] != 0.0
    if varies or constants[at.CONTACT_LOSS] > 0.0:
        return False
    first, second = machine.work[FIRST], machine.work[SECOND]
    for place in range(at.INTEGRATED, at.PAST_INTEGRATED):
        change = max(abs(second[place] - first[place]), abs(state[place] - second[place]))
        if not change <= REPEATED * span[1] * abs(second[place]):
            return False
    return True


@compiled_part
def accept_plain_step(machine: MachineArrays, state: Floats, span: tuple[float, float]) -> None:
    """Make the end of a span that `try_plain_step` has solved the state."""
    time, end = span[0], span[0] + span[1]
    if rests(machine.constants, state):
        state[at.ROD_FORCE] = machine.work[SECOND, at.ROD_FORCE]
        return
    _finish_step(machine, state, (time, end - time))
    switch_all_due(machine, state, end)
