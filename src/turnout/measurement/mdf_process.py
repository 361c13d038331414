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
                master = opened.masters_db.get(number)
                for place, channel in enumerate(group.channels):
                    if place == master:
                        continue
                    try:
                        _read(opened.get(group=number, index=place), found)
                    except Exception as error:  # the reader raises whatever its parts raise
                        found.leave_out(channel.name, error)
    except Exception as error:
        save_fault(folder, error)
        return
    found.save(folder)


def _read(signal: Any, found: Handover) -> None:
    samples = np.asarray(signal.samples)
    if samples.dtype.kind not in "biuf" or samples.ndim != 1:
        message = "it holds no single numbers"
        raise ValueError(message)
    values = samples.astype(np.float64)
    if signal.invalidation_bits is not None:
        values = np.where(np.asarray(signal.invalidation_bits, dtype=bool), np.nan, values)
    found.add(
        signal.name,
        values,
        unit=signal.unit or "",
        description=str(signal.comment or ""),
        time=np.asarray(signal.timestamps, dtype=np.float64),
    )


if __name__ == "__main__":
    convert(Path(sys.argv[1]), Path(sys.argv[2]))
