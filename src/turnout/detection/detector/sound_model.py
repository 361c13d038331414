r"""Sound throws as local Gaussians along the friction level, with what is fixed for a switch apart.

At friction level :math:`l` a throw and its end gaps, :math:`z`, are

.. math:: z = m(l) + B(l)\,u + e, \qquad u \sim N(0, I), \quad e \sim N(0, W(l))

:math:`u` holds what is fixed for a switch. It is found from simulated throws, whose inputs are
known: :math:`z` is fitted by polynomials in level and inputs, products of inputs too; the curves
over :math:`l` that the inputs of the population make are reduced to their principal components.
:math:`W` is the local covariance of what the fit leaves. It varies from throw to throw.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.detection.population import BANDWIDTH, independent

Floats = NDArray[np.float64]

MEAN_DEGREE, LINEAR_DEGREE, PRODUCT_DEGREE = 6, 3, 1
CENTRES = 11
TAIL = 0.01
"""Share of the levels beyond the outermost centres on either side [-]."""
KEPT = 0.999
"""Share of the variance of switches that principal components keep [-]."""
SPACING_SHARE = 0.6
"""Standard deviation of the level about a centre, in spacings [-]."""
SHRINKAGE = 0.05
"""Weight of the covariance of all levels in that of one [-]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SoundModel:
    """Local Gaussians at some centres.

    Attributes
    ----------
    level : ndarray, shape (k,)
        Of the centres, rising [-].
    weight : ndarray, shape (k,)
        Share of the throws around each [-].
    mean : ndarray, shape (k, n)
        Features [N], then end gaps [m].
    slope : ndarray, shape (k, n)
        Change of the mean with the level.
    switch : ndarray, shape (k, n, r)
        :math:`B`.
    within : ndarray, shape (k, n, n)
        :math:`W`.
    shift : ndarray, shape (k, n_features, n_features)
        Second moments of the change of features with the onset of their movement [N^2/s^2].
    """

    level: Floats
    weight: Floats
    mean: Floats
    slope: Floats
    switch: Floats
    within: Floats
    shift: Floats

    @property
    def spacing(self) -> float:
        """Between centres [-]."""
        return float(self.level[1] - self.level[0])

    @property
    def gaps(self) -> int:
        """Number of end gaps."""
        return int(self.mean.shape[1] - self.shift.shape[1])


def fit_sound_model(
    values: Floats,
    *,
    level: Floats,
    inputs: Floats,
    rates: Floats,
    part: NDArray[np.intp],
    scale: Floats,
    centres: int = CENTRES,
) -> tuple[SoundModel, Floats]:
    """Fit local Gaussians to sound throws without noise, and return what the fit leaves of each.

    Parameters
    ----------
    values : ndarray, shape (n_throws, n)
        Features and end gaps.
    level : ndarray, shape (n_throws,)
        Mean friction coefficient [-].
    inputs : ndarray, shape (n_throws, n_inputs)
        What is fixed for a switch, in any unit.
    rates : ndarray, shape (n_throws, n_features)
        Change of features with the onset of their movement [N/s].
    part : ndarray of int, shape (n_features,)
        Movement of each feature.
    scale : ndarray, shape (n,)
        What counts as much in each value: its assumed discrepancy.
    centres : int
        Levels.

    Returns
    -------
    model : SoundModel
        Of the throws.
    residual : ndarray, shape (n_throws, n)
        Of each throw.
    """
    low, high = np.quantile(level, [TAIL, 1.0 - TAIL])
    at = np.linspace(low, high, centres)
    spread = inputs.std(axis=0)
    kept = spread > 0.0
    theta = independent((inputs[:, kept] - inputs[:, kept].mean(axis=0)) / spread[kept])
    fit = _Fit(values, level=level, theta=theta)
    modes = _principal(np.stack([fit.of_switch(centre) for centre in at], axis=1) / scale)
    switch = modes * scale[:, np.newaxis]
    spacing = at[1] - at[0]
    weights = np.exp(-0.5 * ((level - at[:, np.newaxis]) / BANDWIDTH) ** 2)
    weights /= weights.sum(axis=1, keepdims=True)
    share = np.exp(-0.5 * ((level - at[:, np.newaxis]) / (SPACING_SHARE * spacing)) ** 2)
    share = share.mean(axis=1) + 0.05 * share.mean()
    residual = fit.residual
    whole = fit.lost * residual.T @ residual / len(residual)
    same = part[:, np.newaxis] == part
    within, shift = [], []
    for row in weights:
        local = fit.lost * (residual.T * row) @ residual
        within.append((1.0 - SHRINKAGE) * local + SHRINKAGE * whole)
        shift.append(np.where(same, (rates.T * row) @ rates, 0.0))
    model = SoundModel(
        level=at,
        weight=share / share.sum(),
        mean=np.array([fit.mean(centre) for centre in at]),
        slope=np.array([fit.slope(centre) for centre in at]),
        switch=switch,
        within=np.array(within),
        shift=np.array(shift),
    )
    return model, residual


