"""The three-phase induction motor of one implicit stage: fluxes, torque, line current, powers.

Space vectors with peak values as complex numbers, in a frame that turns with the supply (direction
d, w_k = d 2 pi f), where the phase voltage u is real. Gamma model, with the stator's flux psi_s and
the rotor's psi_r [V s]:

    psi_s' = u - R_s i_s - j w_k psi_s               i_s = psi_s/L_s + (psi_s - psi_r)/L_l
    psi_r' = -R_r i_r - j (w_k - n_p w1) psi_r       i_r = (psi_r - psi_s)/L_l
    T = 1.5 n_p Im(i_s conj psi_s)

Iron loss is a resistance across the motor's terminals, behind the line: what both do to the stator
is one source u/(1 + R_line/R_fe) with R_line R_fe/(R_line + R_fe) in series. The steady circuit is
the same with both derivatives zero.
"""

import math

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute.places import (
    COPPER,
    DIRECTION,
    ENERGIES,
    FIELD,
    INTO_STORES,
    IRON_CONDUCTANCE,
    LEAKAGE_INDUCTANCE,
    LINE,
    LINE_RESISTANCE,
    PHASE_VOLTAGE,
    POLE_PAIRS,
    RESISTANCE,
    ROTOR_FLUX,
    ROTOR_FLUX_ACROSS,
    ROTOR_RESISTANCE,
    SNUB,
    STATOR_FLUX,
    STATOR_FLUX_ACROSS,
    STATOR_INDUCTANCE,
    STEADY_CIRCUIT,
    SUPPLY,
    SUPPLY_SPEED,
)


@compiled_part
def stator_flux(row: Floats) -> complex:
    """Return psi_s of a state, a stage or a base."""
    return complex(row[STATOR_FLUX], row[STATOR_FLUX_ACROSS])


@compiled_part
def rotor_flux(row: Floats) -> complex:
    """Return psi_r of a state, a stage or a base."""
    return complex(row[ROTOR_FLUX], row[ROTOR_FLUX_ACROSS])


@compiled_part
def winding_currents(constants: Floats, psi_s: complex, psi_r: complex) -> tuple[complex, complex]:
    """Return the currents of stator and rotor [A]."""
    i_r = (psi_r - psi_s) / constants[LEAKAGE_INDUCTANCE]
    return psi_s / constants[STATOR_INDUCTANCE] - i_r, i_r


@compiled_part
def series_resistance(constants: Floats) -> float:
    """Return what line and iron together put in series with the stator [ohm]."""
    line = constants[LINE_RESISTANCE]
    return float(line / (1.0 + line * constants[IRON_CONDUCTANCE]))


@compiled_part
def terminals(constants: Floats, i_s: complex) -> tuple[complex, complex]:
    """Return the voltage at the motor's terminals [V] and the current in the line [A]."""
    conductance = constants[IRON_CONDUCTANCE]
    source = constants[PHASE_VOLTAGE] / (1.0 + constants[LINE_RESISTANCE] * conductance)
    voltage = source - series_resistance(constants) * i_s
    return voltage, i_s + conductance * voltage


@compiled
def stage_fluxes(
    constants: Floats, state: Floats, g: float, base: Floats, w1: float
) -> tuple[complex, complex, complex, complex]:
    """Return the fluxes of stator and rotor, and their derivatives over the motor speed.

    Parameters
    ----------
    constants, state : ndarray
        Rows of the machine; of the state only the direction is read.
    g : float
        Length of the stage [s].
    base : ndarray
        What the earlier stages leave of the integrated states.
    w1 : float
        [rad/s].
    """
    rate = 0.0 if constants[STEADY_CIRCUIT] > 0.0 else 1.0 / g
    wk, pairs = state[DIRECTION] * constants[SUPPLY_SPEED], constants[POLE_PAIRS]
    leak = constants[LEAKAGE_INDUCTANCE]
    extra = series_resistance(constants)
    r_s, r_r = constants[RESISTANCE] + extra, constants[ROTOR_RESISTANCE]
    a11 = complex(rate + r_s / constants[STATOR_INDUCTANCE] + r_s / leak, wk)
    a22 = complex(rate + r_r / leak, wk - pairs * w1)
    a12, a21 = -r_s / leak, -r_r / leak
    source = constants[PHASE_VOLTAGE] / (
        1.0 + constants[LINE_RESISTANCE] * constants[IRON_CONDUCTANCE]
    )
    b1, b2 = source + rate * stator_flux(base), rate * rotor_flux(base)
    det = a11 * a22 - a12 * a21
    psi_s, psi_r = (b1 * a22 - a12 * b2) / det, (a11 * b2 - a21 * b1) / det
    turned = complex(0.0, pairs) * psi_r / det
    return psi_s, psi_r, -a12 * turned, a11 * turned


