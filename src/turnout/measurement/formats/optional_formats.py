"""Formats that optional packages read: Dewesoft (.d7d, .dxd), MDF (ASAM), TDMS, Parquet."""

from collections.abc import Iterator
from contextlib import contextmanager
from logging import LogRecord
from pathlib import Path
from typing import Any

import numpy as np

from turnout.core.errors import FileError
from turnout.measurement.formats.assemble import (
    RATE_NAME,
    FileColumn,
    assemble_recording,
    is_time_name,
    seconds_of,
    split_unit,
    tidy_unit,
)
from turnout.measurement.formats.extent import Declared
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
                        time = np.asarray(opened.get_master(number), dtype=np.float64)
                    columns.append(_mdf_column(opened, channel.name, (number, place), time))
                except MemoryError:
                    raise
                except Exception as error:  # the reader raises whatever its parts raise
                    problems.append(f"channel '{channel.name}' is left out: {error}")
        start_time = opened.header.start_time.isoformat()
    return assemble_recording(columns, source=str(path), start_time=start_time, problems=problems)


def _mdf_column(opened: Any, name: str, place: tuple[int, int], time: Any) -> FileColumn:
    at = {"group": place[0], "index": place[1]}
    # Without the times, which the group shares and each channel would bring again.
    samples, invalid = opened.get(**at, samples_only=True)
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
    from nptdms import log

    columns: list[FileColumn] = []
    problems: list[str] = []
    start_time = None
    with _log_as_problems(log, problems), nptdms.TdmsFile.open(path) as file:
        groups = file.groups()
        declared = Declared(path)
        for group in groups:
            declared.add(sum(len(channel) for channel in group.channels()))
        for group in groups:
            times = [item[:] for item in group.channels() if is_time_name(item.name)]
            for channel in group.channels():
                name = f"{group.name}/{channel.name}" if len(groups) > 1 else channel.name
                if is_time_name(channel.name):
                    continue
                values = channel[:]
                if np.asarray(values).dtype.kind not in "biuf":
                    problems.append(f"channel '{name}' is left out: it holds no numbers")
                    continue
                columns.append(_tdms_column(name, channel.properties, np.asarray(values), times))
                start_time = start_time or channel.properties.get("wf_start_time")
    return assemble_recording(
        columns,
        source=str(path),
        start_time=str(start_time) if start_time is not None else None,
        problems=problems,
        remedy=NO_TDMS_TIME,
    )


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


def _tdms_column(name: str, properties: Any, values: Any, times: list[Any]) -> FileColumn:
    step = properties.get("wf_increment")
    own = float(step) if step else 0.0
    time = next((item for item in times if len(item) == len(values)), None)
    return FileColumn(
        name,
        values,
        tidy_unit(str(properties.get("unit_string", properties.get("NI_UnitDescription", "")))),
        str(properties.get("description", "")),
        time=None if own > 0 or time is None else np.asarray(time, dtype=np.float64),
        rate=1.0 / own if own > 0 else None,
        start=float(properties.get("wf_start_offset", 0.0)),
    )


NO_PARQUET_TIME = "give a column 'time' [s], or 'sample_rate' among the metadata of the table"


def read_parquet(path: Path) -> Recording:
    """Read the numeric columns of a Parquet file; the others become problems.

    Units are in the column's metadata (`unit`) or its name. The time is a column called time, in
    seconds or as timestamps.

    Raises
    ------
    FileError
        When it declares too much, or a column holds no time.
    """
    import pyarrow.parquet as pq

    file = pq.ParquetFile(path)
    Declared(path).add(file.metadata.num_rows * file.metadata.num_columns)
    table = file.read()
    time, rate, start_time = None, _rate(table), _text_of(table.schema.metadata, "start_time")
    numbers: list[tuple[Any, Any]] = []
    problems: list[str] = []
    for field, column in zip(table.schema, table.columns, strict=True):
        values = column.to_numpy()
        if is_time_name(field.name) and time is None:
            time, first = _seconds(path, field, values)
            start_time = start_time or first
        elif values.dtype.kind in "biuf":
            numbers.append((field, values))
        else:
            problems.append(f"column '{field.name}' is left out: it holds no numbers")
    columns = []
    for field, values in numbers:
        name, unit = split_unit(field.name)
        columns.append(
            FileColumn(
                name,
                values,
                tidy_unit(_text_of(field.metadata, "unit") or unit),
                _text_of(field.metadata, "description") or "",
                time=time,
                rate=rate,
            )
        )
    return assemble_recording(
        columns, source=str(path), start_time=start_time, problems=problems, remedy=NO_PARQUET_TIME
    )


def _seconds(path: Path, field: Any, values: Any) -> tuple[Any, str | None]:
    """Return a time column in seconds, and the moment of its first row if it holds one."""
    if values.dtype.kind == "M":
        return (values - values[0]) / np.timedelta64(1, "s"), str(values[0])
    if values.dtype.kind == "m":
        return values / np.timedelta64(1, "s"), None
    try:
        unit = _text_of(field.metadata, "unit") or split_unit(field.name)[1]
        return values.astype(np.float64) * seconds_of(unit), None
    except (ValueError, TypeError) as error:
        message = f"{path}: column '{field.name}': {error}"
        raise FileError(message) from None


def _rate(table: Any) -> float | None:
    for key, value in (table.schema.metadata or {}).items():
        if RATE_NAME.fullmatch(key.decode(errors="replace")):
            try:
                return float(value)
            except ValueError:
                return None
    return None


def _text_of(metadata: Any, key: str) -> str | None:
    value = (metadata or {}).get(key.encode())
    return value.decode("utf-8", "replace") if value else None
