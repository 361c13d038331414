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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

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
    """Parts of a 95 % band over the movements that are judged.

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


# A direction is identified where its expected scatter moves forces by at least so many noises.
LEAST_ANSWER = 0.5
# Correlation of neighbouring instants of the rest, at most [-].
MOST_ALIKE = 0.99


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Direction:
    """Something that a throw can have of its own.

    Attributes
    ----------
    name : str
        Name in texts and tables, such as "chair.friction_coefficient".
    slope : ndarray, shape (n_channels, n_movements, n_times)
        Of the forces with it [N/its unit].
    expected : float
        Standard deviation from throw to throw before repeats are seen; zero for none.
    """

    name: str
    slope: Floats
    expected: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrowScatter:
    """Standard deviations from throw to throw, and what they make of forces.

    Attributes
    ----------
    sizes : dict of str to float
        By name of the direction.
    rest : ndarray, shape (n_channels,)
        What is left of the difference between repeats, noise among it [N].
    variance : ndarray, shape (n_channels, n_movements, n_times)
        Of one throw about the mean of its like [N^2].
    repeated : int
        Throws that it was found from; with none, the sizes are assumptions.
    freedom : dict of str to float
        Degrees of freedom of the sizes, one for what was expected among them.
    decay : ndarray, shape (n_channels,)
        Instants in which the rest decays to a third.
    """

    sizes: dict[str, float]
    rest: Floats
    variance: Floats
    repeated: int
    freedom: dict[str, float] = field(default_factory=dict)
    decay: Floats = field(default_factory=lambda: np.zeros(0))


def scatter_of(
    measured: Floats,
    directions: Sequence[Direction],
    *,
    groups: Sequence[Sequence[int]],
    noise: Floats,
) -> ThrowScatter:
    """Find from repeats how much each direction differs from throw to throw.

    The difference of each repeat from the mean of its like is written as a sum of the directions;
    what no such sum explains is the rest. Expected sizes count like one more repeat, so that few
    repeats that happen to agree do not make a prediction look sure.

    Parameters
    ----------
    measured : ndarray, shape (n_channels, n_movements, n_times)
        [N]; NaN where nothing was measured.
    directions : sequence of Direction
        What can differ.
    groups : sequence of sequence of int
        Movements that are equal by the sheet.
    noise : ndarray, shape (n_channels,)
        Of a bin, which the rest is never below [N].

    Returns
    -------
    ThrowScatter

    Examples
    --------
    >>> slope = np.ones((1, 2, 4))
    >>> measured = np.array([[[3.0] * 4, [1.0] * 4]])
    >>> found = scatter_of(
    ...     measured,
    ...     [Direction(name="level", slope=slope, expected=1.4142)],
    ...     groups=[[0, 1]],
    ...     noise=np.array([0.1]),
    ... )
    >>> round(found.sizes["level"], 3)
    1.414
    """
    squares = np.array([item.expected**2 for item in directions])
    freedom = np.ones(len(directions))
    left, samples = np.zeros(noise.size), np.zeros(noise.size)
    following = np.zeros(noise.size)
    for group in groups:
        lost = (len(group) - 1.0) / len(group)
        mean = measured[:, list(group)].mean(axis=1)
        for number in group:
            amounts, identified, remainder = _explained(
                measured[:, number] - mean, directions, number=number, noise=noise
            )
            squares += np.where(identified, amounts**2, 0.0)
            freedom += np.where(identified, lost, 0.0)
            known = np.isfinite(remainder)
            filled = np.where(known, remainder, 0.0)
            left += (filled**2).sum(axis=1)
            following += (filled[:, 1:] * filled[:, :-1]).sum(axis=1)
            samples += lost * known.sum(axis=1)
    sizes = np.sqrt(squares / freedom)
    rest = np.sqrt(np.divide(left, samples, out=noise**2, where=samples > 0))
    variance = np.broadcast_to(
        np.maximum(rest, noise)[:, np.newaxis, np.newaxis] ** 2, measured.shape
    ).copy()
    for size, item in zip(sizes, directions, strict=True):
        variance += (size * item.slope) ** 2
    return ThrowScatter(
        sizes={item.name: float(size) for item, size in zip(directions, sizes, strict=True)},
        rest=np.maximum(rest, noise),
        variance=variance,
        repeated=sum(len(group) for group in groups),
        freedom={item.name: float(n) for item, n in zip(directions, freedom, strict=True)},
        decay=_decay(following, left),
    )


def _decay(following: Floats, squares: Floats) -> Floats:
    """Return in how many instants a rest decays to a third, by its correlation with the next one.

    Examples
    --------
    >>> _decay(np.array([0.0, 0.5]), np.ones(2)).round(2)
    array([0.  , 1.44])
    """
    share = np.divide(following, squares, out=np.zeros_like(squares), where=squares > 0.0)
    share = np.clip(share, 0.0, MOST_ALIKE)
    found = np.zeros_like(share)
    np.divide(
        -1.0,
        np.log(share, where=share > 0.0, out=np.ones_like(share)),
        out=found,
        where=share > 0.0,
    )
    return found


def _explained(
    difference: Floats, directions: Sequence[Direction], *, number: int, noise: Floats
) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """Return the share of each direction in a difference, which are identified, and the rest."""
    rows = np.array([item.slope[:, number] for item in directions])
    there = np.isfinite(difference) & np.isfinite(rows).all(axis=0)
    weight = 1.0 / noise[:, np.newaxis]
    flat = np.where(there, rows * weight, 0.0).reshape(len(directions), -1)
    count = max(int(there.sum()), 1)
    answer = np.sqrt((flat**2).sum(axis=1) / count) * [item.expected for item in directions]
    identified = answer > LEAST_ANSWER
    amounts = np.zeros(len(directions))
    if identified.any():
        target = np.where(there, difference * weight, 0.0).ravel()
        amounts[identified] = np.linalg.lstsq(flat[identified].T, target, rcond=1e-6)[0]
    remainder = difference - np.tensordot(amounts, np.where(there, rows, 0.0), axes=1)
    return amounts, identified, np.where(there, remainder, np.nan)


# Information of a value that must be left without a place, as a share of all [-].
LEAST_LEFT = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeftOut:
    """Each movement as it is predicted from other places.

    Attributes
    ----------
    forces : ndarray, shape (n_channels, n_movements, n_times)
        Predicted [N].
    variance : ndarray, shape (n_channels, n_movements, n_times)
        From the uncertainty of the values without the movement's place, or with it where the others
        do not suffice [N^2].
    predicted : ndarray of bool, shape (n_movements,)
        Whether the others sufficed to predict it.
    """

    forces: Floats
    variance: Floats
    predicted: NDArray[np.bool_]


def leave_out_places(
    measured: Floats,
    forces: Floats,
    slopes: Mapping[str, Floats],
    *,
    places: Sequence[str],
    variance: Floats,
    covariance: Floats,
    alike: Sequence[Floats] = (),
) -> LeftOut:
    """Predict the movements at each place with the values that the other places give.

    Parameters
    ----------
    measured, forces : ndarray, shape (n_channels, n_movements, n_times)
        Measured, NaN where nothing was, and predicted by the fit to all movements [N].
    slopes : mapping of str to ndarray, shape (n_channels, n_movements, n_times)
        Of the forces with each of the p fitted values [N/its unit].
    places : sequence of str
        Of each movement.
    variance : ndarray, shape (n_channels, n_movements, n_times)
        Of a measured instant about its prediction [N^2]; NaN in channels that were not fitted.
    covariance : ndarray, shape (p, p)
        Of the values of the fit to all movements.
    alike : sequence of ndarray, shape (n_channels, n_movements, n_times)
        What moves all instants of a movement together, such as its own friction, for one standard
        deviation [N]; not in the variance. Taken as noise of each instant it would be a reason to
        change the values.

    Returns
    -------
    LeftOut

    Examples
    --------
    >>> level = {"level": np.ones((1, 2, 3))}
    >>> measured = np.array([[[1.0] * 3, [3.0] * 3]])
    >>> found = leave_out_places(
    ...     measured, np.full((1, 2, 3), 2.0), level, places=["a", "b"],
    ...     variance=np.ones((1, 2, 3)), covariance=np.array([[0.1]]))
    >>> found.forces[0, :, 0].tolist()
    [3.0, 1.0]
    """
    stacked = np.stack(list(slopes.values()))
    # A channel without a variance was not fitted, and says nothing of the values.
    known = np.isfinite(measured) & np.isfinite(stacked).all(axis=0) & (variance > 0.0)
    weight = np.divide(1.0, variance, out=np.zeros_like(variance), where=known)
    J = np.where(known, stacked, 0.0)
    rest = np.where(known, measured - forces, 0.0)
    information, gradient = _of_movements(J, weight, rest, alike)
    whole = information.sum(axis=0)
    if not np.diag(whole).all():
        # What none of these movements depends on stays as it is, and changes no prediction.
        used = np.diag(whole) > 0.0
        if not used.any():
            nothing = np.zeros(len(places), dtype=np.bool_)
            return LeftOut(forces=forces, variance=np.zeros_like(forces), predicted=nothing)
        return leave_out_places(
            measured,
            forces,
            {key: item for (key, item), on in zip(slopes.items(), used, strict=True) if on},
            places=places,
            variance=variance,
            covariance=covariance[np.ix_(used, used)],
            alike=alike,
        )
    # Values in units in which all movements together know each to one.
    scale = 1.0 / np.sqrt(np.diag(whole))
    every = _scaled(whole, scale)
    least = LEAST_LEFT * float(np.linalg.eigvalsh(every)[0])
    # From the values that are judged to those that fit all movements best.
    nearest = scale * np.linalg.solve(every, scale * gradient.sum(axis=0))
    # Takes inverses in these units to the covariance of the fit, whose weights know more: the
    # nearest such matrix to plain units, so that it is these where the weights are the fit's own.
    known_root, lower = np.linalg.cholesky(covariance), np.linalg.cholesky(every)
    plain = np.linalg.solve(known_root, scale[:, None] * np.linalg.inv(lower).T)
    U, _, Vt = np.linalg.svd(plain)
    root = known_root @ U @ Vt @ lower.T
    found = forces.copy()
    spread = np.einsum("icmt,ij,jcmt->cmt", stacked, covariance, stacked)
    predicted = np.zeros(len(places), dtype=np.bool_)
    for place in dict.fromkeys(places):
        inside = np.array([item == place for item in places])
        left = _scaled(whole - information[inside].sum(axis=0), scale)
        if float(np.linalg.eigvalsh(left)[0]) < least:
            continue
        inverse = np.linalg.inv(left)
        own_gradient = gradient[inside].sum(axis=0) - information[inside].sum(axis=0) @ nearest
        shift = -scale * (inverse @ (scale * own_gradient))
        own = root @ inverse @ root.T
        found[:, inside] += np.tensordot(shift, stacked[:, :, inside], axes=1)
        spread[:, inside] = np.einsum(
            "icmt,ij,jcmt->cmt", stacked[:, :, inside], own, stacked[:, :, inside]
        )
        predicted |= inside
    return LeftOut(forces=found, variance=spread, predicted=predicted)


def _of_movements(
    J: Floats, weight: Floats, rest: Floats, alike: Sequence[Floats]
) -> tuple[Floats, Floats]:
    """Return the information of each movement on the values, (m, p, p), and gradients, (m, p)."""
    information = np.einsum("icmt,jcmt,cmt->mij", J, J, weight)
    gradient = np.einsum("icmt,cmt,cmt->mi", J, weight, rest)
    if alike:
        S = np.nan_to_num(np.stack(alike))
        inner = np.eye(len(alike)) + np.einsum("acmt,bcmt,cmt->mab", S, S, weight)
        across = np.einsum("icmt,acmt,cmt->mia", J, S, weight)
        solved = np.linalg.solve(inner, np.swapaxes(across, 1, 2))
        information = information - across @ solved
        own = np.einsum("acmt,cmt,cmt->ma", S, weight, rest)
        gradient = gradient - np.einsum("mai,ma->mi", solved, own)
    return information, gradient


def _scaled(matrix: Floats, scale: Floats) -> Floats:
    return np.asarray(matrix * np.outer(scale, scale))
