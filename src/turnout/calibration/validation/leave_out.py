r"""Predict the movements at each place from those at all others, where none were held back.

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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
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
