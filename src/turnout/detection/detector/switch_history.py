r"""What sound throws of a switch say about the next one: exact conditioning of the sound model.

Fixed for a switch are :math:`u` of the sound model and :math:`\delta`, the fixed part of the
discrepancy with the gains of its force sensors. Of a throw at friction level :math:`l`,

.. math:: y = m(l) + B(l)\,u + \delta + e

where :math:`e` holds what changes from throw to throw. :math:`u` and :math:`\delta` are normal
before the first throw (the population: empirical Bayes) and after each (Kalman 1960). A switch
drifts: between throws the covariance grows by a small share of that of the population. A change
that comes faster than that is never taken for drift, so a ramp stays visible.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.detection.conditioning import conditioned
from turnout.detection.detector.sound_model import SPACING_SHARE, SoundModel

Floats = NDArray[np.float64]

DRIFT = 1e-4
"""Variance by which a switch drifts from throw to throw, share of that of the population [-]."""
LEVEL_DEVIATION = 0.02
"""How well the friction level of a throw of the history is known from its forces [-]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expectation:
    r"""What is known of a switch.

    Attributes
    ----------
    mean : ndarray, shape (r + n_features,)
        Of :math:`u` and :math:`\\delta`.
    covariance : ndarray, shape (r + n_features, r + n_features)
        Of these.
    throws : int
        That it comes from.
    """

    mean: Floats
    covariance: Floats
    throws: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrowErrors:
    """Covariances of features beside the sound model.

    Attributes
    ----------
    fixed : ndarray, shape (n_features, n_features)
        The same in all throws of a switch [N^2].
    changing : ndarray, shape (n_features, n_features)
        Drawn again in each throw [N^2].
    timing : float
        Standard deviation of the onset of a movement [s].
    gap : float
        Standard deviation of end gaps [m].
    """

    fixed: Floats
    changing: Floats
    timing: float
    gap: float

    def some(self, index: NDArray[np.intp]) -> "ThrowErrors":
        """Return those of some features."""
        grid = np.ix_(index, index)
        return replace(self, fixed=self.fixed[grid], changing=self.changing[grid])


def before_history(model: SoundModel, errors: ThrowErrors) -> Expectation:
    """Return what is known of a switch of the population."""
    modes, size = model.switch.shape[2], len(errors.fixed)
    covariance = np.zeros((modes + size, modes + size))
    covariance[:modes, :modes] = np.eye(modes)
    covariance[modes:, modes:] = errors.fixed
    return Expectation(mean=np.zeros(modes + size), covariance=covariance)


def response_at(model: SoundModel, number: int, *, size: int) -> Floats:
    r"""Return what :math:`u`, :math:`\delta` make of a throw at a centre, shape (n, r + size)."""
    rows = model.switch.shape[1]
    fixed = np.zeros((rows, size))
    fixed[:size] = np.eye(size)
    return np.hstack([model.switch[number], fixed])


def error_at(model: SoundModel, errors: ThrowErrors, number: int, *, level: float) -> Floats:
    """Return the covariance of what changes from throw to throw at a centre, shape (n, n).

    Parameters
    ----------
    model : SoundModel
        With n values, features and then gaps.
    errors : ThrowErrors
        Beside it.
    number : int
        Of the centre.
    level : float
        Standard deviation of the level about it [-].
    """
    size = len(errors.fixed)
    found = model.within[number] + level**2 * np.outer(model.slope[number], model.slope[number])
    found[:size, :size] += errors.changing + errors.timing**2 * model.shift[number]
    gaps = np.arange(size, len(found))
    found[gaps, gaps] += errors.gap**2
    return np.asarray(found)


def predict(
    model: SoundModel, errors: ThrowErrors, known: Expectation, number: int
) -> tuple[Floats, Floats]:
    """Return mean and covariance of the next sound throw at a centre, features and then gaps."""
    size = len(errors.fixed)
    response = response_at(model, number, size=size)
    found = response @ known.covariance @ response.T
    found += error_at(model, errors, number, level=SPACING_SHARE * model.spacing)
    return model.mean[number] + response @ known.mean, 0.5 * (found + found.T)


def observe(
    model: SoundModel,
    errors: ThrowErrors,
    known: Expectation,
    features: Floats,
    *,
    level: float,
    drift: float = DRIFT,
) -> Expectation:
    """Return what is known after a sound throw.

    Parameters
    ----------
    model : SoundModel
        Of the population.
    errors : ThrowErrors
        Beside it.
    known : Expectation
        Before the throw.
    features : ndarray, shape (n_features,)
        [N]; NaN in a movement that was not recorded.
    level : float
        Friction level of the throw [-].
    drift : float
        Variance by which the switch drifts since the throw before, share of the population's [-].
    """
    size, _modes = len(errors.fixed), model.switch.shape[2]
    position = np.clip((level - model.level[0]) / model.spacing, 0.0, len(model.level) - 1.0)
    below = min(int(position), len(model.level) - 2)
    share = position - below
    response = (1.0 - share) * response_at(model, below, size=size)[:size]
    response += share * response_at(model, below + 1, size=size)[:size]
    mean = _on_curve(model, below, share)[:size]
    error = np.zeros((size, size))
    for at, part in ((below, 1.0 - share), (below + 1, share)):
        error += part * error_at(model, errors, at, level=LEVEL_DEVIATION)[:size, :size]
    seen = np.isfinite(features)
    response, mean, error, own = (
        response[seen],
        mean[seen],
        error[np.ix_(seen, seen)],
        features[seen],
    )
    before = known.covariance
    if known.throws and drift:
        before = before + drift * before_history(model, errors).covariance
    covariance, gain = conditioned(before, way=response, error=error)
    return Expectation(
        mean=known.mean + gain @ (own - mean - response @ known.mean),
        covariance=covariance,
        throws=known.throws + 1,
    )


def _on_curve(model: SoundModel, below: int, share: float) -> Floats:
    """Return the mean between two centres, by the cubic through their means and slopes."""
    start, end = model.mean[below], model.mean[below + 1]
    first, last = model.spacing * model.slope[below], model.spacing * model.slope[below + 1]
    t = share
    return np.asarray(
        (1.0 + 2.0 * t) * (1.0 - t) ** 2 * start
        + t * (1.0 - t) ** 2 * first
        + t**2 * (3.0 - 2.0 * t) * end
        - t**2 * (1.0 - t) * last
    )
