"""Motors of point machines: their record, and a class for each kind.

A class of `MOTOR_KINDS` is all there is to a kind: which values it has, which circuit of
`turnout.machine.compute.motor` it is to the kernels and with which numbers, its steady points, its
words, and what of a machine means nothing to it.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from turnout.core.quantity import (
    Current,
    FieldConstant,
    Frequency,
    Inductance,
    Inertia,
    JudgedRecord,
    MotorConstant,
    NameIn,
    Record,
    Resistance,
    RotationalDrag,
    Temperature,
    Time,
    Torque,
    Voltage,
)
from turnout.core.units import SI
from turnout.machine.compute import places as at
from turnout.machine.compute.induction import (
    gamma_energy,
    gamma_impedance,
    line_powers,
    main_excess,
)
from turnout.machine.compute.motor import CONSTANT_FIELD, SERIES_FIELD, THREE_PHASE

Floats = NDArray[np.float64]

COPPER_REFERENCE = 293.15
"""Temperature at which resistances are given [K]."""
COPPER_COEFFICIENT = 3.9e-3
"""Of the resistance of copper, from its value at 20 degC [1/K]."""
TRANSIENT_STEP = 2e-4
"""Longest step in which the fluxes of an induction motor are followed: a hundredth of 50 Hz [s]."""


def _whole(value: object) -> object:
    """Return a whole number that was given in Python as one: overrides mark all numbers as SI."""
    return int(value) if isinstance(value, SI) and float(value).is_integer() else value


MOTOR_KINDS: dict[str, "MotorKind"] = {}
"""Kinds of motors by their name, see the end of this file."""


def with_article(kind: str) -> str:
    """Return the name of a kind with its article."""
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


class Motor(JudgedRecord):
    """DC motor with brushes, or three-phase induction motor (Gamma model, values of a phase)."""

    kind: Annotated[str, NameIn(MOTOR_KINDS)] = Field(
        "permanent magnet",
        description="'split field' is a series motor with one field winding for each direction",
    )
    voltage: Voltage = Field(
        gt=0, description="rated, at the supply; of an induction motor line to line, rms [V]"
    )
    resistance: Resistance = Field(
        gt=0,
        description="of the copper that carries the armature current, of an induction motor of a "
        "stator phase (star), at 20 degC [ohm]",
    )
    temperature: Temperature = Field(
        COPPER_REFERENCE, gt=150, lt=500, description="of the copper [K]"
    )
    inductance: Inductance | None = Field(
        None, gt=0, description="of the motor circuit, with brushes [H]"
    )
    constant: MotorConstant | None = Field(
        None, gt=0, le=1e4, description="torque per ampere, of a permanent magnet [V s/rad]"
    )
    field_constant: FieldConstant | None = Field(
        None, gt=0, description="motor constant per ampere of field, unsaturated [V s/(rad A)]"
    )
    saturation_current: Current | None = Field(
        None, gt=0, description="field current that halves the motor constant per ampere [A]"
    )
    field_resistance: Resistance | None = Field(
        None, gt=0, description="of a separate field winding, at 20 degC [ohm]"
    )
    frequency: Frequency | None = Field(
        None, gt=0, le=1000, description="of the supply of an induction motor [Hz]"
    )
    pole_pairs: Annotated[int | None, BeforeValidator(_whole)] = Field(
        None, ge=1, le=50, description="of an induction motor [-]"
    )
    rotor_resistance: Resistance | None = Field(
        None, gt=0, description="R_r of the Gamma model at 20 degC [ohm]"
    )
    stator_inductance: Inductance | None = Field(
        None,
        gt=0,
        description="L_s of the Gamma model: magnetising, of a phase, at the rated flux [H]",
    )
    main_saturation: float | None = Field(
        None,
        ge=1,
        lt=9,
        description="d ln i/d ln psi of the magnetising branch at the rated flux; default 1, none "
        "[-]",
    )
    leakage_inductance: Inductance | None = Field(
        None, gt=0, description="L_l of the Gamma model: all leakage, on the rotor's side [H]"
    )
    iron_resistance: Resistance | None = Field(
        None, gt=0, description="across the terminals of a phase; default no iron loss [ohm]"
    )
    transient: bool = Field(
        True,
        description="fluxes of an induction motor as states; false: steady circuit at every "
        "instant, as quick mode takes it",
    )
    brush_drop: Voltage = Field(0.0, ge=0, description="both brushes [V]")
    contact_loss: float = Field(
        0.0, ge=0, le=1, description="share of each turn in which a brush has poor contact [-]"
    )
    contact_resistance: Resistance = Field(
        0.0, ge=0, description="that poor contact of a brush adds [ohm]"
    )
    loss_torque: Torque = Field(0.0, ge=0, description="dry friction up to the clutch [N m]")
    brake_torque: Torque = Field(0.0, ge=0, description="dry, when de-energised [N m]")
    drag: RotationalDrag = Field(0.0, ge=0, description="before the clutch [N m s/rad]")
    inertia: Inertia = Field(gt=0, description="of all before the clutch [kg m^2]")

    @property
    def of_kind(self) -> "MotorKind":
        """Record of its kind."""
        return MOTOR_KINDS[self.kind]

    def faults(self) -> Iterator[str]:
        """Yield the faults between the values."""
        kind, named = self.of_kind, with_article(self.kind)
        missing = [name for name in kind.needs if getattr(self, name) is None]
        if missing:
            yield f"{named} motor needs {' and '.join(missing)}"
        own = {name for each in MOTOR_KINDS.values() for name in (*each.needs, *each.may_have)}
        spare = own - {*kind.needs, *kind.may_have}
        given = sorted(name for name in spare if getattr(self, name) is not None)
        if given:
            yield f"{named} motor has no {' or '.join(given)}"


class Supply(Record):
    """Supply of the machine, actual and not rated."""

    voltage: Voltage | None = Field(
        None, gt=0, description="at its terminals; default the motor's rated one [V]"
    )
    line_resistance: Resistance = Field(
        0.0,
        ge=0,
        description="of the line there and back; of an induction motor of each phase [ohm]",
    )
    shared_resistance: Resistance = Field(
        0.0,
        ge=0,
        description="of what several machines share, of induction motors of each phase [ohm]",
    )
    phase_lost_at: Time | None = Field(
        None,
        ge=0,
        description="one of the three conductors of an induction motor opens; default never [s]",
    )


def copper_factor(motor: Motor) -> float:
    """Return the resistance of the motor's windings over that at 20 degC."""
    return 1.0 + COPPER_COEFFICIENT * (motor.temperature - COPPER_REFERENCE)


