"""Baselines of machine learning: isolation forest, MiniRocket, gradient boosting.

Isolation forest and gradient boosting are those of scikit-learn, the extra `learn`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from benchmarks.detection.classical import (
    Components,
    ComponentsMethod,
    closing_of,
    peak_and_duration,
    three_features,
)
from benchmarks.detection.make_throws import STEP
from benchmarks.detection.method import Judged, Model
from benchmarks.detection.minirocket import MiniRocket, fit_minirocket
from turnout.core.errors import TurnoutError

Floats = NDArray[np.float64]
Settings = Sequence[Mapping[str, Any]]


def scikit_learn(name: str) -> Any:
    """Return `sklearn.ensemble`, or refuse the baseline that needs it."""
    try:
        from sklearn import ensemble
    except ImportError:
        message = (
            f"the baseline '{name}' needs scikit-learn, which is not installed; "
            "run: pip install 'turnout[learn]'"
        )
        raise TurnoutError(message) from None
    return ensemble


# ---- isolation forest


@dataclass(frozen=True, eq=False)
class Forest:
    """An isolation forest of sound throws, by their principal components."""

    components: Components
    forest: Any

    def score(self, judged: Judged) -> Floats:
        """Return how few cuts isolate each throw."""
        return -np.asarray(self.forest.score_samples(forest_inputs(self.components, judged)))

    def judge(self, judged: Judged) -> tuple[Floats, Mapping[str, Any]]:
        """Return the score, also as the novelty."""
        score = self.score(judged)
        return score, {"novelty": score}


def forest_inputs(components: Components, judged: Judged) -> Floats:
    """Return whitened principal components and the logarithm of their residual.

    In raw features an object is no further out than high friction is, and a forest hardly grades
    what lies outside: whitened, small directions count as much as large ones.
    """
    along, errors = components.whitened(judged)
    return np.column_stack([along, np.log(errors + 1e-12)])


@dataclass(frozen=True)
class ForestMethod:
    """Isolation forest (Liu, Ting and Zhou 2008) on the difference from the reference curve."""

    name: str = "isolation-forest"
    title: str = "isolation forest"
    settings: Settings = tuple(
        {"samples": samples, "components": number} for samples in (256, 1024) for number in (20, 60)
    )

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Model:
        """Learn sound throws."""
        given = {"components": setting["components"], "relative": True}
        components = ComponentsMethod().fit(train, given)
        values = forest_inputs(components, train)[train.sound]
        forest = scikit_learn(self.title).IsolationForest(
            n_estimators=200, max_samples=min(setting["samples"], len(values)), random_state=0
        )
        return Forest(components, forest.fit(values))


# ---- gradient boosting


def sweep_features(histories: Floats, judged: Judged) -> Floats:
    """Return the features of a sweep from recorded histories, shape (n, n_features).

    Peak force and its time, plateau, end force, duration, and onset and slope of the build-up: the
    first time above half of the peak, and the steepest rise over 80 ms.
    """
    closing = closing_of(judged.layout)
    opening = slice(0, closing.start)
    own = histories[..., closing]
    peak = own.max(axis=-1, keepdims=True)
    rise = (own[..., 4:] - own[..., :-4]) / (4.0 * STEP)
    onset = STEP * np.argmax(own > 0.5 * peak, axis=-1)
    return np.hstack([
        peak_and_duration(histories, closing), three_features(histories, closing),
        STEP * own.argmax(axis=-1), onset, rise.max(axis=-1), STEP * rise.argmax(axis=-1),
        histories[..., opening].min(axis=-1), np.median(histories[..., opening], axis=-1),
    ])  # fmt: skip


@dataclass(frozen=True, eq=False)
class Boosted:
    """A boosted classifier of objects, and one of causes."""

    inputs: str
    classifier: Any
    causes: Any

    def score(self, judged: Judged) -> Floats:
        """Return the log odds of an object."""
        values = boosting_inputs(self.inputs, judged)
        with threadpool_limits(limits=1):
            return np.asarray(self.classifier.decision_function(values))

    def judge(self, judged: Judged) -> tuple[Floats, Mapping[str, Any]]:
        """Return the log odds, the likeliest cause and the probability of an object."""
        values = boosting_inputs(self.inputs, judged)
        with threadpool_limits(limits=1):
            score = np.asarray(self.classifier.decision_function(values))
            return score, {
                "cause": self.causes.predict(values).astype(np.str_),
                "probability": self.classifier.predict_proba(values)[:, 1],
            }


def boosting_inputs(name: str, judged: Judged) -> Floats:
    """Return the inputs of a setting."""
    own = sweep_features(judged.side.histories, judged)
    whole = np.hstack([own, own - sweep_features(judged.reference, judged)])
    if name == "sweep features":
        return whole
    return np.hstack([whole, judged.features(relative=True)])


@dataclass(frozen=True)
class BoostingMethod:
    """Histogram gradient boosting on the sweep's features, with or without all window means."""

    name: str = "boosting"
    title: str = "gradient boosting"
    settings: Settings = tuple(
        {"inputs": inputs, "rate": rate}
        for inputs in ("sweep features", "and window means")
        for rate in (0.05, 0.15)
    )

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Model:
        """Learn touched objects against all else, and causes."""
        values = boosting_inputs(setting["inputs"], train)
        ensemble = scikit_learn(self.title)
        used = train.touched | (train.side.labels["role"] != "object")
        role = train.side.labels["role"].astype(np.str_)

        def booster(rounds: int) -> Any:
            return ensemble.HistGradientBoostingClassifier(
                learning_rate=setting["rate"], max_iter=rounds, max_leaf_nodes=15, max_bins=BINS,
                class_weight="balanced", early_stopping=False, random_state=0,
            )  # fmt: skip

        # threads that wait for each other cost more than they gain
        with threadpool_limits(limits=1):
            causes = booster(CAUSE_ROUNDS).fit(values[used], role[used]) if final else None
            objects = booster(ROUNDS).fit(values[used], train.touched[used])
        return Boosted(setting["inputs"], objects, causes)


