"""Dewesoft files (.d7d, .dxd), through Dewesoft's own free library."""

from pathlib import Path
from typing import Any

import numpy as np

from turnout.measurement.formats.assemble import Column, assemble, tidy_unit
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

    columns: list[Column] = []
    problems: list[str] = []
    declared = Declared(path)
    with dwdatareader.DWFile(str(path)) as opened:
        start_time = _moment(opened.info)
        for name, channel in opened.items():
            try:
                declared.add(int(channel.number_of_samples) * int(channel.array_size))
                columns.append(_column(name, channel))
            except (RuntimeError, AttributeError, ValueError, IndexError) as error:
                reason = getattr(error, "message", "") or error
                problems.append(f"channel '{name}' is left out: {reason}")
    return assemble(columns, source=str(path), start_time=start_time, problems=problems)


def _column(name: str, channel: Any) -> Column:
    time, values = channel.scaled()
    if np.iscomplexobj(values) or channel.array_size > 1:
        message = "it has several values a sample"
        raise ValueError(message)
    told = (name, values, tidy_unit(channel.unit), channel.description)
    if channel.channel_type == SYNCHRONOUS and channel.sample_rate > 0 and len(time):
        return Column(*told, rate=float(channel.sample_rate), start=float(time[0]))
    return Column(*told, time=time)


def _moment(info: Any) -> str | None:
    try:
        return str(info.start_store_time.isoformat())
    except (AttributeError, ValueError, OverflowError):
        return None
