"""A point machine as records: motor, clutch, gear, stroke, rod, circuit, hand crank.

Angles, speeds and torques are those at the motor shaft, so that no gear ratio stands between them;
positions are those of the rod's machine end, positive in the closing direction, and 0 where the
rail is home against the stock rail.
"""

import math
from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from turnout.core.keys import Keys
from turnout.core.quantity import (
    Angle,
    AngularStiffness,
    Current,
    Damping,
    Force,
    HeatCapacity,
    Inertia,
    JudgedRecord,
    Length,
    Mass,
    PerEnergy,
    PositiveNumberList,
    Record,
    Resistance,
    RotationalDrag,
    RotationalSpeed,
    ShaftRatio,
    Stiffness,
    TemperatureCoefficient,
    Time,
    Torque,
)
from turnout.core.units import SI
from turnout.machine.motor_kind import COPPER_REFERENCE, Motor, Supply, motor_row, with_article

MOST_INSTANTS = 1_000_000


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

    @property
    def slip_torque(self) -> float:
        """Torque while it slips, as worn as it is, at ambient temperature [N m]."""
        return self.torque * (1.0 - self.worn)


class Gear(JudgedRecord):
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

    def faults(self) -> Iterator[str]:
        """Yield the faults between the values."""
        if self.dry_from is None or self.dry_to is None:
            if self.dry_ratio < 1.0 or self.dry_from is not self.dry_to:
                yield "a gear that is dry needs dry_from and dry_to"
        elif self.dry_to <= self.dry_from:
            yield "dry_to must be more than dry_from"


class Stroke(JudgedRecord):
    """Rod position over shaft angle."""

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

    def faults(self) -> Iterator[str]:
        """Yield the faults between the values."""
        screw, table = self.kind == "screw", self.kind == "table"
        needed = ["ratio"] if screw else ["angle", "length"]
        needed += ["angle_share", "length_share"] if table else []
        missing = [name for name in needed if getattr(self, name) is None]
        if missing:
            yield f"a {self.kind} needs {' and '.join(missing)}"
        elif table:
            angles, lengths = [0.0, *(self.angle_share or ())], [0.0, *(self.length_share or ())]
            rises = all(a < b for a, b in zip(angles, angles[1:], strict=False))
            follows = all(a <= b for a, b in zip(lengths, lengths[1:], strict=False))
            if len(angles) != len(lengths) or not rises or not follows:
                yield "angle_share must rise, length_share not fall, and both be equally long"
            elif angles[-1] != 1.0 or lengths[-1] != 1.0:
                yield "angle_share and length_share must end with 1"

    @property
    def standing(self) -> tuple[float, float]:
        """Shares of the angle up to which, and from which on, the rod stands [-]."""
        if self.kind != "table" or self.angle_share is None or self.length_share is None:
            return 0.0, 1.0
        moved = list(zip(self.angle_share, self.length_share, strict=False))
        first = max((angle for angle, length in moved if length == 0.0), default=0.0)
        last = min((angle for angle, length in moved if length == 1.0), default=1.0)
        return first, last


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


class Lock(Record):
    """Lock bar, which the machine moves while the rod stands: before its way and after it."""

    stroke: Length | None = Field(
        None,
        gt=0,
        le=0.3,
        description="of the bar at each end of a screw's way, at the screw's ratio; a table has "
        "its own, where it stands [m]",
    )
    force: Force = Field(
        0.0, ge=0, description="against the bar's motion, at the ratio of the way between [N]"
    )


class HandCrank(Record):
    """A hand at the crank in place of the motor current; the armature is open."""

    stiffness: RotationalDrag = Field(gt=0, description="torque per speed lag [N m s/rad]")
    speed: RotationalSpeed = Field(gt=0, description="of the hand, at the shaft [rad/s]")
    ramp: Time = Field(gt=0, description="from rest to that speed [s]")
    release: Literal["cut-off", "never"] = Field(
        "cut-off", description="when the hand lets go: at the limit contact, or not at all"
    )


