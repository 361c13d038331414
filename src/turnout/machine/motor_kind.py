"""Motors of point machines: their record, and a class for each kind.

A class of `MOTOR_KINDS` is all there is to a kind: which values it has, which circuit of
`turnout.machine.compute.motor` it is to the kernels and with which numbers, its steady points, its
words, and what of a machine means nothing to it.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

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
from turnout.machine.compute.induction import gamma_energy, gamma_impedance, main_excess
from turnout.machine.compute.motor import CONSTANT_FIELD, SERIES_FIELD, THREE_PHASE

Floats = NDArray[np.float64]

COPPER_REFERENCE = 293.15
"""Temperature at which resistances are given [K]."""
COPPER_COEFFICIENT = 3.9e-3
"""Of the resistance of copper, from its value at 20 degC [1/K]."""
TRANSIENT_STEP = 2e-4
"""Longest step in which the fluxes of an induction motor are followed: a hundredth of 50 Hz [s]."""
BRUSHES = ("motor.brush_drop", "motor.contact_loss", "motor.contact_resistance")
"""Keys of a machine that are of brushes."""


def _whole(value: object) -> object:
    """Return a whole number that was given in Python as one: overrides mark all numbers as SI."""
    return int(value) if isinstance(value, SI) and float(value).is_integer() else value


IN_SI = {"si": True}
"""Context of records that are made of numbers in SI."""
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
        if not kind.brushes and (self.brush_drop or self.contact_loss or self.contact_resistance):
            yield (
                f"{named} motor has no brushes: leave out brush_drop, contact_loss and "
                "contact_resistance"
            )
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


@dataclass(frozen=True, slots=True)
class SteadyPoint:
    """Current [A], speed of the shaft [rad/s], active [W] and apparent power [V A] drawn.

    The current is that of the motor; of an induction motor that of the line, rms. `stalled`: the
    torque is beyond what the motor can give, so it stands.
    """

    current: float
    speed: float
    power: float
    apparent: float
    stalled: bool = False


class MotorKind:
    """A kind of motor; one of brushes and a constant field unless it says otherwise.

    Attributes
    ----------
    needs, may_have : tuple of str
        Values of `Motor` that kinds differ by: those that it has in any case, and may have.
    brushes : bool
        Whether it has brushes.
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
    brushes = True
    alternating = False
    without_effect: tuple[str, ...] = ()
    no_effect_since = ""
    ignored: tuple[str, ...] = ()
    stall = "standstill"
    energy_names: Mapping[str, str] = {}

    @property
    def meaningless(self) -> tuple[str, ...]:
        """Keys of a machine that mean nothing to it."""
        brushes = () if self.brushes else BRUSHES
        return (*brushes, *self.without_effect, *self.ignored)

    def source(self, motor: Motor, supply: Supply) -> str:
        """Return the supply that it needs; machines that share one must need the same."""
        del motor, supply
        return "direct current"

    def constant(self, motor: Motor, voltage: float, factor: float) -> float:
        """Return the number of the kernels for the strength of the field, k [V s/rad].

        Parameters
        ----------
        motor : Motor
        voltage : float
            At its terminals [V].
        factor : float
            Resistance of the windings over that at 20 degC.
        """
        raise NotImplementedError

    def constant_at(self, motor: Motor, current: float, constant: float) -> float:
        """Return torque per ampere at a current [N m/A], from the number of the kernels."""
        del motor, current
        return constant

    def field_current(self, motor: Motor, voltage: float, factor: float) -> float:
        """Return the current of a field winding that is fed apart [A]."""
        del motor, voltage, factor
        return 0.0

    def places(self, motor: Motor, supply: Supply) -> dict[int, float]:
        """Return constants of the kernels that this kind has, by their place."""
        voltage, factor = nominal_voltage(motor, supply), copper_factor(motor)
        return {
            at.MOTOR_CIRCUIT: CONSTANT_FIELD,
            at.MOTOR_CONSTANT: self.constant(motor, voltage, factor),
            at.FIELD_POWER: voltage * self.field_current(motor, voltage, factor),
        }

    def stall_torque(
        self, motor: Motor, voltage: float, line: float = 0.0, *, cold: bool = False
    ) -> float:
        """Return the torque below which it stands, without its own friction [N m].

        Parameters
        ----------
        motor : Motor
        voltage, line : float
            Of the supply [V], and of the line to it [ohm].
        cold : bool
            Whether the copper is at 20 degC instead of its temperature.
        """
        factor = 1.0 if cold else copper_factor(motor)
        current = (voltage - motor.brush_drop) / (motor.resistance * factor + line)
        return self.constant_at(motor, current, self.constant(motor, voltage, factor)) * current

    def steady_point(
        self, motor: Motor, supply: Supply, *, torque: float, viscous: float
    ) -> SteadyPoint:
        """Return the steady point under a torque behind its dry loss and a viscous drag.

        Parameters
        ----------
        motor : Motor
        supply : Supply
        torque : float
            Beyond both [N m].
        viscous : float
            Drag of motor and gear [N m s/rad].
        """
        from scipy.optimize import brentq  # slow to load; sweeps of markers need none

        voltage, factor = nominal_voltage(motor, supply), copper_factor(motor)
        resistance = motor.resistance * factor + line_resistance(supply)
        constant = self.constant(motor, voltage, factor)

        def speed_at(current: float) -> float:
            left = voltage - resistance * current
            return (left - motor.brush_drop) / self.constant_at(motor, current, constant)

        def short(current: float) -> float:
            need = motor.loss_torque + viscous * speed_at(current) + torque
            return self.constant_at(motor, current, constant) * current - need

        most = (voltage - motor.brush_drop) / resistance
        stalled = short(most) < 0.0
        current = most if stalled else float(brentq(short, 1e-9 * most, most, xtol=1e-15))
        power = voltage * (current + self.field_current(motor, voltage, factor))
        return SteadyPoint(current, max(speed_at(current), 0.0), power, power, stalled)

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

    def constant(self, motor: Motor, voltage: float, factor: float) -> float:
        """Return k [V s/rad]."""
        del voltage, factor
        return motor.constant or 0.0


