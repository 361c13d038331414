"""Values that scatter from place to place along the switch, alike where places are near."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from turnout.study.distribution import EDGE, Distribution, normal_share

FloatArray = npt.NDArray[np.float64]
CORRELATIONS = ("exponential", "gaussian")
# Added to the diagonal: a Gaussian correlation of close places is singular in rounding [-].
JITTER = 1e-10


@dataclass(frozen=True, slots=True, kw_only=True)
class RandomField:
    """A Gaussian field along x, seen through the quantiles of a distribution.

    Attributes
    ----------
    name : str
        Of the field in the results.
    key : str
        Family and field of the panel, such as "chair.friction_coefficient".
    members : tuple of str
        Names of the members, in the order of `x`.
    x : tuple of float
        Their places [m].
    distribution : Distribution
        Of the value at each place.
    correlation_length : float
        Distance in which the correlation falls to 1/e [m].
    correlation : str
        "exponential", :math:`e^{-d/L}`, rough, or "gaussian", :math:`e^{-(d/L)^2}`, smooth.
    factor : bool
        Whether its values multiply those of the panel instead of replacing them.
    """

    name: str
    key: str
    members: tuple[str, ...]
    x: tuple[float, ...]
    distribution: Distribution
    correlation_length: float
    correlation: str = "exponential"
    factor: bool = False

    def values(self, rng: np.random.Generator) -> dict[str, float]:
        """Draw a value for each member, in SI or as a factor [-].

        Examples
        --------
        >>> law = Distribution(kind="uniform", parameters={"minimum": 0.1, "maximum": 0.3})
        >>> field = RandomField(
        ...     name="friction", key="chair.friction_coefficient", members=("1", "2"), x=(0.0, 0.6),
        ...     distribution=law, correlation_length=2.0,
        ... )
        >>> list(field.values(np.random.default_rng(1)))
        ['1', '2']
        """
        root = correlation_root(
            np.array(self.x), length=self.correlation_length, kind=self.correlation
        )
        shares = normal_share(root @ rng.standard_normal(len(self.x)))
        drawn = self.distribution.quantile(np.clip(shares, EDGE, 1.0 - EDGE))
        return dict(zip(self.members, drawn.tolist(), strict=True))


def correlation_root(x: FloatArray, *, length: float, kind: str) -> FloatArray:
    """Return the Cholesky factor of the correlation between places.

    Parameters
    ----------
    x : ndarray, shape (n,)
        Places [m].
    length : float
        Distance in which the correlation falls to 1/e [m].
    kind : str
        "exponential" or "gaussian".

    Returns
    -------
    ndarray, shape (n, n)
        Lower triangle; with its transpose it gives the correlation.

    Examples
    --------
    >>> root = correlation_root(np.array([0.0, 2.0]), length=2.0, kind="exponential")
    >>> round(float((root @ root.T)[0, 1]), 6)
    0.367879
    """
    distance = np.abs(x[:, np.newaxis] - x[np.newaxis, :]) / length
    matrix = np.exp(-distance) if kind == "exponential" else np.exp(-(distance**2))
    jittered = (matrix + JITTER * np.eye(x.size)) / (1.0 + JITTER)
    return np.linalg.cholesky(jittered).astype(np.float64)
