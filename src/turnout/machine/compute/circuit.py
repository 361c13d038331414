"""A machine over a span of time: steps between what switches, located where they must be.

`advance` covers a span with steps that end at every switching instant. The length of a step is cut
at known instants; the limit contact and the standstill of the lock are located inside a step, which
is then taken again up to there. A step that does not converge is taken in halves.
"""

import math

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.clutch import update_clutch
from turnout.machine.compute.contactor import INSTANT, log_event, next_instant, switch_all_due
from turnout.machine.compute.machine_step import SECOND, accept_step, span_of, take_step
from turnout.machine.compute.rail import rail_side

HALVINGS = 20
"""A step is halved at most so often before the run ends."""
LOCATE = 40
"""So many trials locate a switching instant within a step."""
ANGLE_ROUNDING = 1e-10
"""Shaft angle by which a limit contact may be missed [rad]."""


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


@compiled
def _locate_limit(
    constants: Floats,
    rail: Floats,
    table: Floats,
    state: Floats,
    span: tuple[float, float],
    work: Floats,
) -> float:
    """Return the length of the step that ends where the limit contact opens, and take it."""
    time, step = span
    low, high = 0.0, step
    f_low = beyond_limit(constants, state, state[at.GEAR_ANGLE])
    f_high = beyond_limit(constants, state, work[SECOND, at.GEAR_ANGLE])
    h, side = step, 0
    for _ in range(LOCATE):
        h = low + (high - low) * f_low / (f_low - f_high)
        if not low < h < high:
            h = 0.5 * (low + high)
        if take_step(constants, rail, table, state, time, h, work) != at.CONVERGED:
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
def _locate_turn(
    constants: Floats,
    rail: Floats,
    table: Floats,
    state: Floats,
    span: tuple[float, float],
    work: Floats,
) -> float:
    """Return the length of the step at whose end the gear stands, and take it."""
    time, step = span
    before = state[at.GEAR_SPEED]
    low, high = 0.0, step
    h = step
    for _ in range(LOCATE):
        h = 0.5 * (low + high)
        if take_step(constants, rail, table, state, time, h, work) != at.CONVERGED:
            return -1.0
        w2 = work[SECOND, at.GEAR_SPEED]
        if w2 == 0.0 or abs(w2) <= 1e-9 * abs(before):
            break
        if w2 * before < 0.0:
            high = h
        else:
            low = h
    return h


@compiled_part
def rail_is_home(constants: Floats, rail: Floats, state: Floats) -> bool:
    """Return whether the rail is near enough for the lock; true where the rail is not here."""
    if rail[at.ONE_MASS] == 0.0 or state[at.DIRECTION] < 0.0:
        return True
    return bool(state[at.RAIL_POSITION] >= -constants[at.LOCK_GAP])


