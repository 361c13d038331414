"""One step of a machine: two implicit stages, and the energy by the scheme's own sums.

The scheme is the L-stable SDIRK of order 2 (Alexander 1977, doi 10.1137/0714068) with
gamma = 1 - 1/sqrt(2) and weights (1 - gamma, gamma); its second stage ends at the end of the step.
Set-valued laws hold in each stage exactly.
"""

import math

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.induction import (
    add_electrical_energy,
    field_energy,
    fill_fluxes,
    stored_in_stage,
)
from turnout.machine.compute.lost_phase import add_lost_phase_energy, lost_phase_circuit
from turnout.machine.compute.motor import net_voltage
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
    if state[at.HAND_ON] == 0.0:
        return 0.0
    since = time - state[at.HAND_SINCE]
    if since >= constants[at.HAND_RAMP]:
        return float(constants[at.HAND_SPEED])
    return float(constants[at.HAND_SPEED] * max(since, 0.0) / constants[at.HAND_RAMP])


@compiled_part
def span_of(
    constants: Floats, rail: Floats, state: Floats, time: float
) -> tuple[float, float, float]:
    """Return hand speed, free position and compliance of an affine rail at the end of a stage.

    The rail is taken along the parabola from its position and speed at the start of its step to
    the end of it, where it is RAIL_FREE + RAIL_COMPLIANCE F.
    """
    hand = hand_speed(constants, state, time)
    if rail[at.ONE_MASS] > 0.0:
        return hand, 0.0, 0.0
    tau = time - rail[at.RAIL_TIME]
    share = (tau / rail[at.RAIL_STEP]) ** 2
    start, speed = rail[at.RAIL_START], rail[at.RAIL_START_SPEED]
    bend = rail[at.RAIL_FREE] - start - speed * rail[at.RAIL_STEP]
    return hand, start + speed * tau + bend * share, rail[at.RAIL_COMPLIANCE] * share


@compiled_part
def _guess_speeds(state: Floats, stage: Floats, guess: Floats, number: int) -> None:
    """Begin the search for a stage with the change of speeds in that stage of the last step."""
    for place, change in ((at.SPEED, GUESS_MOTOR), (at.GEAR_SPEED, GUESS_GEAR)):
        speed = state[place] + guess[change + number * (GUESS_STAGE - 1)]
        if speed * state[place] > 0.0:  # what stands or turns round is looked for from there
            stage[place] = speed


@compiled_part
def _note_speeds(state: Floats, stage: Floats, guess: Floats, number: int) -> None:
    """Note the change of speeds in a stage."""
    for place, change in ((at.SPEED, GUESS_MOTOR), (at.GEAR_SPEED, GUESS_GEAR)):
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
    first[at.RAIL_POSITION] += g * state[at.RAIL_SPEED]
    if alike:
        _guess_speeds(state, first, guess, 0)
    span = span_of(constants, rail, state, time + g)
    code = solve_stage(constants, rail, table, state, g, base, span, first, work[CURVE])
    if code != at.CONVERGED:
        return code
    ahead = (1.0 - GAMMA) / GAMMA
    for k in range(first.size):
        second[k] = first[k]
    for k in range(at.INTEGRATED):
        base[k] = state[k] + ahead * (first[k] - state[k])
    second[at.RAIL_POSITION] = base[at.RAIL_POSITION] + g * first[at.RAIL_SPEED]
    if alike:
        _guess_speeds(state, second, guess, 1)
    span = span_of(constants, rail, state, time + step)
    code = solve_stage(constants, rail, table, state, g, base, span, second, work[CURVE])
    if code == at.CONVERGED:
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
        slid = stage[at.SPEED] - stage[at.GEAR_SPEED] - (stage[at.TWIST] - before[at.TWIST]) / g
        slip += weight * slid
        state[at.ENERGIES + at.CLUTCH] += (
            weight * constants[at.CLUTCH_STIFFNESS] * stage[at.TWIST] * slid
        )
        _add_motor_energy(constants, state, stage, hand, weight)
        _add_gear_energy(constants, table, state, stage, weight)
        _add_stored_energy(constants, rail, state, stage, before, (g, weight))
    state[at.SLIP] += slip
    for k in range(at.INTEGRATED):
        state[k] = second[k]
    state[at.ROD_POSITION] = second[at.ROD_POSITION]
    state[at.ROD_FORCE] = second[at.ROD_FORCE]


@compiled_part
def _fill_steady_circuit(constants: Floats, state: Floats, g: float, stage: Floats) -> None:
    """Write the current, and fluxes, of a stage that was solved without asking for them."""
    if constants[at.THREE_PHASE] == 0.0 or state[at.ARMATURE_OPEN] > 0.0:
        return
    if state[at.PHASE_LOST] > 0.0:
        stage[at.CURRENT] = lost_phase_circuit(constants, state, stage[at.SPEED])[0]
    elif constants[at.STEADY_CIRCUIT] > 0.0:
        fill_fluxes(constants, state, g, stage, stage, stage[at.SPEED])


