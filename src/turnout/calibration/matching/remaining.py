"""Ranges and combinations of the accepted panels, and measurements that would separate them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from turnout.calibration.matching.facts import Facts, Sum

Floats = NDArray[np.float64]

FEWEST = 10
"""Accepted panels below which nothing is said about them."""
STRONG = 0.5
"""Rank correlation from which two parameters are named."""
NODES = np.array([-np.sqrt(3.0), 0.0, np.sqrt(3.0)])
NODE_WEIGHTS = np.array([1.0, 4.0, 1.0]) / 6.0
"""Three-point Gauss-Hermite rule for the error of a measurement, in standard deviations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Range:
    """A parameter before and after: bounds as stated, and those of the accepted panels, in SI.

    Attributes
    ----------
    name, unit, origin : str
        Of the parameter.
    minimum, maximum : float
        As stated.
    least, low, median, high, most : float
        Of the accepted panels: extremes, and 5, 50 and 95 % of them.
    left : float
        Spread of the accepted panels as a share of that of the stated range [-].
    """

    name: str
    unit: str
    origin: str
    minimum: float
    maximum: float
    least: float
    low: float
    median: float
    high: float
    most: float
    left: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Combination:
    """Two parameters that the facts bind together, by their rank correlation (Spearman) [-]."""

    first: str
    second: str
    correlation: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Gain:
    """Expected effect of a further measurement on the accepted panels.

    Attributes
    ----------
    name, unit, origin : str
        Of the measurement.
    precision, spread : float
        Its standard deviation, and that of its value over the accepted panels.
    left : float
        Share of the panels that would remain, counted by the entropy of their weights [-].
    parameters, answers : float
        Mean share of the variance of the parameters, and of the answers, that would remain [-].
    """

    name: str
    unit: str
    origin: str
    precision: float
    spread: float
    left: float
    parameters: float
    answers: float


def ranges(facts: Facts, points: Floats) -> list[Range]:
    """Return each parameter before and after.

    Parameters
    ----------
    facts : Facts
        With the stated ranges.
    points : ndarray, shape (n_accepted, n_parameters)
        Accepted panels as shares of the ranges.
    """
    found = []
    for parameter, shares in zip(facts.parameters, points.T, strict=True):
        marks = parameter.value(np.quantile(shares, [0.0, 0.05, 0.5, 0.95, 1.0]))
        found.append(
            Range(
                name=parameter.name,
                unit=parameter.unit,
                origin=parameter.origin,
                minimum=parameter.minimum,
                maximum=parameter.maximum,
                least=float(marks[0]),
                low=float(marks[1]),
                median=float(marks[2]),
                high=float(marks[3]),
                most=float(marks[4]),
                left=float(shares.std() * np.sqrt(12.0)),
            )
        )
    return found


def combinations(facts: Facts, points: Floats, *, strong: float = STRONG) -> list[Combination]:
    """Return the pairs of parameters with a strong rank correlation, the strongest first."""
    ranked = np.apply_along_axis(rankdata, 0, points)
    matrix = np.corrcoef(ranked.T)
    names = [item.name for item in facts.parameters]
    found = [
        Combination(first=names[i], second=names[j], correlation=float(matrix[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(matrix[i, j]) >= strong
    ]
    return sorted(found, key=lambda item: -abs(item.correlation))


def fixed_direction(facts: Facts, points: Floats, *, most: int = 4) -> list[tuple[float, str]]:
    """Return the combination of parameters that the facts fix most, its largest parts first.

    It is the eigenvector of the least variance of the scaled parameters; each part is a share of
    the stated range.
    """
    values, vectors = np.linalg.eigh(np.cov(points.T))
    weights = vectors[:, int(np.argmin(values))]
    weights = weights / weights[np.argmax(np.abs(weights))]
    order = np.argsort(-np.abs(weights))[:most]
    return [(float(weights[number]), facts.parameters[number].name) for number in order]


def gains(
    facts: Facts,
    points: Floats,
    measured: Floats,
    answers: Floats,
) -> list[Gain]:
    r"""Return what each further measurement is expected to leave, the most useful first.

    Each accepted panel is taken as the true one in turn. A measurement of it gives every panel the
    weight

    .. math:: w_i \propto \exp(-(y_i - y_j - e)^2 / 2 s^2)

    with error e, averaged over its normal distribution.

    Parameters
    ----------
    facts : Facts
        With the measurements.
    points : ndarray, shape (n, n_parameters)
        Accepted panels as shares of the ranges.
    measured : ndarray, shape (n, n_measurements)
        What each would show, in SI.
    answers : ndarray, shape (n, n_answers)
        What is to be predicted, in SI.
    """
    found = []
    for item, column in zip(facts.measurements, measured.T, strict=True):
        weights = _weights(column, item.precision)
        found.append(_gain(item, column, weights, points, answers))
    return sorted(found, key=lambda gain: gain.left)


def _weights(values: Floats, precision: float) -> Floats:
    """Return the weights of all panels by true panel and error, shape (n, 3, n)."""
    shown = values[:, np.newaxis] + precision * NODES
    logs = -0.5 * ((shown[:, :, np.newaxis] - values) / precision) ** 2
    weights = np.exp(logs - logs.max(axis=2, keepdims=True))
    return np.asarray(weights / weights.sum(axis=2, keepdims=True))


def _gain(item: Sum, column: Floats, weights: Floats, points: Floats, answers: Floats) -> Gain:
    entropy = -(weights * np.log(np.maximum(weights, 1e-300))).sum(axis=2)
    left = float((np.exp(entropy) @ NODE_WEIGHTS).mean()) / len(column)
    return Gain(
        name=item.name,
        unit=item.unit,
        origin=item.origin,
        precision=item.precision,
        spread=float(column.std()),
        left=left,
        parameters=_variance_left(points, weights),
        answers=_variance_left(answers, weights),
    )


def _variance_left(values: Floats, weights: Floats) -> float:
    """Return the mean share of the variance of columns that weights are expected to leave."""
    moving = values[:, values.std(axis=0) > 0.0]
    if not moving.size:
        return 1.0
    mean = weights @ moving
    spread = weights @ moving**2 - mean**2
    expected = np.einsum("jek,e->k", spread, NODE_WEIGHTS) / len(values)
    return float((expected / moving.var(axis=0)).mean())


def answer_rows(answers: Sequence[Sum], values: Floats) -> list[dict[str, float | str]]:
    """Return how each answer spreads over panels: least, 5, 50, 95 % and most, in SI."""
    rows: list[dict[str, float | str]] = []
    for item, column in zip(answers, values.T, strict=True):
        marks = np.quantile(column, [0.0, 0.05, 0.5, 0.95, 1.0])
        names = ("least", "low", "median", "high", "most")
        row: dict[str, float | str] = {"name": item.name, "unit": item.unit}
        rows.append(row | dict(zip(names, map(float, marks), strict=True)))
    return rows
