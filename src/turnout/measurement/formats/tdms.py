"""TDMS files, as LabVIEW writes them."""

from collections.abc import Iterator
from contextlib import contextmanager
from logging import LogRecord
from pathlib import Path
from typing import Any

import numpy as np

from turnout.measurement.formats.assemble import Column, assemble, is_time_name, tidy_unit
from turnout.measurement.formats.extent import Declared
from turnout.measurement.recording import Recording

NO_TIME = "a channel needs wf_increment, or a channel called time in its group"


def read_tdms(path: Path) -> Recording:
    """Read the numeric channels of all groups of a TDMS file; the others become problems.

    Raises
    ------
    FileError
        When it holds no channel or declares too much.
    """
    import nptdms
    from nptdms import log

    columns: list[Column] = []
    problems: list[str] = []
    start_time = None
    with _said(log, problems), nptdms.TdmsFile.open(path) as file:
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
                columns.append(_column(name, channel.properties, np.asarray(values), times))
                start_time = start_time or channel.properties.get("wf_start_time")
    return assemble(
        columns,
        source=str(path),
        start_time=str(start_time) if start_time is not None else None,
        problems=problems,
        remedy=NO_TIME,
    )


@contextmanager
def _said(log: Any, problems: list[str]) -> Iterator[None]:
    """Turn what the reader would log to the screen (a file cut off) into problems."""

    def keep(record: LogRecord) -> bool:
        problems.append(record.getMessage())
        return False

    handler = log.log_manager.console_handler
    handler.addFilter(keep)
    try:
        yield
    finally:
        handler.removeFilter(keep)


def _column(name: str, properties: Any, values: Any, times: list[Any]) -> Column:
    step = properties.get("wf_increment")
    own = float(step) if step else 0.0
    time = next((item for item in times if len(item) == len(values)), None)
    return Column(
        name,
        values,
        tidy_unit(str(properties.get("unit_string", properties.get("NI_UnitDescription", "")))),
        str(properties.get("description", "")),
        time=None if own > 0 or time is None else np.asarray(time, dtype=np.float64),
        rate=1.0 / own if own > 0 else None,
        start=float(properties.get("wf_start_offset", 0.0)),
    )
