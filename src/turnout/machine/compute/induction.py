"""The three-phase induction motor of one implicit stage: fluxes, torque, line current, powers.

Space vectors with peak values as complex numbers, in a frame that turns with the supply (direction
d, w_k = d 2 pi f), where the phase voltage u is real. Gamma model, with the stator's flux psi_s and
the rotor's psi_r [V s]:

    psi_s' = u - R_s i_s - j w_k psi_s               i_s = psi_s/L_s + (psi_s - psi_r)/L_l
    psi_r' = -R_r i_r - j (w_k - n_p w1) psi_r       i_r = (psi_r - psi_s)/L_l
    T = 1.5 n_p Im(i_s conj psi_s)

The main branch may saturate: its current per flux is (1 + c (|psi_s|/psi_0)^8 - c)/L_s with L_s at
the rated flux psi_0, so that n = d ln i/d ln psi is 1 + 8 c there. Within a step it is that of the
flux at the start, which leaves the equations of a stage linear. With one phase lost it is 1/L_s.

Iron loss is a resistance across the motor's terminals, behind the line: what both do to the stator
is one source u/(1 + R_line/R_fe) with R_line R_fe/(R_line + R_fe) in series. The steady circuit is
the same with both derivatives zero. What other machines take from a shared supply is subtracted
from u. The two equations of a stage are linear in the fluxes, so the torque is a quotient of
polynomials in the slip speed, whose coefficients are computed once a stage.

The steady circuit seen from its terminals is, with the stator's flux as the reference and at the
slip speed s = w_k - n_p w1 (electrical):

    i_s = lambda psi_s,    lambda = 1/L_s + j s/(R_r + j s L_l),    Z = R_s + j w_k/lambda

At the slip S = s/w_k this is R_s in series with jX_s parallel to jX_l + R_r/S, and it is finite at
synchronous speed, S = 0.

With one conductor of the supply open the current of the two others flows through two windings in
series. By symmetrical components (C. L. Fortescue, AIEE Transactions 37, 1918) it is a forward and
a backward system of equal currents, whose impedances Z_1 at the slip s and Z_2 at 2 - s are in
series between two lines:

    I = V/|Z_1 + Z_2|,    |I_1| = |I_2| = I/sqrt(3),    T = T_1 + T_2,  T_2 against the rotation

At rest both torques cancel: the motor does not start. What the model leaves out is the pulsation of
the torque at twice the supply's frequency and the decay of the fluxes.
"""

import math
from typing import Any

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at

SAME_BRANCH, MOST_CHANGES = 1e-9, 40
"""Smallest change of the main branch that is made, and the most changes of a steady circuit [-]."""
NO_CURVE = (0.0, 0.0, 1.0, 0.0, 0.0)
"""Torque curve of a motor without one."""


def gamma_impedance(
    frame: float,
    slip_speed: float,
    resistances: tuple[float, float],
    inductances: tuple[float, float],
) -> tuple[complex, complex, complex]:
    """Return stator current per flux [1/H], impedance [ohm], and the rotor's own impedance [ohm].

    Parameters
    ----------
    frame : float
        w_k, electrical [rad/s]; negative of a system that turns backwards.
    slip_speed : float
        [rad/s].
    resistances : tuple of float
        R_s and R_r [ohm].
    inductances : tuple of float
        L_s and L_l [H].
    """
    rotor = resistances[1] + 1j * slip_speed * inductances[1]
    per_flux = 1.0 / inductances[0] + 1j * slip_speed / rotor
    return per_flux, resistances[0] + 1j * frame / per_flux, rotor


gamma_circuit = compiled_part(gamma_impedance)
"""`gamma_impedance` for kernels."""


@compiled_part
def scaled(z: complex, factor: float) -> complex:
    """Return z times a real factor, without the product of two complex numbers."""
    return complex(z.real * factor, z.imag * factor)


@compiled_part
def squared(z: complex) -> float:
    """Return |z|^2, without the root that abs takes."""
    return z.real * z.real + z.imag * z.imag


@compiled_part
def stator_flux(row: Floats) -> complex:
    """Return psi_s of a state, a stage or a base."""
    return complex(row[at.STATOR_FLUX], row[at.STATOR_FLUX_ACROSS])


@compiled_part
def rotor_flux(row: Floats) -> complex:
    """Return psi_r of a state, a stage or a base."""
    return complex(row[at.ROTOR_FLUX], row[at.ROTOR_FLUX_ACROSS])