def nominal_voltage(motor: Motor, supply: Supply) -> float:
    """Return the voltage of the supply as it is [V]."""
    return supply.voltage or motor.voltage


def line_resistance(supply: Supply) -> float:
    """Return the resistance between the source and the motor, of a phase if it has three [ohm]."""
    return supply.line_resistance + supply.shared_resistance


def motor_row(motor: Motor, supply: Supply) -> Floats:
    """Return the constants of the kernels that motor and supply have; the others are 0."""
    row = np.zeros(at.CONSTANTS)
    entries = {
        at.VOLTAGE: nominal_voltage(motor, supply),
        at.RESISTANCE: motor.resistance * copper_factor(motor),
        at.LINE_RESISTANCE: line_resistance(supply),
        at.INDUCTANCE: motor.inductance or 0.0,
        at.BRUSH_DROP: motor.brush_drop,
        at.CONTACT_LOSS: motor.contact_loss,
        at.CONTACT_RESISTANCE: motor.contact_resistance,
        at.LOSS_TORQUE: motor.loss_torque,
        at.BRAKE_TORQUE: motor.brake_torque,
        at.MOTOR_DRAG: motor.drag,
        at.MOTOR_INERTIA: motor.inertia,
        at.LONGEST_STEP: math.inf,
        at.PHASE_LOST_TIME: math.inf if supply.phase_lost_at is None else supply.phase_lost_at,
    }
    for place, value in (entries | motor.of_kind.places(motor, supply)).items():
        row[place] = value
    return row


@dataclass(frozen=True, slots=True)
class SteadyPoint:
    """Current [A], speed of the shaft [rad/s] and active power drawn [W].

    The current is that of the motor; of an induction motor that of the line, rms. `stalled`: the
    torque is beyond what the motor can give, so it stands.
    """

    current: float
    speed: float
    power: float
    stalled: bool = False


