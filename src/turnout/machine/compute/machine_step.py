"""One step of a machine: two implicit stages, and the energy by the scheme's own sums.

The scheme is the L-stable SDIRK of order 2 (Alexander 1977, doi 10.1137/0714068) with
gamma = 1 - 1/sqrt(2) and weights (1 - gamma, gamma); its second stage ends at the end of the step.
Set-valued laws hold in each stage exactly.

A stage of length g asks for the gear speed w2 with

    J2 (w2 - w2*)/g + c2 w2 - T_c(w2) + X'(th2) F(x) + t_g = 0

where T_c is what the motor side answers (it falls with w2), F what the rod answers (it rises with
the rod position x = X(th2), th2 = th2* + g w2), and t_g the loss of the gear: the load appears at
the shaft as X' F / eta where it is driven, as X' F eta_b where it drives back, and as any value
between while the gear stands; a lock bar adds its torque against the motion. All of it rises with
w2, jumps included, so there is one solution; it is looked for on the side of w2 that the last stage
was on, and the standing gear is tried when that side has no solution. Nothing is smoothed and no
sign is guessed.
"""

import math
from typing import NamedTuple

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.induction import note_saturation
from turnout.machine.compute.motor import (
    ITERATIONS,
    ROUNDING,
    MotorStage,
    add_electrical_energy,
    fill_currents,
    into_field,
    motor_side,
    next_guess,
    stage_curve,
)

GAMMA = 1.0 - math.sqrt(0.5)
"""Length of a stage per length of the step."""
SAME_STEP = 1e-9
"""Share by which two steps may differ in length and count as equally long."""
BASE, FIRST, SECOND, GUESS, WORK_ROWS = range(5)
"""Rows of the work of a machine: what the stages leave, both stages, and what follows."""
GUESS_STEP, GUESS_MOTOR, GUESS_GEAR, GUESS_STAGE = range(4)
"""Of the row GUESS: length of the last step; change of both speeds in its first stage, and the
places by which those of the second are further on."""


class MachineArrays(NamedTuple):
    """Arrays that the kernels of one machine read and write beside its state.

    Attributes
    ----------
    constants, rail : ndarray, shape (CONSTANTS,), (RAIL_CONSTANTS,)
        Of the machine, and of the rail at its rod for a step.
    table : ndarray, shape (n, 5)
        Of the stroke, see `rod_position`.
    commands : ndarray, shape (n_commands, 2)
        Time [s] and direction (1 closing, -1 opening), rising in time.
    work : ndarray, shape (WORK_ROWS, ROD_FORCE + 1)
        Stages of a step and what follows, by the rows above.
    log : ndarray, shape (n, 2)
        Receives time [s] and event.
    """

    constants: Floats
    rail: Floats
    table: Floats
    commands: Floats
    work: Floats
    log: Floats


@compiled_part
def rod_position(constants: Floats, table: Floats, angle: float) -> tuple[float, float, float]:
    """Return the rod position and its first two derivatives over the shaft angle.

    Parameters
    ----------
    constants : ndarray
    table : ndarray, shape (n, 5)
        Of a stroke given as a table: share of the angle at which a piece begins, and the
        coefficients of 1, s, s^2, s^3 of the share of the stroke in it; the last row ends it.
    angle : float
        [rad].
    """
    if constants[at.STROKE_KIND] == at.SCREW:
        return angle / constants[at.RATIO], 1.0 / constants[at.RATIO], 0.0
    whole, stroke, start = constants[at.RATIO], constants[at.STROKE], constants[at.STROKE_START]
    if constants[at.STROKE_KIND] == at.CRANK:
        turn = math.pi / whole
        phi, half = turn * angle, 0.5 * stroke
        x = start + half * (1.0 - math.cos(phi))
        return x, half * turn * math.sin(phi), half * turn * turn * math.cos(phi)
    share = min(max(angle / whole, 0.0), 1.0)
    row = 0
    while row < table.shape[0] - 2 and share >= table[row + 1, 0]:
        row += 1
    s = share - table[row, 0]
    a0, a1, a2, a3 = table[row, 1], table[row, 2], table[row, 3], table[row, 4]
    x = start + stroke * (a0 + s * (a1 + s * (a2 + s * a3)))
    if not 0.0 < angle / whole < 1.0:
        return x, 0.0, 0.0
    slope = stroke / whole * (a1 + s * (2.0 * a2 + s * 3.0 * a3))
    return x, slope, stroke / whole**2 * (2.0 * a2 + s * 6.0 * a3)