def main_excess(constants: Floats, size: Any) -> Any:
    """Return the main branch's current per flux over 1/L_s, less 1, at a flux |psi_s| [-].

    An array where Python calls this.
    """
    share = size / constants[at.RATED_FLUX]
    fourth = share * share * share * share
    return constants[at.MAIN_BEND] * (fourth * fourth - 1.0)


_excess = compiled_part(main_excess)


@compiled_part
def winding_currents(
    constants: Floats, state: Floats, psi_s: complex, psi_r: complex
) -> tuple[complex, complex]:
    """Return the currents of stator and rotor [A]; of the state only the main branch is read."""
    i_r = scaled(psi_r - psi_s, 1.0 / constants[at.LEAKAGE_INDUCTANCE])
    main = (1.0 + state[at.MAIN_EXCESS]) / constants[at.STATOR_INDUCTANCE]
    return scaled(psi_s, main) - i_r, i_r


@compiled_part
def stator_source(constants: Floats, state: Floats) -> tuple[complex, float]:
    """Return voltage (peak) [V] and resistance [ohm] of the source that the stator sees."""
    line = constants[at.LINE_RESISTANCE]
    divided = 1.0 + line * constants[at.IRON_CONDUCTANCE]
    along = constants[at.PHASE_VOLTAGE] - state[at.SHARED_DROP]
    voltage = complex(along, -state[at.SHARED_DROP_ACROSS])
    return scaled(voltage, 1.0 / divided), float(line / divided)


@compiled_part
def terminals(constants: Floats, state: Floats, i_s: complex) -> tuple[complex, complex]:
    """Return the voltage at the motor's terminals [V] and the current in the line [A]."""
    source, series = stator_source(constants, state)
    voltage = source - scaled(i_s, series)
    return voltage, i_s + scaled(voltage, constants[at.IRON_CONDUCTANCE])


@compiled_part
def line_current(constants: Floats, state: Floats) -> complex:
    """Return the current of the line in the frame of the machine's own direction, peak [A]."""
    i_s, _ = winding_currents(constants, state, stator_flux(state), rotor_flux(state))
    return terminals(constants, state, i_s)[1]


@compiled_part
def slip_speed(constants: Floats, state: Floats, w1: float) -> float:
    """Return w_k - n_p w1, electrical [rad/s]."""
    return float(state[at.DIRECTION] * constants[at.SUPPLY_SPEED] - constants[at.POLE_PAIRS] * w1)


@compiled_part
def _stage_system(
    constants: Floats, state: Floats, g: float, base: Floats
) -> tuple[complex, float, float, float, complex, complex]:
    """Return a11, a12, a21, Re a22, b1, b2 of a stage: A (psi_s, psi_r) = b, Im a22 the slip."""
    rate = 0.0 if constants[at.STEADY_CIRCUIT] > 0.0 else 1.0 / g
    leak, r_r = constants[at.LEAKAGE_INDUCTANCE], constants[at.ROTOR_RESISTANCE]
    source, series = stator_source(constants, state)
    r_s = constants[at.RESISTANCE] + series
    wk = state[at.DIRECTION] * constants[at.SUPPLY_SPEED]
    main = r_s * (1.0 + state[at.MAIN_EXCESS]) / constants[at.STATOR_INDUCTANCE]
    a11 = complex(rate + main + r_s / leak, wk)
    b1, b2 = source + scaled(stator_flux(base), rate), scaled(rotor_flux(base), rate)
    return a11, -r_s / leak, -r_r / leak, rate + r_r / leak, b1, b2


@compiled
def stage_fluxes(
    constants: Floats, state: Floats, g: float, base: Floats, w1: float
) -> tuple[complex, complex]:
    """Return the fluxes of stator and rotor at a motor speed.

    Parameters
    ----------
    constants, state : ndarray
        Rows of the machine; of the state direction, shared drop and main branch are read.
    g : float
        Length of the stage [s].
    base : ndarray
        What the earlier stages leave of the integrated states.
    w1 : float
        [rad/s].
    """
    a11, a12, a21, across, b1, b2 = _stage_system(constants, state, g, base)
    a22 = complex(across, slip_speed(constants, state, w1))
    det = a11 * a22 - a12 * a21
    inverse = scaled(det.conjugate(), 1.0 / squared(det))
    return (b1 * a22 - scaled(b2, a12)) * inverse, (a11 * b2 - scaled(b1, a21)) * inverse


