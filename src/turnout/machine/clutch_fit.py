"""Slip current of a clutch, and how it changes from movement to movement as the clutch wears."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import MachineError
from turnout.machine.current_fit import BLOCK, Estimate

Floats = NDArray[np.float64]

LEAST_TREND = 5
"""Movements in which a clutch slipped, without which no trend is stated."""
BLOCKS, SHORTEST_BLOCK = 4, 10
"""A span is cut into at least so many blocks, unless they would be shorter than so many samples:
those of a moving average over 0.1 s repeat each other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SlipLevel:
    """Current of one movement while the clutch slips.

    Attributes
    ----------
    name : str
        Of the movement.
    number : int
        Its place among the movements of the campaign.
    current, deviation : float
        Mean of the slipping span and its standard deviation, from blocks of half a second or, in
        a short span, of a quarter of it [A].
    blocks : int
        So many blocks; 2 where the span is too short for them.
    held : float
        Force that the standing gear holds meanwhile, NaN where none was measured [N].
    """

    name: str
    number: int
    current: float
    deviation: float
    blocks: int
    held: float


def slip_level(name: str, *, number: int, current: Floats, held: Floats | None) -> SlipLevel:
    """Return the mean current of a slipping span, at every `STEP`.

    A span of less than 0.2 s counts as one value with the scatter of its samples.

    Raises
    ------
    MachineError
        With fewer than two samples.
    """
    if current.size < 2:
        text = f"{name}: {current.size} sample of slip current shows no scatter; needs at least two"
        raise MachineError([text], source="slip current")
    length = min(BLOCK, max(current.size // BLOCKS, SHORTEST_BLOCK))
    blocks = [current[k : k + length].mean() for k in range(0, current.size - length + 1, length)]
    deviation = float(np.std(current, ddof=1))
    if len(blocks) > 1:
        deviation = float(np.std(blocks, ddof=1) / math.sqrt(len(blocks)))
    return SlipLevel(
        name=name,
        number=number,
        current=float(current.mean()),
        deviation=deviation,
        blocks=max(len(blocks), 2),
        held=float(np.mean(held)) if held is not None else math.nan,
    )


def slip_estimate(levels: Sequence[SlipLevel]) -> Estimate | None:
    """Return the mean slip current of some movements; None without any.

    One movement gives the interval of its own span only.
    """
    if not levels:
        return None
    currents = np.array([level.current for level in levels])
    if currents.size == 1:
        alone = levels[0]
        return replace(Estimate.of(alone.current, alone.deviation, alone.blocks), count=1)
    deviation = float(currents.std(ddof=1) / math.sqrt(currents.size))
    return Estimate.of(float(currents.mean()), deviation, currents.size)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClutchTrend:
    """How the slip current of a clutch changes from movement to movement.

    Attributes
    ----------
    per_throw : Estimate
        Change per movement of the campaign [A].
    share : Estimate or None
        The same over the current that the clutch's torque takes, slip current less idle
        current [1]; None without idle current.
    changes : bool
        Whether the 95 % interval excludes no change.
    """

    per_throw: Estimate
    share: Estimate | None
    changes: bool


def clutch_trend(levels: Sequence[SlipLevel], *, idle: float | None) -> ClutchTrend | None:
    """Return the trend of the slip current; None from fewer than five movements.

    Parameters
    ----------
    levels : sequence of SlipLevel
    idle : float or None
        Current without force [A].

    Examples
    --------
    >>> levels = [SlipLevel(name="", number=n, current=2.0 - 0.01 * n + 1e-4 * (-1)**n,
    ...                     deviation=1e-3, blocks=9, held=6e3) for n in range(6)]
    >>> trend = clutch_trend(levels, idle=0.8)
    >>> round(trend.per_throw.value, 3), trend.changes
    (-0.01, True)
    """
    if len(levels) < LEAST_TREND:
        return None
    number = np.array([level.number for level in levels], dtype=np.float64)
    current = np.array([level.current for level in levels])
    centred = number - number.mean()
    squares = float(centred @ centred)
    slope = float(centred @ current) / squares
    rest = current - current.mean() - slope * centred
    deviation = math.sqrt(float(rest @ rest) / (number.size - 2) / squares)
    per_throw = Estimate.of(slope, deviation, number.size - 1)
    share = None
    if idle is not None:
        first = float(current.mean() - slope * (number.mean() - number.min())) - idle
        if first > 0.0:  # else the idle current is not one of this clutch
            share = Estimate.of(slope / first, deviation / first, number.size - 1)
    return ClutchTrend(
        per_throw=per_throw, share=share, changes=per_throw.low > 0.0 or per_throw.high < 0.0
    )
