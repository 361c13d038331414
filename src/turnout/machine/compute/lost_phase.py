"""An induction motor of which one conductor of the supply is open: steady circuit, mean torque.

The current of the two others flows through two windings in series. By symmetrical components
(C. L. Fortescue, AIEE Transactions 37, 1918) it is a forward and a backward system of equal
currents, whose impedances Z_1 at the slip s and Z_2 at 2 - s are in series between two lines:

    I = V/|Z_1 + Z_2|,    |I_1| = |I_2| = I/sqrt(3),    T = T_1 + T_2,  T_2 against the rotation

At rest both torques cancel: the motor does not start. What the model leaves out is the pulsation of
the torque at twice the supply's frequency and the decay of the fluxes.
"""

import math

from turnout.kernels.compiled import compiled, compiled_part
from turnout.law.table import Floats
from turnout.machine.compute import places as at
from turnout.machine.compute.gamma import gamma_circuit
from turnout.machine.compute.induction import drop_fluxes


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
