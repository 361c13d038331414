"""One step of a machine: two implicit stages, and the energy by the scheme's own sums.

The scheme is the L-stable SDIRK of order 2 (Alexander 1977, doi 10.1137/0714068) with
gamma = 1 - 1/sqrt(2) and weights (1 - gamma, gamma); its second stage ends at the end of the step.
Set-valued laws hold in each stage exactly.
"""

import math

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute.induction import (
    add_electrical_energy,
    field_energy,
    fill_fluxes,
    stored_in_stage,
)
from turnout.machine.compute.lost_phase import add_lost_phase_energy, lost_phase_circuit
from turnout.machine.compute.motor import net_voltage
from turnout.machine.compute.places import (
    ARMATURE_OPEN,
    BED_REST,
    BED_STIFFNESS,
    BRUSH,
    BRUSH_DROP,
    BRUSH_RESISTANCE,
    CLUTCH,
    CLUTCH_STIFFNESS,
    CONVERGED,
    COPPER,
    CURRENT,
    ENERGIES,
    ENERGISED,
    FIELD,
    FIELD_POWER,
    FRICTION_STIFFNESS,
    GEAR,
    GEAR_ANGLE,
    GEAR_DRAG,
    GEAR_DRAG_HEAT,
    GEAR_INERTIA,
    GEAR_SPEED,
    HAND,
    HAND_GAIN,
    HAND_ON,
    HAND_RAMP,
    HAND_SINCE,
    HAND_SPEED,
    INDUCTANCE,
    INTEGRATED,
    INTO_STORES,
    LINE,
    LINE_RESISTANCE,
    MOTOR_DRAG,
    MOTOR_DRAG_HEAT,
    MOTOR_FRICTION,
    MOTOR_INERTIA,
    OBJECT_SIZE,
    OBJECT_STIFFNESS,
    ONE_MASS,
    PHASE_LOST,
    RAIL_COMPLIANCE,
    RAIL_DAMPING,
    RAIL_DAMPING_HEAT,
    RAIL_FREE,
    RAIL_FRICTION_HEAT,
    RAIL_MASS,
    RAIL_POSITION,
    RAIL_SPEED,
    RAIL_START,
    RAIL_START_SPEED,
    RAIL_STEP,
    RAIL_TIME,
    RAIL_TWIST,
    RESISTANCE,
    ROD_FORCE,
    ROD_INPUT,
    ROD_ON_RAIL,
    ROD_POSITION,
    ROD_STIFFNESS,
    SLIP,
    SNUB,
    SNUB_RESISTANCE,
    SPEED,
    STEADY_CIRCUIT,
    STILL_TORQUE,
    STOP_STIFFNESS,
    SUPPLIED,
    SUPPLY,
    THREE_PHASE,
    TWIST,
)
from turnout.machine.compute.rail import bed_force, rod_position
from turnout.machine.compute.stage import load_factor, solve_stage

GAMMA = 1.0 - math.sqrt(0.5)
"""Length of a stage per length of the step."""
SAME_STEP = 1e-9
"""Share by which two steps may differ in length and count as equally long."""
BASE, FIRST, SECOND, GUESS, CURVE, WORK_ROWS = range(6)
"""Rows of the work of a machine: what the stages leave, both stages, and what follows."""
GUESS_STEP, GUESS_MOTOR, GUESS_GEAR, GUESS_STAGE = range(4)
"""Of the row GUESS: length of the last step; change of both speeds in its first stage, and the
places by which those of the second are further on."""


@compiled_part
def hand_speed(constants: Floats, state: Floats, time: float) -> float:
    """Return the speed of the hand at the crank [rad/s]."""
    if state[HAND_ON] == 0.0:
        return 0.0
    since = time - state[HAND_SINCE]
    if since >= constants[HAND_RAMP]:
        return float(constants[HAND_SPEED])
    return float(constants[HAND_SPEED] * max(since, 0.0) / constants[HAND_RAMP])


@compiled_part
def span_of(
    constants: Floats, rail: Floats, state: Floats, time: float
) -> tuple[float, float, float]:
    """Return hand speed, free position and compliance of an affine rail at the end of a stage.

    The rail is taken along the parabola from its position and speed at the start of its step to
    the end of it, where it is RAIL_FREE + RAIL_COMPLIANCE F.
    """
    hand = hand_speed(constants, state, time)
    if rail[ONE_MASS] > 0.0:
        return hand, 0.0, 0.0
    tau = time - rail[RAIL_TIME]
    share = (tau / rail[RAIL_STEP]) ** 2
    start, speed = rail[RAIL_START], rail[RAIL_START_SPEED]
    bend = rail[RAIL_FREE] - start - speed * rail[RAIL_STEP]
    return hand, start + speed * tau + bend * share, rail[RAIL_COMPLIANCE] * share


@compiled_part
def _guess_speeds(state: Floats, stage: Floats, guess: Floats, number: int) -> None:
    """Begin the search for a stage with the change of speeds in that stage of the last step."""
    for place, change in ((SPEED, GUESS_MOTOR), (GEAR_SPEED, GUESS_GEAR)):
        speed = state[place] + guess[change + number * (GUESS_STAGE - 1)]
        if speed * state[place] > 0.0:  # what stands or turns round is looked for from there
            stage[place] = speed


