"""The process in which a Dewesoft file is read, through Dewesoft's own free library.

python -m turnout.measurement.dewesoft_process FILE FOLDER
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from turnout.measurement.handover import Handover, save_fault

SYNCHRONOUS = 0


def convert(file: Path, folder: Path) -> None:
    """Leave the channels of a file in a folder; those that the library cannot give are named."""
    import dwdatareader

    found = Handover()
    try:
        with dwdatareader.DWFile(str(file)) as opened:
            found.start_time = _moment(opened.info)
            for name, channel in opened.items():
                try:
                    _read(name, channel, found)
                except (RuntimeError, AttributeError, ValueError, IndexError) as error:
                    found.leave_out(name, getattr(error, "message", "") or error)
    except dwdatareader.DWError as error:
        save_fault(folder, getattr(error, "message", "") or error)
        return
    found.save(folder)


def _read(name: str, channel: Any, found: Handover) -> None:
    time, values = channel.scaled()
    if np.iscomplexobj(values) or channel.array_size > 1:
        message = "it has several values a sample"
        raise ValueError(message)
    told = {"unit": channel.unit, "description": channel.description}
    if channel.channel_type == SYNCHRONOUS and channel.sample_rate > 0 and len(time):
        rate, start = float(channel.sample_rate), float(time[0])
        found.add(name, values, rate=rate, start=start, **told)
    else:
        found.add(name, values, time=time, **told)


def _moment(info: Any) -> str | None:
    try:
        return str(info.start_store_time.isoformat())
    except (AttributeError, ValueError, OverflowError):
        return None


if __name__ == "__main__":
    convert(Path(sys.argv[1]), Path(sys.argv[2]))
