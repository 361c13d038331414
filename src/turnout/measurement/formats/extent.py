"""Limit on the declared size of a recording: a small file must not ask for a large memory.

Compressed, chunked and filled datasets can declare any shape in a few bytes. What a file declares
is added up before its samples are read, and compared with its size.
"""

from pathlib import Path

from turnout.core.errors import FileError

# Of a small file: 8 channels at 20 kHz for 78 s, 100 MB as float64.
MOST_SAMPLES = 12_500_000
# Samples a byte of a larger file: recorded noise seldom compresses to less than 1 byte a sample.
SAMPLES_A_BYTE = 3
MOST_CHANNELS = 10_000
# Memory of a reader beside that of its program, and for each sample that a file may declare [byte].
LEAST_MEMORY = 600_000_000
MEMORY_A_SAMPLE = 40
# Time of a reader, and for each byte of its file [s].
LEAST_SECONDS = 8.0
SECONDS_A_BYTE = 1e-6


def most_samples(size: int) -> int:
    """Return the number of samples that a file of a size [byte] may declare.

    Examples
    --------
    >>> most_samples(1700), most_samples(100_000_000)
    (12500000, 300000000)
    """
    return max(MOST_SAMPLES, SAMPLES_A_BYTE * size)


def most_memory(size: int) -> int:
    """Return the memory that reading a file of a size may take [byte]."""
    return max(LEAST_MEMORY, MEMORY_A_SAMPLE * most_samples(size))


def most_seconds(size: int) -> float:
    """Return the time that reading a file of a size may take [s]."""
    return LEAST_SECONDS + SECONDS_A_BYTE * size


class Declared:
    """The samples that a file declares, added up as its parts are met.

    Parameters
    ----------
    path : Path
        File whose size limits what it may declare.

    Examples
    --------
    >>> declared = Declared(Path(__file__))
    >>> declared.add(10**10)
    Traceback (most recent call last):
    turnout.core.errors.FileError: ...extent.py: declares 10000000000 samples...
    """

    def __init__(self, path: Path) -> None:
        self._path, self._size = path, path.stat().st_size
        self._total = 0

    def add(self, count: int) -> None:
        """Count samples; FileError when they are more than a file of this size may hold."""
        self._total += int(count)
        most = most_samples(self._size)
        if self._total > most:
            message = (
                f"{self._path}: declares {self._total} samples in {self._size} bytes, at most "
                f"{most} are read; export it again, in shorter recordings or uncompressed"
            )
            raise FileError(message)
