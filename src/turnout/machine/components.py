"""A point machine as records: motor, clutch, gear, stroke, rod, circuit, hand crank.

Angles, speeds and torques are those at the motor shaft, so that no gear ratio stands between them;
positions are those of the rod's machine end, positive in the closing direction, and 0 where the
rail is home against the stock rail.
"""

import math
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from turnout.core.quantity import (
    Angle,
    AngularStiffness,
    Current,
    Damping,
    FieldConstant,
    Force,
    Frequency,
    HeatCapacity,
    Inductance,
    Inertia,
    Length,
    Mass,
    MotorConstant,
    PerEnergy,
    PositiveNumberList,
    Resistance,
    RotationalDrag,
    RotationalSpeed,
    ShaftRatio,
    Stiffness,
    Temperature,
    TemperatureCoefficient,
    Time,
    Torque,
    Voltage,
)
from turnout.core.units import SI

COPPER_REFERENCE = 293.15
"""Temperature at which resistances are given [K]."""
COPPER_COEFFICIENT = 3.9e-3
"""Of the resistance of copper, from its value at 20 degC [1/K]."""

MOST_INSTANTS = 1_000_000


class Record(BaseModel):
    """Base of all records here: unknown keys are refused, nothing changes after validation."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        str_strip_whitespace=True,
    )


NEEDED = {
    "permanent magnet": ("inductance", "constant"),
    "separate field": ("inductance", "field_constant", "field_resistance"),
    "series": ("inductance", "field_constant"),
    "split field": ("inductance", "field_constant"),
    "induction": (
        *("frequency", "pole_pairs", "rotor_resistance", "stator_inductance"),
        "leakage_inductance",
    ),
}
"""What a motor of each kind has beside what all have."""
OWN_OF_A_KIND = {*(name for names in NEEDED.values() for name in names), "iron_resistance"}


class Motor(Record):
    """DC motor with brushes, or three-phase induction motor (Gamma model, values of a phase)."""

    kind: Literal["permanent magnet", "separate field", "series", "split field", "induction"] = (
        Field(
            "permanent magnet",
            description="'split field' is a series motor with one field winding for each direction",
        )
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
    pole_pairs: int | None = Field(None, ge=1, le=50, description="of an induction motor [-]")
    rotor_resistance: Resistance | None = Field(
        None, gt=0, description="R_r of the Gamma model at 20 degC [ohm]"
    )
    stator_inductance: Inductance | None = Field(
        None, gt=0, description="L_s of the Gamma model: magnetising, of a phase [H]"
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

    @model_validator(mode="after")
    def _needs(self) -> Self:
        needed = NEEDED[self.kind]
        missing = [name for name in needed if getattr(self, name) is None]
        if missing:
            message = f"a {self.kind} motor needs {' and '.join(missing)}"
            raise ValueError(message)
        spare = OWN_OF_A_KIND - set(needed)
        if self.kind == "induction":
            spare -= {"iron_resistance"}
            if self.brush_drop or self.contact_loss:
                message = "an induction motor has no brushes: leave out brush_drop and contact_loss"
                raise ValueError(message)
        given = sorted(name for name in spare if getattr(self, name) is not None)
        if given:
            message = f"a {self.kind} motor has no {' or '.join(given)}"
            raise ValueError(message)
        return self


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
    By the source that the rotor's R_r/s sees, with line and iron loss in U and R_s:

    .. math:: s_b = R_r/|Z|,\quad Z = jX_l + \frac{jX_sR_s}{R_s+jX_s},\quad
              T_b = \frac{3 n_p U^2}{2\omega (|Z| + \mathrm{Re} Z)}

    with U the rms voltage at the open rotor side of the stator's divider.
    """
    assert motor.frequency is not None  # noqa: S101 - of an induction motor
    assert motor.stator_inductance is not None  # noqa: S101
    assert motor.leakage_inductance is not None  # noqa: S101
    assert motor.rotor_resistance is not None  # noqa: S101
    speed, factor = 2.0 * math.pi * motor.frequency, copper_factor(motor)
    iron = 1.0 / motor.iron_resistance if motor.iron_resistance else 0.0
    share = 1.0 / (1.0 + line * iron)
    main, r_s = 1j * speed * motor.stator_inductance, motor.resistance * factor + line * share
    source = share * (voltage or motor.voltage) / math.sqrt(3.0)
    open_voltage = source * abs(main / (r_s + main))
    z = 1j * speed * motor.leakage_inductance + r_s * main / (r_s + main)
    torque = 3.0 * (motor.pole_pairs or 1) * open_voltage**2 / (2.0 * speed * (abs(z) + z.real))
    return motor.rotor_resistance * factor / abs(z), torque


