"""Baselines that need numpy only: limits on a few numbers, a reference curve, PCA."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.make_throws import STEP, fine_layout
from benchmarks.detection.method import Judged, Model
from turnout.detection.detector.throw_layout import CLOSING, Layout

Floats = NDArray[np.float64]
Settings = Sequence[Mapping[str, Any]]

SETTLED = 1000.0
"""A movement lasts until its force stays nearer than this to the one at the end [N]."""
BUILD_UP = 10
"""Samples of the means whose rise is the build-up."""
LEAST_SPREAD = 1e-6
"""Of a number that is the same in all sound throws [N], [s]."""
REST = 0.4
"""At the end of a closing, over which the end force is averaged [s]."""


def closing_of(layout: Layout) -> slice:
    """Return the samples of the closing movement in a history."""
    fine = fine_layout(layout)
    names = [part.name for part in fine.parts]
    first = sum(part.count for part in fine.parts[: names.index(CLOSING)])
    return slice(first, first + fine.parts[names.index(CLOSING)].count)


def peak_and_duration(histories: Floats, closing: slice) -> Floats:
    """Return peak force and duration of the closing for each signal, shape (n, 2 n_signals)."""
    own = histories[..., closing]
    peak = np.abs(own).max(axis=-1)
    end = own[..., -round(REST / STEP) :].mean(axis=-1, keepdims=True)
    away = np.abs(own - end) > SETTLED
    last = away.shape[-1] - np.argmax(away[..., ::-1], axis=-1)
    return np.hstack([peak, STEP * np.where(away.any(axis=-1), last, 0)])


def peak_and_build_up(histories: Floats, closing: slice) -> Floats:
    """Return peak force and duration until the force builds up at the end, for each signal.

    The build-up is the steepest rise between means over 0.2 s, after the first quarter. Until when
    a force stays away from its end depends on a limit in newtons, and jumps in sound throws.

    Returns
    -------
    ndarray, shape (n, 2 n_signals)
    """
    own = histories[..., closing]
    peak = np.abs(own).max(axis=-1)
    total = np.cumsum(own, axis=-1)
    mean = (total[..., BUILD_UP:] - total[..., :-BUILD_UP]) / BUILD_UP
    rise = (mean[..., BUILD_UP:] - mean[..., :-BUILD_UP])[..., own.shape[-1] // 4 :]
    return np.hstack([peak, STEP * rise.argmax(axis=-1)])


def three_features(histories: Floats, closing: slice) -> Floats:
    """Return peak, plateau and end force of the closing, shape (n, 3 n_signals).

    As monitors of point machines take them: the plateau is the median of the middle half.
    """
    own = histories[..., closing]
    quarter = own.shape[-1] // 4
    plateau = np.median(own[..., quarter : 3 * quarter], axis=-1)
    end = own[..., -round(REST / STEP) :].mean(axis=-1)
    return np.hstack([own.max(axis=-1), plateau, end])


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits on some numbers, by their distance from the median in deviations: largest, or all."""

    numbers: str
    relative: bool
    largest: bool
    middle: Floats
    spread: Floats

    def values(self, judged: Judged) -> Floats:
        """Return the numbers of each throw, less those of the reference curve if wanted."""
        return numbers_of(self.numbers, judged, relative=self.relative)

    def score(self, judged: Judged) -> Floats:
        """Return the largest distance, or the root of the sum of their squares."""
        away = np.abs(self.values(judged) - self.middle) / self.spread
        return np.asarray(away.max(axis=1) if self.largest else np.linalg.norm(away, axis=1))

    def judge(self, judged: Judged) -> tuple[Floats, Mapping[str, Any]]:
        """Return the score, also as the novelty."""
        score = self.score(judged)
        return score, {"novelty": score}


NUMBERS = {"peak and duration": peak_and_build_up, "three features": three_features}


def numbers_of(name: str, judged: Judged, *, relative: bool) -> Floats:
    """Return some numbers of each throw, less those of its reference curve if wanted."""
    closing = closing_of(judged.layout)
    found = NUMBERS[name](judged.side.histories, closing)
    return found - NUMBERS[name](judged.reference, closing) if relative else found


@dataclass(frozen=True)
class LimitsMethod:
    """Learned limits: median and standard deviation of sound throws."""

    name: str
    title: str
    numbers: str
    settings: Settings = tuple(
        {"relative": relative, "largest": largest}
        for relative in (True, False)
        for largest in (True, False)
    )

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Model:
        """Take the limits from sound throws."""
        values = numbers_of(self.numbers, train, relative=setting["relative"])[train.sound]
        middle = np.median(values, axis=0)
        # a duration is the same in most throws: a median deviation of it may be 0
        spread = np.maximum(values.std(axis=0), LEAST_SPREAD)
        return Limits(self.numbers, setting["relative"], setting["largest"], middle, spread)