@compiled_part
def _after_step(
    constants: Floats,
    rail: Floats,
    state: Floats,
    log: Floats,
    times: tuple[float, float],
    x_before: float,
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
    reached = beyond_limit(constants, state, state[at.GEAR_ANGLE]) >= -ANGLE_ROUNDING
    if reached and rail_is_home(constants, rail, state):
        state[at.CUTOFF_TIME] = time + constants[at.CUTOFF_DELAY]


@compiled_part
def set_local_faults(constants: Floats, state: Floats) -> None:
    """Set what depends on where gear and motor stand: dry teeth, a brush of poor contact.

    It holds for the whole step that begins there, so that each step is one of constant values.
    """
    state[at.GEAR_RATIO], state[at.BRUSH_RESISTANCE] = 1.0, 0.0
    if constants[at.DRY_FROM] <= state[at.ROD_POSITION] <= constants[at.DRY_TO]:
        state[at.GEAR_RATIO] = constants[at.DRY_RATIO]
    if constants[at.CONTACT_LOSS] > 0.0:
        turns = (state[at.GEAR_ANGLE] + state[at.TWIST] + state[at.SLIP]) / (2.0 * math.pi)
        if turns - math.floor(turns) < constants[at.CONTACT_LOSS]:
            state[at.BRUSH_RESISTANCE] = constants[at.CONTACT_RESISTANCE]


@compiled
def _piece(
    constants: Floats,
    rail: Floats,
    table: Floats,
    state: Floats,
    span: tuple[float, float],
    work: Floats,
    log: Floats,
) -> float:
    """Take one step of at most the given length and return its length; negative on failure."""
    time, h = span
    set_local_faults(constants, state)
    halvings = 0
    while take_step(constants, rail, table, state, time, h, work) != at.CONVERGED:
        halvings += 1
        if halvings > HALVINGS:
            return -1.0
        state[at.HALVED] += 1
        h *= 0.5
    over = beyond_limit(constants, state, work[SECOND, at.GEAR_ANGLE])
    before = beyond_limit(constants, state, state[at.GEAR_ANGLE])
    if over > ANGLE_ROUNDING and before < -ANGLE_ROUNDING:
        h = _locate_limit(constants, rail, table, state, (time, h), work)
    if h > 0.0 and _turns_round(constants, state, work):
        h = _locate_turn(constants, rail, table, state, (time, h), work)
    if h > 0.0:
        _finish_step(constants, rail, table, state, (time, h), work, log)
    return h


@compiled_part
def _may_lock(constants: Floats, state: Floats) -> bool:
    """Return whether the lock holds the gear at its next standstill."""
    return bool(
        constants[at.HOLDS] > 0.0 and state[at.ENERGISED] == 0.0 and state[at.LOCKED] == 0.0
    )


@compiled_part
def _turns_round(constants: Floats, state: Floats, work: Floats) -> bool:
    """Return whether the gear stood within the step and may be locked there."""
    return bool(
        _may_lock(constants, state) and work[SECOND, at.GEAR_SPEED] * state[at.GEAR_SPEED] < 0.0
    )


@compiled
def _finish_step(
    constants: Floats,
    rail: Floats,
    table: Floats,
    state: Floats,
    span: tuple[float, float],
    work: Floats,
    log: Floats,
) -> None:
    """Make the end of a step the state, with what clutch, contacts, relay and lock do there."""
    time, h = span
    locks = _may_lock(constants, state)
    x_before, w2_before = state[at.ROD_POSITION], state[at.GEAR_SPEED]
    accept_step(constants, rail, table, state, time, h, work)
    update_clutch(constants, state, h)
    _after_step(constants, rail, state, log, (time, time + h), x_before)
    if locks and (
        state[at.GEAR_SPEED] == 0.0 or abs(state[at.GEAR_SPEED]) <= 1e-9 * abs(w2_before)
    ):
        # what is left of the motion ends in the lock
        motion = 0.5 * constants[at.GEAR_INERTIA] * state[at.GEAR_SPEED] ** 2
        state[at.ENERGIES + at.GEAR] += motion
        state[at.ENERGIES + at.INTO_STORES] -= motion
        state[at.GEAR_SPEED], state[at.LOCKED] = 0.0, 1.0
        log_event(state, log, time + h, at.EVENT_LOCKED)


@compiled_part
def rests(constants: Floats, rail: Floats, state: Floats) -> bool:
    """Return whether nothing in the machine can move until the next switching instant."""
    off = state[at.ENERGISED] == 0.0 and state[at.CURRENT] == 0.0 and state[at.SPEED] == 0.0
    held = abs(constants[at.CLUTCH_STIFFNESS] * state[at.TWIST]) <= state[at.STILL_TORQUE]
    return bool(off and held and state[at.LOCKED] > 0.0 and rail[at.ONE_MASS] == 0.0)


@compiled_part
def _hold(
    constants: Floats, rail: Floats, state: Floats, span: tuple[float, float]
) -> tuple[float, float]:
    """Return the force of a rod that stands, and the rail's position, at the end of a span."""
    free, compliance = span_of(constants, rail, state, span[0] + span[1])[1:]
    x, y = state[at.ROD_POSITION], state[at.RAIL_POSITION]
    force, _, y = rail_side(constants, rail, span[1], state, free, compliance, y, x)
    return force, y


@compiled
def advance(
    constants: Floats,
    rail: Floats,
    table: Floats,
    commands: Floats,
    state: Floats,
    span: tuple[float, float],
    work: Floats,
    log: Floats,
) -> int:
    """Take a machine over a span of time.

    Parameters
    ----------
    constants, rail, table : ndarray
        Of the machine, of its rail, of its stroke.
    commands : ndarray, shape (n_commands, 2)
        Time [s] and direction (1 closing, -1 opening), rising in time.
    state : ndarray
        Changed to the end of the span.
    span : tuple of float
        Start and length [s]; the length is at most one step.
    work : ndarray, shape (WORK_ROWS, ROD_FORCE + 1)
    log : ndarray, shape (n, 2)
        Receives time and event.

    Returns
    -------
    int
        CONVERGED or NOT_CONVERGED.
    """
    time, end = span[0], span[0] + span[1]
    if rests(constants, rail, state) and next_instant(constants, state, commands, time) > end:
        state[at.ROD_FORCE], state[at.RAIL_POSITION] = _hold(constants, rail, state, span)
        return at.CONVERGED
    pieces = 0
    while True:
        instant = switch_all_due(constants, state, commands, time, log)
        left = min(end, instant) - time
        if left <= INSTANT:
            return at.CONVERGED
        pieces += 1
        most = min(left, constants[at.LONGEST_STEP])
        h = _piece(constants, rail, table, state, (time, most), work, log)
        if h <= 0.0 or pieces > 1 << HALVINGS:
            return at.NOT_CONVERGED
        time = min(end, instant) if h == left else time + h


@compiled
def try_plain_step(
    constants: Floats,
    rail: Floats,
    table: Floats,
    commands: Floats,
    state: Floats,
    span: tuple[float, float],
    work: Floats,
) -> bool:
    """Solve a span in which nothing switches, where that is one step or rest; False otherwise.

    Takes what `advance` takes. The state stays as it is but for `set_local_faults`, so that the
    span may be tried again; `accept_plain_step` makes the state of it that `advance` would.
    """
    time, end = span[0], span[0] + span[1]
    h = end - time
    if next_instant(constants, state, commands, time) <= end + INSTANT:
        return False
    if rests(constants, rail, state):
        work[SECOND, at.ROD_POSITION] = state[at.ROD_POSITION]
        held = _hold(constants, rail, state, span)
        work[SECOND, at.ROD_FORCE], work[SECOND, at.RAIL_POSITION] = held
        return True
    if h > constants[at.LONGEST_STEP]:
        return False
    set_local_faults(constants, state)
    if take_step(constants, rail, table, state, time, h, work) != at.CONVERGED:
        return False
    over = beyond_limit(constants, state, work[SECOND, at.GEAR_ANGLE])
    before = beyond_limit(constants, state, state[at.GEAR_ANGLE])
    at_limit = over > ANGLE_ROUNDING and before < -ANGLE_ROUNDING
    return not (at_limit or _turns_round(constants, state, work))


@compiled
def accept_plain_step(
    constants: Floats,
    rail: Floats,
    table: Floats,
    commands: Floats,
    state: Floats,
    span: tuple[float, float],
    work: Floats,
    log: Floats,
) -> None:
    """Make the end of a span that `try_plain_step` has solved the state."""
    time, end = span[0], span[0] + span[1]
    if rests(constants, rail, state):
        state[at.ROD_FORCE] = work[SECOND, at.ROD_FORCE]
        state[at.RAIL_POSITION] = work[SECOND, at.RAIL_POSITION]
        return
    _finish_step(constants, rail, table, state, (time, end - time), work, log)
    switch_all_due(constants, state, commands, end, log)
