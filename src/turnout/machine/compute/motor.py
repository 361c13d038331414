"""The motor side of one implicit stage: current, motor speed and clutch torque for a gear speed.

With the stage length g and the values (*) that the earlier stages leave behind, the unknown motor
speed w1 solves

    J1 (w1 - w1*)/g + c1 w1 + T_c(w1 - w2) - T_m(w1) - T_h(w1) + t_0 = 0,  t_0 in T_0 Sgn(w1)

Every term but the set-valued one is continuous and does not fall with w1, and J1/g > 0: there is
one solution, which a Newton iteration inside a bracket always finds. float64 throughout; torques
[N m], speeds [rad/s], positive in the closing direction.

A motor has one of the circuits below, with brushes here or with three phases in
`turnout.machine.compute.induction`; the functions above `clutch_torque` tell them apart.
"""

import math
from typing import NamedTuple

from turnout.kernels.compiled import compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.induction import (
    NO_CURVE,
    add_lost_phase_energy,
    add_three_phase_energy,
    curve_torque,
    drop_fluxes,
    fill_fluxes,
    line_current,
    lost_phase_circuit,
    stored_in_stage,
    torque_curve,
)

(CONSTANT_FIELD, SERIES_FIELD, THREE_PHASE) = range(3)
"""Circuits of motors: torque k i; K i^2/(1 + |i|/i_s); that of the Gamma model."""
ITERATIONS = 60
ROUNDING = 4e-14
"""Residual, as a share of the sum of its terms, that counts as zero."""
UNSOLVED = 1e-9
"""The same where a bracket has closed without a solution."""
Curve = tuple[float, float, float, float, float]


class MotorStage(NamedTuple):
    """All that the motor side of a stage follows from beside the speeds.

    Attributes
    ----------
    constants, state : ndarray
        Rows of the machine; of the state only circuit, clutch level and hand are read.
    g : float
        Length of the stage [s].
    base : ndarray
        What the earlier stages leave of the integrated states.
    curve : tuple of float
        Of an induction motor's torque, see `turnout.machine.compute.induction.torque_curve`.
    hand : float
        Speed of the hand at the crank at the end of the stage [rad/s].
    """

    constants: Floats
    state: Floats
    g: float
    base: Floats
    curve: Curve
    hand: float


@compiled_part
def is_three_phase(constants: Floats) -> bool:
    """Return whether the motor is an induction motor."""
    return bool(constants[at.MOTOR_CIRCUIT] == THREE_PHASE)


@compiled_part
def supplied_voltage(constants: Floats, direction: float) -> float:
    """Return the voltage behind the contactor, which reverses a constant field alone [V]."""
    reverses = direction < 0.0 and constants[at.MOTOR_CIRCUIT] == CONSTANT_FIELD
    return float(-constants[at.VOLTAGE] if reverses else constants[at.VOLTAGE])


@compiled_part
def net_voltage(state: Floats) -> float:
    """Return the voltage that drives the current, less what the other machines take [V]."""
    return float(
        state[at.SUPPLIED] - math.copysign(1.0, state[at.SUPPLIED]) * state[at.SHARED_DROP]
    )


@compiled_part
def supply_current(constants: Floats, state: Floats) -> tuple[float, float]:
    """Return the current that the machine takes, along and across its supply's voltage [A]."""
    if is_three_phase(constants) and state[at.ARMATURE_OPEN] == 0.0:
        line = line_current(constants, state)
        return line.real, line.imag
    return abs(state[at.CURRENT]), 0.0


@compiled_part
def stage_curve(constants: Floats, state: Floats, g: float, base: Floats) -> Curve:
    """Return the torque over the slip of an induction motor in a stage, see `torque_curve`."""
    if is_three_phase(constants) and state[at.ARMATURE_OPEN] == 0.0:
        return torque_curve(constants, state, g, base)
    return NO_CURVE