def copper_factor(motor: Motor) -> float:
    """Return the resistance of the motor's windings over that at 20 degC."""
    return 1.0 + COPPER_COEFFICIENT * (motor.temperature - COPPER_REFERENCE)


class Clutch(Record):
    """Friction clutch: elastic until it slips, and it remembers by how much it slipped."""

    torque: Torque = Field(gt=0, description="while it slips, new and at ambient [N m]")
    stiffness: AngularStiffness = Field(
        gt=0, le=1e7, description="of the clutch before it slips [N m/rad]"
    )
    static_ratio: float = Field(1.0, ge=1, le=3, description="breakaway torque over torque [-]")
    worn: float = Field(0.0, ge=0, le=0.9, description="share of the torque lost so far [-]")
    wear: PerEnergy = Field(0.0, ge=0, description="share of the torque lost per heat [1/J]")
    temperature_coefficient: TemperatureCoefficient = Field(
        0.0, ge=-0.02, le=0.02, description="of the torque, above ambient [1/K]"
    )
    heat_capacity: HeatCapacity | None = Field(
        None, gt=0, description="of the linings; default they stay at ambient [J/K]"
    )
    cooling_time: Time | None = Field(
        None, gt=0, description="time constant of their cooling; default none [s]"
    )


class Gear(Record):
    """All between the clutch and the rod, seen from the shaft."""

    inertia: Inertia = Field(gt=0, description="of all behind the clutch [kg m^2]")
    drag: RotationalDrag = Field(0.0, ge=0, description="behind the clutch [N m s/rad]")
    efficiency: float = Field(gt=0.05, le=1, description="where it drives the load [-]")
    back_efficiency: float | None = Field(
        None,
        ge=0,
        le=1,
        description="where the load drives it back; 0 is self-locking; default as driving [-]",
    )
    dry_ratio: float = Field(
        1.0, gt=0.05, le=1, description="share of both efficiencies left where the gear is dry [-]"
    )
    dry_from: Length | None = Field(None, description="rod position from which it is dry [m]")
    dry_to: Length | None = Field(None, description="rod position up to which it is dry [m]")

    @model_validator(mode="after")
    def _dry(self) -> Self:
        if self.dry_from is None or self.dry_to is None:
            if self.dry_ratio < 1.0 or self.dry_from is not self.dry_to:
                message = "a gear that is dry needs dry_from and dry_to"
                raise ValueError(message)
        elif self.dry_to <= self.dry_from:
            message = "dry_to must be more than dry_from"
            raise ValueError(message)
        return self


class Stroke(Record):
    """How the rod position follows from the shaft angle."""

    kind: Literal["screw", "crank", "table"] = Field(
        "screw", description="a constant ratio, a crank of half a turn, or a table"
    )
    ratio: ShaftRatio | None = Field(None, ge=1, le=1e7, description="of a screw or rack [rad/m]")
    angle: Angle | None = Field(None, gt=0, description="of the whole stroke [rad]")
    length: Length | None = Field(None, gt=0, description="of the whole stroke [m]")
    start: Length = Field(0.0, description="rod position at the open end, angle 0 [m]")
    angle_share: PositiveNumberList | None = Field(
        None, description="of a table: rising to 1; 0 is added in front"
    )
    length_share: tuple[float, ...] | list[float] | None = Field(
        None, description="of a table: share of the stroke at each; 0 is added in front"
    )

    @model_validator(mode="after")
    def _needs(self) -> Self:
        screw, table = self.kind == "screw", self.kind == "table"
        needed = ["ratio"] if screw else ["angle", "length"]
        needed += ["angle_share", "length_share"] if table else []
        missing = [name for name in needed if getattr(self, name) is None]
        if missing:
            message = f"a {self.kind} needs {' and '.join(missing)}"
            raise ValueError(message)
        if table:
            angles, lengths = [0.0, *(self.angle_share or ())], [0.0, *(self.length_share or ())]
            rises = all(a < b for a, b in zip(angles, angles[1:], strict=False))
            follows = all(a <= b for a, b in zip(lengths, lengths[1:], strict=False))
            if len(angles) != len(lengths) or not rises or not follows:
                message = "angle_share must rise, length_share not fall, and both be equally long"
                raise ValueError(message)
            if angles[-1] != 1.0 or lengths[-1] != 1.0:
                message = "angle_share and length_share must end with 1"
                raise ValueError(message)
        return self


