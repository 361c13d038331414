r"""Bands of a prediction: scatter from throw to throw, coverage by chance, places left out.

Instants of a movement are not independent: its friction moves all of them together, and an error of
a parameter those of all movements. So a right model covers 95 % in the mean over campaigns, and
more or less in one of them. Campaigns are drawn from the parts of the band,

.. math:: y - m = J z_p + \sum_s \sigma_s a_s J_s + r, \quad a_s^2 = \nu_s / \chi^2(\nu_s),

with the uncertainty of the values and of the chain, common to all movements, the scatter from throw
to throw, of the size that `nu` degrees of freedom leave it, and a rest `r` that decays
exponentially over time. Mean and variance of their coverage give the number of independent
instants that it is worth, :math:`n = c (1 - c) / v - 1`, and a beta distribution its limit.

A fit that has seen every movement says nothing of places that it has not. To first order about it,
with the slopes `J` of the forces with the values, their weights `W` and what was measured less what
is predicted, `r`, the values without the movements of a place `p` are

.. math:: \theta_p = \theta - (H - H_p)^{-1} (J_p^T W_p r_p - H_p d), \quad
          H = \sum_q J_q^T W_q J_q, \quad H d = \sum_q J_q^T W_q r_q

(Cook and Weisberg 1982, Residuals and Influence in Regression, equation 3.4.4, for groups), which
is exact for a linear model. There `d` is zero, as the values fit best; for others it keeps what the
place did to the fit apart from an error of the values, which so stays in each prediction as it is:
without `d` it would grow by :math:`(H - H_p)^{-1} H`.

What moves all instants of a movement together, `S`, such as its own friction, is in its weight,
:math:`W = (R + S S^T)^{-1}` with the variance `R` of the rest. The covariance of the values grows
from `C` by the information that is lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.stats import beta

Floats = NDArray[np.float64]
# A direction is identified where its expected scatter moves forces by at least so many noises.
LEAST_ANSWER = 0.5
# Correlation of neighbouring instants of the rest, at most [-].
MOST_ALIKE = 0.99


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrowScatter:
    """Standard deviations from throw to throw, found from repeats.

    Attributes
    ----------
    own : ndarray, shape (s, n_channels, n_movements, n_times)
        What one standard deviation of each thing that a throw has of its own makes of forces [N].
    sizes, freedom : ndarray, shape (s,)
        These standard deviations, each in its unit, and their degrees of freedom, one for what was
        expected among them.
    rest, decay : ndarray, shape (n_channels,)
        What is left of the difference between repeats, noise among it [N], and the instants in
        which it decays to a third.
    """

    own: Floats
    sizes: Floats
    freedom: Floats
    rest: Floats
    decay: Floats

    @property
    def variance(self) -> Floats:
        """Of one throw about the mean of its like, by channel, movement and time [N^2]."""
        return np.asarray(self.rest[:, None, None] ** 2 + (self.own**2).sum(axis=0))


def scatter_of(
    measured: Floats,
    slopes: Floats,
    expected: Sequence[float],
    *,
    groups: Sequence[Sequence[int]],
    noise: Floats,
) -> ThrowScatter:
    """Find from repeats how much a throw differs from the next.

    The difference of each repeat from the mean of its like is written as a sum of slopes; what no
    such sum explains is the rest. Expected sizes count like one more repeat, so that few repeats
    that happen to agree do not make a prediction look sure.

    Parameters
    ----------
    measured : ndarray, shape (n_channels, n_movements, n_times)
        [N]; NaN where nothing was measured.
    slopes : ndarray, shape (s, n_channels, n_movements, n_times)
        Of the forces with each thing that a throw may have of its own [N over its unit].
    expected : sequence of float, length s
        Standard deviation of each from throw to throw before repeats are seen.
    groups : sequence of sequence of int
        Movements that are equal by the sheet.
    noise : ndarray, shape (n_channels,)
        Of a bin, which the rest is never below [N].

    Returns
    -------
    ThrowScatter

    Examples
    --------
    >>> measured = np.array([[[3.0] * 4, [1.0] * 4]])
    >>> found = scatter_of(
    ...     measured, np.ones((1, 1, 2, 4)), [1.4142], groups=[[0, 1]], noise=np.array([0.1])
    ... )
    >>> found.sizes.round(3).tolist()
    [1.414]
    """
    squares, freedom = np.square(expected), np.ones(len(expected))
    left, samples, following = np.zeros((3, noise.size))
    for group in groups:
        lost = (len(group) - 1.0) / len(group)
        mean = measured[:, list(group)].mean(axis=1)
        for number in group:
            difference = measured[:, number] - mean
            amounts, identified = _explained(difference, slopes[:, :, number], expected, noise)
            squares += np.where(identified, amounts**2, 0.0)
            freedom += np.where(identified, lost, 0.0)
            rest = difference - np.tensordot(amounts, np.nan_to_num(slopes[:, :, number]), axes=1)
            known = np.isfinite(rest) & np.isfinite(slopes[:, :, number]).all(axis=0)
            rest = np.where(known, rest, 0.0)
            left += (rest**2).sum(axis=1)
            following += (rest[:, 1:] * rest[:, :-1]).sum(axis=1)
            samples += lost * known.sum(axis=1)
    sizes = np.sqrt(squares / freedom)
    found = np.sqrt(np.divide(left, samples, out=noise**2, where=samples > 0))
    alike = np.divide(following, left, out=np.zeros_like(left), where=left > 0.0)
    return ThrowScatter(
        own=sizes[:, None, None, None] * slopes,
        sizes=sizes,
        freedom=freedom,
        rest=np.maximum(found, noise),
        decay=-1.0 / np.log(np.clip(alike, 1e-12, MOST_ALIKE)),
    )


def _explained(
    difference: Floats, slopes: Floats, expected: Sequence[float], noise: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the share of each slope in a difference, and which are identified."""
    there = np.isfinite(difference) & np.isfinite(slopes).all(axis=0)
    rows = np.where(there, slopes / noise[:, None], 0.0).reshape(len(slopes), -1)
    answer = np.sqrt((rows**2).sum(axis=1) / max(int(there.sum()), 1)) * expected
    identified = answer > LEAST_ANSWER
    amounts = np.zeros(len(slopes))
    target = np.where(there, difference / noise[:, None], 0.0).ravel()
    amounts[identified] = np.linalg.lstsq(rows[identified].T, target, rcond=1e-6)[0]
    return amounts, identified