@compiled
def induction_torque(
    constants: Floats, state: Floats, g: float, base: Floats, w1: float
) -> tuple[float, float, float]:
    """Return line current (rms), torque and its slope over the motor speed.

    Takes what `stage_fluxes` takes.
    """
    psi_s, psi_r, slope_s, slope_r = stage_fluxes(constants, state, g, base, w1)
    i_s, _ = winding_currents(constants, psi_s, psi_r)
    slope_i, _ = winding_currents(constants, slope_s, slope_r)
    factor = 1.5 * constants[POLE_PAIRS]
    torque = factor * (i_s * psi_s.conjugate()).imag
    slope = factor * (slope_i * psi_s.conjugate() + i_s * slope_s.conjugate()).imag
    return abs(terminals(constants, i_s)[1]) / math.sqrt(2.0), torque, slope


@compiled_part
def fill_fluxes(
    constants: Floats, state: Floats, g: float, base: Floats, stage: Floats, w1: float
) -> None:
    """Write the fluxes of a stage at its motor speed."""
    psi_s, psi_r, _, _ = stage_fluxes(constants, state, g, base, w1)
    stage[STATOR_FLUX], stage[STATOR_FLUX_ACROSS] = psi_s.real, psi_s.imag
    stage[ROTOR_FLUX], stage[ROTOR_FLUX_ACROSS] = psi_r.real, psi_r.imag


@compiled_part
def add_electrical_energy(constants: Floats, state: Floats, stage: Floats, weight: float) -> None:
    """Add what a stage takes from the supply and loses in line, iron and windings."""
    i_s, i_r = winding_currents(constants, stator_flux(stage), rotor_flux(stage))
    voltage, line = terminals(constants, i_s)
    part = 1.5 * weight
    state[ENERGIES + SUPPLY] += part * constants[PHASE_VOLTAGE] * line.real
    state[ENERGIES + LINE] += part * constants[LINE_RESISTANCE] * abs(line) ** 2
    state[ENERGIES + FIELD] += part * constants[IRON_CONDUCTANCE] * abs(voltage) ** 2
    heat = constants[RESISTANCE] * abs(i_s) ** 2 + constants[ROTOR_RESISTANCE] * abs(i_r) ** 2
    state[ENERGIES + COPPER] += part * heat


@compiled_part
def stored_in_stage(constants: Floats, stage: Floats, before: Floats) -> float:
    """Return what the change of the fluxes within a stage stores [J]."""
    if constants[STEADY_CIRCUIT] > 0.0:
        return 0.0
    psi_s, psi_r = stator_flux(stage), rotor_flux(stage)
    i_s, i_r = winding_currents(constants, psi_s, psi_r)
    into = (i_s.conjugate() * (psi_s - stator_flux(before))).real
    into += (i_r.conjugate() * (psi_r - rotor_flux(before))).real
    return 1.5 * into


@compiled_part
def field_energy(constants: Floats, row: Floats) -> float:
    """Return the energy in the magnetic field, 0 of the steady circuit [J]."""
    if constants[STEADY_CIRCUIT] > 0.0:
        return 0.0
    psi_s, psi_r = stator_flux(row), rotor_flux(row)
    energy = abs(psi_s) ** 2 / constants[STATOR_INDUCTANCE]
    energy += abs(psi_r - psi_s) ** 2 / constants[LEAKAGE_INDUCTANCE]
    return 0.75 * float(energy)


@compiled_part
def drop_fluxes(constants: Floats, state: Floats) -> None:
    """Let arc and windings take what the field holds when the contactor opens."""
    held = field_energy(constants, state)
    state[ENERGIES + SNUB] += held
    state[ENERGIES + INTO_STORES] -= held
    state[STATOR_FLUX], state[STATOR_FLUX_ACROSS] = 0.0, 0.0
    state[ROTOR_FLUX], state[ROTOR_FLUX_ACROSS] = 0.0, 0.0
