"""One step of Levenberg and Marquardt within bounds; notation as of `fit`."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from turnout.calibration.parameter import Parameter, coordinates, prior_residuals, prior_slopes

Floats = NDArray[np.float64]
# Longest step, a factor of 1.6 [coordinate].
MAX_STEP = 0.5


def bounded_step(
    r: Floats,
    J: Floats,
    parameters: Sequence[Parameter],
    values: Mapping[str, float],
    damping: float,
) -> tuple[Floats, float]:
    r"""Return the Levenberg-Marquardt step within bounds, and the predicted decrease of the cost.

    .. math::

        \min_s \|J s + r\|^2 + \lambda \|D s\|^2, \quad D_{jj} = \|J_{:j}\|

    Parameters
    ----------
    r : ndarray, shape (n,)
        Whitened residuals [-].
    J : ndarray, shape (n, p)
        Their change with each coordinate.
    parameters : sequence of Parameter
        With bounds, in the order of the columns of `J`.
    values : mapping of str to float
        At the present point.
    damping : float
        :math:`\lambda` [-].
    """
    theta = coordinates(parameters, values)
    J = np.vstack([J, np.diag(prior_slopes(parameters))])
    r = np.concatenate([r, prior_residuals(parameters, theta)])
    D = np.sqrt((J**2).sum(axis=0))
    D = np.where(D > 0, D, 1.0)
    lower = np.array([item.coordinate(item.lower) for item in parameters]) - theta
    upper = np.array([item.coordinate(item.upper) for item in parameters]) - theta
    lower = np.minimum(np.maximum(lower, -MAX_STEP), -1e-12)
    upper = np.maximum(np.minimum(upper, MAX_STEP), 1e-12)
    # The triangle of [J r] gives the same step as the tall matrices.
    R: Floats = np.asarray(np.linalg.qr(np.column_stack([J, r]), mode="r"), dtype=np.float64)
    p = len(parameters)
    matrix = np.vstack([R[:, :p], np.sqrt(damping) * np.diag(D)])
    right = np.concatenate([-R[:, p], np.zeros(p)])
    step = lsq_linear(matrix, right, bounds=(lower, upper)).x
    r_linear = r + J @ step
    return np.asarray(step), float(r @ r - r_linear @ r_linear)