@compiled_part
def rod_stretch(constants: Floats, stretch: float) -> float:
    """Return the elastic part of the distance between rod end and rail, beyond the lost motion."""
    half = 0.5 * constants[at.ROD_PLAY]
    if abs(stretch) <= half:
        return 0.0
    return float(stretch - math.copysign(half, stretch))


@compiled_part
def rail_side(constants: Floats, free: float, compliance: float, x: float) -> tuple[float, float]:
    """Return rod force, positive when it pushes the rail home, and its slope over rod position x.

    The rail is at y = free + compliance F.
    """
    stiffness = constants[at.ROD_STIFFNESS] / (1.0 + constants[at.ROD_STIFFNESS] * compliance)
    elastic = rod_stretch(constants, x - free)
    return stiffness * elastic, stiffness if elastic != 0.0 else 0.0


@compiled_part
def load_factor(constants: Floats, state: Floats, force: float, sign: float) -> float:
    """Return torque at the shaft per load, X' F, when the gear turns with a sign."""
    if force * sign > 0.0:
        return float(constants[at.FACTOR_DRIVING] / state[at.GEAR_RATIO])
    return float(constants[at.FACTOR_DRIVEN] * state[at.GEAR_RATIO])


@compiled_part
def _fill(
    motor: MotorStage, stage: Floats, solution: tuple[float, float, float, float, float]
) -> None:
    """Write the solution of a stage."""
    i, w1, w2, x, force = solution
    stage[at.CURRENT], stage[at.SPEED], stage[at.GEAR_SPEED] = i, w1, w2
    stage[at.GEAR_ANGLE] = motor.base[at.GEAR_ANGLE] + motor.g * w2
    stage[at.ROD_POSITION], stage[at.ROD_FORCE] = x, force
    fill_currents(motor, stage, w1)


@compiled_part
def follow_gear(w1: float, change: float) -> float:
    """Return where the motor will be to first order, or its speed where that turns it round."""
    ahead = w1 + change
    return ahead if ahead * w1 > 0.0 else w1


