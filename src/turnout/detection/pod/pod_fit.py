"""Maximum and profile likelihood of test campaigns, many at once."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.detection.pod.pod_likelihood import (
    INTERCEPT,
    KNOWN,
    SCALE,
    SLOPE,
    SPREAD,
    Campaigns,
    Constraint,
    Evaluation,
    evaluate,
    margin,
)

Floats = NDArray[np.float64]

MOST_STEPS, SHORTENINGS = 60, 6
CLOSE = 1e-7
"""Gain of log-likelihood that a further step promises at the end [-]."""
LEAST_SHARE = 0.3
"""Of the scale, which a step may leave."""
STEEPEST, WIDEST = 20.0, 30.0
"""Values that count as infinite: change of the mean between the two nearest sizes, in errors of a
throw; spread of switches, in changes of the mean over all sizes, or in errors where these are more.

Hits and misses that do not overlap have no finite estimate; their likelihood no longer changes.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """Maximum-likelihood estimates.

    Attributes
    ----------
    parameters : ndarray, shape (n_campaigns, 4)
        a0, a1, w, gamma.
    value : ndarray, shape (n_campaigns,)
        Log-likelihood.
    """

    parameters: Floats
    value: Floats


def maximise(
    campaigns: Campaigns, constraint: Constraint | None = None, *, start: Floats | None = None
) -> Fit:
    """Fit campaigns by Newton's method; curvature of the wrong sign is turned round.

    Parameters
    ----------
    campaigns : Campaigns
        The data.
    constraint : Constraint, optional
        A share that is detected at a size.
    start : ndarray, shape (n_campaigns, 4) or (4,), optional
        Parameters to begin with.
    """
    count = len(campaigns.y)
    if start is None:
        start = starting_values(campaigns)
    parameters = np.array(np.broadcast_to(start, (count, 4)), dtype=np.float64)
    free = [item for item in campaigns.free if constraint is None or item != INTERCEPT]
    value = np.full(count, -np.inf)
    active = np.arange(count)
    data = campaigns
    found = evaluate(data, parameters, constraint)
    stuck = np.zeros(count, dtype=np.bool_)
    for _ in range(MOST_STEPS):
        value[active] = found.value
        step = _step(found.gradient, found.hessian)
        promised = np.einsum("bk,bk->b", found.gradient, step)
        endless = is_endless(parameters[active], campaigns)
        going = (promised > CLOSE) & ~endless & ~stuck
        if not going.any():
            break
        active, step, data = active[going], step[going], data.rows(going)
        trial, found, stuck = _uphill(
            data, parameters[active], step, free, found.value[going], constraint
        )
        parameters[active] = trial
    value[active] = found.value
    parameters[:, SPREAD] = np.abs(parameters[:, SPREAD])
    if constraint is not None:
        mean = margin(parameters[:, SPREAD], campaigns, constraint.probability)[0]
        parameters[:, INTERCEPT] = mean - parameters[:, SLOPE] * constraint.x
    return Fit(parameters=parameters, value=value)


def is_endless(parameters: Floats, campaigns: Campaigns) -> NDArray[np.bool_]:
    """Return whether slope or spread of hits and misses have no finite estimate.

    Parameters
    ----------
    parameters : ndarray, shape (n_campaigns, 4)
        Of a fit that may still be under way.
    campaigns : Campaigns
        The data.
    """
    if not campaigns.binary:
        return np.zeros(len(parameters), dtype=np.bool_)
    slope, spread = np.abs(parameters[:, SLOPE]), np.abs(parameters[:, SPREAD])
    finest = np.diff(np.unique(campaigns.x)).min(initial=np.inf)
    change = slope * np.ptp(campaigns.x)
    return np.asarray((slope * finest > STEEPEST) | (spread > WIDEST * np.maximum(change, 1.0)))


def _uphill(
    data: Campaigns,
    begin: Floats,
    step: Floats,
    free: list[int],
    before: Floats,
    constraint: Constraint | None,
) -> tuple[Floats, Evaluation, NDArray[np.bool_]]:
    """Take a step, shortened where the likelihood would fall; say where no length is uphill.

    Near the maximum quadrature is not exact enough to see a gain: such campaigns are done.
    """
    length = np.ones(len(step))
    if not data.binary:
        change = -step[:, -1] / begin[:, SCALE]
        length = np.minimum(1.0, (1.0 - LEAST_SHARE) / np.maximum(change, 1e-12))
    worse = np.ones(len(step), dtype=np.bool_)
    for _ in range(SHORTENINGS):
        trial = begin.copy()
        trial[:, free] += length[:, None] * step
        found = evaluate(data, trial, constraint)
        worse = ~(found.value >= before)
        if not worse.any():
            return trial, found, worse
        length[worse] *= 0.2
    trial[worse] = begin[worse]
    return trial, evaluate(data, trial, constraint), worse


