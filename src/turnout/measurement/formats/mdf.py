"""MDF files (.mf4, .mdf), the format of automotive measurement (ASAM)."""

from pathlib import Path
from typing import Any

import numpy as np

from turnout.measurement.formats.assemble import Column, assemble, tidy_unit
from turnout.measurement.formats.extent import Declared
from turnout.measurement.recording import Recording


def read_mdf(path: Path) -> Recording:
    """Read the numeric channels of all groups of an MDF file; the others become problems.

    Raises
    ------
    FileError
        When it holds no channel or declares too much.
    """
    import asammdf

    columns: list[Column] = []
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
                    columns.append(_column(opened, channel.name, (number, place), time))
                except MemoryError:
                    raise
                except Exception as error:  # the reader raises whatever its parts raise
                    problems.append(f"channel '{channel.name}' is left out: {error}")
        start_time = opened.header.start_time.isoformat()
    return assemble(columns, source=str(path), start_time=start_time, problems=problems)


def _column(opened: Any, name: str, place: tuple[int, int], time: Any) -> Column:
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
    return Column(name, values, unit, str(opened.get_channel_comment(**at) or ""), time=time)