@compiled_part
def _put_fluxes(
    constants: Floats, state: Floats, row: Floats, fluxes: tuple[complex, complex]
) -> None:
    """Write the fluxes of stator and rotor into a row, and the line's current (rms)."""
    psi_s, psi_r = fluxes
    row[at.STATOR_FLUX], row[at.STATOR_FLUX_ACROSS] = psi_s.real, psi_s.imag
    row[at.ROTOR_FLUX], row[at.ROTOR_FLUX_ACROSS] = psi_r.real, psi_r.imag
    i_s, _ = winding_currents(constants, state, psi_s, psi_r)
    row[at.CURRENT] = math.sqrt(0.5 * squared(terminals(constants, state, i_s)[1]))


@compiled_part
def note_saturation(constants: Floats, state: Floats) -> None:
    """Take the main branch for the next step by the flux at the end of this one.

    A steady circuit takes the one that its flux at this speed leaves, found in halved changes.
    """
    psi_s, psi_r = stator_flux(state), rotor_flux(state)
    if constants[at.MAIN_BEND] == 0.0 or abs(psi_s) == 0.0:
        return
    steady = constants[at.STEADY_CIRCUIT] > 0.0
    for _ in range(MOST_CHANGES if steady else 1):
        last = state[at.MAIN_EXCESS]
        change = _excess(constants, abs(psi_s)) - last
        if abs(change) <= SAME_BRANCH:
            break
        state[at.MAIN_EXCESS] = last + (0.5 * change if steady else change)
        if steady:
            psi_s, psi_r = stage_fluxes(constants, state, 1.0, state, state[at.SPEED])
    _put_fluxes(constants, state, state, (psi_s, psi_r))


@compiled
def torque_curve(
    constants: Floats, state: Floats, g: float, base: Floats
) -> tuple[float, float, float, float, float]:
    """Return n0, n1, d0, d1, d2 of T = (n0 + n1 s)/(d0 + d1 s + d2 s^2) over the slip speed s.

    Takes what `stage_fluxes` takes but the motor speed.

    Notes
    -----
    T = 1.5 n_p/L_l Im(psi_s conj psi_r) with psi_s = (b1 a22 - a12 b2)/D, psi_r = n/D,
    n = a11 b2 - a21 b1, and D = a11 a22 - a12 a21. Only a22 = r + j s depends on the speed.
    """
    a11, a12, a21, across, b1, b2 = _stage_system(constants, state, g, base)
    n = (a11 * b2 - scaled(b1, a21)).conjugate()
    d = scaled(a11, across) - a12 * a21
    factor = 1.5 * constants[at.POLE_PAIRS] / constants[at.LEAKAGE_INDUCTANCE]
    n0 = factor * ((scaled(b1, across) - scaled(b2, a12)) * n).imag
    n1 = factor * (b1 * n).real
    d1 = -2.0 * (d.conjugate() * a11).imag
    return n0, n1, squared(d), d1, squared(a11)


@compiled_part
def curve_torque(
    constants: Floats,
    state: Floats,
    curve: tuple[float, float, float, float, float],
    w1: float,
) -> tuple[float, float]:
    """Return torque and its slope over the motor speed from a `torque_curve`."""
    n0, n1, d0, d1, d2 = curve
    slip = slip_speed(constants, state, w1)
    share = 1.0 / (d0 + slip * (d1 + slip * d2))
    torque = (n0 + n1 * slip) * share
    fall = (n1 - torque * (d1 + 2.0 * slip * d2)) * share
    return torque, -constants[at.POLE_PAIRS] * fall


@compiled_part
def fill_fluxes(
    constants: Floats, state: Floats, g: float, base: Floats, stage: Floats, w1: float
) -> None:
    """Write the fluxes of a stage at its motor speed, and the line's current (rms)."""
    _put_fluxes(constants, state, stage, stage_fluxes(constants, state, g, base, w1))


