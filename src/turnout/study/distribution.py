"""Named distributions by their quantiles: a number between 0 and 1 becomes a value."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from turnout.study.scenario import Value

FloatArray = npt.NDArray[np.float64]
Parameters = Mapping[str, float]

# Needed parameters of each distribution; in the second place those that may be left out.
PARAMETERS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "uniform": (("minimum", "maximum"), ()),
    "log-uniform": (("minimum", "maximum"), ()),
    "normal": (("mean", "standard_deviation"), ()),
    "truncated normal": (("mean", "standard_deviation", "minimum", "maximum"), ()),
    "lognormal": (("median", "log_deviation"), ("minimum", "maximum")),
    "triangular": (("minimum", "mode", "maximum"), ()),
    "beta": (("minimum", "maximum", "alpha", "beta"), ()),
}
# Plain numbers whatever the variable is; all other parameters have its dimension.
DIMENSIONLESS_PARAMETERS = frozenset({"log_deviation", "alpha", "beta"})
# Draws keep to the open interval: the quantiles of 0 and 1 may be infinite.
PROBABILITY_MARGIN = 1e-12
# A difference of values, not a value: 5 K of scatter are not 5 K above absolute zero.
DIFFERENCE_PARAMETERS = frozenset({"standard_deviation"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """A distribution of numbers.

    Attributes
    ----------
    kind : str
        A key of `PARAMETERS`.
    parameters : mapping of str to float
        In SI; `log_deviation` is the standard deviation of the logarithm.
    """

    kind: str
    parameters: Parameters

    def quantile(self, share: npt.ArrayLike) -> FloatArray:
        """Return the values below which these shares of all draws lie.

        Parameters
        ----------
        share : array_like
            Between 0 and 1 [-].

        Examples
        --------
        >>> triangle = {"minimum": 0, "mode": 1, "maximum": 2}
        >>> law = Distribution(kind="triangular", parameters=triangle)
        >>> law.quantile([0.0, 0.5, 1.0]).tolist()
        [0.0, 1.0, 2.0]
        """
        with np.errstate(divide="ignore"):
            return _QUANTILES[self.kind](np.asarray(share, dtype=np.float64), self.parameters)

    def value(self, share: float) -> float:
        """Return one value."""
        return float(self.quantile(share))

    def drawn(self, shares: FloatArray) -> Sequence[Value]:
        """Return the value of each share, as `value` gives them."""
        found: list[Value] = self.quantile(shares).tolist()
        return found

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest value that can be drawn.

        Examples
        --------
        >>> law = Distribution(kind="uniform", parameters={"minimum": 1, "maximum": 3})
        >>> [round(value, 9) for value in law.bounds]
        [1.0, 3.0]
        """
        low, high = self.quantile([PROBABILITY_MARGIN, 1.0 - PROBABILITY_MARGIN]).tolist()
        return low, high


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """One of some values, by their weights.

    Attributes
    ----------
    values : tuple of float, str or bool
        At least one, numbers in SI.
    weights : tuple of float
        One a value, more than 0 [-].
    """

    values: tuple[Value, ...]
    weights: tuple[float, ...]

    def value(self, share: float) -> Value:
        """Return the value at a share of the summed weights.

        Examples
        --------
        >>> coin = Choice(values=("sleeper 1", "sleeper 6"), weights=(1.0, 3.0))
        >>> coin.value(0.2), coin.value(0.3)
        ('sleeper 1', 'sleeper 6')
        """
        return self.drawn(np.array([share]))[0]

    def drawn(self, shares: FloatArray) -> Sequence[Value]:
        """Return the value at each of some shares, as `value` gives them."""
        edges = np.cumsum(self.weights) / np.sum(self.weights)
        found = np.searchsorted(edges, shares, side="right").tolist()
        last = len(self.values) - 1
        return [self.values[min(number, last)] for number in found]


def normal_share(score: FloatArray) -> FloatArray:
    """Return the share of standard normal numbers below some.

    Examples
    --------
    >>> normal_share(np.zeros(1)).tolist()
    [0.5]
    """
    from scipy import special  # takes as long to load as some throws; many studies need none

    return np.asarray(special.ndtr(score), dtype=np.float64)


