"""Laws of a bushing that is soft at first, or has another stiffness in each of its first spans."""

from collections.abc import Mapping, Sequence

import numpy as np

from turnout.calibration.drive_law.candidates import REACH, stiffness_and_level, symmetric_law
from turnout.panel.load import LoadedPanel

# How much softer a bushing is at first, as a logarithm [-], and how far that is expected from this;
# the share of the slip level at which its stretch stays the same, and how far at most its stiffness
# rises for that, as a factor [-].
SOFTNESS, SOFTNESS_SPREAD, SECANT, STIFFEST = 1.4, 0.7, 0.6, 3.0
# A bushing as a table: where its spans end [m], how far the logarithm of the stiffness in one is
# expected from that beyond, and up to which share of the slip level a span may reach [-].
TABLE_ENDS, TABLE_SPREAD, LAST_SPAN = (0.5e-3, 1e-3, 2e-3, 4e-3), 0.7, 0.95


def stiffness_beyond(
    panel: LoadedPanel,
    drive: str,
    values: Mapping[str, float],
    *,
    travel: float,
    softness: float = SOFTNESS,
) -> float:
    r"""Return the stiffness beyond a soft travel that leaves the stretch as it is.

    .. math:: \frac{F}{k} = x + \frac{F - s k' x}{k'}, \quad s = e^{-\text{softness}}

    at a share of the slip level as force `F`; an infinite softness is play.
    """
    stiffness, level = stiffness_and_level(panel, drive, values)
    before = SECANT * level / stiffness
    left = before - (1.0 - float(np.exp(-softness))) * travel
    return stiffness * min(before / max(left, before / STIFFEST), STIFFEST)


def soft_bushing(
    panel: LoadedPanel,
    drive: str,
    values: Mapping[str, float],
    *,
    travel: float,
    softness: float = SOFTNESS,
) -> dict[str, object]:
    """Return a bushing with a part of its stiffness over its first travel, as overrides.

    Parameters
    ----------
    panel : LoadedPanel
        Gives what is not among the values.
    drive : str
        Name of the drive.
    values : mapping of str to float
        By key of the panel, in SI.
    travel : float
        To either side [m].
    softness : float
        Logarithm of how much softer it is there [-].
    """
    if travel < 1e-6:
        return {}
    stiffness, level = stiffness_and_level(panel, drive, values)
    first = min(float(np.exp(-softness)) * stiffness * travel, 0.9 * level)
    knee = travel + (level - first) / stiffness
    return _symmetric_bushing(panel, drive, [(travel, first)], knee=knee, level=level)


def _symmetric_bushing(
    panel: LoadedPanel,
    drive: str,
    points: Sequence[tuple[float, float]],
    *,
    knee: float,
    level: float,
) -> dict[str, object]:
    """Return a bushing through points [m], [N] that slips beyond its knee, alike to either side."""
    last = level + panel.drive[drive].saturated_stiffness * (REACH - knee) + 1.0
    return symmetric_law(drive, [*points, (knee, level), (REACH, last)])


def bushing_table(
    panel: LoadedPanel, drive: str, values: Mapping[str, float], *, softness: Sequence[float]
) -> dict[str, object]:
    r"""Return a bushing with another stiffness in each of its first spans, as overrides.

    .. math:: k_i = k e^{-s_i} \text{ up to } x_i, \quad k \text{ beyond}

    Parameters
    ----------
    panel : LoadedPanel
        Gives what is not among the values.
    drive : str
        Name of the drive.
    values : mapping of str to float
        By key of the panel, in SI.
    softness : sequence of float
        :math:`s_i` of the spans that end at `TABLE_ENDS` [-].
    """
    stiffness, level = stiffness_and_level(panel, drive, values)
    half: list[tuple[float, float]] = []
    x = force = 0.0
    for end, soft in zip(TABLE_ENDS, softness, strict=True):
        k = stiffness * float(np.exp(-soft))
        if force + k * (end - x) >= LAST_SPAN * level:
            break
        x, force = end, force + k * (end - x)
        half.append((x, force))
    slope = (
        stiffness * float(np.exp(-softness[len(half)])) if len(half) < len(softness) else stiffness
    )
    knee = x + (level - force) / slope
    return _symmetric_bushing(panel, drive, half, knee=knee, level=level)