class Machine(JudgedRecord):
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
    lock: Lock | None = Field(
        None, description="bar that unlocks before the way and locks after it; default none"
    )

    def faults(self) -> Iterator[str]:
        """Yield the faults between the values."""
        breakaway = self.clutch.torque * self.clutch.static_ratio
        cold = self.motor.model_copy(update={"temperature": COPPER_REFERENCE})
        row = motor_row(cold, Supply.model_validate({}))
        most = cold.of_kind.stall_torque(row) - cold.loss_torque
        if breakaway >= most:
            yield (
                f"the clutch would never slip: {breakaway:.4g} N m to break away, the motor stalls "
                f"at {most:.4g} N m; lower clutch.torque or raise motor.voltage"
            )
        if self.supply.phase_lost_at is not None and self.supply.shared_resistance:
            yield (
                "supply.phase_lost_at goes with supply.line_resistance only; leave out "
                "supply.shared_resistance"
            )
        kind = self.motor.of_kind
        spare = [text for key in kind.without_effect if (text := self._given(key))]
        if spare:
            yield (
                f"{' and '.join(spare)}: without effect on {with_article(self.motor.kind)} motor, "
                f"{kind.no_effect_since}; leave it out"
            )
        back = self.gear.back_efficiency
        if self.circuit.holding == "gear" and back != 0.0:
            yield "circuit.holding = 'gear' needs a self-locking gear: gear.back_efficiency = 0"
        if self.circuit.holding == "brake" and self.motor.brake_torque == 0.0:
            yield "circuit.holding = 'brake' needs motor.brake_torque"
        if self.lock is not None:
            yield from self._lock_faults(self.lock)

    @property
    def lock_torque(self) -> float:
        """Torque at the shaft while the lock bar moves [N m]."""
        if self.lock is None:
            return 0.0
        stroke = self.stroke
        if stroke.kind == "screw":
            travel = 1.0 / (stroke.ratio or math.inf)
        else:
            first, last = stroke.standing
            travel = (stroke.length or 0.0) / ((stroke.angle or math.inf) * (last - first))
        return self.lock.force * travel / self.gear.efficiency

    def _lock_faults(self, lock: Lock) -> Iterator[str]:
        screw = self.stroke.kind == "screw"
        if screw and lock.stroke is None:
            yield "lock.stroke is needed with a screw: the way of the bar at each end"
        elif not screw and lock.stroke is not None:
            kind = self.stroke.kind
            yield f"lock.stroke is of screws; a {kind} stands where its length_share does"
        elif not screw and self.stroke.standing == (0.0, 1.0):
            yield (
                f"lock: this {self.stroke.kind} never stands; give a table whose length_share "
                "begins with 0 and reaches 1 before its end, or a screw with lock.stroke"
            )
        else:
            holds = self.clutch.slip_torque
            if self.lock_torque >= holds:
                yield (
                    f"lock.force = {lock.force:g} N: takes {self.lock_torque:.4g} N m, the clutch "
                    f"slips at {holds:.4g} N m, so that it never unlocks; at most "
                    f"{lock.force * holds / self.lock_torque:.4g} N"
                )

    def _given(self, key: str) -> str:
        """Return a key of a part whose value is not its default, with the value of a choice."""
        part, name = key.split(".")
        record = getattr(self, part)
        value = getattr(record, name)
        if value == type(record).model_fields[name].default:
            return ""
        return f"{key} = '{value}'" if isinstance(value, str) else key


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
    """Commands of the interlocking and their times."""

    time: Time = Field(ge=0, description="[s]")
    direction: Literal["close", "open"] = "close"


class Throw(JudgedRecord):
    """One machine on a one-mass rail: where it starts, what is commanded, how it is computed."""

    machine: str | None = Field(None, description="its name; needed where the file has several")
    start: Length = Field(description="rod position at the start [m]")
    duration: Time = Field(gt=0, le=600, description="[s]")
    step: Time = Field(1e-4, gt=0, le=0.02, description="of the scheme [s]")
    output_interval: Time = Field(1e-3, gt=0, le=1, description="a multiple of the step [s]")
    command: tuple[Command, ...] | list[Command] = Field(
        default_factory=lambda: [Command(time=SI(0.0))], min_length=1
    )

    def faults(self) -> Iterator[str]:
        """Yield the faults between the values."""
        count = self.output_interval / self.step
        if abs(count - round(count)) > 1e-6 * count or round(count) < 1:
            yield f"output_interval must be a multiple of step = {self.step:g} s"
        if self.duration > MOST_INSTANTS * self.output_interval:
            yield f"duration / output_interval: at most {MOST_INSTANTS} instants are kept"
        times = [command.time for command in self.command]
        if any(a >= b for a, b in zip(times, times[1:], strict=False)):
            yield "commands must be given in the order of their times"


class MachineFile(Record):
    """A file of machines, perhaps with a one-mass rail and a throw to try them on."""

    schema_version: Literal[1]
    name: str = Field(min_length=1)
    description: str = ""
    machine: dict[str, Machine] = Field(min_length=1)
    rail: OneMassRail | None = None
    throw: Throw | None = None


MACHINE_KEYS = Keys(MachineFile, what="file", implied="machine", example='motor.voltage="176 V"')