@compiled
def solve_stage(machine: MachineArrays, state: Floats, g: float, end: float, stage: Floats) -> int:
    """Solve one stage; `stage` holds the guess and receives the solution.

    Parameters
    ----------
    machine : MachineArrays
        Row BASE of its work holds what the earlier stages leave.
    state : ndarray
        Circuit, lock, clutch level, and whether the gear is dry here.
    g, end : float
        Length and end of the stage [s].
    stage : ndarray
        As the first entries of a state row, up to ROD_FORCE.

    Returns
    -------
    int
        CONVERGED or NOT_CONVERGED.
    """
    constants, base = machine.constants, machine.work[BASE]
    free, compliance = rail_at(machine.rail, end)
    inertia, bar = constants[at.GEAR_INERTIA] / g, state[at.BAR_TORQUE]
    w1 = stage[at.SPEED]
    w2 = 0.0 if state[at.LOCKED] > 0.0 else stage[at.GEAR_SPEED]
    sign = math.copysign(1.0, w2)
    stands, checked = w2 == 0.0, False
    curve = stage_curve(constants, state, g, base)
    motor = MotorStage(constants, state, g, base, curve, hand_speed(constants, state, end))
    low, high = -math.inf, math.inf
    for _ in range(2 * ITERATIONS):
        w1, i, clutch, clutch_slope, follows = motor_side(motor, w1, w2)
        x, dx, ddx = rod_position(constants, machine.table, base[at.GEAR_ANGLE] + g * w2)
        force, force_slope = rail_side(constants, free, compliance, x)
        load = dx * force
        f = inertia * (w2 - base[at.GEAR_SPEED]) - clutch
        if not abs(f + load) < math.inf or math.isnan(i):
            return at.NOT_CONVERGED
        settled = False
        if stands:
            below = load_factor(constants, state, load, -1.0)
            above = load_factor(constants, state, load, 1.0)
            most = f + above * load + bar
            settled = state[at.LOCKED] > 0.0 or f + below * load - bar <= 0.0 <= most
            if not settled:
                stands, checked, low, high = False, True, -math.inf, math.inf
                sign = 1.0 if most < 0.0 else -1.0
        if not stands:
            factor = load_factor(constants, state, load, sign)
            f += constants[at.GEAR_DRAG] * w2 + factor * load + bar * sign
            slope = inertia + constants[at.GEAR_DRAG] - clutch_slope
            slope += factor * g * (dx * dx * force_slope + ddx * force)
            scale = inertia * (abs(w2) + abs(base[at.GEAR_SPEED])) + abs(clutch)
            scale += factor * abs(load) + bar
            settled = abs(f) <= ROUNDING * scale
            if not settled:
                if slope <= 0.0:
                    return at.NOT_CONVERGED
                new, low, high = next_guess(w2, f, slope, low, high)
                settled = new in (w2, low, high)
                if not settled:
                    w1, w2 = follow_gear(w1, follows * (new - w2)), new
                    continue
            if not checked and w2 * sign < 0.0:
                stands, w2 = True, 0.0
                continue
        if settled:
            _fill(motor, stage, (i, w1, w2, x, force))
            stage[at.TWIST] = clutch / constants[at.CLUTCH_STIFFNESS]
            return at.CONVERGED
    return at.NOT_CONVERGED


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
def rail_at(rail: Floats, time: float) -> tuple[float, float]:
    """Return position without rod force [m] and compliance of the rail at a time in its step.

    The rail is taken along the parabola from its position and speed at the start of its step to
    the end of it, where it is RAIL_FREE + RAIL_COMPLIANCE F.
    """
    tau = time - rail[at.RAIL_TIME]
    share = (tau / rail[at.RAIL_STEP]) ** 2
    start, speed = rail[at.RAIL_START], rail[at.RAIL_START_SPEED]
    bend = rail[at.RAIL_FREE] - start - speed * rail[at.RAIL_STEP]
    return start + speed * tau + bend * share, rail[at.RAIL_COMPLIANCE] * share


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
def take_step(machine: MachineArrays, state: Floats, time: float, step: float) -> int:
    """Solve both stages of a step without changing the state.

    Parameters
    ----------
    machine : MachineArrays
        Its work receives the stages; row SECOND is the end of the step. The search begins with the
        changes of the last step, if that was as long.
    state : ndarray
    time, step : float
        Start and length of the step [s].

    Returns
    -------
    int
        CONVERGED or NOT_CONVERGED.
    """
    work = machine.work
    g = GAMMA * step
    base, first, second, guess = work[BASE], work[FIRST], work[SECOND], work[GUESS]
    alike = abs(guess[GUESS_STEP] - step) <= SAME_STEP * step
    guess[GUESS_STEP] = 0.0
    for k in range(first.size):
        first[k] = state[k]
        base[k] = state[k]
    if alike:
        _guess_speeds(state, first, guess, 0)
    code = solve_stage(machine, state, g, time + g, first)
    if code != at.CONVERGED:
        return code
    ahead = (1.0 - GAMMA) / GAMMA
    for k in range(first.size):
        second[k] = first[k]
    for k in range(at.INTEGRATED, at.PAST_INTEGRATED):
        base[k] = state[k] + ahead * (first[k] - state[k])
    if alike:
        _guess_speeds(state, second, guess, 1)
    code = solve_stage(machine, state, g, time + step, second)
    if code == at.CONVERGED:
        _note_speeds(state, first, guess, 0)
        _note_speeds(state, second, guess, 1)
        guess[GUESS_STEP] = step
    return code