ROUNDS, CAUSE_ROUNDS = 120, 40
"""Trees, for each class of several."""
BINS = 63
"""Of a feature; 255 took twice as long and detected as much of what was held back."""


# ---- MiniRocket


@dataclass(frozen=True, eq=False)
class Ridge:
    """A linear classifier of MiniRocket features."""

    features: "RocketMethod"
    weights: Floats
    middle: Floats
    scale: Floats

    def score(self, judged: Judged) -> Floats:
        """Return the linear score."""
        values = (self.features.of(judged) - self.middle) / self.scale
        return np.asarray(values @ self.weights, dtype=np.float64)

    def judge(self, judged: Judged) -> tuple[Floats, Mapping[str, Any]]:
        """Return the linear score, and nothing more."""
        return self.score(judged), {}


@dataclass
class RocketMethod:
    """MiniRocket on the difference from the reference curve, and ridge regression.

    The transform is fitted once, to training throws without their labels.
    """

    name: str = "minirocket"
    title: str = "MiniRocket, ridge"
    settings: Settings = tuple({"ridge": 10.0**power} for power in (2, 3, 4, 5))
    features: int = 2520
    _rocket: MiniRocket | None = None
    _known: dict[int, NDArray[np.float32]] = field(default_factory=dict)
    _normal: "tuple[Judged, Normal] | None" = None

    def __getstate__(self) -> dict[str, Any]:
        """Leave out transformed throws, which are no part of a model."""
        return {**self.__dict__, "_known": {}, "_normal": None}

    def of(self, judged: Judged) -> NDArray[np.float32]:
        """Return the features of throws, each transformed once."""
        numbers = judged.side.throw.tolist()
        new = [row for row, number in enumerate(numbers) if number not in self._known]
        if new:
            series = _halved(judged.relative[new])
            if self._rocket is None:
                self._rocket = fit_minirocket(series, features=self.features)
            found = self._rocket.transform(series)
            self._known |= {numbers[row]: item for row, item in zip(new, found, strict=True)}
        return np.stack([self._known[number] for number in numbers])

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Model:
        """Solve the ridge regression of touched objects, 1, against all else, -1."""
        if self._normal is None or self._normal[0] is not train:
            self._normal = (train, self._normal_equations(train))
        found = self._normal[1]
        square = found.square + setting["ridge"] * np.eye(len(found.square))
        weights = np.linalg.solve(square, found.product)
        return Ridge(self, weights, found.middle, found.scale)

    def _normal_equations(self, train: Judged) -> "Normal":
        used = train.touched | (train.side.labels["role"] != "object")
        values = self.of(train)[used].astype(np.float64)
        middle, scale = values.mean(axis=0), values.std(axis=0) + 1e-8
        values -= middle
        values /= scale
        wanted = np.where(train.touched[used], 1.0, -1.0)
        return Normal(values.T @ values, values.T @ (wanted - wanted.mean()), middle, scale)


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations of a regression, which all ridges share."""

    square: Floats
    product: Floats
    middle: Floats
    scale: Floats


def _halved(histories: Floats) -> Floats:
    """Return histories at half of the samples; an odd last one is left out."""
    even = histories[..., : histories.shape[-1] // 2 * 2]
    return np.asarray(even.reshape(*even.shape[:-1], -1, 2).mean(axis=-1))
