r"""A population of sound switches as a local linear-Gaussian model along the friction level.

.. math:: y = m(l) + G(l)\,\theta + e, \qquad \theta \sim N(0, I), \quad e \sim N(0, W(l))

:math:`\theta` is what is fixed for a switch, standardised; mean and sensitivities are polynomials
in the friction level :math:`l`, fitted by least squares; :math:`W` is the covariance of what they
leave, weighted around the level. It holds the chair field, the clock, and what is not linear in
:math:`\theta`, which so counts as changing from throw to throw.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MEAN_DEGREE, SENSITIVITY_DEGREE = 6, 2
CENTRES = 9
BANDWIDTH = 0.05
"""Standard deviation of the weights around a level [-]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Local:
    """The model at one friction level.

    Attributes
    ----------
    level : float
        [-]
    mean : ndarray, shape (n_features,)
        :math:`m` [N].
    sensitivity : ndarray, shape (n_features, n_inputs)
        :math:`G` [N].
    slope : ndarray, shape (n_features,)
        :math:`dm/dl` [N].
    within : ndarray, shape (n_features, n_features)
        :math:`W` [N^2].
    """

    level: float
    mean: Floats
    sensitivity: Floats
    slope: Floats
    within: Floats


def local_models(
    features: Floats, *, switch: Floats, level: Floats, centres: int = CENTRES
) -> tuple[Local, ...]:
    """Fit the model and give it at some levels, evenly by rank.

    Parameters
    ----------
    features : ndarray, shape (n_throws, n_features)
        Of sound throws without discrepancy and noise [N].
    switch : ndarray, shape (n_throws, n_inputs)
        What is fixed for a switch, in any unit.
    level : ndarray, shape (n_throws,)
        Mean friction coefficient [-].
    centres : int
        Levels.
    """
    spread = switch.std(axis=0)
    kept = spread > 0.0
    theta = (switch[:, kept] - switch[:, kept].mean(axis=0)) / spread[kept]
    theta = independent(theta)
    middle, half = level.mean(), np.ptp(level) / 2.0
    along = (level - middle) / half
    means = np.polynomial.chebyshev.chebvander(along, MEAN_DEGREE)
    ways = np.polynomial.chebyshev.chebvander(along, SENSITIVITY_DEGREE)
    products = (ways[:, :, np.newaxis] * theta[:, np.newaxis, :]).reshape(len(level), -1)
    design = np.hstack([means, products])
    found, *_ = np.linalg.lstsq(design, features, rcond=None)
    rest = features - design @ found
    of_mean, of_switch = found[: MEAN_DEGREE + 1], found[MEAN_DEGREE + 1 :]
    of_switch = of_switch.reshape(SENSITIVITY_DEGREE + 1, theta.shape[1], -1)
    slopes = np.polynomial.chebyshev.chebder(of_mean, axis=0)
    # what the fit took out of the residuals
    lost = len(level) / (len(level) - design.shape[1])
    at = np.quantile(level, (np.arange(centres) + 0.5) / centres)
    models = []
    for centre in at:
        place = (centre - middle) / half
        weights = np.exp(-0.5 * ((level - centre) / BANDWIDTH) ** 2)
        weights /= weights.sum()
        models.append(
            Local(
                level=float(centre),
                mean=np.polynomial.chebyshev.chebval(place, of_mean),
                sensitivity=np.tensordot(
                    np.polynomial.chebyshev.chebvander(np.array([place]), SENSITIVITY_DEGREE)[0],
                    of_switch,
                    axes=1,
                ).T,
                slope=np.polynomial.chebyshev.chebval(place, slopes) / half,
                within=lost * (rest.T * weights) @ rest,
            )
        )
    return tuple(models)


def independent(values: Floats) -> Floats:
    """Return columns of unit variance that are uncorrelated and span the same, fewer if dependent.

    Parameters
    ----------
    values : ndarray, shape (n, n_inputs)
        With mean 0.

    Examples
    --------
    >>> independent(np.array([[1.0, 1.0], [-1.0, -1.0]])).shape
    (2, 1)
    """
    left, sizes, _ = np.linalg.svd(values, full_matrices=False)
    kept = sizes > DEPENDENT * sizes[0]
    return np.asarray(left[:, kept] * np.sqrt(len(values)))


DEPENDENT = 0.03
"""Inputs whose combination spreads less than this share are one: the two stress-free fractions."""