class _Fit:
    """Least squares of throws by polynomials in level and inputs."""

    def __init__(self, values: Floats, *, level: Floats, theta: Floats) -> None:
        self._middle = float(level.mean())
        self._half = float(np.ptp(level)) / 2.0
        first, second = np.triu_indices(theta.shape[1])
        products = theta[:, first] * theta[:, second]
        products -= products.mean(axis=0)
        both = np.hstack([theta, products])
        self._root = np.linalg.cholesky(both.T @ both / len(both) + 1e-9 * np.eye(both.shape[1])).T
        along = (level - self._middle) / self._half
        design = np.hstack(
            [
                _powers(along, MEAN_DEGREE),
                _times(_powers(along, LINEAR_DEGREE), theta),
                _times(_powers(along, PRODUCT_DEGREE), products),
            ]
        )
        found, *_ = np.linalg.lstsq(design, values, rcond=None)
        self.residual = values - design @ found
        # what the fit took out of the residuals
        self.lost = len(level) / max(len(level) - design.shape[1], 0.2 * len(level))
        ends = np.cumsum([MEAN_DEGREE + 1, (LINEAR_DEGREE + 1) * theta.shape[1]])
        self._mean, linear, product = np.split(found, ends)
        self._linear = linear.reshape(LINEAR_DEGREE + 1, theta.shape[1], -1)
        self._product = product.reshape(PRODUCT_DEGREE + 1, products.shape[1], -1)

    def mean(self, level: float) -> Floats:
        return np.asarray(np.polynomial.chebyshev.chebval(self._along(level), self._mean))

    def slope(self, level: float) -> Floats:
        found = np.polynomial.chebyshev.chebder(self._mean, axis=0)
        return np.asarray(np.polynomial.chebyshev.chebval(self._along(level), found) / self._half)

    def of_switch(self, level: float) -> Floats:
        """Return what uncorrelated inputs and products make of a throw, shape (n_inputs, n)."""
        along = np.array([self._along(level)])
        of_inputs = np.tensordot(_powers(along, LINEAR_DEGREE)[0], self._linear, axes=1)
        of_products = np.tensordot(_powers(along, PRODUCT_DEGREE)[0], self._product, axes=1)
        return np.asarray(self._root @ np.vstack([of_inputs, of_products]))

    def _along(self, level: float) -> float:
        return (level - self._middle) / self._half


def _powers(along: Floats, degree: int) -> Floats:
    """Return Chebyshev polynomials up to a degree, shape (n, degree + 1)."""
    return np.asarray(np.polynomial.chebyshev.chebvander(along, degree), dtype=np.float64)


def _times(first: Floats, second: Floats) -> Floats:
    return (first[:, :, np.newaxis] * second[:, np.newaxis, :]).reshape(len(first), -1)


def _principal(responses: Floats) -> Floats:
    """Return the principal components of what uncorrelated inputs make, each times its deviation.

    Parameters
    ----------
    responses : ndarray, shape (n_inputs, k, n)
        Each to an input of unit variance.

    Returns
    -------
    ndarray, shape (k, n, r)
    """
    count, centres, size = responses.shape
    _, values, directions = np.linalg.svd(responses.reshape(count, -1), full_matrices=False)
    explained = np.cumsum(values**2) / np.sum(values**2)
    keep = int(np.searchsorted(explained, KEPT)) + 1
    found = directions[:keep].T * values[:keep]
    return np.asarray(found.reshape(centres, size, keep))