class SeparateField(MotorKind):
    """Torque k i with k by the current of a field winding of its own."""

    needs = ("inductance", "field_constant", "field_resistance")

    def field_current(self, motor: Motor, voltage: float, factor: float) -> float:
        """Return the current of the field winding [A]."""
        return voltage / ((motor.field_resistance or math.inf) * factor)

    def constant(self, motor: Motor, voltage: float, factor: float) -> float:
        """Return k = K i_f/(1 + i_f/i_s) [V s/rad]."""
        field = self.field_current(motor, voltage, factor)
        saturation = field / motor.saturation_current if motor.saturation_current else 0.0
        return (motor.field_constant or 0.0) * field / (1.0 + saturation)


class Series(MotorKind):
    """Torque K i^2/(1 + i/i_s): the armature's current is that of the field."""

    needs = ("inductance", "field_constant")

    def constant(self, motor: Motor, voltage: float, factor: float) -> float:
        """Return K [V s/(rad A)]."""
        del voltage, factor
        return motor.field_constant or 0.0

    def constant_at(self, motor: Motor, current: float, constant: float) -> float:
        """Return K i/(1 + i/i_s) [N m/A]."""
        return constant * current / (1.0 + current / (motor.saturation_current or math.inf))

    def places(self, motor: Motor, supply: Supply) -> dict[int, float]:
        """Return constants of the kernels that this kind has, by their place."""
        return super().places(motor, supply) | {
            at.MOTOR_CIRCUIT: SERIES_FIELD,
            at.INVERSE_SATURATION: 1.0 / (motor.saturation_current or math.inf),
        }


class Induction(MotorKind):
    """Three phases, Gamma model; the steady circuit of `turnout.machine.compute.induction`."""

    needs = (
        *("frequency", "pole_pairs", "rotor_resistance", "stator_inductance"),
        "leakage_inductance",
    )
    may_have = ("iron_resistance", "main_saturation")
    brushes = False
    alternating = True
    without_effect = ("circuit.snub_resistance", "circuit.measured_current")
    no_effect_since = "whose windings are open after the cut-off and whose line is the supply"
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

    def stall_torque(
        self, motor: Motor, voltage: float, line: float = 0.0, *, cold: bool = False
    ) -> float:
        """Return the breakdown torque [N m], at the temperature of the copper in any case."""
        del cold
        return breakdown_point(motor, voltage=voltage, line=line)[1]

    def steady_point(
        self, motor: Motor, supply: Supply, *, torque: float, viscous: float
    ) -> SteadyPoint:
        """Return the point on the branch above the breakdown speed, or that of standstill."""
        from scipy.optimize import brentq  # slow to load; sweeps of markers need none

        voltage, line = nominal_voltage(motor, supply), line_resistance(supply)
        slip, _ = breakdown_point(motor, voltage=voltage, line=line)
        synchronous = 2.0 * math.pi * (motor.frequency or 0.0) / (motor.pole_pairs or 1)

        def short(speed: float) -> float:
            found = gamma_point(motor, supply, speed)[0]
            return found - motor.loss_torque - viscous * speed - torque

        least = (1.0 - min(slip, 1.0)) * synchronous
        if short(least) < 0.0:
            return replace(gamma_point(motor, supply, 0.0)[1], stalled=True)
        speed = float(brentq(short, least, synchronous, xtol=1e-13))
        return gamma_point(motor, supply, speed)[1]

    def powers(self, constants: Floats, states: Floats) -> tuple[Floats, Floats]:
        """Return active [W] and apparent power [V A] of the lines, shape (n,)."""
        return line_power(constants, states)[:2]

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


