r"""The confidence bound a90/95: profile likelihood, calibrated by simulated campaigns.

The size at which a share :math:`p` of all switches and throws is detected has the upper bound at
which the signed root :math:`r` of the likelihood ratio falls to a limit :math:`c`. For many
switches :math:`c = \Phi^{-1}(0.05) = -1.645`. With the few switches of a real campaign that bound
is too low in 8 to 15 of 100 campaigns instead of 5: the spread between switches is estimated too
small, and :math:`r` is skewed. Here :math:`c` is the 5 % quantile of :math:`r` in campaigns of the
same design, drawn where the bound lies with all other parameters at their constrained maximum
(DiCiccio, Martin and Stern 2001, Canadian Journal of Statistics 29, 67-76).
"""

from collections.abc import Callable

import numpy as np
from scipy.special import ndtri

from turnout.detection.pod.pod_fit import (
    Fit,
    detected_size,
    draw_campaigns,
    maximise,
    signed_root,
)
from turnout.detection.pod.pod_likelihood import Campaigns, Constraint

DRAWN, ROUNDS = 400, 2
"""Simulated campaigns, and how often the place where they are drawn is moved to the bound."""
FARTHEST = 20.0
"""Ranges of the sizes beyond which a bound counts as none."""


def upper_bound(
    campaigns: Campaigns, best: Fit, *, probability: float, limit: float
) -> tuple[float, Fit]:
    """Return the size where the signed root falls to a limit, and the constrained fit there.

    Parameters
    ----------
    campaigns : Campaigns
        One campaign.
    best : Fit
        Of it.
    probability : float
        Detected share at that size.
    limit : float
        Of the signed root; a positive one gives a lower bound.

    Returns
    -------
    size : float
        On the scale of the model; infinite if there is none.
    fit : Fit
        With the constraint.
    """
    begin = float(detected_size(best.parameters, campaigns, probability)[0])
    span = float(np.ptp(campaigns.x))
    fits: dict[float, Fit] = {begin: best}
    way = 1.0 if limit < 0.0 else -1.0

    def height(x: float) -> float:
        near = min(fits, key=lambda known: abs(known - x))
        constraint = Constraint(x=x, probability=probability)
        fits[x] = maximise(campaigns, constraint, start=fits[near].parameters)
        return float(signed_root(campaigns, best, fits[x], constraint)[0]) - limit

    inner, above = begin, -limit
    step = 0.05 * span
    while step <= FARTHEST * span:
        outer = begin + way * step
        below = height(outer)
        if below * above <= 0.0:
            root = _root(height, inner, above, outer, below, tolerance=1e-5 * span)
            return root, fits[root]
        inner, above, step = outer, below, 2.0 * step
    return way * np.inf, best


def _root(
    function: Callable[[float], float],
    a: float, fa: float, b: float, fb: float, *, tolerance: float,
) -> float:  # fmt: skip
    """Return the last place tried by the Illinois method (Dowell and Jarratt 1971)."""
    c = b
    for _ in range(40):
        c = b - fb * (b - a) / (fb - fa) if fb != fa else 0.5 * (a + b)
        fc = function(c)
        if fc == 0.0 or abs(b - a) < tolerance or abs(fc) < 1e-6:
            break
        if fc * fb < 0.0:
            a, fa = b, fb
        else:
            fa *= 0.5
        b, fb = c, fc
    return c


def calibrated_limit(
    campaigns: Campaigns,
    fit: Fit,
    size: float,
    *,
    probability: float,
    level: float,
    drawn: int,
    seed: int,
) -> float:
    """Return the quantile of the signed root in campaigns drawn from a constrained fit.

    Parameters
    ----------
    campaigns : Campaigns
        One campaign, whose design is kept.
    fit : Fit
        With the constraint at `size`.
    size : float
        Where the drawn campaigns detect the share `probability`.
    level : float
        Of the quantile [-].
    drawn : int
        Campaigns.
    seed : int
        Of the random numbers.
    """
    rng = np.random.default_rng(seed)
    simulated = draw_campaigns(campaigns, fit.parameters[0], drawn, rng)
    constraint = Constraint(x=size, probability=probability)
    best = maximise(simulated, start=fit.parameters)
    bound = maximise(simulated, constraint, start=fit.parameters)
    roots = signed_root(simulated, best, bound, constraint)
    return float(np.quantile(roots[np.isfinite(roots)], level))


def confidence_bound(
    campaigns: Campaigns,
    best: Fit,
    *,
    probability: float = 0.9,
    confidence: float = 0.95,
    drawn: int = DRAWN,
    seed: int = 1,
) -> tuple[float, float, float]:
    """Return the upper bound, that of the uncalibrated profile, and the calibrated limit.

    Parameters
    ----------
    campaigns : Campaigns
        One campaign.
    best : Fit
        Of it.
    probability : float
        Detected share.
    confidence : float
        Share of campaigns whose bound shall not lie below the truth.
    drawn : int
        Simulated campaigns; 0 leaves the profile as it is.
    seed : int
        Of the random numbers.
    """
    usual = float(ndtri(1.0 - confidence))
    plain, fit = upper_bound(campaigns, best, probability=probability, limit=usual)
    bound, limit = plain, usual
    for turn in range(ROUNDS if drawn else 0):
        if not np.isfinite(bound):
            break
        limit = calibrated_limit(
            campaigns, fit, bound,
            probability=probability, level=1.0 - confidence, drawn=drawn, seed=seed + turn,
        )  # fmt: skip
        bound, fit = upper_bound(campaigns, best, probability=probability, limit=limit)
    return bound, plain, limit


def separated(campaigns: Campaigns) -> bool:
    """Return whether every hit is at least as large as every miss.

    Then the slope has no finite estimate.

    Parameters
    ----------
    campaigns : Campaigns
        One campaign of hits and misses.
    """
    hit = campaigns.side[0] > 0
    return campaigns.binary and bool(campaigns.x[~hit].max() <= campaigns.x[hit].min())
