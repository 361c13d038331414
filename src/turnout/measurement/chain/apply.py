"""Turn recorded columns into physical channels by a channel map, and back.

One way: raw column -> sensor (a straight line to SI) -> physical channel -> conditioning (tare,
common time). `raw_from_physical` is the inverse, `mapped_channels` lists the outcome.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import ValidationError

from turnout.core.channels import SCHEMA_VERSION, label
from turnout.core.errors import MeasurementError
from turnout.core.files import require_regular_file, user_path
from turnout.core.library import names_a_file, open_toml
from turnout.core.problems import choices, nearest
from turnout.core.provenance import content_hash, version
from turnout.core.toml import TomlFile
from turnout.core.units import CURRENT, FORCE, POWER, STRAIN, VOLTAGE, VOLTAGE_RATIO, Dimension
from turnout.measurement.chain.channel_map import (
    OF_DRIVES,
    Amplified,
    AnySensor,
    ChannelMap,
    Clamp,
    KnownLoadSensor,
    LoadCell,
    RawUnit,
    StrainBridge,
    drives_together,
    map_problem,
    raw_unit,
)
from turnout.measurement.chain.condition import SAME_STEP, common_time, resample, tare
from turnout.measurement.recording import RecordedChannel, Recording, whole_rate


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
    along = {"full bending": 4.0, "half bending": 2.0, "quarter": 1.0}
    return 2.0 * (1.0 + poisson_ratio) if bridge == "full T" else along[bridge]


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


def load_channel_map(name_or_path: Path | str) -> ChannelMap:
    """Read a channel map (TOML) from a file, or one of the library by its name.

    Parameters
    ----------
    name_or_path : path-like
        A path ends in .toml or has a separator; "two-rods" is in the library.

    Raises
    ------
    FileError
        When it cannot be read or is no TOML.
    MeasurementError
        With everything that is wrong in it.

    Examples
    --------
    >>> load_channel_map("two-rods").drive_current["1"].sensitivity
    0.1
    """
    if names_a_file(name_or_path):
        require_regular_file(user_path(name_or_path))
    return parse_channel_map(open_toml("turnout.measurement", name_or_path, kind="channel map"))


def parse_channel_map(file: TomlFile) -> ChannelMap:
    """Make a channel map of a TOML document; MeasurementError lists all that is wrong."""
    try:
        channel_map = ChannelMap.model_validate(file.data)
    except ValidationError as error:
        problems = [map_problem(item) for item in error.errors(include_url=False)]
        raise MeasurementError(list(dict.fromkeys(problems)), source=file.source) from None
    used: dict[str, str] = {}
    twice = [
        f"{key}.gain_uncertainty: is of force channels alone; leave it out"
        for key, dimension, sensor in sensors(channel_map)
        if dimension is not FORCE and sensor.gain_uncertainty is not None
    ]
    for key, _, sensor in sensors(channel_map):
        quantity, _, name = key.partition(".")
        if "+" in name and (quantity == "drive_force" or not drives_together(name)):
            twice.append(
                f"{key}: a name such as '1+2' is that of one current, voltage or power for the "
                "machines of two drives; a force is of one drive"
            )
        for column in (sensor.column, *sensor.phases):
            if column in used:
                twice.append(f'{key}.column = "{column}": is also that of {used[column]}')
            used[column] = key
    if twice or not used:
        nothing = [f"maps no column; give {choices((*OF_DRIVES, 'object_force'))}"]
        raise MeasurementError(twice or nothing, source=file.source)
    return channel_map


def sensors(channel_map: ChannelMap) -> Iterator[tuple[str, Dimension, AnySensor]]:
    """Yield key, dimension and sensor of each mapped channel.

    Examples
    --------
    >>> [key for key, _, _ in sensors(load_channel_map("two-rods"))][:2]
    ['drive_force.1', 'drive_force.2']
    """
    for quantity, dimension in OF_DRIVES.items():
        for name, sensor in getattr(channel_map, quantity).items():
            yield f"{quantity}.{name}", dimension, sensor
    if channel_map.object_force is not None:
        yield "object_force", FORCE, channel_map.object_force


def apply_chain(recording: Recording, channel_map: ChannelMap) -> xr.Dataset:
    r"""Turn the columns of a recording into channels of the schema, in SI.

    Parameters
    ----------
    recording : Recording
        As it was read.
    channel_map : ChannelMap
        Which column is which quantity, through what sensor.

    Returns
    -------
    xarray.Dataset
        ``drive_force``, ``drive_current``, ``drive_voltage``, ``drive_power`` where there are any,
        ``object_force`` (NaN where no column measured it), and ``recorded``: the mapped columns as
        they were, phases as their mean. All share one even
        time; a column with another rate is interpolated linearly, after averaging over a step
        where it is faster. What was mended is in ``attrs["problems"]``.

    Raises
    ------
    MeasurementError
        With every missing column and every unit that does not fit.

    Examples
    --------
    >>> from turnout.core.toml import parse_toml
    >>> clamp = RecordedChannel("Clamp 1", "V", np.array([0.0, 0.2]), rate=1000.0)
    >>> text = '[drive_current.1]\ncolumn = "Clamp 1"\nkind = "clamp"\nsensitivity = "100 mV/A"'
    >>> channel_map = parse_channel_map(parse_toml(text, source="example"))
    >>> dataset = apply_chain(Recording({"Clamp 1": clamp}, "example"), channel_map)
    >>> dataset["drive_current"].sel(drive="1").values
    array([0., 2.])
    """
    mapped = _mapped_columns(recording, channel_map)
    raw = [item.column for item in mapped]
    try:
        time = common_time(raw, rate=channel_map.rate)
    except ValueError as error:
        raise MeasurementError([str(error)], source=recording.source) from None
    physical, notes = _conditioned(mapped, time, source=recording.source)
    dataset = _dataset(physical, channel_map, time)
    columns = np.stack([resample(column, column.values, time=time) for column in raw])
    dataset["recorded"] = (("column", "time"), columns)
    dataset = dataset.assign_coords(
        column=np.array([column.name for column in raw]),
        column_unit=("column", np.array([item.line.unit.text for item in mapped])),
    )
    dataset.attrs = {
        "schema_version": SCHEMA_VERSION,
        "version": version(),
        "title": channel_map.title or Path(recording.source).name,
        "source": recording.source,
        "start_time": recording.start_time or "",
        "channel_map_hash": map_hash(channel_map),
        "problems": "\n".join((*recording.problems, *notes)),
    }
    slow = {
        item.key: float(item.column.rate)
        for item in mapped
        if item.is_force and item.column.rate * (time[1] - time[0]) < 1.0 - SAME_STEP
    }
    if slow:
        dataset.attrs["force_rates"] = json.dumps(slow)
    return label(dataset)


def raw_from_physical(dataset: xr.Dataset, channel_map: ChannelMap) -> Recording:
    """Return the recording that `apply_chain` would turn into a dataset: its exact inverse.

    A tare is not undone, as what stood in its rest is not known: a map with tares gives zero
    there.

    Parameters
    ----------
    dataset : xarray.Dataset
        With the quantities of the map over an even ``time``.
    channel_map : ChannelMap
        Each sensor with its ``unit``; those of kind "clamp" are in V, others in the SI unit of
        what the sensor gives, where it is left out. An optional column that is NaN throughout is
        left out.

    Returns
    -------
    Recording
        A channel a column.

    Raises
    ------
    MeasurementError
        When the dataset lacks a quantity or a drive.
    """
    time = dataset["time"].values
    channels: dict[str, RecordedChannel] = {}
    problems = []
    # Summed over the whole run, so that rounding of single times does not matter.
    rate = whole_rate(float((time.size - 1) / (time[-1] - time[0]))) if time.size > 1 else 1.0
    for key, dimension, sensor in sensors(channel_map):
        try:
            physical = _quantity(dataset, key)
            line = line_of(sensor, quantity=dimension, recorded_unit=_usual_unit(sensor, dimension))
        except (ValueError, KeyError) as error:
            if not (sensor.optional and isinstance(error, KeyError)):
                problems.append(f"{key}: {error.args[0]}")
            continue
        if sensor.optional and np.isnan(physical).all():
            continue
        channels[sensor.column] = RecordedChannel(
            sensor.column, line.unit.text, line.raw(physical), rate, float(time[0]), key
        )
    if problems:
        raise MeasurementError(problems, source="dataset")
    return Recording(channels, str(dataset.attrs.get("title", "dataset")))


def map_hash(channel_map: ChannelMap) -> str:
    """Hash what a channel map states, whatever its file looks like.

    Keys that it leaves out do not count: a new one costs nobody a second reading.
    """
    return content_hash(channel_map.model_dump(exclude_defaults=True))


def stated_uncertainties(channel_map: ChannelMap) -> dict[str, float]:
    """Return the uncertainty of the sensitivity of each force channel that states one [-].

    Examples
    --------
    >>> stated_uncertainties(load_channel_map("two-rods"))
    {}
    """
    return {
        key: float(sensor.gain_uncertainty)
        for key, dimension, sensor in sensors(channel_map)
        if dimension is FORCE and sensor.gain_uncertainty is not None
    }


@dataclass(frozen=True, slots=True)
class _MappedColumn:
    """A raw column with its sensor, and the key of the quantity that it becomes."""

    key: str
    column: RecordedChannel
    sensor: AnySensor
    line: SensorLine
    remark: str

    @property
    def is_force(self) -> bool:
        return self.key.partition(".")[0] in ("drive_force", "object_force")


def _mapped_columns(recording: Recording, channel_map: ChannelMap) -> list[_MappedColumn]:
    """Match the channel map with the columns of a recording; MeasurementError with all faults."""
    found: list[_MappedColumn] = []
    problems: list[str] = []
    taken = {column for _, _, s in sensors(channel_map) for column in (s.column, *s.phases)}
    for key, dimension, sensor in sensors(channel_map):
        columns = [_column(recording, name) for name in (sensor.column, *sensor.phases)]
        channel = columns[0]
        if channel is None:
            if not sensor.optional:
                near = nearest(sensor.column, [n for n in recording.channels if n not in taken])
                problems.append(
                    f'{key}.column = "{sensor.column}": is not in the file{near}; '
                    f"there are {choices(recording.channels)}"
                    + ("; where recordings may lack it, say optional = true" * (dimension is FORCE))
                )
            continue
        try:
            channel, unlike = _mean_of_phases(channel, columns[1:], sensor.phases)
            line = line_of(sensor, quantity=dimension, recorded_unit=channel.unit)
            if dimension is POWER:  # the sum is so many times the mean
                line = replace(line, scale=line.scale * (1 + len(sensor.phases)))
        except ValueError as error:
            problems.append(f"{key} (column '{sensor.column}'): {error}")
            continue
        most = UNBALANCED.get(dimension, math.inf)
        remark = _unbalanced_text(key, unlike) if max(map(abs, unlike.values())) > most else ""
        found.append(_MappedColumn(key, channel, sensor, line, remark))
    if not found and not problems:
        problems.append("none of the columns of the channel map is in the file")
    if problems:
        raise MeasurementError(problems, source=recording.source)
    return found


def _conditioned(
    mapped: list[_MappedColumn], time: NDArray[np.float64], *, source: str
) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
    """Return physical values by key on a common time, in SI, and a note on each tare."""
    physical: dict[str, NDArray[np.float64]] = {}
    notes: list[str] = []
    problems: list[str] = []
    for item in mapped:
        column, rest = item.column, item.sensor.tare
        other = other_unit(item.sensor, item.line, recorded_unit=column.unit)
        notes += [f"{item.key} (column '{column.name}'): {other}"] if other else []
        notes += [item.remark] if item.remark else []
        values = item.line.physical(column.values)
        if rest is not None:
            start, end = rest.start - column.start, rest.end - column.start
            try:
                tared = tare(values, rate=column.rate, start=start, end=end)
            except ValueError as error:
                problems.append(f"{item.key}.tare: {error}")
                continue
            unit = OF_DRIVES.get(item.key.partition(".")[0], FORCE).unit
            change = f"{values[0] - tared[0]:.6g} {unit}"
            notes.append(f"{item.key}: {change} subtracted as tare")
            values = tared
        physical[item.key] = resample(column, values, time=time)
    if problems:
        raise MeasurementError(problems, source=source)
    return physical, notes


def _column(recording: Recording, name: str) -> RecordedChannel | None:
    """Return a column by its name, or by its MATLAB name: "Rod 1" is a variable Rod_1."""
    return recording.channels.get(name) or recording.channels.get(re.sub(r"\W", "_", name))


SILENT_PHASE = 0.05
"""A phase whose largest value is below this share of that of the others is missing [-]."""
UNLIKE_PHASES = "unbalanced phases"
UNBALANCED = {CURRENT: 0.05, VOLTAGE: 0.02}
"""Deviations of a phase from the mean of all from which they are unbalanced: voltages as EN 50160
allows them; such voltages of a running motor move its currents by more [-]."""


def _mean_of_phases(
    first: RecordedChannel, others: list[RecordedChannel | None], names: list[str]
) -> tuple[RecordedChannel, dict[str, float]]:
    """Return the mean of the phases of a drive, and by how much of it the rms of each is off.

    ValueError when one is missing or differs. A phase that is silent while the others run would
    make the mean a third too small.
    """
    values = [first.values]
    for name, other in zip(names, others, strict=True):
        if other is None:
            message = f"its phase '{name}' is not in the file"
            raise ValueError(message)
        same = (other.rate, other.start, other.values.size, other.unit)
        if same != (first.rate, first.start, first.values.size, first.unit):
            message = f"its phase '{name}' has other times or another unit"
            raise ValueError(message)
        values.append(other.values)
    largest = [float(np.nanmax(np.abs(row), initial=0.0)) for row in values]
    for name, most in zip([first.name, *names], largest, strict=True):
        if most < SILENT_PHASE * max(largest):
            message = f"its phase '{name}' is silent while the others are not: a dead channel?"
            raise ValueError(message)
    if not names or max(largest) == 0.0:
        return first, dict.fromkeys([first.name, *names], 0.0)
    sizes = [math.sqrt(float(np.nanmean(np.square(row)))) for row in values]
    mean = math.fsum(sizes) / len(sizes)
    unlike = [size / mean - 1.0 for size in sizes]
    joined = replace(first, values=np.mean(values, axis=0))
    return joined, dict(zip([first.name, *names], unlike, strict=True))


def _unbalanced_text(key: str, unlike: Mapping[str, float]) -> str:
    """Return by how much each phase of a quantity is off the mean, as a remark."""
    parts = ", ".join(f"{name} {100.0 * off:+.0f} %" for name, off in unlike.items())
    return f"{UNLIKE_PHASES} of {key}: {parts} of their mean, which is taken"


def _dataset(
    physical: dict[str, NDArray[np.float64]], channel_map: ChannelMap, time: NDArray[np.float64]
) -> xr.Dataset:
    names = list(dict.fromkeys(n for q in OF_DRIVES for n in getattr(channel_map, q)))
    missing = np.full(time.size, np.nan)
    variables: dict[str, Any] = {}
    for quantity in OF_DRIVES:
        if getattr(channel_map, quantity):
            rows = [physical.get(f"{quantity}.{name}", missing) for name in names]
            variables[quantity] = (("drive", "time"), np.stack(rows))
    variables["object_force"] = ("time", physical.get("object_force", missing).copy())
    coordinates: dict[str, Any] = {"time": time}
    if names:
        coordinates["drive"] = np.array(names)
    return xr.Dataset(variables, coordinates)


def _quantity(dataset: xr.Dataset, key: str) -> NDArray[np.float64]:
    """Return a quantity of the map from a dataset; KeyError when it is not there."""
    quantity, _, drive = key.partition(".")
    if quantity not in dataset:
        message = f"the dataset has no {quantity}"
        raise KeyError(message)
    if not drive:
        return np.asarray(dataset[quantity].values, dtype=np.float64)
    if drive not in dataset["drive"].values:
        drives = choices([str(name) for name in dataset["drive"].values])
        message = f"the dataset has no drive '{drive}'; there are {drives}"
        raise KeyError(message)
    return np.asarray(dataset[quantity].sel(drive=drive).values, dtype=np.float64)


def _usual_unit(sensor: AnySensor, dimension: Dimension) -> str:
    if sensor.kind == "calibrated":
        return str(sensor.readings.dimension.unit)
    return {"clamp": "V", "scaled": dimension.unit}.get(sensor.kind, "mV/V")


@dataclass(frozen=True, slots=True)
class MappedChannel:
    """A quantity: its key, column, range [unit], and its sensor in words."""

    key: str
    column: str
    least: float
    largest: float
    unit: str
    sensor: str


def mapped_channels(dataset: xr.Dataset, channel_map: ChannelMap) -> Iterator[MappedChannel]:
    """Yield a row for each channel of the map that the recording had.

    Parameters
    ----------
    dataset : xarray.Dataset
        That `turnout.measurement.chain.apply.apply_chain` made.
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
        factor = 1e-3 if dimension is FORCE else 1.0
        there = values.values[np.isfinite(values.values)] * factor
        yield MappedChannel(
            key=key,
            column=sensor.column,
            least=float(there.min()) if there.size else np.nan,
            largest=float(there.max()) if there.size else np.nan,
            unit="kN" if dimension is FORCE else dimension.unit,
            sensor=describe_sensor(sensor, dimension, raw_unit(units[sensor.column])),
        )