def normal_score(share: FloatArray) -> FloatArray:
    """Return the standard normal numbers below which these shares of all lie.

    Examples
    --------
    >>> normal_score(np.array([0.5])).tolist()
    [0.0]
    """
    from scipy import special

    return np.asarray(special.ndtri(share), dtype=np.float64)


def parameter_faults(kind: str, parameters: Parameters) -> list[tuple[str, str]]:
    """Find the faults in the parameters of a distribution: the parameter and a text for each.

    Examples
    --------
    >>> parameter_faults("uniform", {"minimum": 2.0, "maximum": 1.0})
    [('maximum', ': must be more than `minimum`')]
    """
    faults = [
        (name, ": must be more than 0")
        for name in ("standard_deviation", "log_deviation", "alpha", "beta", "median")
        if name in parameters and not parameters[name] > 0
    ]
    if kind == "log-uniform" and not parameters["minimum"] > 0:
        faults.append(("minimum", ": must be more than 0 for a log-uniform distribution"))
    low, high = parameters.get("minimum"), parameters.get("maximum")
    if low is not None and high is not None and not low < high:
        faults.append(("maximum", ": must be more than `minimum`"))
    elif kind == "triangular" and not parameters["minimum"] <= parameters["mode"] <= float(
        high or 0
    ):
        faults.append(("mode", ": must lie between `minimum` and `maximum`"))
    if faults or kind not in ("truncated normal", "lognormal"):
        return faults
    share = np.diff(_truncation_shares(kind, parameters))[0]
    if not share > 1e-6:
        faults.append(("minimum", " and `maximum`: almost no probability lies between them"))
    return faults


def _truncation_shares(kind: str, p: Parameters) -> FloatArray:
    """Return the shares of the untruncated distribution at its bounds."""
    low, high = p.get("minimum", -np.inf), p.get("maximum", np.inf)
    if kind == "lognormal":
        scores = [
            -np.inf if x <= 0 else (np.log(x / p["median"])) / p["log_deviation"]
            for x in (low, high)
        ]
    else:
        scores = [(x - p["mean"]) / p["standard_deviation"] for x in (low, high)]
    return normal_share(np.array(scores))


def _truncated_score(u: FloatArray, kind: str, p: Parameters) -> FloatArray:
    """Return normal scores of shares of the probability between the bounds."""
    below, above = _truncation_shares(kind, p)
    return normal_score(below + u * (above - below))


def _clip(values: FloatArray, p: Parameters) -> FloatArray:
    """Take rounding beyond a bound back to it."""
    return np.clip(values, p.get("minimum", -np.inf), p.get("maximum", np.inf))


def _uniform(u: FloatArray, p: Parameters) -> FloatArray:
    return p["minimum"] + u * (p["maximum"] - p["minimum"])


def _log_uniform(u: FloatArray, p: Parameters) -> FloatArray:
    return _clip(p["minimum"] * (p["maximum"] / p["minimum"]) ** u, p)


def _normal(u: FloatArray, p: Parameters) -> FloatArray:
    return p["mean"] + p["standard_deviation"] * normal_score(u)


def _truncated_normal(u: FloatArray, p: Parameters) -> FloatArray:
    scores = _truncated_score(u, "truncated normal", p)
    return _clip(p["mean"] + p["standard_deviation"] * scores, p)


def _lognormal(u: FloatArray, p: Parameters) -> FloatArray:
    scores = _truncated_score(u, "lognormal", p)
    return _clip(p["median"] * np.exp(p["log_deviation"] * scores), p)


def _triangular(u: FloatArray, p: Parameters) -> FloatArray:
    low, mode, high = p["minimum"], p["mode"], p["maximum"]
    split = (mode - low) / (high - low)
    left = low + np.sqrt(u * (high - low) * (mode - low))
    right = high - np.sqrt((1 - u) * (high - low) * (high - mode))
    return np.where(u < split, left, right)


def _beta(u: FloatArray, p: Parameters) -> FloatArray:
    from scipy import special

    share = special.betaincinv(p["alpha"], p["beta"], u)
    return np.asarray(p["minimum"] + (p["maximum"] - p["minimum"]) * share)


_QUANTILES: dict[str, Callable[[FloatArray, Parameters], FloatArray]] = {
    "uniform": _uniform,
    "log-uniform": _log_uniform,
    "normal": _normal,
    "truncated normal": _truncated_normal,
    "lognormal": _lognormal,
    "triangular": _triangular,
    "beta": _beta,
}
