"""Write recordings in the formats that other programs read, whole or not at all."""

from collections.abc import Callable
from pathlib import Path

from turnout.errors import FileError
from turnout.files.atomic import write_atomic
from turnout.measurement.hdf5 import hdf5_bytes
from turnout.measurement.mat import mat_bytes
from turnout.measurement.recording import Recording
from turnout.measurement.text import csv_bytes

WRITERS: dict[str, Callable[[Recording], bytes]] = {
    ".csv": csv_bytes,
    ".mat": mat_bytes,
    ".h5": hdf5_bytes,
}


def write_recording(recording: Recording, path: Path | str) -> None:
    """Write a recording; the suffix tells the format.

    Parameters
    ----------
    recording : Recording
        At least one channel.
    path : path-like
        Ends in .csv (as DewesoftX exports it), .mat (version 5) or .h5; a file there is replaced.

    Raises
    ------
    FileError
        When it cannot be written; nothing half-written stays behind.
    MeasurementError
        When the format cannot hold the recording.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from turnout.measurement.read import read_recording
    >>> from turnout.measurement.recording import Channel
    >>> file = Path(tempfile.mkdtemp()) / "throw.mat"
    >>> rod = Channel("Rod 1", "mV/V", np.array([0.1, 0.2]), rate=1000.0)
    >>> write_recording(Recording({"Rod 1": rod}, "a test"), file)
    >>> read_recording(file).channel("Rod 1").unit
    'mV/V'
    """
    path = Path(path)
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        message = f"{path}: the name must end in {' or '.join(WRITERS)}"
        raise FileError(message)
    write_atomic(path, writer(recording))