@compiled_part
def motor_torque(motor: MotorStage, w1: float) -> tuple[float, float, float]:
    """Return current, torque and slope of the torque at a motor speed [rad/s].

    Notes
    -----
    With i* of the current from the earlier stages,
    L (i - i*)/g + R i + u_b + e = U with u_b in V_b Sgn(i); R includes what a brush of poor contact
    adds. A permanent magnet has e = k w1, T = k i; a series motor p = K i/(1 + |i|/i_s),
    e = d p w1, T = d p i, and a quadratic for |i| with exactly one positive root. Their torque
    never rises with w1; that of an induction motor does below breakdown, by far less than J_1/g.
    The current of an induction motor is not needed here; 0 stands for it.
    """
    constants, state, g = motor.constants, motor.state, motor.g
    if state[at.ARMATURE_OPEN] > 0.0:
        return 0.0, 0.0, 0.0
    if is_three_phase(constants):
        if state[at.PHASE_LOST] > 0.0:
            _, torque, slope, _ = lost_phase_circuit(constants, state, w1)
        else:
            torque, slope = curve_torque(constants, state, motor.curve, w1)
        return 0.0, torque, slope
    current = motor.base[at.CURRENT]
    k, drop = constants[at.MOTOR_CONSTANT], constants[at.BRUSH_DROP]
    r = constants[at.INDUCTANCE] / g + state[at.CIRCUIT_RESISTANCE] + state[at.BRUSH_RESISTANCE]
    q = net_voltage(state) + constants[at.INDUCTANCE] / g * current
    if constants[at.MOTOR_CIRCUIT] == CONSTANT_FIELD:
        q -= k * w1
        if abs(q) <= drop:
            return 0.0, 0.0, 0.0
        i = (q - math.copysign(drop, q)) / r
        return i, k * i, -k * k / r
    if abs(q) <= drop:
        return 0.0, 0.0, 0.0
    sign, d, u_s = math.copysign(1.0, q), state[at.DIRECTION], constants[at.INVERSE_SATURATION]
    free = abs(q) - drop
    generated = d * k * w1
    a, b = r * u_s, r + generated - free * u_s
    root = math.sqrt(b * b + 4.0 * a * free)
    if b > 0.0:
        u = 2.0 * free / (b + root)
    elif a > 0.0:
        u = (root - b) / (2.0 * a)
    else:
        return math.nan, math.nan, 0.0  # excites itself faster than the step can follow
    s = 1.0 + u * u_s
    fall = -(u / s) / (r + generated / (s * s))
    slope = k * u * (1.0 + s) / (s * s) * fall * k
    return sign * u, d * k * u * u / s, slope


@compiled_part
def fill_currents(motor: MotorStage, stage: Floats, w1: float) -> None:
    """Write the current, and fluxes, of a stage of an induction motor."""
    constants, state = motor.constants, motor.state
    if not is_three_phase(constants) or state[at.ARMATURE_OPEN] > 0.0:
        return
    if state[at.PHASE_LOST] > 0.0:
        stage[at.CURRENT] = lost_phase_circuit(constants, state, w1)[0]
    else:
        fill_fluxes(constants, state, motor.g, motor.base, stage, w1)


@compiled_part
def add_electrical_energy(constants: Floats, state: Floats, stage: Floats, weight: float) -> None:
    """Add what a stage takes from the supply, and loses in line, copper and brushes."""
    i = stage[at.CURRENT]
    heat = weight * i * i
    if is_three_phase(constants):
        if state[at.ARMATURE_OPEN] == 0.0 and state[at.PHASE_LOST] > 0.0:
            add_lost_phase_energy(constants, state, stage, weight)
        elif state[at.ARMATURE_OPEN] == 0.0:
            add_three_phase_energy(constants, state, stage, weight)
        return
    if state[at.ENERGISED] > 0.0:
        taken = state[at.SUPPLIED] - net_voltage(state)
        power = state[at.SUPPLIED] * i + constants[at.FIELD_POWER]
        state[at.ENERGIES + at.SUPPLY] += weight * power
        state[at.ENERGIES + at.FIELD] += weight * constants[at.FIELD_POWER]
        state[at.ENERGIES + at.LINE] += heat * constants[at.LINE_RESISTANCE] + weight * taken * i
    else:
        state[at.ENERGIES + at.SNUB] += heat * constants[at.SNUB_RESISTANCE]
    state[at.ENERGIES + at.COPPER] += heat * constants[at.RESISTANCE]
    state[at.ENERGIES + at.BRUSH] += weight * constants[at.BRUSH_DROP] * abs(i)
    state[at.ENERGIES + at.BRUSH] += heat * state[at.BRUSH_RESISTANCE]


@compiled_part
def into_field(constants: Floats, state: Floats, stage: Floats, before: Floats) -> float:
    """Return what the change of current or fluxes within a stage stores [J]."""
    into = constants[at.INDUCTANCE] * stage[at.CURRENT] * (stage[at.CURRENT] - before[at.CURRENT])
    if is_three_phase(constants):
        into += stored_in_stage(constants, state, stage, before)
    return float(into)