class MotorKind:
    """A kind of motor; one of brushes and a constant field unless it says otherwise.

    Attributes
    ----------
    needs, may_have : tuple of str
        Values of `Motor` that kinds differ by: those that it has in any case, and may have.
    alternating : bool
        Whether its supply has three phases, of which one may be lost; currents are then rms values
        of a line.
    without_effect : tuple of str
        Keys of a machine that mean nothing to it and are refused.
    no_effect_since : str
        Why.
    ignored : tuple of str
        Keys that mean nothing to it and may be given, since machines that it is based on have them.
    stall : str
        Name of the largest torque.
    energy_names : mapping of str to str
        Energies of a throw that have another name of this kind.
    """

    needs: tuple[str, ...] = ()
    may_have: tuple[str, ...] = ()
    alternating = False
    without_effect: tuple[str, ...] = ("supply.phase_lost_at",)
    no_effect_since = "which has no phases"
    ignored: tuple[str, ...] = ()
    stall = "standstill"
    energy_names: Mapping[str, str] = {}

    @property
    def meaningless(self) -> tuple[str, ...]:
        """Keys of a machine that mean nothing to it."""
        return (*self.without_effect, *self.ignored)

    def source(self, motor: Motor, supply: Supply) -> str:
        """Return the supply that it needs; machines that share one must need the same."""
        del motor, supply
        return "direct current"

    def places(self, motor: Motor, supply: Supply) -> dict[int, float]:
        """Return constants of the kernels that are of this kind, by their place."""
        raise NotImplementedError

    def branch(self, constants: Floats) -> tuple[float, float, float]:
        """Return standstill, largest torque and no torque as `point` counts them: by the current.

        Parameters
        ----------
        constants : ndarray, shape (CONSTANTS,)
            From `motor_row`, here and below.
        """
        voltage = constants[at.VOLTAGE] - constants[at.BRUSH_DROP]
        most = float(voltage / (constants[at.RESISTANCE] + constants[at.LINE_RESISTANCE]))
        return most, most, 1e-9 * most

    def point(self, constants: Floats, current: float) -> tuple[float, SteadyPoint]:
        """Return torque [N m] and steady point at a place of the `branch`, here a current [A]."""
        constant = constants[at.MOTOR_CONSTANT]
        if constants[at.MOTOR_CIRCUIT] == SERIES_FIELD:
            constant *= current / (1.0 + current * constants[at.INVERSE_SATURATION])
        left = constants[at.VOLTAGE] - constants[at.BRUSH_DROP]
        left -= (constants[at.RESISTANCE] + constants[at.LINE_RESISTANCE]) * current
        power = float(constants[at.VOLTAGE] * current + constants[at.FIELD_POWER])
        speed = max(float(left / constant), 0.0)
        return float(constant * current), SteadyPoint(current, speed, power)

    def stall_torque(self, constants: Floats) -> float:
        """Return the torque below which it stands, without its own friction [N m]."""
        return self.point(constants, self.branch(constants)[1])[0]

    def steady_point(self, constants: Floats, *, torque: float, viscous: float) -> SteadyPoint:
        """Return the steady point under a torque behind its dry loss and a viscous drag.

        Parameters
        ----------
        constants : ndarray, shape (CONSTANTS,)
        torque : float
            Beyond both [N m].
        viscous : float
            Drag of motor and gear [N m s/rad].
        """
        from scipy.optimize import brentq  # slow to load; sweeps of markers need none

        standstill, most, none = self.branch(constants)

        def short(place: float) -> float:
            found, there = self.point(constants, place)
            return float(found - constants[at.LOSS_TORQUE] - viscous * there.speed - torque)

        if short(most) < 0.0:
            return replace(self.point(constants, standstill)[1], stalled=True)
        return self.point(constants, float(brentq(short, most, none, xtol=1e-15)))[1]

    def powers(self, constants: Floats, states: Floats) -> tuple[Floats, Floats]:
        """Return active [W] and apparent power [V A] that a machine draws, shape (n,).

        They are alike, but where the motor feeds back: there the active power is less.
        """
        field = states[:, at.ENERGISED] * constants[at.FIELD_POWER]
        power = states[:, at.SUPPLIED] * states[:, at.CURRENT] + field
        return power, np.abs(power)

    def field_energies(self, constants: Floats, states: Floats) -> Floats:
        """Return the energy in the field beside that of the coil, shape (n,) [J]."""
        del constants
        return np.zeros(states.shape[0])


class PermanentMagnet(MotorKind):
    """Torque k i."""

    needs = ("inductance", "constant")

    def places(self, motor: Motor, supply: Supply) -> dict[int, float]:
        """Return k [V s/rad]."""
        del supply
        return {at.MOTOR_CIRCUIT: CONSTANT_FIELD, at.MOTOR_CONSTANT: motor.constant or 0.0}