def _step(gradient: Floats, hessian: Floats) -> Floats:
    """Return the Newton step, uphill in every direction."""
    curvature, ways = np.linalg.eigh(hessian)
    size = np.maximum(np.abs(curvature), 1e-8 * np.abs(curvature).max(axis=1, keepdims=True))
    along = np.einsum("bkl,bk->bl", ways, gradient) / np.maximum(size, 1e-12)
    return np.asarray(np.einsum("bkl,bl->bk", ways, along))


def starting_values(campaigns: Campaigns) -> Floats:
    """Return parameters to begin with: a straight line through responses, or through hits."""
    x, y = campaigns.x, campaigns.y
    away = x - x.mean()
    share = max(float(away @ away), 1e-300)
    target = 2.0 * (campaigns.side > KNOWN) - 1.0 if campaigns.binary else y
    slope = target @ away / share
    level = target.mean(axis=1)
    rest = target - level[:, None] - slope[:, None] * away
    scale = 1.0 / np.maximum(rest.std(axis=1), 1e-6 * np.maximum(np.abs(y).max(axis=1), 1e-300))
    if campaigns.binary:
        slope, level, scale = 2.0 * slope, 2.0 * level, np.ones(len(y))
    found = np.zeros((len(y), 4))
    found[:, SLOPE] = scale * slope
    found[:, INTERCEPT] = scale * level - found[:, SLOPE] * x.mean()
    found[:, SPREAD] = 0.5 if campaigns.grouped else 0.0
    found[:, SCALE] = scale
    return found


def detected_size(parameters: Floats, campaigns: Campaigns, probability: float) -> Floats:
    """Return the size that a share of throws detects, on the scale of the model.

    Parameters
    ----------
    parameters : ndarray, shape (n_campaigns, 4)
        Of a fit.
    campaigns : Campaigns
        Link, low and high.
    probability : float
        The share, between low and high.
    """
    mean = margin(parameters[:, SPREAD], campaigns, probability)[0]
    return np.asarray((mean - parameters[:, INTERCEPT]) / parameters[:, SLOPE])


def signed_root(campaigns: Campaigns, best: Fit, bound: Fit, constraint: Constraint) -> Floats:
    r"""Return the signed root of the likelihood ratio of a constraint.

    .. math:: r = \mathrm{sign}(\hat x - x^*)\,\sqrt{2 (\hat\ell - \ell(x^*))}

    Parameters
    ----------
    campaigns : Campaigns
        The data.
    best, bound : Fit
        Without and with the constraint.
    constraint : Constraint
        The share that is detected at the size :math:`x^*`.
    """
    needed = margin(best.parameters[:, SPREAD], campaigns, constraint.probability)[0]
    reached = best.parameters[:, INTERCEPT] + best.parameters[:, SLOPE] * constraint.x
    return np.asarray(
        np.sign(needed - reached) * np.sqrt(2.0 * np.maximum(best.value - bound.value, 0.0))
    )


def draw_campaigns(
    campaigns: Campaigns, parameters: Floats, count: int, rng: np.random.Generator
) -> Campaigns:
    """Draw campaigns of the same design, with the same limits of the response.

    Parameters
    ----------
    campaigns : Campaigns
        One campaign; where its responses have limits the drawn ones have them too.
    parameters : ndarray, shape (4,)
        a0, a1, w, gamma.
    count : int
        Campaigns.
    rng : numpy.random.Generator
        Source of random numbers.
    """
    shape = (count, campaigns.x.size)
    effect = rng.standard_normal((count, campaigns.starts.size))[:, campaigns.switch]
    error = rng.logistic(size=shape) if campaigns.link == "logit" else rng.standard_normal(shape)
    mean = parameters[INTERCEPT] + parameters[SLOPE] * campaigns.x + parameters[SPREAD] * effect
    if campaigns.binary:
        hit = mean + error > 0.0
        by_chance = rng.uniform(size=shape)
        hit = np.where(hit, by_chance < campaigns.high, by_chance < campaigns.low)
        side = np.where(hit, 1, -1).astype(np.int8)
        return replace(campaigns, y=np.zeros(shape), side=side)
    y = (mean + error) / parameters[SCALE]
    side = (y >= campaigns.most).astype(np.int8) - (y <= campaigns.least).astype(np.int8)
    return replace(campaigns, y=np.clip(y, campaigns.least, campaigns.most), side=side)
