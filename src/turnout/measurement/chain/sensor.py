"""From the reading of a sensor to newtons and amperes: every chain is one straight line."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.core.units import CURRENT, FORCE, STRAIN, VOLTAGE, VOLTAGE_RATIO, Dimension
from turnout.measurement.chain.channel_map import (
    Amplified,
    AnySensor,
    Clamp,
    KnownLoadSensor,
    LoadCell,
    RawUnit,
    StrainBridge,
    raw_unit,
)

# Arms that work in a bridge, as multiples of one gauge along the strain.
FULL_BENDING, HALF_BENDING, QUARTER = 4.0, 2.0, 1.0


@dataclass(frozen=True, slots=True)
class SensorLine:
    """A straight line: physical = scale (raw - offset), all in SI.

    Attributes
    ----------
    scale : float
        With the sign of the sensor [N or A for each SI unit of raw].
    offset : float
        Reading at no load [SI unit of raw].
    unit : RawUnit
        Unit of the column.
    """

    scale: float
    offset: float
    unit: RawUnit

    def physical(self, raw: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return newtons or amperes from readings in the unit of the column."""
        return self.scale * (raw * self.unit.factor - self.offset)

    def raw(self, physical: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return readings in the unit of the column from newtons or amperes."""
        return (physical / self.scale + self.offset) / self.unit.factor


def bridge_arms(bridge: str, poisson_ratio: float) -> float:
    r"""Return the strain that a bridge adds up, as a number of gauges.

    Parameters
    ----------
    bridge : str
        "full T" has on either side of the rod one gauge along and one across, which sees
        :math:`-\nu\varepsilon`: :math:`2(1 + \nu)`. "full bending" has two along on either side,
        "half bending" one, "quarter" one gauge in all.
    poisson_ratio : float
        Of the rod [-].

    Examples
    --------
    >>> bridge_arms("full T", 0.3)
    2.6
    """
    arms = {
        "full T": 2.0 * (1.0 + poisson_ratio),
        "full bending": FULL_BENDING,
        "half bending": HALF_BENDING,
        "quarter": QUARTER,
    }
    return arms[bridge]


def force_per_strain(sensor: StrainBridge) -> float:
    r"""Return the rod force that bends the rod's surface by unit strain [N].

    The attachment is eccentric by :math:`h` and the motor's end carries no moment, so

    .. math:: M = F h, \quad \varepsilon = \frac{M}{E W}, \quad F = \frac{E W}{h} \varepsilon .

    Parameters
    ----------
    sensor : StrainBridge
        With :math:`W` given, or :math:`\pi d^3 / 32` of a solid round rod.
    """
    modulus = sensor.section_modulus
    if modulus is None:
        modulus = math.pi * float(sensor.diameter or 0.0) ** 3 / 32.0
    return sensor.youngs_modulus * modulus / sensor.eccentricity


def strain_per_ratio(sensor: StrainBridge) -> float:
    r"""Return the strain for unit output of a bridge, voltage over excitation.

    .. math:: \frac{U}{U_0} = \frac{k \, n}{4} \varepsilon

    with the gauge factor :math:`k` and :math:`n` of `bridge_arms`.
    """
    return 4.0 / (sensor.gauge_factor * bridge_arms(sensor.bridge, sensor.poisson_ratio))


def line_of(sensor: AnySensor, *, quantity: Dimension, recorded_unit: str = "") -> SensorLine:
    """Return the straight line from a column to its quantity.

    Parameters
    ----------
    sensor : StrainBridge, Clamp, LoadCell, Scaled or Calibrated
        Of the channel map.
    quantity : Dimension
        Of the quantity that the column stands for.
    recorded_unit : str
        Unit that the file states; the sensor's own goes before it.

    Raises
    ------
    ValueError
        When the unit is unknown or does not fit the sensor.

    Examples
    --------
    >>> cell = LoadCell(kind="load cell", column="A", sensitivity="1 mV/V", capacity="20 kN")
    >>> line = line_of(cell, quantity=FORCE, recorded_unit="mV/V")
    >>> round(line.scale * 0.3e-3)
    6000
    """
    text = sensor.unit or recorded_unit
    if not text:
        message = "neither the file nor the map states the unit of the column; add unit = ..."
        raise ValueError(message)
    unit = raw_unit(text)
    scale = _scale(sensor, unit, quantity)
    offset = 0.0
    if isinstance(sensor, KnownLoadSensor):
        offset = sensor.calibration().offset
    if sensor.offset is not None:
        if sensor.offset.dimension is not unit.dimension:
            message = (
                f"the offset is a {sensor.offset.dimension.name}, the column a "
                f"{unit.dimension.name} ({unit.text})"
            )
            raise ValueError(message)
        offset += sensor.offset.values[0]
    return SensorLine(sensor.sign * scale, offset, unit)


def other_unit(sensor: AnySensor, line: SensorLine, *, recorded_unit: str) -> str:
    """Return a remark if the file states another unit of a column than the map, which counts.

    Parameters
    ----------
    sensor, line
        Of the channel map, and as the column is taken.
    recorded_unit : str
        Unit that the file states; one that is not known is what the map's is for.

    Examples
    --------
    >>> from turnout.measurement.chain.channel_map import Scaled
    >>> rod = Scaled(kind="scaled", column="A", unit="kN")
    >>> other_unit(rod, line_of(rod, quantity=FORCE), recorded_unit="N")
    'the file says N, the channel map kN, which is taken; correct one of them'
    """
    try:
        stated = raw_unit(recorded_unit)
    except ValueError:
        return ""
    same = (stated.dimension, stated.factor) == (line.unit.dimension, line.unit.factor)
    if not sensor.unit or same:
        return ""
    return (
        f"the file says {stated.text}, the channel map {line.unit.text}, which is taken; "
        "correct one of them"
    )


def describe_sensor(sensor: AnySensor, quantity: Dimension, unit: RawUnit) -> str:
    """Return the value of one unit of a column, and its uncertainty from a calibration, as text.

    Examples
    --------
    >>> cell = LoadCell(kind="load cell", column="A", sensitivity="1 mV/V", capacity="20 kN")
    >>> describe_sensor(cell, FORCE, raw_unit("mV/V"))
    'load cell, 1 mV/V is 20 kN'
    """
    line = line_of(sensor, quantity=quantity, recorded_unit=unit.text)
    factor, shown = (1e-3, "kN") if quantity is FORCE else (1.0, quantity.unit)
    text = f"{sensor.kind}, 1 {unit.text} is {line.scale * unit.factor * factor:.5g} {shown}"
    if isinstance(sensor, KnownLoadSensor):
        fit = sensor.calibration()
        if fit.count == 2:
            return f"{text}; two points give no error"
        text += (
            f" +- {100 * fit.scale_error / abs(fit.scale):.2g} %, zero at "
            f"{fit.offset / unit.factor:.4g} +- {fit.offset_error / unit.factor:.2g} {unit.text}, "
            f"at most {100 * fit.nonlinearity:.2g} % of the range off the line ({fit.count} points)"
        )
    return text


def _scale(sensor: AnySensor, unit: RawUnit, quantity: Dimension) -> float:
    if isinstance(sensor, Clamp):
        _require(quantity is CURRENT, f"a clamp measures a current, not a {quantity.name}")
        _fits(unit, VOLTAGE)
        return 1.0 / sensor.sensitivity
    if isinstance(sensor, StrainBridge):
        _require(quantity is FORCE, f"a strain bridge measures a force, not a {quantity.name}")
        _fits(unit, VOLTAGE_RATIO, VOLTAGE, STRAIN)
        per_strain = force_per_strain(sensor)
        if unit.dimension is STRAIN:
            return per_strain
        return per_strain * strain_per_ratio(sensor) * _ratio(sensor, unit)
    if isinstance(sensor, LoadCell):
        _require(quantity is FORCE, f"a load cell measures a force, not a {quantity.name}")
        _fits(unit, VOLTAGE_RATIO, VOLTAGE)
        return sensor.capacity / sensor.sensitivity * _ratio(sensor, unit)
    if isinstance(sensor, KnownLoadSensor):
        _fits(unit, sensor.readings.dimension)
        _require(
            sensor.loads.dimension is quantity,
            f"the loads are a {sensor.loads.dimension.name}, must be a {quantity.name}",
        )
        return sensor.calibration().scale
    _fits(unit, quantity)
    return 1.0


def _ratio(sensor: Amplified, unit: RawUnit) -> float:
    """Return the bridge output for unit reading: a voltage went through excitation and gain."""
    if unit.dimension is VOLTAGE_RATIO:
        return 1.0
    if sensor.excitation is None:
        message = f"the column is a voltage ({unit.text}); add the bridge's excitation"
        raise ValueError(message)
    return 1.0 / (sensor.excitation * sensor.gain)


def _fits(unit: RawUnit, *dimensions: Dimension) -> None:
    names = " or ".join(f"{item.name} ({item.unit})" for item in dimensions)
    _require(
        unit.dimension in dimensions,
        f"the column is a {unit.dimension.name} in {unit.text}, must be a {names}",
    )


def _require(holds: bool, message: str) -> None:
    if not holds:
        raise ValueError(message)