@compiled_part
def _note_speeds(state: Floats, stage: Floats, guess: Floats, number: int) -> None:
    """Note the change of speeds in a stage."""
    for place, change in ((SPEED, GUESS_MOTOR), (GEAR_SPEED, GUESS_GEAR)):
        guess[change + number * (GUESS_STAGE - 1)] = stage[place] - state[place]


@compiled
def take_step(
    constants: Floats,
    rail: Floats,
    table: Floats,
    state: Floats,
    time: float,
    step: float,
    work: Floats,
) -> int:
    """Solve both stages of a step without changing the state.

    Parameters
    ----------
    time, step : float
        Start and length of the step [s].
    work : ndarray, shape (WORK_ROWS, INTEGRATED + 3)
        Of this machine. Receives the stages; row SECOND is the end of the step. The search begins
        with the changes of the last step, if that was as long.

    Returns
    -------
    int
        CONVERGED or NOT_CONVERGED.
    """
    g = GAMMA * step
    base, first, second, guess = work[BASE], work[FIRST], work[SECOND], work[GUESS]
    alike = abs(guess[GUESS_STEP] - step) <= SAME_STEP * step
    guess[GUESS_STEP] = 0.0
    for k in range(first.size):
        first[k] = state[k]
        base[k] = state[k]
    first[RAIL_POSITION] += g * state[RAIL_SPEED]
    if alike:
        _guess_speeds(state, first, guess, 0)
    span = span_of(constants, rail, state, time + g)
    code = solve_stage(constants, rail, table, state, g, base, span, first, work[CURVE])
    if code != CONVERGED:
        return code
    ahead = (1.0 - GAMMA) / GAMMA
    for k in range(first.size):
        second[k] = first[k]
    for k in range(INTEGRATED):
        base[k] = state[k] + ahead * (first[k] - state[k])
    second[RAIL_POSITION] = base[RAIL_POSITION] + g * first[RAIL_SPEED]
    if alike:
        _guess_speeds(state, second, guess, 1)
    span = span_of(constants, rail, state, time + step)
    code = solve_stage(constants, rail, table, state, g, base, span, second, work[CURVE])
    if code == CONVERGED:
        _note_speeds(state, first, guess, 0)
        _note_speeds(state, second, guess, 1)
        guess[GUESS_STEP] = step
    return code


@compiled
def accept_step(
    constants: Floats,
    rail: Floats,
    table: Floats,
    state: Floats,
    time: float,
    step: float,
    work: Floats,
) -> None:
    """Make the end of a step the state, and add its energies; takes what `take_step` takes."""
    g = GAMMA * step
    first, second, base = work[FIRST], work[SECOND], work[BASE]
    slip = 0.0
    for number in range(2):
        stage = first if number == 0 else second
        before = state if number == 0 else base
        weight = (1.0 - GAMMA) * step if number == 0 else g
        hand = hand_speed(constants, state, time + (g if number == 0 else step))
        _fill_steady_circuit(constants, state, g, stage)
        slid = stage[SPEED] - stage[GEAR_SPEED] - (stage[TWIST] - before[TWIST]) / g
        slip += weight * slid
        state[ENERGIES + CLUTCH] += weight * constants[CLUTCH_STIFFNESS] * stage[TWIST] * slid
        _add_motor_energy(constants, state, stage, hand, weight)
        _add_gear_energy(constants, table, state, stage, weight)
        _add_stored_energy(constants, rail, state, stage, before, (g, weight))
    state[SLIP] += slip
    for k in range(INTEGRATED):
        state[k] = second[k]
    state[ROD_POSITION] = second[ROD_POSITION]
    state[ROD_FORCE] = second[ROD_FORCE]


@compiled_part
def _fill_steady_circuit(constants: Floats, state: Floats, g: float, stage: Floats) -> None:
    """Write the current, and fluxes, of a stage that was solved without asking for them."""
    if constants[THREE_PHASE] == 0.0 or state[ARMATURE_OPEN] > 0.0:
        return
    if state[PHASE_LOST] > 0.0:
        stage[CURRENT] = lost_phase_circuit(constants, state, stage[SPEED])[0]
    elif constants[STEADY_CIRCUIT] > 0.0:
        fill_fluxes(constants, state, g, stage, stage, stage[SPEED])


