"""The process in which an MDF file is read.

python -m turnout.measurement.mdf_process FILE FOLDER
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from turnout.measurement.handover import Handover, save_fault


def convert(file: Path, folder: Path) -> None:
    """Leave the numeric channels of all groups of a file in a folder; the others are named."""
    import asammdf

    found = Handover()
    try:
        with asammdf.MDF(file) as opened:
            found.start_time = opened.header.start_time.isoformat()
            groups: Any = opened.groups
            for number, group in enumerate(groups):
                master, time = opened.masters_db.get(number), None
                for place, channel in enumerate(group.channels):
                    if place == master:
                        continue
                    try:
                        if time is None:
                            time = np.asarray(opened.get_master(number), dtype=np.float64)
                        _read(opened, channel.name, (number, place), time, found)
                    except Exception as error:  # the reader raises whatever its parts raise
                        found.leave_out(channel.name, error)
    except Exception as error:
        save_fault(folder, error)
        return
    found.save(folder)


def _read(opened: Any, name: str, place: tuple[int, int], time: Any, found: Handover) -> None:
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
    found.add(
        name,
        values,
        unit=str(opened.get_channel_unit(**at) or ""),
        description=str(opened.get_channel_comment(**at) or ""),
        time=time,
    )


if __name__ == "__main__":
    convert(Path(sys.argv[1]), Path(sys.argv[2]))
