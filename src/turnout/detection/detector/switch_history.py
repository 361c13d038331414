r"""Prediction of the next sound throw of a switch: exact conditioning of the sound model.

Fixed for a switch are :math:`u` of the sound model and :math:`\delta`, the fixed part of the
discrepancy with the gains of its force sensors. Of a throw at friction level :math:`l`,

.. math:: y = m(l) + B(l)\,u + \delta + e

where :math:`e` holds what changes from throw to throw. :math:`u` and :math:`\delta` are normal
before the first throw (the population: empirical Bayes) and after each (Kalman 1960). A switch
drifts: between throws the covariance grows by a small share of that of the population. A change
that comes faster than that is never taken for drift, so a ramp stays visible.

A real switch may vary more from throw to throw than is assumed. :math:`C`, the part of the
covariance of :math:`e` beside the sound model, is multiplied by :math:`\lambda \ge 1`, which its
throws show. With :math:`S` the covariance of what a throw differs by from what was expected,
:math:`r`, and :math:`A = S^{-1/2}\, C\, S^{-T/2}`, :math:`w = S^{-1/2}\, r`, each throw moves it by

.. math:: \Delta\lambda = \frac{w^T A\, w - \operatorname{tr} A}{2 I}, \qquad
    I = I_0 + \tfrac{1}{2} \sum \operatorname{tr} A^2

the score over the information of all throws so far (recursive maximum likelihood).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from turnout.detection.detector.sound_model import SPACING_SHARE, SoundModel

Floats = NDArray[np.float64]

DRIFT = 1e-4
"""Variance by which a switch drifts from throw to throw, share of that of the population [-]."""
LEVEL_DEVIATION = 0.02
"""Standard deviation of the friction level of a throw of the history from its forces [-]."""
ASSUMED_INFORMATION = 25.0
r""":math:`I_0`, as if :math:`\lambda` were known to be 1 +- 0.2 before the first throw [-]."""
WORTH_REPEATING = 0.1
"""Growth of the scatter from which on throws are gone through once more [-]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expectation:
    r"""Knowledge of a switch.

    Attributes
    ----------
    mean : ndarray, shape (r + n_features,)
        Of :math:`u` and :math:`\\delta`.
    covariance : ndarray, shape (r + n_features, r + n_features)
        Of these.
    throws : int
        That it comes from.
    scatter : float
        Variance of what changes from throw to throw beside the sound model, in multiples of that
        assumed, 1 at least [-].
    information : float
        On the scatter: its inverse variance [-].
    """

    mean: Floats
    covariance: Floats
    throws: int = 0
    scatter: float = 1.0
    information: float = ASSUMED_INFORMATION


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

    def scattered(self, factor: float) -> "ThrowErrors":
        """Return those of a switch whose throws vary more, by a factor on the variance [-]."""
        return replace(self, changing=factor * self.changing)


def before_history(model: SoundModel, errors: ThrowErrors) -> Expectation:
    """Return what is known of a switch of the population."""
    modes, size = model.switch.shape[2], len(errors.fixed)
    covariance = np.zeros((modes + size, modes + size))
    covariance[:modes, :modes] = np.eye(modes)
    covariance[modes:, modes:] = errors.fixed
    return Expectation(mean=np.zeros(modes + size), covariance=covariance)