@compiled_part
def accept_step(machine: MachineArrays, state: Floats, time: float, step: float) -> None:
    """Make the end of a step the state, and add its energies; takes what `take_step` takes."""
    constants, work = machine.constants, machine.work
    g = GAMMA * step
    first, second, base = work[FIRST], work[SECOND], work[BASE]
    slip = 0.0
    for number in range(2):
        stage = first if number == 0 else second
        before = state if number == 0 else base
        weight = (1.0 - GAMMA) * step if number == 0 else g
        hand = hand_speed(constants, state, time + (g if number == 0 else step))
        slid = stage[at.SPEED] - stage[at.GEAR_SPEED] - (stage[at.TWIST] - before[at.TWIST]) / g
        slip += weight * slid
        state[at.ENERGIES + at.CLUTCH] += (
            weight * constants[at.CLUTCH_STIFFNESS] * stage[at.TWIST] * slid
        )
        _add_motor_energy(constants, state, stage, hand, weight)
        _add_gear_energy(machine, state, stage, weight)
        _add_stored_energy(constants, state, stage, before, weight / g)
    state[at.SLIP] += slip
    for k in range(at.INTEGRATED, at.PAST_INTEGRATED):
        state[k] = second[k]
    state[at.ROD_POSITION] = second[at.ROD_POSITION]
    state[at.ROD_FORCE] = second[at.ROD_FORCE]
    note_saturation(constants, state)


@compiled_part
def _add_motor_energy(
    constants: Floats, state: Floats, stage: Floats, hand: float, weight: float
) -> None:
    add_electrical_energy(constants, state, stage, weight)
    w1 = stage[at.SPEED]
    state[at.ENERGIES + at.MOTOR_FRICTION] += weight * state[at.STILL_TORQUE] * abs(w1)
    state[at.ENERGIES + at.MOTOR_DRAG_HEAT] += weight * constants[at.MOTOR_DRAG] * w1 * w1
    gain = constants[at.HAND_GAIN] * state[at.HAND_ON]
    state[at.ENERGIES + at.HAND] += weight * gain * (hand - w1) * w1


@compiled_part
def _add_gear_energy(machine: MachineArrays, state: Floats, stage: Floats, weight: float) -> None:
    constants = machine.constants
    w2 = stage[at.GEAR_SPEED]
    if w2 == 0.0:
        return
    load = rod_position(constants, machine.table, stage[at.GEAR_ANGLE])[1] * stage[at.ROD_FORCE]
    factor = load_factor(constants, state, load, math.copysign(1.0, w2))
    bar = state[at.BAR_TORQUE] * abs(w2)
    state[at.ENERGIES + at.GEAR] += weight * ((factor - 1.0) * load * w2 + bar)
    state[at.ENERGIES + at.GEAR_DRAG_HEAT] += weight * constants[at.GEAR_DRAG] * w2 * w2
    state[at.ENERGIES + at.ROD_INPUT] += weight * load * w2


@compiled_part
def _add_stored_energy(
    constants: Floats, state: Floats, stage: Floats, before: Floats, weight: float
) -> None:
    """Add what a stage puts into inertias, clutch and coil, whose change has a weight."""
    into = into_field(constants, state, stage, before)
    for place, factor in (
        (at.SPEED, at.MOTOR_INERTIA),
        (at.GEAR_SPEED, at.GEAR_INERTIA),
        (at.TWIST, at.CLUTCH_STIFFNESS),
    ):
        into += constants[factor] * stage[place] * (stage[place] - before[place])
    state[at.ENERGIES + at.INTO_STORES] += weight * into