@compiled_part
def drop_field(constants: Floats, state: Floats) -> None:
    """Let the arc take what coil or fluxes hold when the contactor opens."""
    coil = 0.5 * constants[at.INDUCTANCE] * state[at.CURRENT] ** 2
    state[at.ENERGIES + at.SNUB] += coil
    state[at.ENERGIES + at.INTO_STORES] -= coil
    state[at.CURRENT] = 0.0
    if is_three_phase(constants):
        drop_fluxes(constants, state)


@compiled_part
def clutch_torque(
    constants: Floats, state: Floats, g: float, twist: float, slip_speed: float
) -> tuple[float, float]:
    """Return torque and slope of the elastic-plastic clutch [N m], [N m s/rad]."""
    trial = constants[at.CLUTCH_STIFFNESS] * (twist + g * slip_speed)
    level = state[at.LEVEL]
    if abs(trial) <= level:
        return trial, constants[at.CLUTCH_STIFFNESS] * g
    return math.copysign(level, trial), 0.0


@compiled_part
def next_guess(
    x: float, f: float, slope: float, low: float, high: float
) -> tuple[float, float, float]:
    """Return Newton's next guess from x, or the middle of the bracket, and the narrower bracket."""
    if f > 0.0:
        high = x
    else:
        low = x
    new = x - f / slope
    return new if low < new < high else 0.5 * (low + high), low, high


@compiled_part
def _residual(
    motor: MotorStage, w1: float, w2: float
) -> tuple[float, float, float, float, float, float]:
    """Return residual, slope and scale at w1 without t_0; clutch torque, its slope and current."""
    constants, state, g, base, _, hand = motor
    i, torque, torque_slope = motor_torque(motor, w1)
    clutch, clutch_slope = clutch_torque(constants, state, g, base[at.TWIST], w1 - w2)
    inertia = constants[at.MOTOR_INERTIA] / g
    gain = constants[at.HAND_GAIN] * state[at.HAND_ON]
    viscous = constants[at.MOTOR_DRAG] + gain
    residual = inertia * (w1 - base[at.SPEED]) + viscous * w1 - gain * hand + clutch - torque
    scale = inertia * (abs(w1) + abs(base[at.SPEED])) + viscous * abs(w1) + gain * abs(hand)
    scale += abs(clutch) + abs(torque)
    return residual, inertia + viscous + clutch_slope - torque_slope, scale, clutch, clutch_slope, i


@compiled_part
def motor_side(
    motor: MotorStage, start: float, w2: float
) -> tuple[float, float, float, float, float]:
    """Return motor speed, current, clutch torque, and how torque and speed follow the gear's speed.

    Parameters
    ----------
    motor : MotorStage
    start : float
        First guess of the motor speed.
    w2 : float
        Speed of the gear [rad/s].

    Returns
    -------
    tuple of float
        The current is NaN where the iteration did not end, and 0 of an induction motor.
    """
    still = motor.state[at.STILL_TORQUE]
    w1, sign = start, math.copysign(1.0, start)
    stands, checked = start == 0.0, False
    low, high = -math.inf, math.inf
    for _ in range(ITERATIONS):
        tried = 0.0 if stands else w1
        f, slope, scale, clutch, clutch_slope, i = _residual(motor, tried, w2)
        if stands:
            if abs(f) <= still:
                return 0.0, i, clutch, -clutch_slope, 0.0
            stands, checked, sign = False, True, -math.copysign(1.0, f)
            low, high = -math.inf, math.inf
            continue
        f += sign * still
        if not abs(f) < math.inf:
            break
        settled = abs(f) <= ROUNDING * (scale + still)
        if not settled:
            new, low, high = next_guess(w1, f, slope, low, high)
            settled = new in (w1, low, high)
            if not settled:
                w1 = new
                continue
            if is_three_phase(motor.constants) and not abs(f) <= UNSOLVED * (scale + still):
                break  # torque rises faster than the inertia's J1/g: the step is too long
        if checked or w1 * sign >= 0.0:
            follows = clutch_slope / slope
            return w1, i, clutch, -clutch_slope * (1.0 - follows), follows
        stands = True  # the guess had the wrong sign: the motor stands, or turns the other way
    return w1, math.nan, 0.0, 0.0, 0.0
