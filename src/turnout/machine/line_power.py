"""Power that machines of either kind draw; parameters and field energy of induction motors."""

import math

import numpy as np
from numpy.typing import NDArray

from turnout.machine.compute import places as at
from turnout.machine.compute.gamma import gamma_impedance

Floats = NDArray[np.float64]


def line_power(constants: Floats, states: Floats) -> tuple[Floats, Floats, Floats]:
    """Return active power [W], apparent power [V A] and line current [A, rms] of states.

    Parameters
    ----------
    constants : ndarray, shape (CONSTANTS,)
        Of one machine with an induction motor.
    states : ndarray, shape (n, STATES)

    Notes
    -----
    P = 1.5 Re(u conj i) and S = 1.5 u |i| with peak values; while the contactor is open both are 0.
    With one phase lost S is the voltage between the two lines that are left times their current.
    """
    if np.isfinite(constants[at.PHASE_LOST_TIME]):
        lost = states[:, at.PHASE_LOST] > 0.0
        both = _three_phases(constants, states), _two_phases(constants, states)
        active, apparent, current = (np.where(lost, b, a) for a, b in zip(*both, strict=True))
        return active, apparent, current
    return _three_phases(constants, states)


def _three_phases(constants: Floats, states: Floats) -> tuple[Floats, Floats, Floats]:
    psi_s = states[:, at.STATOR_FLUX] + 1j * states[:, at.STATOR_FLUX_ACROSS]
    psi_r = states[:, at.ROTOR_FLUX] + 1j * states[:, at.ROTOR_FLUX_ACROSS]
    leak = (psi_s - psi_r) / constants[at.LEAKAGE_INDUCTANCE]
    i_s = psi_s / constants[at.STATOR_INDUCTANCE] + leak
    voltage, line = constants[at.PHASE_VOLTAGE], constants[at.LINE_RESISTANCE]
    iron = constants[at.IRON_CONDUCTANCE]
    seen = voltage - states[:, at.SHARED_DROP] - 1j * states[:, at.SHARED_DROP_ACROSS]
    terminal = (seen - line * i_s) / (1.0 + line * iron)
    current = np.where(_is_on(states), i_s + iron * terminal, 0.0)
    size = np.abs(current)
    return 1.5 * voltage * current.real, 1.5 * voltage * size, size / math.sqrt(2.0)


def _is_on(states: Floats) -> NDArray[np.bool_]:
    return np.asarray((states[:, at.ENERGISED] > 0.0) & (states[:, at.ARMATURE_OPEN] == 0.0))


def _two_phases(constants: Floats, states: Floats) -> tuple[Floats, Floats, Floats]:
    """Return active and apparent power and line current of a motor with one conductor open.

    Forward and backward impedance of the steady circuit in series between two lines, see
    `turnout.machine.compute.lost_phase`.
    """
    supply, iron = constants[at.SUPPLY_SPEED], constants[at.IRON_CONDUCTANCE]
    turned = constants[at.POLE_PAIRS] * states[:, at.DIRECTION] * states[:, at.SPEED]
    whole = np.full(turned.shape, 2.0 * constants[at.LINE_RESISTANCE], dtype=np.complex128)
    resistances = constants[at.RESISTANCE], constants[at.ROTOR_RESISTANCE]
    inductances = constants[at.STATOR_INDUCTANCE], constants[at.LEAKAGE_INDUCTANCE]
    for slip_speed in (supply - turned, supply + turned):
        _, own, _ = gamma_impedance(supply, slip_speed, resistances, inductances)
        whole += own / (1.0 + own * iron)
    line_to_line = math.sqrt(1.5) * constants[at.PHASE_VOLTAGE]
    current = np.where(_is_on(states), line_to_line / np.abs(whole), 0.0)
    return whole.real * current**2, line_to_line * current, current


def field_energies(constants: Floats, states: Floats) -> Floats:
    """Return the energy in the field of an induction motor, shape (n,) [J].

    0.75 (|psi_s|^2/L_s + |psi_r - psi_s|^2/L_l); 0 of the steady circuit, which stores nothing.
    """
    if constants[at.STEADY_CIRCUIT] > 0.0:
        return np.zeros(states.shape[0])
    along = states[:, [at.STATOR_FLUX, at.ROTOR_FLUX]]
    across = states[:, [at.STATOR_FLUX_ACROSS, at.ROTOR_FLUX_ACROSS]]
    stator = along[:, 0] ** 2 + across[:, 0] ** 2
    leak = (along[:, 1] - along[:, 0]) ** 2 + (across[:, 1] - across[:, 0]) ** 2
    return np.asarray(
        0.75 * (stator / constants[at.STATOR_INDUCTANCE] + leak / constants[at.LEAKAGE_INDUCTANCE])
    )


def machine_powers(constants: Floats, states: Floats) -> tuple[Floats, Floats]:
    """Return active [W] and apparent power [V A] that a machine of either kind draws, shape (n,).

    Those of a direct current are alike, but where the motor feeds back: there the active is less.
    """
    if constants[at.THREE_PHASE] > 0.0:
        return line_power(constants, states)[:2]
    field = states[:, at.ENERGISED] * constants[at.FIELD_POWER]
    power = states[:, at.SUPPLIED] * states[:, at.CURRENT] + field
    return power, np.abs(power)


def gamma_from_inverse_gamma(
    *, rotor_resistance: float, leakage_inductance: float, magnetising_inductance: float
) -> tuple[float, float, float]:
    """Return R_r, L_s, L_l of the Gamma model from R_R, L_sigma, L_M of the inverse-Gamma model.

    Notes
    -----
    With g = L_M/(L_M + L_sigma): L_s = L_M + L_sigma, L_l = L_sigma/g, R_r = R_R/g^2. The same
    motor; read as the other model's, the numbers are off by 1 to 2 % of the peaks of a start.

    Examples
    --------
    >>> rotor, stator, leakage = gamma_from_inverse_gamma(
    ...     rotor_resistance=2.1, leakage_inductance=0.021, magnetising_inductance=0.224
    ... )
    >>> round(rotor, 6), round(stator, 6), round(leakage, 8)
    (2.512207, 0.245, 0.02296875)
    """
    stator = magnetising_inductance + leakage_inductance
    share = magnetising_inductance / stator
    return rotor_resistance / share**2, stator, leakage_inductance / share