def covariance_of_throw(
    covariance: Floats, response: Floats, at: NDArray[np.intp]
) -> tuple[Floats, Floats]:
    r"""Return the covariances of :math:`B u + \delta`: with :math:`u, \delta`, and its own.

    Parameters
    ----------
    covariance : ndarray, shape (r + n_features, r + n_features)
        Of :math:`u` and :math:`\delta`.
    response : ndarray, shape (n, r)
        :math:`B`.
    at : ndarray of int, shape (m,)
        Features of the first m rows; there is no :math:`\delta` in the others.

    Returns
    -------
    crossed : ndarray, shape (n, r + n_features)
    own : ndarray, shape (n, n)
    """
    modes = response.shape[1]
    crossed = response @ covariance[:modes]
    crossed[: len(at)] += covariance[modes + at]
    own = crossed[:, :modes] @ response.T
    own[:, : len(at)] += crossed[:, modes + at]
    return crossed, own


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
    response, size = model.switch[number], len(errors.fixed)
    modes = response.shape[1]
    _, found = covariance_of_throw(known.covariance, response, np.arange(size))
    own = errors.scattered(known.scatter)
    found += error_at(model, own, number, level=SPACING_SHARE * model.spacing)
    mean = model.mean[number] + response @ known.mean[:modes]
    mean[:size] += known.mean[modes:]
    return mean, 0.5 * (found + found.T)


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
    seen = np.flatnonzero(np.isfinite(features))
    mean, response, error = _expected_at(model, errors.scattered(known.scatter), level)
    response, grid, modes = response[seen], np.ix_(seen, seen), response.shape[1]
    before = known.covariance
    if known.throws and drift:
        before = before + drift * before_history(model, errors).covariance
    crossed, covariance = covariance_of_throw(before, response, seen)
    lower = np.linalg.cholesky(covariance + error[grid])
    # the update of Kalman (1960) by the root of the covariance of what is seen
    gain = solve_triangular(lower, crossed, lower=True)
    off = (features - mean)[seen] - response @ known.mean[:modes] - known.mean[modes + seen]
    white = solve_triangular(lower, off, lower=True)
    half = solve_triangular(lower, errors.changing[grid], lower=True)
    share = solve_triangular(lower, half.T, lower=True)
    scatter, information = _scatter_after(known, white, share)
    return Expectation(
        mean=known.mean + white @ gain,
        covariance=before - gain.T @ gain,
        throws=known.throws + 1,
        scatter=scatter,
        information=information,
    )


def observe_all(
    model: SoundModel,
    errors: ThrowErrors,
    known: Expectation,
    features: Floats,
    *,
    levels: Floats,
) -> Expectation:
    """Return what is known after some sound throws.

    How much they vary is known after the last of them only. Where that is more than was assumed
    before, all are gone through once more with it, so that the first are not trusted too much.

    Parameters
    ----------
    model, errors, known
        As of `observe`.
    features : ndarray, shape (n_throws, n_features)
        In the order of time [N].
    levels : ndarray, shape (n_throws,)
        Friction level of each [-].
    """

    def after(start: Expectation) -> Expectation:
        for row, level in zip(features, levels, strict=True):
            start = observe(model, errors, start, row, level=float(level))
        return start

    found = after(known)
    if found.scatter - known.scatter < WORTH_REPEATING:
        return found
    return after(replace(known, scatter=found.scatter))


def _expected_at(
    model: SoundModel, errors: ThrowErrors, level: float
) -> tuple[Floats, Floats, Floats]:
    r"""Return mean features at a level, :math:`B` of them there, and the error."""
    size = len(errors.fixed)
    position = np.clip((level - model.level[0]) / model.spacing, 0.0, len(model.level) - 1.0)
    below = min(int(position), len(model.level) - 2)
    share = position - below
    response = (1.0 - share) * model.switch[below, :size] + share * model.switch[below + 1, :size]
    error = np.zeros((size, size))
    for at, part in ((below, 1.0 - share), (below + 1, share)):
        error += part * error_at(model, errors, at, level=LEVEL_DEVIATION)[:size, :size]
    return _on_curve(model, below, share)[:size], response, error


def _scatter_after(known: Expectation, white: Floats, share: Floats) -> tuple[float, float]:
    """Return the scatter of a switch and the information on it after a throw.

    Parameters
    ----------
    known : Expectation
        Before the throw.
    white : ndarray, shape (n,)
        What the throw differs by from what was expected, whitened, :math:`w` [-].
    share : ndarray, shape (n, n)
        Part of its covariance that the scatter multiplies, whitened, :math:`A` [-].
    """
    information = known.information + 0.5 * float(np.einsum("ij,ij->", share, share))
    score = 0.5 * float(white @ share @ white - np.trace(share))
    return max(1.0, known.scatter + score / information), information


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
