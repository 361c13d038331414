r"""The likelihood of test campaigns whose throws are grouped by switch, for many at once.

.. math:: \gamma y = a_0 + a_1 x + w v_s + e, \qquad v_s \sim N(0, 1)

with the size :math:`x` (or its logarithm), the response :math:`y` in units of the error
(:math:`\gamma = 1/\sigma`, Olsen 1978), an effect :math:`w v_s` of each switch and an error
:math:`e` of each throw, standard normal or logistic. A response is known, or known to lie below or
above a value: below the recording floor, above the slip of a drive; for hits and misses
:math:`\gamma = 1`. The effects are integrated by adaptive Gauss-Hermite quadrature (Pinheiro and
Bates 1995, Journal of Computational and Graphical Statistics 4, 12-35).

At a size :math:`x^*` the share of all switches and throws that is detected is

.. math:: p = \int F(a_0 + a_1 x^* + w v)\,\varphi(v)\,dv

and the constraint that it be :math:`p` there takes the place of :math:`a_0`.

Parameters are rows (a0, a1, w, gamma); arrays have the shape (n_campaigns, n_throws).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, log_ndtr, ndtr, ndtri

Floats = NDArray[np.float64]

KNOWN, BELOW, ABOVE = 0, -1, 1
"""Knowledge of a response: its value, or the side of a value on which it lies."""
INTERCEPT, SLOPE, SPREAD, SCALE = 0, 1, 2, 3
"""Columns of the parameters a0, a1, w and gamma."""
MODE_STEPS = 5
_ROOT_2_PI = float(np.sqrt(2.0 * np.pi))
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(7)
_EVEN_NODES, _EVEN_WEIGHTS = np.polynomial.hermite_e.hermegauss(40)
_EVEN_WEIGHTS = _EVEN_WEIGHTS / _ROOT_2_PI


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Campaigns:
    """Campaigns of one design.

    Attributes
    ----------
    x : ndarray, shape (n_throws,)
        Size on the scale of the model.
    switch : ndarray of int, shape (n_throws,)
        From 0, rising: throws are sorted by switch.
    y : ndarray, shape (n_campaigns, n_throws)
        Response on the scale of the model less the decision threshold; 0 for hits and misses.
    side : ndarray of int, shape (n_campaigns, n_throws)
        KNOWN, BELOW or ABOVE; a hit is above.
    link : str
        "probit" or "logit": normal or logistic errors.
    binary : bool
        Hits and misses: no scale of the response.
    grouped : bool
        Whether switches have an effect; False pools all throws.
    low, high : float
        Probability of a hit as the size falls and as it grows without limit [-].
    least, most : float
        Between which responses are known, as `y`.
    """

    x: Floats
    switch: NDArray[np.intp]
    y: Floats
    side: NDArray[np.int8]
    link: str = "probit"
    binary: bool = True
    grouped: bool = True
    low: float = 0.0
    high: float = 1.0
    least: float = -np.inf
    most: float = np.inf

    @property
    def starts(self) -> NDArray[np.intp]:
        """The first throw of each switch."""
        return np.flatnonzero(np.diff(self.switch, prepend=-1))

    @property
    def free(self) -> list[int]:
        """The columns of the parameters that are estimated."""
        return [
            *(INTERCEPT, SLOPE),
            *([SPREAD] if self.grouped else []),
            *([] if self.binary else [SCALE]),
        ]

    def rows(self, chosen: NDArray[np.bool_]) -> "Campaigns":
        """Return some of the campaigns."""
        return replace(self, y=self.y[chosen], side=self.side[chosen])


@dataclass(frozen=True, slots=True, kw_only=True)
class Constraint:
    """That a share `probability` is detected at the size `x`, on the scale of the model."""

    x: float
    probability: float


def quantile(probability: float, link: str) -> float:
    """Return the value below which an error lies with a probability."""
    if link == "logit":
        return float(np.log(probability) - np.log1p(-probability))
    return float(ndtri(probability))


def margin(spread: Floats, campaigns: Campaigns, probability: float) -> tuple[Floats, ...]:
    """Return the mean that detects a share over all switches, and two derivatives by the spread.

    Parameters
    ----------
    spread : ndarray, shape (n,)
        Deviation of the effects of switches, in units of the error.
    campaigns : Campaigns
        Link, low and high.
    probability : float
        Between low and high.

    Examples
    --------
    >>> one = np.zeros((1, 1))
    >>> toy = Campaigns(x=one[0], switch=np.array([0]), y=one, side=np.array([[1]], np.int8))
    >>> margin(np.array([1.0]), toy, 0.9)[0].round(6).tolist()  # root of 2 times 1.281552
    [1.812388]
    """
    share = (probability - campaigns.low) / (campaigns.high - campaigns.low)
    start = quantile(share, campaigns.link)
    root = np.sqrt(1.0 + spread * spread)
    if campaigns.link == "probit":
        return start * root, start * spread / root, start / root**3
    mean = start * np.sqrt(1.0 + spread * spread / 2.9)  # a logistic error is 1.7 normal ones
    across = spread[:, np.newaxis] * _EVEN_NODES
    for _ in range(6):
        below = expit(mean[:, np.newaxis] + across)
        density = below * (1.0 - below)
        mean = mean - ((below @ _EVEN_WEIGHTS) - share) / (density @ _EVEN_WEIGHTS)
    below = expit(mean[:, np.newaxis] + across)
    density = below * (1.0 - below)
    change = density * (1.0 - 2.0 * below) * _EVEN_WEIGHTS
    density = density * _EVEN_WEIGHTS
    total = density.sum(axis=1)
    first = -(density @ _EVEN_NODES) / total
    second = -(
        change @ _EVEN_NODES**2
        + 2.0 * (change @ _EVEN_NODES) * first
        + change.sum(axis=1) * first**2
    ) / total  # fmt: skip
    return mean, first, second


def error_terms(
    residual: Floats, campaigns: Campaigns, side: NDArray[np.int8]
) -> tuple[Floats, Floats, Floats]:
    """Return the log-likelihood of throws, and two derivatives by the residual.

    Parameters
    ----------
    residual : ndarray, shape (n_campaigns, n_throws, ...)
        Of the response or of its limit, in units of the error.
    campaigns : Campaigns
        Link, low and high.
    side : ndarray, shape (n_campaigns, n_throws)
        What is known.
    """
    limited = side != KNOWN
    if limited.all():
        shape = (*side.shape, *([1] * (residual.ndim - 2)))
        return _limited_terms(residual, campaigns, side.reshape(shape).astype(np.float64))
    value, first, second = -0.5 * residual**2, -residual, np.full(residual.shape, -1.0)
    if limited.any():
        some = side[limited].astype(np.float64).reshape(-1, *([1] * (residual.ndim - 2)))
        found = _limited_terms(residual[limited], campaigns, some)
        value[limited], first[limited], second[limited] = found
    return value, first, second


def _limited_terms(
    residual: Floats, campaigns: Campaigns, side: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the same where a response lies on a side of a value."""
    u = side * residual
    low, high = campaigns.low, campaigns.high
    if campaigns.link == "logit":
        below = expit(u)
        if low == 0.0 and high == 1.0:
            return -np.logaddexp(0.0, u), -side * below, -below * (1.0 - below)
        above, density = expit(-u), below * (1.0 - below)
        bend = density * (1.0 - 2.0 * below)
    else:
        if low == 0.0 and high == 1.0:
            log_above = log_ndtr(-u)
            hazard = np.exp(-0.5 * u * u - log_above) / _ROOT_2_PI
            return log_above, -side * hazard, -hazard * (hazard - u)
        above, density = ndtr(-u), np.exp(-0.5 * u * u) / _ROOT_2_PI
        bend = -u * density
    span = high - low
    likelihood = np.where(side > 0, low, 1.0 - high) + span * above
    likelihood = np.maximum(likelihood, np.finfo(float).tiny)
    first = -side * span * density / likelihood
    return np.log(likelihood), first, -span * bend / likelihood - first**2