class SeparateField(MotorKind):
    """Torque k i with k by the current of a field winding of its own."""

    needs = ("inductance", "field_constant", "field_resistance")

    def places(self, motor: Motor, supply: Supply) -> dict[int, float]:
        """Return k = K i_f/(1 + i_f/i_s) [V s/rad] and the power of the field [W]."""
        voltage = nominal_voltage(motor, supply)
        field = voltage / ((motor.field_resistance or math.inf) * copper_factor(motor))
        saturation = field / motor.saturation_current if motor.saturation_current else 0.0
        return {
            at.MOTOR_CIRCUIT: CONSTANT_FIELD,
            at.MOTOR_CONSTANT: (motor.field_constant or 0.0) * field / (1.0 + saturation),
            at.FIELD_POWER: voltage * field,
        }


class Series(MotorKind):
    """Torque K i^2/(1 + i/i_s): the armature's current is that of the field."""

    needs = ("inductance", "field_constant")

    def places(self, motor: Motor, supply: Supply) -> dict[int, float]:
        """Return K [V s/(rad A)] and 1/i_s [1/A]."""
        del supply
        return {
            at.MOTOR_CIRCUIT: SERIES_FIELD,
            at.MOTOR_CONSTANT: motor.field_constant or 0.0,
            at.INVERSE_SATURATION: 1.0 / (motor.saturation_current or math.inf),
        }


class Induction(MotorKind):
    """Three phases, Gamma model; the steady circuit of `turnout.machine.compute.induction`."""

    needs = (
        *("frequency", "pole_pairs", "rotor_resistance", "stator_inductance"),
        "leakage_inductance",
    )
    may_have = ("iron_resistance", "main_saturation")
    alternating = True
    without_effect = (
        *("motor.brush_drop", "motor.contact_loss", "motor.contact_resistance"),
        *("circuit.snub_resistance", "circuit.measured_current"),
    )
    no_effect_since = (
        "which has no brushes, whose windings are open after the cut-off and whose line is the "
        "supply"
    )
    ignored = ("circuit.after_cutoff",)
    stall = "breakdown"
    energy_names: Mapping[str, str] = {"energy_field": "energy_iron", "energy_snub": "energy_arc"}

    def source(self, motor: Motor, supply: Supply) -> str:
        """Return voltage and frequency of the three phases."""
        return f"three phases of {nominal_voltage(motor, supply):g} V, {motor.frequency:g} Hz"

    def places(self, motor: Motor, supply: Supply) -> dict[int, float]:
        """Return constants of the kernels that this kind has, by their place."""
        iron = motor.iron_resistance
        return {
            at.MOTOR_CIRCUIT: THREE_PHASE,
            at.OPEN_AFTER: 1.0,
            at.STEADY_CIRCUIT: float(not motor.transient),
            at.PHASE_VOLTAGE: math.sqrt(2.0 / 3.0) * nominal_voltage(motor, supply),
            at.SUPPLY_SPEED: 2.0 * math.pi * (motor.frequency or 0.0),
            at.POLE_PAIRS: float(motor.pole_pairs or 1),
            at.ROTOR_RESISTANCE: (motor.rotor_resistance or 0.0) * copper_factor(motor),
            at.STATOR_INDUCTANCE: motor.stator_inductance or 0.0,
            at.MAIN_BEND: ((motor.main_saturation or 1.0) - 1.0) / 8.0,
            at.RATED_FLUX: rated_flux(motor),
            at.LEAKAGE_INDUCTANCE: motor.leakage_inductance or 0.0,
            at.IRON_CONDUCTANCE: 1.0 / iron if iron else 0.0,
            at.LONGEST_STEP: TRANSIENT_STEP if motor.transient else math.inf,
        }

    def branch(self, constants: Floats) -> tuple[float, float, float]:
        """Return standstill, breakdown and synchronism, by the speed of the shaft [rad/s]."""
        synchronous = float(constants[at.SUPPLY_SPEED] / constants[at.POLE_PAIRS])
        return 0.0, (1.0 - min(breakdown_slip(constants), 1.0)) * synchronous, synchronous

    def point(self, constants: Floats, speed: float) -> tuple[float, SteadyPoint]:
        """Return torque [N m] and steady point at a speed of the shaft [rad/s]."""
        return gamma_point(constants, speed)

    def powers(self, constants: Floats, states: Floats) -> tuple[Floats, Floats]:
        """Return active [W] and apparent power [V A] of the lines, shape (n,)."""
        found = np.empty((2, len(states)))
        line_powers(constants, np.ascontiguousarray(states), found)
        return found[0], found[1]

    def field_energies(self, constants: Floats, states: Floats) -> Floats:
        """Return the energy in the field of an induction motor, shape (n,) [J]."""
        if constants[at.STEADY_CIRCUIT] > 0.0:
            return np.zeros(states.shape[0])
        fluxes = (at.STATOR_FLUX, at.STATOR_FLUX_ACROSS, at.ROTOR_FLUX, at.ROTOR_FLUX_ACROSS)
        return np.asarray(gamma_energy(constants, *(states[:, place] for place in fluxes)))