class Rod(Record):
    """Rod between machine and rail."""

    stiffness: Stiffness = Field(gt=0, description="along the rod [N/m]")
    play: Length = Field(0.0, ge=0, description="lost motion between machine and rail [m]")


class Circuit(Record):
    """From the command to the cut-off, and what holds the rail after it."""

    contactor_delay: Time = Field(0.0, ge=0, description="from the command [s]")
    limit_closing: Length | None = Field(
        None, description="rod position of the limit contact; default the end of the stroke [m]"
    )
    limit_opening: Length | None = Field(
        None, description="rod position of the limit contact; default the end of the stroke [m]"
    )
    overrun: Length = Field(
        0.0,
        ge=0,
        description="in a panel: the limit contacts stand so far before the rest positions, which "
        "the machine reaches while it is braked; where the limits are not given [m]",
    )
    cutoff_delay: Time = Field(0.0, ge=0, description="after the limit contact [s]")
    lock_gap: Length | None = Field(
        None, ge=0, description="the limit contact acts only with the rail so near; default any [m]"
    )
    time_out: Time | None = Field(None, gt=0, description="after the contactor; default none [s]")
    overload_current: Current | None = Field(None, gt=0, description="of the relay [A]")
    overload_time: Time = Field(0.1, gt=0, description="above it until the relay opens [s]")
    detection_open: Length | None = Field(
        None, description="rod position below which the end contact is made [m]"
    )
    detection_closed: Length | None = Field(
        None, description="rod position above which the end contact is made [m]"
    )
    after_cutoff: Literal["short circuit", "open"] = Field(
        "short circuit", description="what happens to the armature after the cut-off"
    )
    snub_resistance: Resistance = Field(0.0, ge=0, description="in the short circuit [ohm]")
    holding: Literal["lock", "brake", "gear"] = Field(
        "lock",
        description="'lock': the gear from its standstill after cut-off to the next contactor; "
        "'brake': the motor's brake through clutch and gear; 'gear': a self-locking gear",
    )
    measured_current: Literal["motor lead", "supply"] = Field(
        "motor lead", description="where the clamp sits; a motor lead shows the braking current"
    )


class Supply(Record):
    """What feeds the machine, as it is and not as it is rated."""

    voltage: Voltage | None = Field(
        None, gt=0, description="at its terminals; default the motor's rated one [V]"
    )
    line_resistance: Resistance = Field(
        0.0,
        ge=0,
        description="of the line there and back; of an induction motor of each phase [ohm]",
    )
    shared_resistance: Resistance = Field(
        0.0, ge=0, description="of what several machines share [ohm]"
    )


class HandCrank(Record):
    """A hand at the crank in place of the motor current; the armature is open."""

    stiffness: RotationalDrag = Field(gt=0, description="torque per speed lag [N m s/rad]")
    speed: RotationalSpeed = Field(gt=0, description="of the hand, at the shaft [rad/s]")
    ramp: Time = Field(gt=0, description="from rest to that speed [s]")
    release: Literal["cut-off", "never"] = Field(
        "cut-off", description="when the hand lets go: at the limit contact, or not at all"
    )