@compiled_part
def add_three_phase_energy(constants: Floats, state: Floats, stage: Floats, weight: float) -> None:
    """Add what a stage takes from the supply and loses in line, iron and windings."""
    i_s, i_r = winding_currents(constants, state, stator_flux(stage), rotor_flux(stage))
    voltage, line = terminals(constants, state, i_s)
    part = 1.5 * weight
    taken = state[at.SHARED_DROP] * line.real + state[at.SHARED_DROP_ACROSS] * line.imag
    state[at.ENERGIES + at.SUPPLY] += part * constants[at.PHASE_VOLTAGE] * line.real
    state[at.ENERGIES + at.LINE] += part * (constants[at.LINE_RESISTANCE] * squared(line) + taken)
    state[at.ENERGIES + at.FIELD] += part * constants[at.IRON_CONDUCTANCE] * squared(voltage)
    heat = constants[at.RESISTANCE] * squared(i_s) + constants[at.ROTOR_RESISTANCE] * squared(i_r)
    state[at.ENERGIES + at.COPPER] += part * heat


@compiled_part
def stored_in_stage(constants: Floats, state: Floats, stage: Floats, before: Floats) -> float:
    """Return what the change of the fluxes within a stage stores [J]."""
    if constants[at.STEADY_CIRCUIT] > 0.0:
        return 0.0
    psi_s, psi_r = stator_flux(stage), rotor_flux(stage)
    i_s, i_r = winding_currents(constants, state, psi_s, psi_r)
    into = (i_s.conjugate() * (psi_s - stator_flux(before))).real
    into += (i_r.conjugate() * (psi_r - rotor_flux(before))).real
    return 1.5 * into


def gamma_energy(
    constants: Floats, along: Any, across: Any, rotor_along: Any, rotor_across: Any
) -> Any:
    """Return 0.75 (|psi_s|^2/L_s + |psi_r - psi_s|^2/L_l) from the parts of both fluxes [J].

    These are arrays where Python calls this. Of a main branch that saturates the first part is the
    integral of its current.
    """
    stator = along * along + across * across
    share = stator / (constants[at.RATED_FLUX] * constants[at.RATED_FLUX])
    fourth = share * share
    stator = stator * (1.0 + constants[at.MAIN_BEND] * (0.2 * fourth * fourth - 1.0))
    leak = (rotor_along - along) ** 2 + (rotor_across - across) ** 2
    energy = stator / constants[at.STATOR_INDUCTANCE] + leak / constants[at.LEAKAGE_INDUCTANCE]
    return 0.75 * energy


_energy = compiled_part(gamma_energy)


@compiled_part
def field_energy(constants: Floats, row: Floats) -> float:
    """Return the energy in the magnetic field, 0 of the steady circuit [J]."""
    if constants[at.STEADY_CIRCUIT] > 0.0:
        return 0.0
    stator, rotor = stator_flux(row), rotor_flux(row)
    return float(_energy(constants, stator.real, stator.imag, rotor.real, rotor.imag))


@compiled_part
def drop_fluxes(constants: Floats, state: Floats) -> None:
    """Let arc and windings take what the field holds when the contactor opens."""
    held = field_energy(constants, state)
    state[at.ENERGIES + at.SNUB] += held
    state[at.ENERGIES + at.INTO_STORES] -= held
    state[at.STATOR_FLUX], state[at.STATOR_FLUX_ACROSS] = 0.0, 0.0
    state[at.ROTOR_FLUX], state[at.ROTOR_FLUX_ACROSS] = 0.0, 0.0
    state[at.MAIN_EXCESS] = 0.0  # as before the first start


# --- one conductor open


@compiled_part
def lose_phase(constants: Floats, state: Floats) -> None:
    """Open one conductor: the arc takes what the field holds."""
    drop_fluxes(constants, state)
    state[at.PHASE_LOST] = 1.0


@compiled_part
def _system(
    constants: Floats, frame: float, w1: float
) -> tuple[complex, complex, complex, complex]:
    """Return stator current per flux and impedance of one system, and their slopes over the slip.

    Per slip speed s = frame - n_p w1: lambda' = j R_r/(R_r + j s L_l)^2 and
    Z' = -(Z - R_s) lambda'/lambda.
    """
    slip, r_r = frame - constants[at.POLE_PAIRS] * w1, constants[at.ROTOR_RESISTANCE]
    resistances = (constants[at.RESISTANCE], r_r)
    inductances = (constants[at.STATOR_INDUCTANCE], constants[at.LEAKAGE_INDUCTANCE])
    per_flux, own, rotor = gamma_circuit(frame, slip, resistances, inductances)
    slope = complex(0.0, r_r) / (rotor * rotor)
    return per_flux, own, slope, -(own - constants[at.RESISTANCE]) * slope / per_flux


