"""Parquet files: a column a channel, and one with the time."""

from pathlib import Path
from typing import Any

import numpy as np

from turnout.errors import FileError
from turnout.measurement.formats.assemble import (
    RATE_NAME,
    Column,
    assemble,
    is_time_name,
    seconds_of,
    split_unit,
    tidy_unit,
)
from turnout.measurement.formats.extent import Declared
from turnout.measurement.recording import Recording

NO_TIME = "give a column 'time' [s], or 'sample_rate' among the metadata of the table"


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
    time, rate, start_time = None, _rate(table), _told(table.schema.metadata, "start_time")
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
            Column(
                name,
                values,
                tidy_unit(_told(field.metadata, "unit") or unit),
                _told(field.metadata, "description") or "",
                time=time,
                rate=rate,
            )
        )
    return assemble(
        columns, source=str(path), start_time=start_time, problems=problems, remedy=NO_TIME
    )


def _seconds(path: Path, field: Any, values: Any) -> tuple[Any, str | None]:
    """Return a time column in seconds, and the moment of its first row where it tells one."""
    if values.dtype.kind == "M":
        return (values - values[0]) / np.timedelta64(1, "s"), str(values[0])
    if values.dtype.kind == "m":
        return values / np.timedelta64(1, "s"), None
    try:
        unit = _told(field.metadata, "unit") or split_unit(field.name)[1]
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


def _told(metadata: Any, key: str) -> str | None:
    value = (metadata or {}).get(key.encode())
    return value.decode("utf-8", "replace") if value else None
