"""Formats that optional packages read: Dewesoft (.d7d, .dxd), MDF (ASAM), TDMS, Parquet."""

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from logging import LogRecord
from pathlib import Path
from typing import Any

import numpy as np

from turnout.core.errors import FileError
from turnout.measurement.formats.assemble import (
    FileColumn,
    assemble_recording,
    column_clock,
    named_unit,
    tidy_unit,
)
from turnout.measurement.formats.channel_table import table_columns
from turnout.measurement.formats.clock import StatedClock, is_time_name, is_time_unit, seconds_of
from turnout.measurement.formats.extent import Declared
from turnout.measurement.formats.file_table import Table, TableColumn
from turnout.measurement.formats.named_arrays import stated_clock
from turnout.measurement.formats.time_axis import moments_axis
from turnout.measurement.recording import Recording

SYNCHRONOUS = 0


def read_dewesoft(path: Path) -> Recording:
    """Read a Dewesoft file.

    Channels that Dewesoft's library cannot give (CAN messages, binary data) become problems, one
    by one; all others are read.

    Raises
    ------
    FileError
        When it holds no channel or declares too much.
    """
    import dwdatareader

    columns: list[FileColumn] = []
    problems: list[str] = []
    declared = Declared(path)
    with dwdatareader.DWFile(str(path)) as opened:
        start_time = _start_time(opened.info)
        for name, channel in opened.items():
            try:
                declared.add(int(channel.number_of_samples) * int(channel.array_size))
                columns.append(_dewesoft_column(name, channel))
            except (RuntimeError, AttributeError, ValueError, IndexError) as error:
                reason = getattr(error, "message", "") or error
                problems.append(f"channel '{name}' is left out: {reason}")
    return assemble_recording(columns, source=str(path), start_time=start_time, problems=problems)


def _dewesoft_column(name: str, channel: Any) -> FileColumn:
    time, values = channel.scaled()
    if np.iscomplexobj(values) or channel.array_size > 1:
        message = "it has several values a sample"
        raise ValueError(message)
    described = (name, values, tidy_unit(channel.unit), channel.description)
    if channel.channel_type == SYNCHRONOUS and channel.sample_rate > 0 and len(time):
        return FileColumn(*described, rate=float(channel.sample_rate), start=float(time[0]))
    return FileColumn(*described, time=time)


def _start_time(info: Any) -> str | None:
    try:
        return str(info.start_store_time.isoformat())
    except (AttributeError, ValueError, OverflowError):
        return None


def read_mdf(path: Path) -> Recording:
    """Read the numeric channels of all groups of an MDF file; the others become problems.

    Raises
    ------
    FileError
        When it holds no channel or declares too much.
    """
    import asammdf

    columns: list[FileColumn] = []
    problems: list[str] = []
    with asammdf.MDF(path) as opened:
        groups: Any = opened.groups
        declared = Declared(path)
        for group in groups:
            declared.add(int(group.channel_group.cycles_nr) * len(group.channels))
        for number, group in enumerate(groups):
            master, time = opened.masters_db.get(number), None
            for place, channel in enumerate(group.channels):
                if place == master:
                    continue
                try:
                    if time is None:
                        time = _mdf_times(opened, group, number, master)
                    columns.append(_mdf_column(opened, channel.name, (number, place), time))
                except MemoryError:
                    raise
                except Exception as error:  # the reader raises whatever its parts raise
                    problems.append(f"channel '{channel.name}' is left out: {error}")
        start_time = opened.header.start_time.isoformat()
    return assemble_recording(columns, source=str(path), start_time=start_time, problems=problems)


SYNCHRONISED_BY = {2: "an angle", 3: "a distance", 4: "an index"}


def _mdf_times(opened: Any, group: Any, number: int, master: int | None) -> Any:
    """Return the times of a group; ValueError when its master channel is no time."""
    if master is None:
        message = "its group has no channel of times"
        raise ValueError(message)
    channel = group.channels[master]
    kind = SYNCHRONISED_BY.get(int(getattr(channel, "sync_type", 1)))
    if kind is not None:
        message = f"its group is recorded over {kind} ('{channel.name}'), not over time"
        raise ValueError(message)
    unit = str(opened.get_channel_unit(group=number, index=master) or "")
    return np.asarray(opened.get_master(number), dtype=np.float64) * seconds_of(unit)


