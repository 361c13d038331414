"""MDF files (.mf4, .mdf), the format of automotive measurement (ASAM)."""

from pathlib import Path

from turnout.measurement.isolated import read_isolated
from turnout.measurement.optional import require
from turnout.measurement.recording import Recording


def read_mdf(path: Path) -> Recording:
    """Read the numeric channels of all groups of an MDF file; the others become problems.

    Raises
    ------
    FileError
        When it is damaged, or the reader is not installed.
    """
    require("asammdf", extra="daq", purpose=f"{path}: MDF files", load=False)
    return read_isolated(path, module="turnout.measurement.mdf_process", kind="MDF")