class Machine(Record):
    """Point machine."""

    description: str = Field("", description="what the machine is, in a few sentences")
    motor: Motor = Field(description="DC motor with brushes, or three-phase induction motor")
    clutch: Clutch = Field(description="between motor and gear")
    gear: Gear = Field(description="all between the clutch and the rod")
    stroke: Stroke = Field(description="how the rod follows the shaft")
    rod: Rod = Field(description="between machine and rail")
    circuit: Circuit = Field(description="what switches the motor and holds the rail")
    supply: Supply = Field(
        default_factory=lambda: Supply.model_validate({}), description="as it is, not as rated"
    )
    hand: HandCrank | None = Field(None, description="a hand crank in place of the motor")

    @property
    def constant_at_rest(self) -> float:
        """Torque per ampere at the rated voltage and stall current [N m/A]."""
        motor = self.motor
        if motor.constant is not None:
            return motor.constant
        stall = (motor.voltage - motor.brush_drop) / motor.resistance
        field = stall
        if motor.kind == "separate field" and motor.field_resistance is not None:
            field = motor.voltage / motor.field_resistance
        saturation = field / motor.saturation_current if motor.saturation_current else 0.0
        return (motor.field_constant or 0.0) * field / (1.0 + saturation)

    @property
    def stall_torque(self) -> float:
        """Torque of the standing motor at its rated voltage, without line [N m].

        Of an induction motor the breakdown torque, below which it stalls.
        """
        motor = self.motor
        if motor.kind == "induction":
            return breakdown_point(motor)[1] - motor.loss_torque
        current = (motor.voltage - motor.brush_drop) / motor.resistance
        return self.constant_at_rest * current - motor.loss_torque

    @model_validator(mode="after")
    def _fits(self) -> Self:
        breakaway = self.clutch.torque * self.clutch.static_ratio
        if breakaway >= self.stall_torque:
            message = (
                f"the clutch would never slip: {breakaway:.4g} N m to break away, the motor stalls "
                f"at {self.stall_torque:.4g} N m; lower clutch.torque or raise motor.voltage"
            )
            raise ValueError(message)
        if self.motor.kind == "induction" and self.supply.shared_resistance:
            message = "supply.shared_resistance is for DC machines; give line_resistance of a phase"
            raise ValueError(message)
        back = self.gear.back_efficiency
        if self.circuit.holding == "gear" and back != 0.0:
            message = "circuit.holding = 'gear' needs a self-locking gear: gear.back_efficiency = 0"
            raise ValueError(message)
        if self.circuit.holding == "brake" and self.motor.brake_torque == 0.0:
            message = "circuit.holding = 'brake' needs motor.brake_torque"
            raise ValueError(message)
        return self


class OneMassRail(Record):
    """A rail as one mass at the rod: friction, elastic bed, stop, perhaps an object."""

    mass: Mass = Field(gt=0, description="[kg]")
    damping: Damping = Field(0.0, ge=0, description="[N s/m]")
    bed_stiffness: Stiffness = Field(0.0, ge=0, description="of the bent rail [N/m]")
    bed_rest: Length = Field(0.0, description="position in which it is free of force [m]")
    friction_force: Force = Field(0.0, ge=0, description="[N]")
    friction_stiffness: Stiffness = Field(1e7, gt=0, description="before it slides [N/m]")
    friction_at_start: float = Field(
        -0.9, ge=-1, le=1, description="share of the friction force that acts at the start [-]"
    )
    stop_stiffness: Stiffness = Field(
        ge=0, description="of the stock rail, beyond position 0 [N/m]"
    )
    object_size: Length | None = Field(None, gt=0, description="default no object [m]")
    object_stiffness: Stiffness = Field(4e7, gt=0, description="[N/m]")


class Command(Record):
    """What the interlocking asks for, and when."""

    time: Time = Field(ge=0, description="[s]")
    direction: Literal["close", "open"] = "close"


class Throw(Record):
    """One machine on a one-mass rail: where it starts, what is commanded, how it is computed."""

    machine: str | None = Field(None, description="its name; needed where the file has several")
    start: Length = Field(description="rod position at the start [m]")
    duration: Time = Field(gt=0, le=600, description="[s]")
    step: Time = Field(1e-4, gt=0, le=0.02, description="of the scheme [s]")
    output_interval: Time = Field(1e-3, gt=0, le=1, description="a multiple of the step [s]")
    command: tuple[Command, ...] | list[Command] = Field(
        default_factory=lambda: [Command(time=SI(0.0))], min_length=1
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        count = self.output_interval / self.step
        if abs(count - round(count)) > 1e-6 * count or round(count) < 1:
            message = f"output_interval must be a multiple of step = {self.step:g} s"
            raise ValueError(message)
        if self.duration > MOST_INSTANTS * self.output_interval:
            message = f"duration / output_interval: at most {MOST_INSTANTS} instants are kept"
            raise ValueError(message)
        times = [command.time for command in self.command]
        if any(a >= b for a, b in zip(times, times[1:], strict=False)):
            message = "commands must be given in the order of their times"
            raise ValueError(message)
        return self


class MachineFile(Record):
    """A file of machines, perhaps with a one-mass rail and a throw to try them on."""

    schema_version: Literal[1]
    name: str = Field(min_length=1)
    description: str = ""
    machine: dict[str, Machine] = Field(min_length=1)
    rail: OneMassRail | None = None
    throw: Throw | None = None