def _mdf_column(opened: Any, name: str, place: tuple[int, int], time: Any) -> FileColumn:
    at = {"group": place[0], "index": place[1]}
    # Without the times, which the group shares and each channel would bring again.
    samples, invalid = opened.get(**at, samples_only=True, ignore_invalidation_bits=True)
    samples = np.asarray(samples)
    if samples.dtype.kind not in "biuf" or samples.ndim != 1:
        message = "it holds no single numbers"
        raise ValueError(message)
    values = samples.astype(np.float64)
    if invalid is not None:
        values = np.where(np.asarray(invalid, dtype=bool), np.nan, values)
    unit = tidy_unit(str(opened.get_channel_unit(**at) or ""))
    return FileColumn(name, values, unit, str(opened.get_channel_comment(**at) or ""), time=time)


NO_TDMS_TIME = "a channel needs wf_increment, or a channel called time in its group"


def read_tdms(path: Path) -> Recording:
    """Read the numeric channels of all groups of a TDMS file; the others become problems.

    Raises
    ------
    FileError
        When it holds no channel or declares too much.
    """
    import nptdms
    from nptdms import log, reader

    columns: list[FileColumn] = []
    problems: list[str] = []
    with _changes_kept(reader), _log_as_problems(log, problems), nptdms.TdmsFile.open(path) as file:
        groups = file.groups()
        declared = Declared(path)
        for group in groups:
            declared.add(sum(len(channel) for channel in group.channels()))
        for group in groups:
            prefix = f"{group.name}/" if len(groups) > 1 else ""
            columns += _tdms_group(group, prefix, {**file.properties}, problems, str(path))
    return assemble_recording(columns, source=str(path), problems=problems, remedy=NO_TDMS_TIME)


def _tdms_group(
    group: Any, prefix: str, properties: dict[str, Any], problems: list[str], source: str
) -> list[FileColumn]:
    """Return the channels of a group: with a clock of their own, or of a table with times."""
    columns: list[FileColumn] = []
    tables: dict[int, list[TableColumn]] = {}
    for channel in group.channels():
        own, values = channel.properties, np.asarray(channel[:])
        name = f"{prefix}{channel.name}"
        if values.dtype.kind not in "biufM":
            problems.append(f"channel '{name}' is left out: it holds no numbers")
            continue
        over = str(own.get("wf_xname", "time")).strip()
        if not (is_time_name(over) or is_time_unit(str(own.get("wf_xunit_string", "s")))):
            problems.append(f"channel '{name}' is left out: it is over {over}, not over time")
            continue
        unit = tidy_unit(str(own.get("unit_string", own.get("NI_UnitDescription", ""))))
        described = (unit, str(own.get("description", "")))
        try:
            clock = _tdms_clock(own, own=True)
            rate = clock.rate_of_rows()
        except ValueError as error:
            problems.append(f"channel '{name}' is left out: {error}")
            continue
        if rate is None or values.dtype.kind == "M":
            bare, unit = named_unit(channel.name, unit)
            tables.setdefault(values.size, []).append(TableColumn(bare, values, unit, described[1]))
            continue
        column = FileColumn(name, values, *described, **column_clock(None, clock))
        if isinstance(moment := own.get("wf_start_time"), np.datetime64):
            column = replace(column, begin=moments_axis(np.array([moment], "M8[us]")).begin)
        columns.append(column)
    stated = {**properties, **group.properties}
    for inner_columns in tables.values():
        table = Table(inner_columns, _tdms_clock(stated), source, remedy=NO_TDMS_TIME, alone=False)
        found, remarks = table_columns(table)
        columns += [replace(c, name=f"{prefix}{c.name}") for c in found]
        problems += remarks
    return columns


_THEN = ", then "


class _Properties(OrderedDict[str, Any]):
    """Properties of a TDMS object; one that changes between segments holds both as a text."""

    def __setitem__(self, key: str, value: Any) -> None:
        first, then, _ = str(self.get(key, value)).partition(_THEN)
        changed = then or str(value) != first
        super().__setitem__(key, f"{first}{_THEN}{value}" if changed else value)