# Campaigns that are drawn, so many at a time, and the seed of their chance.
DRAWS, AT_ONCE, SEED = 400, 40, 20261123
# A right model is refused for the band of one of its channels in one campaign of twenty.
RISK = 0.05
# So much is always enough: repeats do not show what solvers of the same mechanics differ by.
ENOUGH = 0.90


def coverage_limits(reach: Floats, common: Floats, scatter: ThrowScatter) -> tuple[Floats, Floats]:
    """Return the least coverage that is accepted of each channel, and what it rests on.

    Parameters
    ----------
    reach : ndarray, shape (n_channels, n_movements, n_times)
        Half the 95 % band of the movements that are judged; NaN where nothing was measured [N].
    common : ndarray, shape (k, n_channels, n_movements, n_times)
        What one standard deviation of each error that all movements share makes of forces [N].
    scatter : ThrowScatter
        Of the same movements.

    Returns
    -------
    limit, samples : ndarray, shape (n_channels,)
        Share of the measured instants, and the number of independent ones that they are worth; NaN
        for a channel without any.

    Examples
    --------
    Noise alone, a thousand instants:

    >>> none = np.zeros((0, 1, 4, 250))
    >>> noise = ThrowScatter(
    ...     own=none, sizes=np.zeros(0), freedom=np.zeros(0), rest=np.ones(1), decay=np.zeros(1)
    ... )
    >>> limit, samples = coverage_limits(np.full((1, 4, 250), 1.96), none, noise)
    >>> bool(800 < samples[0] < 1250), float(limit[0])
    (True, 0.9)
    """
    covers = _drawn_covers(reach, np.nan_to_num(common), scatter)
    mean, variance = covers.mean(axis=0), covers.var(axis=0, ddof=1)
    known, chance = np.isfinite(mean), variance > 0.0
    # Without any chance all of the measurement is covered.
    samples, limit = np.where(known, np.inf, np.nan), np.where(known, ENOUGH, np.nan)
    m, v = mean[chance], variance[chance]
    n = np.maximum(m * (1.0 - m) / v - 1.0, 1e-3)
    samples[chance] = n
    limit[chance] = np.minimum(beta.ppf(RISK / max(known.sum(), 1), m * n, (1.0 - m) * n), ENOUGH)
    return limit, samples


