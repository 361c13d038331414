"""Turn recorded columns into physical channels by a channel map, and back.

One way: raw column -> sensor (a straight line to SI) -> physical channel -> conditioning (tare,
common time). `raw_from_physical` is the inverse, `mapped_channels` lists the outcome.
"""

import json
import re
from collections.abc import Iterator
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
from turnout.core.units import FORCE, Dimension
from turnout.measurement.chain.channel_map import (
    OF_DRIVES,
    AnySensor,
    ChannelMap,
    drives_together,
    map_problem,
    raw_unit,
)
from turnout.measurement.chain.condition import SAME_STEP, common_time, resample, tare
from turnout.measurement.chain.sensor import SensorLine, describe_sensor, line_of, other_unit
from turnout.measurement.recording import RecordedChannel, Recording


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
    return parse_channel_map(_open(name_or_path))


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
    rate = float((time.size - 1) / (time[-1] - time[0])) if time.size > 1 else 1.0
    rate = float(round(rate)) if abs(rate - round(rate)) < 1e-9 * rate else rate
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
    return content_hash(_plain(channel_map.model_dump(exclude_defaults=True)))


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


def _open(name_or_path: Path | str) -> TomlFile:
    if names_a_file(name_or_path):
        require_regular_file(user_path(name_or_path))
    return open_toml("turnout.measurement", name_or_path, kind="channel map")


@dataclass(frozen=True, slots=True)
class _MappedColumn:
    """A raw column with its sensor, and the key of the quantity that it becomes."""

    key: str
    column: RecordedChannel
    sensor: AnySensor
    line: SensorLine

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
            channel = _mean_of_phases(channel, columns[1:], sensor.phases)
            line = line_of(sensor, quantity=dimension, recorded_unit=channel.unit)
        except ValueError as error:
            problems.append(f"{key} (column '{sensor.column}'): {error}")
            continue
        found.append(_MappedColumn(key, channel, sensor, line))
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
        values = item.line.physical(column.values)
        if rest is not None:
            start, end = rest.start - column.start, rest.end - column.start
            try:
                tared = tare(values, rate=column.rate, start=start, end=end)
            except ValueError as error:
                problems.append(f"{item.key}.tare: {error}")
                continue
            change = f"{values[0] - tared[0]:.6g} {_unit(item.key)}"
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


def _mean_of_phases(
    first: RecordedChannel, others: list[RecordedChannel | None], names: list[str]
) -> RecordedChannel:
    """Return the mean of the phases of a drive; ValueError when one is missing or differs.

    A phase that is silent while the others run would make the mean a third too small.
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
    return replace(first, values=np.mean(values, axis=0)) if names else first


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


def _unit(key: str) -> str:
    return OF_DRIVES.get(key.partition(".")[0], FORCE).unit


def _plain(value: Any) -> Any:
    """Return nested plain data for the hash; a raw value becomes its numbers and dimension."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "dimension"):
        return {"values": list(value.values), "dimension": value.dimension.name}
    return value


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