@contextmanager
def _changes_kept(reader: Any) -> Iterator[None]:
    """Keep both values of a property that changes while TDMS is read."""
    plain, reader.OrderedDict = reader.OrderedDict, _Properties
    try:
        yield
    finally:
        reader.OrderedDict = plain


_TDMS_TEXTS = ("wf_start_time", "description", "unit_string", "NI_ChannelName")


def _tdms_clock(properties: dict[str, Any], *, own: bool = False) -> StatedClock:
    """Return the clock in properties, in the unit that they state; an increment of 0 is none."""
    kept = {k: v for k, v in properties.items() if k != "wf_increment" or v}
    for key, value in kept.items():
        first, then, _ = str(value).partition(_THEN)
        if then and (key == "wf_start_time" or StatedClock().read(key, [first])):
            message = f"{key} changes between segments: {value}; save each in a file of its own"
            raise ValueError(message)
    kept = {k: v for k, v in kept.items() if k not in _TDMS_TEXTS}
    return stated_clock(kept, own=own)


@contextmanager
def _log_as_problems(log: Any, problems: list[str]) -> Iterator[None]:
    """Turn messages that the reader logs to the screen (a file cut off) into problems."""

    def keep(record: LogRecord) -> bool:
        problems.append(record.getMessage())
        return False

    handler = log.log_manager.console_handler
    handler.addFilter(keep)
    try:
        yield
    finally:
        handler.removeFilter(keep)


TIME_RESPONSE, OVER_TIME = (0, 1), 17


def read_uff(path: Path) -> Recording:
    """Read the time histories (data set 58) of a universal file; the others become problems.

    Raises
    ------
    FileError
        When it holds none.
    """
    import pyuff

    columns: list[FileColumn] = []
    problems: list[str] = []
    file = pyuff.UFF(str(path))
    places = [place for place, kind in enumerate(file.get_set_types()) if int(kind) == 58]
    if not places:
        message = f"{path}: holds no time histories (data set 58); export those"
        raise FileError(message)
    for number, place in enumerate(places, start=1):
        item = file.read_sets(place)
        name = str(item.get("id1", "")).strip()
        name = name if name not in ("", "NONE") else f"record {number}"
        over_time = item.get("abscissa_spec_data_type") in (OVER_TIME, 0)
        over_time &= item.get("func_type") in TIME_RESPONSE
        if not over_time or np.iscomplexobj(item["data"]):
            problems.append(f"channel '{name}' is left out: it is no time history")
            continue
        unit = tidy_unit(str(item.get("ordinate_axis_units_lab", "")))
        label = str(item.get("abscissa_axis_units_lab", "")).strip()
        factor = seconds_of(label) if is_time_unit(label) else 1.0
        time = factor * np.asarray(item["x"], dtype=np.float64)
        columns.append(FileColumn(name, np.asarray(item["data"]), unit, time=time))
    return assemble_recording(columns, source=str(path), problems=problems)


NO_PARQUET_TIME = "give a column 'time' [s], or 'sample_rate' among the metadata of the table"


def read_parquet(path: Path) -> Table:
    """Read the numeric columns of a Parquet file; the others become problems.

    Units are in the column's metadata (`unit`) or its name. The time is a column called time, in
    seconds or as timestamps.

    Parameters
    ----------
    path : Path
        Parquet file.

    Raises
    ------
    FileError
        When it declares too much, or a column holds no time.
    """
    import pyarrow.parquet as pq

    file = pq.ParquetFile(path)
    Declared(path).add(file.metadata.num_rows * file.metadata.num_columns)
    held = file.read()
    columns = []
    for field, column in zip(held.schema, held.columns, strict=True):
        heading = "" if field.name.startswith("__index_level_") else field.name
        name, unit = named_unit(heading, _text_of(field.metadata, "unit"))
        description = _text_of(field.metadata, "description")
        columns.append(TableColumn(name, column.to_numpy(), unit, description))
    # pandas puts its index behind the columns.
    columns.sort(key=lambda column: bool(column.name))
    metadata = held.schema.metadata or {}
    stated = stated_clock(
        {k.decode(errors="replace"): v for k, v in metadata.items() if len(v) < 100}
    )
    return Table(columns, stated, str(path), remedy=NO_PARQUET_TIME)


def _text_of(metadata: Any, key: str) -> str:
    return str((metadata or {}).get(key.encode(), b"").decode("utf-8", "replace"))
