"""Readers that a file has taken over: other bytes than an answer, and answers of other classes."""

import os
from fractions import Fraction
from pathlib import Path

import numpy as np

from turnout.measurement.recording import RecordedChannel, Recording

REPLIES = 3
"""Where the process that reads writes its answers: the first that is free behind its errors."""


def recording(label: object = "") -> Recording:
    channel = RecordedChannel("Force", "kN", np.arange(5.0), 25.0)
    return Recording({"Force": channel}, "throw", labels={"made of": label})


def read_sound(path: Path) -> Recording:
    return recording()


def read_foreign(path: Path) -> Recording:
    return recording(Fraction(1, 2))


def read_garbled(path: Path) -> Recording:
    """Answer with the bytes of the file."""
    os.write(REPLIES, path.read_bytes())
    return recording()