@compiled
def lost_phase_circuit(
    constants: Floats, state: Floats, w1: float
) -> tuple[float, float, float, float]:
    """Return current of the two lines (rms), torque, its slope over the speed, active power.

    Parameters
    ----------
    constants, state : ndarray
        Rows of the machine; of the state only the direction is read.
    w1 : float
        [rad/s].
    """
    forward = state[at.DIRECTION] * constants[at.SUPPLY_SPEED]
    iron, pairs = constants[at.IRON_CONDUCTANCE], constants[at.POLE_PAIRS]
    whole, bend = complex(2.0 * constants[at.LINE_RESISTANCE], 0.0), complex(0.0, 0.0)
    share, share_slope = 0.0, 0.0
    for number in range(2):
        frame = forward if number == 0 else -forward
        per_flux, own, slope, own_slope = _system(constants, frame, w1)
        divided = 1.0 + iron * own
        z, dz = own / divided, own_slope / (divided * divided)
        whole += z if number == 0 else z.conjugate()
        bend += dz if number == 0 else dz.conjugate()
        # |psi_s|^2 over |line current|^2 is 1/|per_line|^2
        per_line = divided * per_flux
        per_line_slope = iron * own_slope * per_flux + divided * slope
        flux = 1.0 / (per_line.real * per_line.real + per_line.imag * per_line.imag)
        share += flux * per_flux.imag
        share_slope += flux * slope.imag
        share_slope -= 2.0 * flux * per_flux.imag * (per_line_slope / per_line).real
    # a phasor of the phase voltage, peak, is sqrt(2/3) of the voltage between lines, rms
    line_to_line = math.sqrt(1.5) * constants[at.PHASE_VOLTAGE]
    current = line_to_line / abs(whole)
    factor = pairs * current * current  # 1.5 n_p |i|^2 of each system, |i|^2 = 2/3 I^2
    torque = factor * share
    fall = factor * share_slope - 2.0 * torque * (bend / whole).real
    return current, torque, -pairs * fall, whole.real * current * current


@compiled_part
def add_lost_phase_energy(constants: Floats, state: Floats, stage: Floats, weight: float) -> None:
    """Add what a stage takes from the supply and loses in lines, iron and windings."""
    forward = state[at.DIRECTION] * constants[at.SUPPLY_SPEED]
    current, w1 = stage[at.CURRENT], stage[at.SPEED]
    power = lost_phase_circuit(constants, state, w1)[3]
    iron, squared = constants[at.IRON_CONDUCTANCE], current * current
    state[at.ENERGIES + at.SUPPLY] += weight * power
    state[at.ENERGIES + at.LINE] += weight * 2.0 * constants[at.LINE_RESISTANCE] * squared
    for number in range(2):
        frame = forward if number == 0 else -forward
        per_flux, own, _, _ = _system(constants, frame, w1)
        divided = abs(1.0 + iron * own)
        stator = squared / (divided * divided)  # 3 |I_s|^2 of this system
        voltage = abs(own)
        through = abs((per_flux - 1.0 / constants[at.STATOR_INDUCTANCE]) / per_flux)
        heat = constants[at.RESISTANCE] + constants[at.ROTOR_RESISTANCE] * through * through
        state[at.ENERGIES + at.COPPER] += weight * heat * stator
        state[at.ENERGIES + at.FIELD] += weight * iron * voltage * voltage * stator


# --- drawn from the supply


@compiled
def line_powers(constants: Floats, states: Floats, found: Floats) -> None:
    """Write active [W] and apparent power [V A] of each state into two rows.

    P = 1.5 Re(u conj i) and S = 1.5 u |i| with peak values; while the contactor is open both are 0.
    With one phase lost S is the voltage between the two lines that are left times their current.
    """
    voltage = constants[at.PHASE_VOLTAGE]
    for number in range(states.shape[0]):
        state, power, phases, current = states[number], 0.0, 3.0, 0.0
        if state[at.ENERGISED] > 0.0 and state[at.ARMATURE_OPEN] == 0.0:
            if state[at.PHASE_LOST] > 0.0:
                phases = math.sqrt(3.0)
                current, _, _, power = lost_phase_circuit(constants, state, state[at.SPEED])
            else:
                line = line_current(constants, state)
                current, power = abs(line) / math.sqrt(2.0), 1.5 * voltage * line.real
        found[0, number] = power
        found[1, number] = phases / math.sqrt(2.0) * voltage * current
