"""The motor of a point machine as a record, with what follows from it alone."""

import math
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from turnout.core.quantity import (
    Current,
    FieldConstant,
    Frequency,
    Inductance,
    Inertia,
    MotorConstant,
    Record,
    Resistance,
    RotationalDrag,
    Temperature,
    Torque,
    Voltage,
)
from turnout.core.units import SI

COPPER_REFERENCE = 293.15
"""Temperature at which resistances are given [K]."""
COPPER_COEFFICIENT = 3.9e-3
"""Of the resistance of copper, from its value at 20 degC [1/K]."""


def _whole(value: object) -> object:
    """Return a whole number that was given in Python as one: overrides mark all numbers as SI."""
    return int(value) if isinstance(value, SI) and float(value).is_integer() else value


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
    pole_pairs: Annotated[int | None, BeforeValidator(_whole)] = Field(
        None, ge=1, le=50, description="of an induction motor [-]"
    )
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
            if self.brush_drop or self.contact_loss or self.contact_resistance:
                message = (
                    "an induction motor has no brushes: leave out brush_drop, contact_loss and "
                    "contact_resistance"
                )
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
