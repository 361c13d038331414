r"""How much of a measurement a band of 95 % must cover: what a right model shows by chance.

Instants of a movement are not independent: its friction moves all of them together, and an error of
a parameter those of all movements. So a right model covers 95 % in the mean over campaigns, and
more or less in one of them. Campaigns are drawn from what the band is made of,

.. math:: y - m = J z_p + \sum_s \sigma_s a_s J_s + r, \quad a_s^2 = \nu_s / \chi^2(\nu_s),

with the uncertainty of the values and of the chain, common to all movements, what differs from
throw to throw, of the size that `nu` degrees of freedom leave it, and a rest `r` that decays
exponentially over time. Mean and variance of their coverage give the number of independent
instants that it is worth, :math:`n = c (1 - c) / v - 1`, and a beta distribution its limit.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import beta

Floats = NDArray[np.float64]
# Campaigns that are drawn, so many at a time, and the seed of their chance.
DRAWS, AT_ONCE, SEED = 400, 40, 20261123
# A right model is refused for the band of one of its channels in one campaign of twenty.
RISK = 0.05
# So much is always enough: repeats do not show what solvers of the same mechanics differ by.
ENOUGH = 0.90


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandParts:
    """What a band of 95 % is made of, over the movements that are judged.

    Attributes
    ----------
    reach : ndarray, shape (n_channels, n_movements, n_times)
        Half the band; NaN where nothing was measured [N].
    common : ndarray, shape (k, n_channels, n_movements, n_times)
        What one standard deviation of each error that all movements share makes of forces [N].
    own : ndarray, shape (s, n_channels, n_movements, n_times)
        What one standard deviation of what a throw has of its own makes of them [N].
    freedom : ndarray, shape (s,)
        Degrees of freedom from which the size of these is known.
    rest : ndarray, shape (n_channels,)
        Standard deviation of what is left [N].
    decay : ndarray, shape (n_channels,)
        Instants in which it decays to a third.
    """

    reach: Floats
    common: Floats
    own: Floats
    freedom: Floats
    rest: Floats
    decay: Floats


def coverage_limits(parts: BandParts) -> tuple[Floats, Floats]:
    """Return the least coverage that is accepted of each channel, and what it rests on.

    Parameters
    ----------
    parts : BandParts
        Of the movements that are judged.

    Returns
    -------
    limit, samples : ndarray, shape (n_channels,)
        Share of the measured instants, and the number of independent ones that they are worth; NaN
        for a channel without any.

    Examples
    --------
    Noise alone, a thousand instants:

    >>> parts = BandParts(
    ...     reach=np.full((1, 4, 250), 1.96), common=np.zeros((0, 1, 4, 250)),
    ...     own=np.zeros((0, 1, 4, 250)), freedom=np.zeros(0), rest=np.ones(1), decay=np.zeros(1))
    >>> limit, samples = coverage_limits(parts)
    >>> bool(800 < samples[0] < 1250), float(limit[0])
    (True, 0.9)
    """
    covers = _drawn_covers(parts)
    mean, variance = covers.mean(axis=0), covers.var(axis=0, ddof=1)
    known = np.isfinite(mean)
    limit, samples = np.full(mean.size, np.nan), np.full(mean.size, np.nan)
    for number in np.flatnonzero(known):
        # Without any chance all of the measurement is covered.
        worth = np.inf
        if variance[number] > 0.0:
            worth = max(mean[number] * (1.0 - mean[number]) / variance[number] - 1.0, 1e-3)
        samples[number] = worth
        limit[number] = ENOUGH
        if np.isfinite(worth):
            least = beta.ppf(RISK / known.sum(), mean[number] * worth, (1.0 - mean[number]) * worth)
            limit[number] = min(float(least), ENOUGH)
    return limit, samples


def _drawn_covers(parts: BandParts) -> Floats:
    """Return the coverage of each channel in campaigns of a right model, shape (n, n_channels)."""
    rng = np.random.default_rng(SEED)
    known = np.isfinite(parts.reach)
    count = known.sum(axis=(1, 2)).astype(np.float64)
    reach = np.where(known, parts.reach, -1.0)
    common, own = np.nan_to_num(parts.common), np.nan_to_num(parts.own)
    movements = reach.shape[1]
    freedom = parts.freedom
    found = []
    for _ in range(0, DRAWS, AT_ONCE):
        away = _decaying(rng, (AT_ONCE, *reach.shape), parts)
        away += np.tensordot(rng.standard_normal((AT_ONCE, len(common))), common, axes=1)
        if len(own):
            sizes = np.sqrt(freedom / rng.chisquare(freedom, (AT_ONCE, len(own))))
            amounts = sizes[:, :, None] * rng.standard_normal((AT_ONCE, len(own), movements))
            away += np.einsum("nsm,scmt->ncmt", amounts, own)
        within = (np.abs(away) <= reach).sum(axis=(2, 3))
        found.append(np.divide(within, count, out=np.full(within.shape, np.nan), where=count > 0))
    return np.concatenate(found)


def _decaying(
    rng: np.random.Generator, shape: tuple[int, int, int, int], parts: BandParts
) -> Floats:
    """Return a rest with a correlation that decays exponentially over time."""
    rows = rng.standard_normal(shape)
    for channel, (size, length) in enumerate(zip(parts.rest, parts.decay, strict=True)):
        kept = float(np.exp(-1.0 / length)) if length > 0.0 else 0.0
        series = rows[:, channel]
        if kept:
            series[..., 1:] *= np.sqrt(1.0 - kept**2)
            series = lfilter([1.0], [1.0, -kept], series, axis=-1)
        rows[:, channel] = size * series
    return np.asarray(rows, dtype=np.float64)
