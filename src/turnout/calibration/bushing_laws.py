"""Laws of drives that a panel does not state: bushings soft at first or before they slip, lags."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from turnout.calibration.evaluate import Response
from turnout.panel.load import LoadedPanel

# A table must reach as far as any bushing is stretched [m], and rise even within play [N].
REACH, PLAY_FORCE = 1.0, 1.0
# How much softer a bushing is at first, as a logarithm [-], and how far that is expected from this;
# the share of the slip level at which its stretch stays the same, and how far at most its stiffness
# rises for that, as a factor [-].
SOFTNESS, SOFTNESS_SPREAD, SECANT, STIFFEST = 1.4, 0.7, 0.6, 3.0
# A bushing as a table: where its spans end [m], how far the logarithm of the stiffness in one is
# expected from that beyond, and up to which share of the slip level a span may reach [-].
TABLE_ENDS, TABLE_SPREAD, LAST_SPAN = (0.5e-3, 1e-3, 2e-3, 4e-3), 0.7, 0.95


def stiffness_key(drive: str) -> str:
    """Return the panel's key of a drive's stiffness."""
    return f"drive.{drive}.stiffness"


def level_key(drive: str) -> str:
    """Return the panel's key of a drive's slip level."""
    return f"drive.{drive}.saturation_force"


def stiffness_and_level(
    panel: LoadedPanel, drive: str, values: Mapping[str, float]
) -> tuple[float, float]:
    """Return stiffness [N/m] and slip level [N] of a drive; the panel gives what has no value."""
    record = panel.drive[drive]
    stiffness = values.get(stiffness_key(drive), record.stiffness)
    return stiffness, values.get(level_key(drive), record.saturation_force)


def bushing(
    panel: LoadedPanel,
    drive: str,
    values: Mapping[str, float],
    *,
    first: Sequence[tuple[float, float]] = (),
    softness: float = 0.0,
    knee: float = 0.0,
    knee_softness: float = 0.0,
) -> dict[str, object]:
    r"""Return the elastic law of a drive as overrides: a table of extension and force.

    Alike in tension and compression: through the first points, then with :math:`k e^{-s}`, over the
    last share of the slip level with :math:`e^{-s'}` of that, and beyond it as the panel slips.

    Parameters
    ----------
    panel : LoadedPanel
        Gives what is not among the values.
    drive : str
        Name of the drive in the panel, such as "2".
    values : mapping of str to float
        By key of the panel, in SI.
    first : sequence of (float, float)
        Points in tension, below the slip level [m], [N].
    softness, knee_softness : float
        :math:`s` and :math:`s'` [-].
    knee : float
        Share of the slip level over which the bushing is softer [-].

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> made = bushing(load_panel("sb1"), "2", {}, first=[(0.001, PLAY_FORCE)])
    >>> [round(1e3 * x, 2) for x in made["drive.2.extension"]][3:5]
    [1.0, 8.41]
    """
    stiffness, level = stiffness_and_level(panel, drive, values)
    half = list(first)
    x, force = half[-1] if half else (0.0, 0.0)
    k = stiffness * float(np.exp(-softness))
    if knee > 0.0:
        soft = (1.0 - knee) * level
        if soft > force:
            x, force = x + (soft - force) / k, soft
            half.append((x, force))
        k *= float(np.exp(-knee_softness))
    x += (level - force) / k
    last = level + panel.drive[drive].saturated_stiffness * (REACH - x) + PLAY_FORCE
    half += [(x, level), (REACH, last)]
    both = [*((-x, -f) for x, f in reversed(half)), *half]
    return {
        f"drive.{drive}.extension": [x for x, _ in both],
        f"drive.{drive}.force": [f for _, f in both],
    }


def lagged(response: Response, drive: str, *, lag: float) -> Response:
    r"""Return a response in which a drive's force follows with a lag once an object is touched.

    .. math:: \dot F_m = (F - F_m) / \tau

    Parameters
    ----------
    response : Response
        As simulated, on even times.
    drive : str
        Whose force lags.
    lag : float
        Time constant [s].

    Returns
    -------
    Response
        The same one where nothing is touched, or without a lag.
    """
    if lag <= 0 or response.failure or not np.isfinite(response.contact_time):
        return response
    from scipy.signal import lfilter  # loads slowly, and few fits try a lag

    start = int(np.searchsorted(response.time, response.contact_time))
    if start >= response.time.size - 1:
        return response
    force = response.drive_force[drive].copy()
    step = float(response.time[1] - response.time[0])
    kept = float(np.exp(-step / lag))
    begin = force[max(start - 1, 0)]
    force[start:], _ = lfilter([1.0 - kept], [1.0, -kept], force[start:], zi=[kept * begin])
    return replace(response, drive_force={**response.drive_force, drive: force})


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
    return bushing(panel, drive, values, first=[(travel, first)])


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
    beyond = softness[len(half)] if len(half) < len(softness) else 0.0
    return bushing(panel, drive, values, first=half, softness=beyond)