@compiled_part
def _add_motor_energy(
    constants: Floats, state: Floats, stage: Floats, hand: float, weight: float
) -> None:
    i, w1 = stage[at.CURRENT], stage[at.SPEED]
    heat = weight * i * i
    if constants[at.THREE_PHASE] > 0.0:
        if state[at.ARMATURE_OPEN] == 0.0 and state[at.PHASE_LOST] > 0.0:
            add_lost_phase_energy(constants, state, stage, weight)
        elif state[at.ARMATURE_OPEN] == 0.0:
            add_electrical_energy(constants, state, stage, weight)
        heat, i = 0.0, 0.0
    elif state[at.ENERGISED] > 0.0:
        taken = state[at.SUPPLIED] - net_voltage(state)
        state[at.ENERGIES + at.SUPPLY] += weight * (
            state[at.SUPPLIED] * i + constants[at.FIELD_POWER]
        )
        state[at.ENERGIES + at.FIELD] += weight * constants[at.FIELD_POWER]
        state[at.ENERGIES + at.LINE] += heat * constants[at.LINE_RESISTANCE] + weight * taken * i
    else:
        state[at.ENERGIES + at.SNUB] += heat * constants[at.SNUB_RESISTANCE]
    state[at.ENERGIES + at.COPPER] += heat * constants[at.RESISTANCE]
    state[at.ENERGIES + at.BRUSH] += weight * constants[at.BRUSH_DROP] * abs(i)
    state[at.ENERGIES + at.BRUSH] += heat * state[at.BRUSH_RESISTANCE]
    state[at.ENERGIES + at.MOTOR_FRICTION] += weight * state[at.STILL_TORQUE] * abs(w1)
    state[at.ENERGIES + at.MOTOR_DRAG_HEAT] += weight * constants[at.MOTOR_DRAG] * w1 * w1
    gain = constants[at.HAND_GAIN] * state[at.HAND_ON]
    state[at.ENERGIES + at.HAND] += weight * gain * (hand - w1) * w1


@compiled_part
def _add_gear_energy(
    constants: Floats, table: Floats, state: Floats, stage: Floats, weight: float
) -> None:
    w2 = stage[at.GEAR_SPEED]
    if w2 == 0.0:
        return
    load = rod_position(constants, table, stage[at.GEAR_ANGLE])[1] * stage[at.ROD_FORCE]
    factor = load_factor(constants, state, load, math.copysign(1.0, w2))
    state[at.ENERGIES + at.GEAR] += weight * (factor - 1.0) * load * w2
    state[at.ENERGIES + at.GEAR_DRAG_HEAT] += weight * constants[at.GEAR_DRAG] * w2 * w2
    state[at.ENERGIES + at.ROD_INPUT] += weight * load * w2


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
    into = constants[at.INDUCTANCE] * stage[at.CURRENT] * (stage[at.CURRENT] - before[at.CURRENT])
    if constants[at.THREE_PHASE] > 0.0:
        into += stored_in_stage(constants, stage, before)
    into += constants[at.MOTOR_INERTIA] * stage[at.SPEED] * (stage[at.SPEED] - before[at.SPEED])
    into += (
        constants[at.GEAR_INERTIA]
        * stage[at.GEAR_SPEED]
        * (stage[at.GEAR_SPEED] - before[at.GEAR_SPEED])
    )
    into += constants[at.CLUTCH_STIFFNESS] * stage[at.TWIST] * (stage[at.TWIST] - before[at.TWIST])
    state[at.ENERGIES + at.INTO_STORES] += weight / g * into
    if rail[at.ONE_MASS] == 0.0:
        return
    v, force = stage[at.RAIL_SPEED], stage[at.ROD_FORCE]
    twist, twisted = stage[at.RAIL_TWIST], (stage[at.RAIL_TWIST] - before[at.RAIL_TWIST]) / g
    friction = rail[at.FRICTION_STIFFNESS] * twist
    state[at.ENERGIES + at.RAIL_FRICTION_HEAT] += weight * friction * (v - twisted)
    state[at.ENERGIES + at.RAIL_DAMPING_HEAT] += weight * rail[at.RAIL_DAMPING] * v * v
    state[at.ENERGIES + at.ROD_ON_RAIL] += weight * force * v
    into = rail[at.RAIL_MASS] * v * (v - before[at.RAIL_SPEED]) / g + friction * twisted
    into += bed_force(rail, stage[at.RAIL_POSITION])[0] * v
    state[at.ENERGIES + at.INTO_STORES] += weight * into


@compiled
def stored_energy(constants: Floats, rail: Floats, state: Floats) -> float:
    """Return the energy in the machine, its rod and a one-mass rail [J]."""
    energy = constants[at.INDUCTANCE] * state[at.CURRENT] ** 2
    energy += constants[at.MOTOR_INERTIA] * state[at.SPEED] ** 2
    energy += constants[at.GEAR_INERTIA] * state[at.GEAR_SPEED] ** 2
    energy += constants[at.CLUTCH_STIFFNESS] * state[at.TWIST] ** 2
    if constants[at.THREE_PHASE] > 0.0:
        energy += 2.0 * field_energy(constants, state)
    if rail[at.ONE_MASS] > 0.0:
        y = state[at.RAIL_POSITION]
        energy += rail[at.RAIL_MASS] * state[at.RAIL_SPEED] ** 2
        energy += rail[at.FRICTION_STIFFNESS] * state[at.RAIL_TWIST] ** 2
        energy += rail[at.BED_STIFFNESS] * (y - rail[at.BED_REST]) ** 2
        energy += rail[at.STOP_STIFFNESS] * max(y, 0.0) ** 2
        energy += rail[at.OBJECT_STIFFNESS] * max(y + rail[at.OBJECT_SIZE], 0.0) ** 2
        energy += state[at.ROD_FORCE] ** 2 / constants[at.ROD_STIFFNESS]
    return 0.5 * float(energy)
