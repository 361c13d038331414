"""Amplitude of a line of the mains that is steady over a movement."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# A line is looked for in overlapping parts of a movement, of so many periods at least.
PARTS, PERIODS = 4, 10


def steady_amplitude(values: Floats, *, frequency: float, rate: float) -> float:
    """Return the amplitude that a line has throughout: the median over overlapping parts.

    A part is a quarter of the whole, at least ten periods of the line. Of what dies away, as a
    ringing after an impact, most parts hold nothing.

    Examples
    --------
    >>> time = np.arange(3000) / 1000.0
    >>> line = 80.0 * np.sin(2.0 * np.pi * 50.0 * time)
    >>> round(steady_amplitude(line, frequency=50.0, rate=1000.0), 1)
    80.0
    >>> ringing = np.where(time > 1.5, line * np.exp(-(time - 1.5) / 0.15), 0.0)
    >>> steady_amplitude(8.0 * ringing, frequency=50.0, rate=1000.0) < 20.0
    True
    """
    length = min(values.size, max(values.size // PARTS, int(np.ceil(PERIODS * rate / frequency))))
    starts = np.unique(np.linspace(0, values.size - length, 2 * PARTS - 1).astype(int))
    return float(
        np.median(
            [
                line_amplitude(values[start : start + length], frequency=frequency, rate=rate)
                for start in starts
            ]
        )
    )


def line_amplitude(values: Floats, *, frequency: float, rate: float) -> float:
    """Return the amplitude of a line in a spectrum, whatever slower the channel does.

    A slow cubic is taken off first; a Hann window keeps the rest of it away from the line.

    Examples
    --------
    >>> time = np.arange(3000) / 1000.0
    >>> hum = 20.0 * np.sin(2.0 * np.pi * 50.0 * time) + 500.0 * time
    >>> round(line_amplitude(hum, frequency=50.0, rate=1000.0), 2)
    20.0
    """
    index = np.arange(values.size)
    scaled = 2.0 * index / max(1, values.size - 1) - 1.0
    slow = np.polynomial.polynomial.polyfit(scaled, values, 3)
    fast = values - np.polynomial.polynomial.polyval(scaled, slow)
    window = np.hanning(values.size)
    wave = np.exp(-2j * np.pi * frequency / rate * index)
    return float(2.0 * np.abs(np.sum(window * fast * wave)) / np.sum(window))