def dtw_distance(series: Floats, reference: Floats, *, band: int) -> Floats:
    r"""Return the dynamic time warping distance of each series to its reference.

    .. math:: D_{ij} = |a_i - b_j|^2 + \min(D_{i-1,j},\, D_{i,j-1},\, D_{i-1,j-1})

    within a band (Sakoe and Chiba 1978), all signals warped alike.

    Parameters
    ----------
    series, reference : ndarray, shape (n, n_signals, n_samples)
        Scaled alike.
    band : int
        Samples by which either may lag.

    Examples
    --------
    >>> one = np.array([[[0.0, 1.0, 0.0, 0.0]]])
    >>> late = np.array([[[0.0, 0.0, 1.0, 0.0]]])
    >>> dtw_distance(one, late, band=1).item(), dtw_distance(one, late, band=0).item()
    (0.0, 1.4142135623730951)
    """
    count, _, samples = series.shape
    infinite = np.full(count, np.inf)
    before: dict[int, Floats] = {-1: np.zeros(count)}
    for i in range(samples):
        row: dict[int, Floats] = {}
        for j in range(max(0, i - band), min(samples, i + band + 1)):
            cost = ((series[:, :, i] - reference[:, :, j]) ** 2).sum(axis=1)
            least = np.minimum(before.get(j, infinite), row.get(j - 1, infinite))
            row[j] = cost + np.minimum(least, before.get(j - 1, infinite))
        before = row
    return np.asarray(np.sqrt(before[samples - 1]))


@dataclass(frozen=True, eq=False)
class Warped:
    """Distance to the reference curve by dynamic time warping."""

    band: int
    scale: Floats

    def score(self, judged: Judged) -> Floats:
        """Return the distance over the closing, at half of the samples."""
        closing = closing_of(judged.layout)

        def halved(values: Floats) -> Floats:
            own = values[..., closing]
            return np.asarray(own.reshape(*own.shape[:-1], -1, 2).mean(axis=-1) / self.scale)

        return dtw_distance(halved(judged.side.histories), halved(judged.reference), band=self.band)

    def judge(self, judged: Judged) -> tuple[Floats, Mapping[str, Any]]:
        """Return the distance, also as the novelty."""
        score = self.score(judged)
        return score, {"novelty": score}


@dataclass(frozen=True)
class WarpingMethod:
    """Reference curve with an envelope that warps."""

    name: str = "dtw"
    title: str = "reference curve, DTW"
    settings: Settings = ({"band": 0}, {"band": 1}, {"band": 3}, {"band": 6})

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Model:
        """Scale each signal by the deviation of sound throws from the reference."""
        closing = closing_of(train.layout)
        scale = train.relative[train.sound][..., closing].std(axis=(0, 2))
        return Warped(int(setting["band"]), scale[:, np.newaxis])


@dataclass(frozen=True, eq=False)
class Components:
    """Hotelling's T2 and the squared prediction error of a PCA of sound throws."""

    relative: bool
    middle: Floats
    scale: Floats
    basis: Floats
    variance: Floats
    limits: tuple[float, float]

    def whitened(self, judged: Judged) -> tuple[Floats, Floats]:
        """Return the components of each throw with unit variance, and SPE."""
        values = (judged.features(relative=self.relative) - self.middle) / self.scale
        along = values @ self.basis.T
        rest = values - along @ self.basis
        return along / np.sqrt(self.variance), (rest**2).sum(axis=1)

    def parts(self, judged: Judged) -> tuple[Floats, Floats]:
        """Return T2 and SPE of each throw."""
        along, errors = self.whitened(judged)
        return (along**2).sum(axis=1), errors

    def score(self, judged: Judged) -> Floats:
        """Return both, each as a share of its limit, added (Yue and Qin 2001)."""
        return self.judge(judged)[0]

    def judge(self, judged: Judged) -> tuple[Floats, Mapping[str, Any]]:
        """Return the score, and the squared prediction error as the novelty."""
        squares, errors = self.parts(judged)
        return squares / self.limits[0] + errors / self.limits[1], {"novelty": errors}


@dataclass(frozen=True)
class ComponentsMethod:
    """Principal components of sound throws."""

    name: str = "pca"
    title: str = "PCA, T2 and SPE"
    settings: Settings = tuple(
        {"components": number, "relative": True} for number in (5, 20, 40, 80)
    )

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Components:
        """Take components and limits from sound throws."""
        values = train.features(relative=setting["relative"])[train.sound]
        middle, scale = values.mean(axis=0), values.std(axis=0)
        white = (values - middle) / scale
        variance, vectors = np.linalg.eigh(white.T @ white / len(white))
        variance, directions = variance[::-1], vectors.T[::-1]
        count = min(int(setting["components"]), len(white) - 1)
        found = Components(
            relative=setting["relative"], middle=middle, scale=scale, basis=directions[:count],
            variance=variance[:count], limits=(1.0, 1.0),
        )  # fmt: skip
        squares, errors = found.parts(train)
        limits = tuple(float(np.quantile(item[train.sound], 0.99)) for item in (squares, errors))
        return Components(
            relative=found.relative, middle=middle, scale=scale, basis=found.basis,
            variance=found.variance, limits=(limits[0], limits[1]),
        )  # fmt: skip
