r"""Conditioning of normal quantities on an observation: the update of Kalman (1960).

.. math:: x \sim N(\mu, P), \quad y = H x + e, \quad e \sim N(0, R) \;\Rightarrow\;
    x | y \sim N\left(\mu + K (y - H \mu),\; P - K H P\right), \qquad
    K = P H^T (H P H^T + R)^{-1}
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Floats = NDArray[np.float64]


def conditioned(prior: Floats, *, way: Floats, error: Floats) -> Floats:
    """Return the covariance after an observation, shape (n, n).

    Parameters
    ----------
    prior : ndarray, shape (n, n)
        Covariance before, :math:`P`.
    way : ndarray, shape (m, n)
        What is observed, of what is to be known, :math:`H`.
    error : ndarray, shape (m, m)
        Covariance of the observation, :math:`R`.

    Examples
    --------
    >>> conditioned(np.eye(1), way=np.eye(1), error=np.eye(1)).round(9).tolist()
    [[0.5]]
    """
    crossed = prior @ way.T
    found = prior - crossed @ cho_solve(cho_factor(way @ crossed + error), crossed.T)
    return np.asarray(0.5 * (found + found.T))
