"""Readable ticks on logarithmic axes."""

import math

from matplotlib.axes import Axes

from benchmarks.machine import figure


def plain_ticks(low: float, high: float) -> list[float]:
    """Return 1, 2, 5, 10 ... within a range, thinned to powers of ten if it is wide.

    Examples
    --------
    >>> plain_ticks(0.9, 12.0)
    [1.0, 2.0, 5.0, 10.0]
    >>> plain_ticks(0.9, 1200.0)
    [1.0, 10.0, 100.0, 1000.0]
    """
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = (1, 2, 5) if high / low < 100 else (1,)
    ticks = [float(f"{step}e{power}") for power in powers for step in steps]
    return [tick for tick in ticks if low <= tick <= high]


def label_times(ax: Axes, low: float, high: float) -> None:
    """Give the x axis plain ticks between two values."""
    ticks = plain_ticks(low, high)
    ax.set_xlim(low, high)
    ax.set_xticks(ticks, [figure(tick) for tick in ticks])
    ax.minorticks_off()