def _drawn_covers(reach: Floats, common: Floats, scatter: ThrowScatter) -> Floats:
    """Return the coverage of each channel in campaigns of a right model, shape (n, n_channels)."""
    rng = np.random.default_rng(SEED)
    known = np.isfinite(reach)
    count = known.sum(axis=(1, 2)).astype(np.float64)
    own, freedom = np.nan_to_num(scatter.own), scatter.freedom
    found = []
    for _ in range(0, DRAWS, AT_ONCE):
        away = _decaying(rng.standard_normal((AT_ONCE, *reach.shape)), scatter)
        away += np.tensordot(rng.standard_normal((AT_ONCE, len(common))), common, axes=1)
        sizes = np.sqrt(freedom / rng.chisquare(freedom, (AT_ONCE, len(own))))
        amounts = sizes[:, :, None] * rng.standard_normal((AT_ONCE, len(own), reach.shape[1]))
        away += np.einsum("nsm,scmt->ncmt", amounts, own)
        within = (known & (np.abs(away) <= reach)).sum(axis=(2, 3))
        found.append(np.divide(within, count, out=np.full(within.shape, np.nan), where=count > 0))
    return np.concatenate(found)


def _decaying(rows: Floats, scatter: ThrowScatter) -> Floats:
    """Return white noise, with channels on its second axis, as a rest that decays over time."""
    kept = np.exp(-1.0 / np.maximum(scatter.decay, 1e-3))
    for channel, (size, share) in enumerate(zip(scatter.rest, kept, strict=True)):
        series = rows[:, channel]
        series[..., 1:] *= np.sqrt(1.0 - share**2)
        rows[:, channel] = size * lfilter([1.0], [1.0, -share], series, axis=-1)
    return rows


# Information of a value that must be left without a place, as a share of all [-].
LEAST_LEFT = 0.02