@compiled_part
def _add_motor_energy(
    constants: Floats, state: Floats, stage: Floats, hand: float, weight: float
) -> None:
    i, w1 = stage[CURRENT], stage[SPEED]
    heat = weight * i * i
    if constants[THREE_PHASE] > 0.0:
        if state[ARMATURE_OPEN] == 0.0 and state[PHASE_LOST] > 0.0:
            add_lost_phase_energy(constants, state, stage, weight)
        elif state[ARMATURE_OPEN] == 0.0:
            add_electrical_energy(constants, state, stage, weight)
        heat, i = 0.0, 0.0
    elif state[ENERGISED] > 0.0:
        taken = state[SUPPLIED] - net_voltage(state)
        state[ENERGIES + SUPPLY] += weight * (state[SUPPLIED] * i + constants[FIELD_POWER])
        state[ENERGIES + FIELD] += weight * constants[FIELD_POWER]
        state[ENERGIES + LINE] += heat * constants[LINE_RESISTANCE] + weight * taken * i
    else:
        state[ENERGIES + SNUB] += heat * constants[SNUB_RESISTANCE]
    state[ENERGIES + COPPER] += heat * constants[RESISTANCE]
    state[ENERGIES + BRUSH] += weight * constants[BRUSH_DROP] * abs(i)
    state[ENERGIES + BRUSH] += heat * state[BRUSH_RESISTANCE]
    state[ENERGIES + MOTOR_FRICTION] += weight * state[STILL_TORQUE] * abs(w1)
    state[ENERGIES + MOTOR_DRAG_HEAT] += weight * constants[MOTOR_DRAG] * w1 * w1
    gain = constants[HAND_GAIN] * state[HAND_ON]
    state[ENERGIES + HAND] += weight * gain * (hand - w1) * w1


@compiled_part
def _add_gear_energy(
    constants: Floats, table: Floats, state: Floats, stage: Floats, weight: float
) -> None:
    w2 = stage[GEAR_SPEED]
    if w2 == 0.0:
        return
    load = rod_position(constants, table, stage[GEAR_ANGLE])[1] * stage[ROD_FORCE]
    factor = load_factor(constants, state, load, math.copysign(1.0, w2))
    state[ENERGIES + GEAR] += weight * (factor - 1.0) * load * w2
    state[ENERGIES + GEAR_DRAG_HEAT] += weight * constants[GEAR_DRAG] * w2 * w2
    state[ENERGIES + ROD_INPUT] += weight * load * w2


@compiled_part
def _add_stored_energy(
    constants: Floats,
    rail: Floats,
    state: Floats,
    stage: Floats,
    before: Floats,
    lengths: tuple[float, float],
) -> None:
    """Add what the stages put into springs, masses and the coil, and what the rail takes."""
    g, weight = lengths
    into = constants[INDUCTANCE] * stage[CURRENT] * (stage[CURRENT] - before[CURRENT])
    if constants[THREE_PHASE] > 0.0:
        into += stored_in_stage(constants, stage, before)
    into += constants[MOTOR_INERTIA] * stage[SPEED] * (stage[SPEED] - before[SPEED])
    into += constants[GEAR_INERTIA] * stage[GEAR_SPEED] * (stage[GEAR_SPEED] - before[GEAR_SPEED])
    into += constants[CLUTCH_STIFFNESS] * stage[TWIST] * (stage[TWIST] - before[TWIST])
    state[ENERGIES + INTO_STORES] += weight / g * into
    if rail[ONE_MASS] == 0.0:
        return
    v, force = stage[RAIL_SPEED], stage[ROD_FORCE]
    twist, twisted = stage[RAIL_TWIST], (stage[RAIL_TWIST] - before[RAIL_TWIST]) / g
    friction = rail[FRICTION_STIFFNESS] * twist
    state[ENERGIES + RAIL_FRICTION_HEAT] += weight * friction * (v - twisted)
    state[ENERGIES + RAIL_DAMPING_HEAT] += weight * rail[RAIL_DAMPING] * v * v
    state[ENERGIES + ROD_ON_RAIL] += weight * force * v
    into = rail[RAIL_MASS] * v * (v - before[RAIL_SPEED]) / g + friction * twisted
    into += bed_force(rail, stage[RAIL_POSITION])[0] * v
    state[ENERGIES + INTO_STORES] += weight * into


@compiled
def stored_energy(constants: Floats, rail: Floats, state: Floats) -> float:
    """Return the energy in the machine, its rod and a one-mass rail [J]."""
    energy = constants[INDUCTANCE] * state[CURRENT] ** 2
    energy += constants[MOTOR_INERTIA] * state[SPEED] ** 2
    energy += constants[GEAR_INERTIA] * state[GEAR_SPEED] ** 2
    energy += constants[CLUTCH_STIFFNESS] * state[TWIST] ** 2
    if constants[THREE_PHASE] > 0.0:
        energy += 2.0 * field_energy(constants, state)
    if rail[ONE_MASS] > 0.0:
        y = state[RAIL_POSITION]
        energy += rail[RAIL_MASS] * state[RAIL_SPEED] ** 2
        energy += rail[FRICTION_STIFFNESS] * state[RAIL_TWIST] ** 2
        energy += rail[BED_STIFFNESS] * (y - rail[BED_REST]) ** 2
        energy += rail[STOP_STIFFNESS] * max(y, 0.0) ** 2
        energy += rail[OBJECT_STIFFNESS] * max(y + rail[OBJECT_SIZE], 0.0) ** 2
        energy += state[ROD_FORCE] ** 2 / constants[ROD_STIFFNESS]
    return 0.5 * float(energy)
