"""Dewesoft files (.d7d, .dxd)."""

from pathlib import Path

from turnout.measurement.isolated import read_isolated
from turnout.measurement.optional import require
from turnout.measurement.recording import Recording


def read_dewesoft(path: Path) -> Recording:
    """Read a Dewesoft file.

    Channels that Dewesoft's library cannot give (CAN messages, binary data) become problems, one
    by one; all others are read.

    Raises
    ------
    FileError
        When it is damaged, or the library is not installed.
    """
    require("dwdatareader", extra="daq", purpose=f"{path}: Dewesoft files", load=False)
    return read_isolated(path, module="turnout.measurement.dewesoft_process", kind="Dewesoft")