def leave_out_places(
    measured: Floats,
    forces: Floats,
    slopes: Floats,
    *,
    places: Sequence[str],
    covariance: Floats,
    scatter: ThrowScatter,
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Predict the movements at each place with the values that the other places give.

    Parameters
    ----------
    measured, forces : ndarray, shape (n_channels, n_movements, n_times)
        Measured, NaN where nothing was, and predicted by the fit to all movements [N].
    slopes : ndarray, shape (p, n_channels, n_movements, n_times)
        Of the forces with each of the p fitted values [N/its unit].
    places : sequence of str
        Of each movement.
    covariance : ndarray, shape (p, p)
        Of the values of the fit to all movements.
    scatter : ThrowScatter
        The rest is noise of each instant, NaN in channels that were not fitted; what a movement
        has of its own moves all of its instants, and is no reason to change the values.

    Returns
    -------
    forces, variance : ndarray, shape (n_channels, n_movements, n_times)
        Predicted [N], and the variance from the uncertainty of the values without the movement's
        place, or with it where the others do not suffice [N^2].
    predicted : ndarray of bool, shape (n_movements,)
        Whether the others sufficed.

    Examples
    --------
    >>> measured = np.array([[[1.0] * 3, [3.0] * 3]])
    >>> noise = ThrowScatter(
    ...     own=np.zeros((0, 1, 2, 3)), sizes=np.zeros(0), freedom=np.zeros(0),
    ...     rest=np.ones(1), decay=np.zeros(1))
    >>> found, *_ = leave_out_places(
    ...     measured, np.full((1, 2, 3), 2.0), np.ones((1, 1, 2, 3)), places=["a", "b"],
    ...     covariance=np.array([[0.1]]), scatter=noise)
    >>> found[0, :, 0].round(9).tolist()
    [3.0, 1.0]
    """
    information, gradient = _of_movements(measured - forces, slopes, scatter)
    # What none of these movements depends on stays as it is, and changes no prediction.
    used = np.diag(information.sum(axis=0)) > 0.0
    J, covariance = slopes[used], covariance[np.ix_(used, used)]
    information, gradient = information[:, used][:, :, used], gradient[:, used]
    found, variance = forces.copy(), variance_of(J, covariance)
    predicted = np.zeros(len(places), dtype=np.bool_)
    if not used.any():
        return found, variance, predicted
    whole = information.sum(axis=0)
    # To units in which all movements together know each combination of values to one, and back to
    # the covariance of the fit, whose weights know more: the nearest matrix to the former, so that
    # it is that where the weights are the fit's own.
    W = np.linalg.inv(np.linalg.cholesky(whole))
    root = np.linalg.cholesky(covariance)
    U, _, Vt = np.linalg.svd(np.linalg.solve(root, W.T))
    back = root @ U @ Vt
    # From the values that are judged to those that fit all movements best.
    nearest = np.linalg.solve(whole, gradient.sum(axis=0))
    for place in dict.fromkeys(places):
        inside = np.array([item == place for item in places])
        own = information[inside].sum(axis=0)
        left = np.eye(len(own)) - W @ own @ W.T
        if float(np.linalg.eigvalsh(left)[0]) < LEAST_LEFT:
            continue
        inverse = np.linalg.inv(left)
        shift = -W.T @ inverse @ W @ (gradient[inside].sum(axis=0) - own @ nearest)
        found[:, inside] += np.tensordot(shift, J[:, :, inside], axes=1)
        variance[:, inside] = variance_of(J[:, :, inside], back @ inverse @ back.T)
        predicted |= inside
    return found, variance, predicted


def variance_of(slopes: Floats, covariance: Floats) -> Floats:
    """Return the variance of forces from that of values [N^2]."""
    return np.asarray(np.einsum("i...,ij,j...->...", slopes, covariance, slopes))


def _of_movements(rest: Floats, slopes: Floats, scatter: ThrowScatter) -> tuple[Floats, Floats]:
    """Return the information of each movement on the values, (m, p, p), and gradients, (m, p)."""
    known = np.isfinite(rest) & np.isfinite(slopes).all(axis=0) & (scatter.variance > 0.0)
    variance = np.broadcast_to(scatter.rest[:, None, None] ** 2, rest.shape)
    weight = np.divide(1.0, variance, out=np.zeros(rest.shape), where=known)
    J, r, S = np.where(known, slopes, 0.0), np.where(known, rest, 0.0), np.nan_to_num(scatter.own)
    inner = np.eye(len(S)) + np.einsum("acmt,bcmt,cmt->mab", S, S, weight)
    across = np.einsum("icmt,acmt,cmt->mia", J, S, weight)
    solved = np.linalg.solve(inner, np.swapaxes(across, 1, 2))
    own = np.einsum("acmt,cmt,cmt->ma", S, weight, r)
    information = np.einsum("icmt,jcmt,cmt->mij", J, J, weight) - across @ solved
    gradient = np.einsum("icmt,cmt,cmt->mi", J, weight, r) - np.einsum("mai,ma->mi", solved, own)
    return information, gradient