@dataclass(slots=True, eq=False)
class Evaluation:
    """Log-likelihood with its gradient and Hessian by the free parameters.

    Attributes
    ----------
    value : ndarray, shape (n_campaigns,)
    gradient : ndarray, shape (n_campaigns, n_free)
    hessian : ndarray, shape (n_campaigns, n_free, n_free)
    """

    value: Floats
    gradient: Floats
    hessian: Floats


def evaluate(
    campaigns: Campaigns, parameters: Floats, constraint: Constraint | None = None
) -> Evaluation:
    """Return the log-likelihood of campaigns, each at its own parameters.

    Parameters
    ----------
    campaigns : Campaigns
        The data.
    parameters : ndarray, shape (n_campaigns, 4)
        With a constraint the intercept is not read.
    constraint : Constraint, optional
        Takes the place of the intercept, which then is no free parameter.
    """
    x = campaigns.x if constraint is None else campaigns.x - constraint.x
    slope, spread, scale = parameters[:, SLOPE], parameters[:, SPREAD], parameters[:, SCALE]
    zero = np.zeros(len(parameters))
    mean, lift, curve = parameters[:, INTERCEPT], zero, zero
    if constraint is not None:
        mean, lift, curve = margin(spread, campaigns, constraint.probability)
    base = scale[:, None] * campaigns.y - mean[:, None] - slope[:, None] * x
    starts, switch = campaigns.starts, campaigns.switch
    effect, log_weight = _quadrature(campaigns, base, spread)
    residual = base[:, :, None] - spread[:, None, None] * effect[:, switch]
    logs, first, second = error_terms(residual, campaigns, campaigns.side)

    def total(values: Floats) -> Floats:
        return np.add.reduceat(values, starts, axis=1)

    log_parts = total(logs) + log_weight
    top = log_parts.max(axis=2, keepdims=True)
    share = np.exp(log_parts - top)
    whole = share.sum(axis=2, keepdims=True)
    share /= whole
    ways = _ways(campaigns, x, effect=effect, lift=lift, constrained=constraint is not None)
    score = np.stack([total(first * way) for way in ways], axis=-1)
    bend = np.empty((*score.shape, len(ways)))
    for i, way in enumerate(ways):
        weighted = second * way
        for j, other in enumerate(ways[: i + 1]):
            bend[..., i, j] = bend[..., j, i] = total(weighted * other)
    if campaigns.grouped and constraint is not None:
        bend[..., 1, 1] -= curve[:, None, None] * total(first)
    mean_score = np.einsum("bmq,bmqk->bmk", share, score)
    hessian = (
        np.einsum("bmq,bmqkl->bkl", share, bend)
        + np.einsum("bmq,bmqk,bmql->bkl", share, score, score)
        - np.einsum("bmk,bml->bkl", mean_score, mean_score)
    )
    value = (top + np.log(whole))[..., 0].sum(axis=1)
    gradient = mean_score.sum(axis=1)
    if not campaigns.binary:
        known = (campaigns.side == KNOWN).sum(axis=1)
        value += known * np.log(scale)
        gradient[:, -1] += known / scale
        hessian[:, -1, -1] -= known / scale**2
    return Evaluation(value, gradient, hessian)


