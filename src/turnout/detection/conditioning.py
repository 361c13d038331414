r"""Conditioning of normal quantities on an observation: the update of Kalman (1960).

.. math:: x \sim N(\mu, P), \quad y = H x + e, \quad e \sim N(0, R) \;\Rightarrow\;
    x | y \sim N\left(\mu + K (y - H \mu),\; P - K H P\right), \qquad
    K = P H^T (H P H^T + R)^{-1}
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Floats = NDArray[np.float64]


def conditioned(prior: Floats, *, way: Floats, error: Floats) -> tuple[Floats, Floats]:
    """Return the covariance of what is known after an observation, and the gain.

    Parameters
    ----------
    prior : ndarray, shape (n, n)
        Covariance before, :math:`P`.
    way : ndarray, shape (m, n)
        What is observed, of what is to be known, :math:`H`.
    error : ndarray, shape (m, m)
        Covariance of the observation, :math:`R`.

    Returns
    -------
    covariance : ndarray, shape (n, n)
        After the observation.
    gain : ndarray, shape (n, m)
        :math:`K`.

    Examples
    --------
    >>> covariance, gain = conditioned(np.eye(1), way=np.eye(1), error=np.eye(1))
    >>> covariance.round(9).tolist(), gain.round(9).tolist()
    ([[0.5]], [[0.5]])
    """
    crossed = prior @ way.T
    solved = cho_solve(cho_factor(way @ crossed + error), crossed.T)
    found = prior - crossed @ solved
    return np.asarray(0.5 * (found + found.T)), np.asarray(solved.T)