def breakdown_point(
    motor: Motor, *, voltage: float | None = None, line: float = 0.0
) -> tuple[float, float]:
    r"""Return breakdown slip [-] and torque [N m] of an induction motor.

    Parameters
    ----------
    motor : Motor
    voltage : float, optional
        Line to line, rms; default the rated one [V].
    line : float
        Resistance of each phase of the line [ohm].

    Notes
    -----
    By the source that the rotor's R_r/s sees, with line and iron loss in R_s:

    .. math:: s_b = R_r/|Z|,\quad Z = jX_l + \frac{jX_sR_s}{R_s+jX_s}
    """
    speed, factor = 2.0 * math.pi * (motor.frequency or 0.0), copper_factor(motor)
    iron = 1.0 / motor.iron_resistance if motor.iron_resistance else 0.0
    r_s = motor.resistance * factor + line / (1.0 + line * iron)
    main = 1j * speed * (motor.stator_inductance or 0.0)
    z = 1j * speed * (motor.leakage_inductance or 0.0) + r_s * main / (r_s + main)
    slip = (motor.rotor_resistance or 0.0) * factor / abs(z)
    supply = Supply.model_validate({"voltage": voltage, "line_resistance": line}, context=IN_SI)
    at_slip = (1.0 - slip) * speed / (motor.pole_pairs or 1)
    return slip, gamma_point(motor, supply, at_slip)[0]


def gamma_point(motor: Motor, supply: Supply, speed: float) -> tuple[float, SteadyPoint]:
    """Return torque [N m] and steady point of an induction motor at a speed of its shaft [rad/s].

    Notes
    -----
    The Gamma circuit in phasors (rms) with the iron loss across its terminals and the line before
    them. With psi_s = I_s/lambda, T = 3 n_p Im(I_s conj psi_s) = 3 n_p |psi_s|^2 Im lambda. Where
    the main branch saturates its flux is that which it leaves.
    """
    excess = 0.0
    if (motor.main_saturation or 1.0) > 1.0:
        from scipy.optimize import brentq  # slow to load; sweeps of markers need none

        numbers = Induction().places(motor, supply)
        constants = np.zeros(at.CONSTANTS)
        constants[[at.MAIN_BEND, at.RATED_FLUX]] = [numbers[at.MAIN_BEND], numbers[at.RATED_FLUX]]

        def left(size: float) -> float:
            found = _gamma_point(motor, supply, speed, float(main_excess(constants, size)))
            return found[2] - size

        most = 2.0 * numbers[at.PHASE_VOLTAGE] / numbers[at.SUPPLY_SPEED]
        excess = float(main_excess(constants, brentq(left, 0.0, most, xtol=1e-15, rtol=1e-14)))
    torque, point, _ = _gamma_point(motor, supply, speed, excess)
    return torque, point


def _gamma_point(
    motor: Motor, supply: Supply, speed: float, excess: float
) -> tuple[float, SteadyPoint, float]:
    """Return torque, point and stator flux (peak) with the main branch's current per flux given."""
    line = line_resistance(supply)
    frame = 2.0 * math.pi * (motor.frequency or 0.0)
    pairs, factor = motor.pole_pairs or 1, copper_factor(motor)
    per_flux, stator, _ = gamma_impedance(
        frame,
        frame - pairs * speed,
        (motor.resistance * factor, (motor.rotor_resistance or 0.0) * factor),
        ((motor.stator_inductance or 0.0) / (1.0 + excess), motor.leakage_inductance or 0.0),
    )
    iron = 1.0 / motor.iron_resistance if motor.iron_resistance else 0.0
    whole = line + stator / (1.0 + stator * iron)
    voltage = nominal_voltage(motor, supply) / math.sqrt(3.0)
    current = voltage / whole
    through = (voltage - line * current) / stator
    flux = abs(through / per_flux)
    torque = 3.0 * pairs * flux**2 * per_flux.imag
    power = 3.0 * voltage * current.real
    point = SteadyPoint(abs(current), speed, power, 3.0 * voltage * abs(current))
    return torque, point, math.sqrt(2.0) * flux


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
    main = 1.0 + states[:, at.MAIN_EXCESS]
    i_s = psi_s * main / constants[at.STATOR_INDUCTANCE] + leak
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
    `turnout.machine.compute.induction`.
    """
    supply, iron = constants[at.SUPPLY_SPEED], constants[at.IRON_CONDUCTANCE]
    turned = constants[at.POLE_PAIRS] * states[:, at.DIRECTION] * states[:, at.SPEED]
    resistances = constants[at.RESISTANCE], constants[at.ROTOR_RESISTANCE]
    inductances = constants[at.STATOR_INDUCTANCE], constants[at.LEAKAGE_INDUCTANCE]
    slips: Any = np.array([supply - turned, supply + turned])
    own = np.asarray(gamma_impedance(supply, slips, resistances, inductances)[1])
    whole = 2.0 * constants[at.LINE_RESISTANCE] + (own / (1.0 + own * iron)).sum(axis=0)
    line_to_line = math.sqrt(1.5) * constants[at.PHASE_VOLTAGE]
    current = np.where(_is_on(states), line_to_line / np.abs(whole), 0.0)
    return whole.real * current**2, line_to_line * current, current


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