MOTOR_KINDS |= {
    "permanent magnet": PermanentMagnet(),
    "separate field": SeparateField(),
    "series": Series(),
    "split field": Series(),
    "induction": Induction(),
}


# --- the steady circuit of an induction motor


def rated_flux(motor: Motor) -> float:
    """Return the flux at which an induction motor's stator voltage is the rated one, peak [V s]."""
    return math.sqrt(2.0 / 3.0) * motor.voltage / (2.0 * math.pi * (motor.frequency or math.inf))


def breakdown_slip(constants: Floats) -> float:
    r"""Return the slip of an induction motor at its largest torque [-].

    Notes
    -----
    By the source that the rotor's R_r/s sees, with line and iron loss in R_s:

    .. math:: s_b = R_r/|Z|,\quad Z = jX_l + \frac{jX_sR_s}{R_s+jX_s}
    """
    speed, line = constants[at.SUPPLY_SPEED], constants[at.LINE_RESISTANCE]
    r_s = constants[at.RESISTANCE] + line / (1.0 + line * constants[at.IRON_CONDUCTANCE])
    main = 1j * speed * constants[at.STATOR_INDUCTANCE]
    z = 1j * speed * constants[at.LEAKAGE_INDUCTANCE] + r_s * main / (r_s + main)
    return float(constants[at.ROTOR_RESISTANCE] / abs(z))


def gamma_point(constants: Floats, speed: float) -> tuple[float, SteadyPoint]:
    """Return torque [N m] and steady point of an induction motor at a speed of its shaft [rad/s].

    Parameters
    ----------
    constants : ndarray, shape (CONSTANTS,)
        From `motor_row`.
    speed : float

    Notes
    -----
    The Gamma circuit in phasors (rms) with the iron loss across its terminals and the line before
    them. With psi_s = I_s/lambda, T = 3 n_p Im(I_s conj psi_s) = 3 n_p |psi_s|^2 Im lambda. Where
    the main branch saturates its flux is that which it leaves.
    """
    voltage = float(constants[at.VOLTAGE]) / math.sqrt(3.0)
    frame, pairs = constants[at.SUPPLY_SPEED], constants[at.POLE_PAIRS]

    def at_flux(size: float) -> tuple[complex, complex, float]:
        """Return current, the stator's current per flux, and flux, by a peak of it."""
        excess = main_excess(constants, size)
        per_flux, stator, _ = gamma_impedance(
            frame,
            frame - pairs * speed,
            (constants[at.RESISTANCE], constants[at.ROTOR_RESISTANCE]),
            (constants[at.STATOR_INDUCTANCE] / (1.0 + excess), constants[at.LEAKAGE_INDUCTANCE]),
        )
        line, iron = constants[at.LINE_RESISTANCE], constants[at.IRON_CONDUCTANCE]
        current = voltage / (line + stator / (1.0 + stator * iron))
        return current, per_flux, abs((voltage - line * current) / stator / per_flux)

    size = 0.0
    if constants[at.MAIN_BEND] > 0.0:
        from scipy.optimize import brentq  # slow to load; sweeps of markers need none

        most = 2.0 * constants[at.PHASE_VOLTAGE] / frame
        size = brentq(
            lambda size: math.sqrt(2.0) * at_flux(size)[2] - size, 0.0, most, xtol=1e-15, rtol=1e-14
        )
    current, per_flux, flux = at_flux(size)
    torque = float(3.0 * pairs * flux**2 * per_flux.imag)
    return torque, SteadyPoint(float(abs(current)), speed, float(3.0 * voltage * current.real))


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
