"""What a channel map made of a recording, as rows to be read."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import xarray as xr

from turnout.files.units import CURRENT, Dimension
from turnout.measurement.chain import sensors
from turnout.measurement.channel_map import AnySensor, Calibrated, ChannelMap, RawUnit, raw_unit
from turnout.measurement.sensor import line_of


@dataclass(frozen=True, slots=True)
class ChannelRow:
    """A quantity: its key, column, range [unit], and its sensor in words."""

    key: str
    column: str
    least: float
    largest: float
    unit: str
    sensor: str


def channel_rows(dataset: xr.Dataset, channel_map: ChannelMap) -> Iterator[ChannelRow]:
    """Yield a row for each channel of the map that the recording had.

    Parameters
    ----------
    dataset : xarray.Dataset
        That `turnout.measurement.chain.apply_chain` made.
    channel_map : ChannelMap
        With which it made it.
    """
    units = {
        str(n): str(u)
        for n, u in zip(dataset["column"].values, dataset["column_unit"].values, strict=True)
    }
    for key, dimension, sensor in sensors(channel_map):
        if sensor.column not in units:
            continue
        quantity, _, drive = key.partition(".")
        values = dataset[quantity].sel(drive=drive) if drive else dataset[quantity]
        factor = 1.0 if dimension is CURRENT else 1e-3
        there = values.values[np.isfinite(values.values)] * factor
        yield ChannelRow(
            key=key,
            column=sensor.column,
            least=float(there.min()) if there.size else np.nan,
            largest=float(there.max()) if there.size else np.nan,
            unit="A" if dimension is CURRENT else "kN",
            sensor=describe_sensor(sensor, dimension, raw_unit(units[sensor.column])),
        )


def describe_sensor(sensor: AnySensor, quantity: Dimension, unit: RawUnit) -> str:
    """Say what one unit of a column stands for, and how well a calibration knows it.

    Examples
    --------
    >>> from turnout.measurement.channel_map import LoadCell
    >>> cell = LoadCell(kind="load cell", column="A", sensitivity="1 mV/V", capacity="20 kN")
    >>> from turnout.files.units import FORCE
    >>> describe_sensor(cell, FORCE, raw_unit("mV/V"))
    'load cell, 1 mV/V is 20 kN'
    """
    line = line_of(sensor, quantity=quantity, recorded_unit=unit.text)
    factor, shown = (1.0, "A") if quantity is CURRENT else (1e-3, "kN")
    text = f"{sensor.kind}, 1 {unit.text} is {line.scale * unit.factor * factor:.5g} {shown}"
    if isinstance(sensor, Calibrated):
        fit = sensor.calibration()
        if fit.count == 2:
            return f"{text}; two points tell no error"
        text += (
            f" +- {100 * fit.scale_error / abs(fit.scale):.2g} %, zero at "
            f"{fit.offset / unit.factor:.4g} +- {fit.offset_error / unit.factor:.2g} {unit.text}, "
            f"at most {100 * fit.nonlinearity:.2g} % of the range off the line ({fit.count} points)"
        )
    return text
