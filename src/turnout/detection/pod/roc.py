r"""Detections against false alarms: of a test campaign, and of the bound for the same objects.

A detector's curve comes from its responses: for each threshold the share of sound throws and the
share of throws with objects that reach it. The bound's curve is :math:`\Phi(d - z(\alpha))`, the
mean over states and over the sizes of the campaign. No detector lies above it beyond chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import norm

from turnout.core.errors import StudyError
from turnout.core.problems import choices
from turnout.detection.alarm_threshold import share_interval
from turnout.detection.pod.pod_table import TestThrows

Floats = NDArray[np.float64]

RATES = np.concatenate([np.logspace(-6.0, -1.0, 41), np.linspace(0.15, 0.95, 17)])
"""False-alarm rates at which the bound is given [-]."""
DEVIATES = norm.isf(RATES)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roc:
    """Curves of a campaign and of the bound.

    Attributes
    ----------
    false_alarms, detections : ndarray, shape (n_points,)
        Shares of the detector, by falling threshold [-].
    intervals : ndarray, shape (n_points, 2)
        95 % of the detections (Clopper-Pearson) [-].
    rate, bound : ndarray, shape (n_rates,)
        Of the bound [-].
    sound, objects : int
        Throws of the campaign.
    place : str
        Whose bound it is.
    """

    false_alarms: Floats
    detections: Floats
    intervals: Floats
    rate: Floats
    bound: Floats
    sound: int
    objects: int
    place: str


def campaign_roc(
    throws: TestThrows, limit: xr.Dataset, *, place: str, channel: str = "both drives"
) -> Roc:
    """Return the curves of a campaign at one place.

    Parameters
    ----------
    throws : TestThrows
        With sound throws; hits and misses give one point.
    limit : xarray.Dataset
        From `limit_map`, of the same switch.
    place : str
        Where the objects were.
    channel : str
        Of the map.

    Raises
    ------
    StudyError
        Without sound throws, or for a place that the map does not have.
    """
    sound, objects = throws.size == 0.0, throws.size > 0.0
    faults = []
    if not sound.any() or not objects.any():
        faults.append("has no sound throws, or none with objects: a curve needs both")
    if limit.attrs.get("kind") != "limit" or "index_quantile" not in limit:
        faults.append("the bound is no map of `turnout limit -o limit.nc` of this version")
    elif place not in limit["place"]:
        names = choices([str(name) for name in limit["place"].to_numpy()])
        faults.append(f'place "{place}": the map has {names}')
    if faults:
        raise StudyError(faults, source=throws.source)
    if throws.response is not None:
        score = np.nan_to_num(throws.response, nan=-np.inf)
    else:
        assert throws.hit is not None
        score = throws.hit.astype(np.float64)
    false, seen, intervals = _points(score[sound], score[objects])
    bound = bound_curve(limit, throws.size[objects], place=place, channel=channel)
    return Roc(
        false_alarms=false, detections=seen, intervals=intervals, rate=RATES, bound=bound,
        sound=int(sound.sum()), objects=int(objects.sum()), place=place,
    )  # fmt: skip


def _points(sound: Floats, objects: Floats) -> tuple[Floats, Floats, Floats]:
    """Return shares that reach each threshold, from the highest on."""
    thresholds = np.unique(np.concatenate([sound, objects]))[::-1]
    thresholds = thresholds[np.isfinite(thresholds)]
    count = np.array([np.count_nonzero(objects >= level) for level in thresholds])
    false = np.array([np.count_nonzero(sound >= level) for level in thresholds]) / sound.size
    interval = np.column_stack(share_interval(count, objects.size))
    return false, count / objects.size, interval


def bound_curve(
    limit: xr.Dataset, sizes: Sequence[float] | Floats, *, place: str, channel: str
) -> Floats:
    """Return the share of objects of some sizes that the bound detects at each of `RATES`.

    Parameters
    ----------
    limit : xarray.Dataset
        With `index_quantile`: quantiles of the index of detection over states.
    sizes : array_like, shape (n,)
        [m]
    place, channel : str
        Of the map.
    """
    at = limit["index_quantile"].sel(place=place, channel=channel)
    known = at["size"].to_numpy()
    found = np.zeros(RATES.size)
    for size in np.asarray(sizes, dtype=np.float64):
        index = np.array([np.interp(size, known, row) for row in at.to_numpy()])
        found += norm.cdf(index[:, np.newaxis] - DEVIATES).mean(axis=0)
    return found / len(sizes)


def index_quantiles(pod: Floats, *, false_alarm_rate: float, count: int = 20) -> Floats:
    """Return quantiles of the index over states, from probabilities of detection.

    Parameters
    ----------
    pod : ndarray, shape (n_channels, n_states, n_places, n_sizes)
        [-]
    false_alarm_rate : float
        At which they hold [-].
    count : int
        Of quantiles, in the middles of equal shares.

    Returns
    -------
    ndarray, shape (count, n_channels, n_places, n_sizes)

    Examples
    --------
    >>> index_quantiles(np.full((1, 3, 1, 1), 0.5), false_alarm_rate=1e-3, count=1).round(2).item()
    3.09
    """
    index = np.clip(ndtri(np.clip(pod, 1e-12, 1.0 - 1e-12)) + norm.isf(false_alarm_rate), 0.0, None)
    shares = (np.arange(count) + 0.5) / count
    return np.asarray(np.quantile(index, shares, axis=1))