def _ways(
    campaigns: Campaigns, x: Floats, *, effect: Floats, lift: Floats, constrained: bool
) -> list[Floats]:
    """Return the derivatives of the residual by the free parameters."""
    found = [] if constrained else [np.full((1, 1, 1), -1.0)]
    found.append(-x[None, :, None])
    if campaigns.grouped:
        found.append(-(effect[:, campaigns.switch] + lift[:, None, None]))
    if not campaigns.binary:
        found.append(campaigns.y[:, :, None])
    return found


def _quadrature(campaigns: Campaigns, base: Floats, spread: Floats) -> tuple[Floats, Floats]:
    """Return the effects of switches at which the likelihood is summed, and log weights.

    Both have the shape (n_campaigns, n_switches, n_nodes). The nodes lie around the most likely
    effect of each switch, as wide as its likelihood.
    """
    starts, switch = campaigns.starts, campaigns.switch
    shape = (len(base), starts.size)
    if not campaigns.grouped:
        return np.zeros((*shape, 1)), np.zeros((*shape, 1))
    mode, width = np.zeros(shape), np.ones(shape)
    across = spread[:, None]
    for _ in range(MODE_STEPS):
        residual = base - across * mode[:, switch]
        _, first, second = error_terms(residual, campaigns, campaigns.side)
        slope = -across * np.add.reduceat(first, starts, axis=1) - mode
        bend = across**2 * np.minimum(np.add.reduceat(second, starts, axis=1), 0.0) - 1.0
        mode = mode + np.clip(-slope / bend, -3.0, 3.0)
        width = 1.0 / np.sqrt(-bend)
    effect = mode[..., None] + width[..., None] * _NODES
    log_weight = np.log(width)[..., None] + np.log(_WEIGHTS / _ROOT_2_PI) + 0.5 * _NODES**2
    return effect, log_weight - 0.5 * effect**2


def marginal_probability(
    x: Floats, parameters: Floats, campaigns: Campaigns, *, spread: float | None = None
) -> Floats:
    """Return the share of all switches and throws that is detected at some sizes.

    Parameters
    ----------
    x : ndarray, shape (n,)
        On the scale of the model.
    parameters : ndarray, shape (4,)
        a0, a1, w, gamma.
    campaigns : Campaigns
        Link, low and high.
    spread : float, optional
        In place of w; 0 gives the median switch.
    """
    w = parameters[SPREAD] if spread is None else spread
    mean = parameters[INTERCEPT] + parameters[SLOPE] * np.asarray(x, dtype=np.float64)
    if campaigns.link == "probit":
        share = ndtr(mean / np.sqrt(1.0 + w * w))
    else:
        share = expit(mean[:, np.newaxis] + w * _EVEN_NODES) @ _EVEN_WEIGHTS
    return np.asarray(campaigns.low + (campaigns.high - campaigns.low) * share)
