"""Points of the unit cube: one a state of the switch, one coordinate a variable.

Every method gives the same points for the same seed whatever was requested before. Points of
"random" are drawn one by one, so that more of them leave the earlier ones as they were; the others
fill the cube evenly and are known only together.
"""

import functools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from turnout.study.distribution import PROBABILITY_MARGIN, normal_score, normal_share
from turnout.study.seeds import generators

FloatArray = npt.NDArray[np.float64]

METHODS = ("random", "latin hypercube", "sobol", "saltelli")
# Streams of chance that share the seed of a study.
POINTS, FIELDS, SCENARIOS = 1, 2, 3


def count_states(method: str, *, count: int, dimensions: int) -> int:
    """Return the number of states of the switch in a design.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    count : int
        As the study file gives it.
    dimensions : int
        Variables that are drawn.

    Examples
    --------
    >>> count_states("sobol", count=64, dimensions=3)
    64
    >>> count_states("saltelli", count=64, dimensions=3)
    320
    """
    return count * (dimensions + 2) if method == "saltelli" else count


def sample_points(
    method: str,
    *,
    count: int,
    dimensions: int,
    seed: int,
    states: Sequence[int],
    attempt: int = 0,
) -> FloatArray:
    """Return the coordinates of some states.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    count, dimensions, seed : int
        Of the design.
    states : sequence of int
        Their numbers, from 0 to count - 1.
    attempt : int
        How often these states were drawn before; of "random" alone.

    Returns
    -------
    ndarray, shape (n_states, dimensions)
        Each between 0 and 1, without either.

    Examples
    --------
    >>> sample_points("random", count=1, dimensions=2, seed=1, states=[5]).shape
    (1, 2)
    """
    if method == "random":
        again = [attempt] if attempt else []
        drawn = np.empty((len(states), dimensions))
        for row, rng in zip(drawn, generators([seed, POINTS], states, again), strict=True):
            rng.random(out=row)
        return np.clip(drawn, PROBABILITY_MARGIN, 1.0 - PROBABILITY_MARGIN)
    found: FloatArray = _points(method, count, dimensions, seed)[list(states)]
    return found


@functools.lru_cache(maxsize=4)
def _points(method: str, count: int, dimensions: int, seed: int) -> FloatArray:
    """Return all points of a design that is known only as a whole."""
    from scipy.stats import qmc  # takes as long to import as some throws; random points need none

    rng = np.random.default_rng([seed, POINTS])
    if method == "latin hypercube":
        points = qmc.LatinHypercube(dimensions, rng=rng).random(count)
    elif method == "sobol":
        points = qmc.Sobol(dimensions, rng=rng).random(count)
    else:
        points = _saltelli(qmc.Sobol(2 * dimensions, rng=rng).random(count))
    points = np.clip(points, PROBABILITY_MARGIN, 1.0 - PROBABILITY_MARGIN)
    points.flags.writeable = False
    return points


def _saltelli(pairs: FloatArray) -> FloatArray:
    """Return rows A, A with each column in turn of B, and B, one block a pair of points.

    Saltelli et al. 2010, doi 10.1016/j.cpc.2009.09.018: the design behind first and total indices.
    """
    dimensions = pairs.shape[1] // 2
    first, second = pairs[:, :dimensions], pairs[:, dimensions:]
    blocks = np.repeat(first[:, np.newaxis, :], dimensions + 2, axis=1)
    for column in range(dimensions):
        blocks[:, column + 1, column] = second[:, column]
    blocks[:, -1, :] = second
    return blocks.reshape(-1, dimensions)


def correlate(shares: FloatArray, *, factor: FloatArray) -> FloatArray:
    """Join independent coordinates by a Gaussian copula.

    Parameters
    ----------
    shares : ndarray, shape (n,)
        Independent, each uniform between 0 and 1.
    factor : ndarray, shape (n, n)
        Lower Cholesky factor of the correlation of the normal scores.

    Returns
    -------
    ndarray, shape (n,)
        Each still uniform.

    Examples
    --------
    >>> correlate(np.array([0.3, 0.9]), factor=np.eye(2)).round(12).tolist()
    [0.3, 0.9]
    """
    joined = normal_share(factor @ normal_score(shares))
    return np.clip(joined, PROBABILITY_MARGIN, 1.0 - PROBABILITY_MARGIN)


def normal_score_correlation(rank: float) -> float:
    r"""Return the correlation of normal scores that gives a rank correlation (Spearman's).

    .. math:: r = 2 \sin(\pi \rho_S / 6)

    Exact for the Gaussian copula; Pearson 1907.

    Examples
    --------
    >>> normal_score_correlation(1.0), round(normal_score_correlation(0.5), 4)
    (1.0, 0.5176)
    """
    return round(2.0 * float(np.sin(np.pi * rank / 6.0)), 15)


def copula_factor(
    names: Sequence[str], pairs: Sequence[tuple[str, str, float]]
) -> tuple[FloatArray | None, str]:
    """Return the Cholesky factor of a copula, or the reason for having none.

    Parameters
    ----------
    names : sequence of str
        Of all drawn variables.
    pairs : sequence of (str, str, float)
        Two of the names and their rank correlation; all other pairs are independent.

    Returns
    -------
    factor : ndarray, shape (n, n), or None
        None where the correlations contradict each other.
    fault : str
        Why; empty if nothing is wrong.

    Examples
    --------
    >>> copula_factor(["a", "b"], [("a", "b", 0.0)])[0].tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """
    matrix = np.eye(len(names))
    for first, second, rank in pairs:
        row, column = names.index(first), names.index(second)
        matrix[row, column] = matrix[column, row] = normal_score_correlation(rank)
    least = float(np.linalg.eigvalsh(matrix).min()) if len(names) else 1.0
    if least < 1e-9:
        text = (
            f"contradict each other: the matrix is not positive definite (least eigenvalue "
            f"{least:.3g}, must be more than 0); make the strongest of them weaker"
        )
        return None, text
    return np.linalg.cholesky(matrix).astype(np.float64), ""
