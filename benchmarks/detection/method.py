"""How methods are fitted and tuned alike: on training switches, with thresholds at equal rates.

The budget of a method is four settings at most. Every setting is fitted on two thirds of the
training panels and scores the rest, three times, so that every training throw has a score of a
model that did not see its panel. The setting that detects most touched objects at 1 false alarm in
100 is taken, thresholds for 1 in 1,000 and 1 in 10,000 come from the scores of its sound throws,
and it is fitted again on all training switches.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.data import Benchmark, Side, window_features
from benchmarks.detection.definition import HISTORY, OBJECT, SOUND
from turnout.core.errors import StudyError
from turnout.detection.alarm_threshold import threshold_for
from turnout.detection.detector.throw_layout import Layout
from turnout.detection.floor import TOUCH_FORCE

Floats = NDArray[np.float64]

FOLDS = 3
TUNED_RATE = 1e-2
RATES = (1e-3, 1e-4)
"""Of false alarms a sound throw, at which alarms are called."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Throws that a method learns from or judges, with known throws of their switches.

    Attributes
    ----------
    side : Side
        The judged throws.
    known : Side
        Sound throws that are known of the same switches; may be none.
    layout : Layout
        Windows.
    reference : ndarray, shape (n, n_signals, n_samples)
        For each judged throw the mean of the known throws of its switch; without a history the
        mean of the sound training throws with the same machine.
    everything : Side
        All throws of these switches, histories whole.
    amplitude : mapping of str to ndarray, shape (n_signals,)
        Of the benchmark, by machine.
    history : int
        Sound throws that are known of each switch.
    """

    side: Side
    known: Side
    layout: Layout
    reference: Floats
    everything: Side
    amplitude: Mapping[str, Floats]
    history: int

    @cached_property
    def relative(self) -> Floats:
        """Histories less the reference curve."""
        return self.side.histories - self.reference

    def features(self, *, relative: bool) -> Floats:
        """Return means over windows of the throws or of their differences from the reference."""
        return self.relative_features if relative else self.side.features

    @cached_property
    def relative_features(self) -> Floats:
        """Means over windows of the differences from the reference curve."""
        return window_features(self.relative, self.layout)

    @property
    def touched(self) -> NDArray[np.bool_]:
        """Throws with an object that was touched."""
        return object_touched(self.side)

    @property
    def sound(self) -> NDArray[np.bool_]:
        """Throws without an object and without another cause."""
        return np.asarray(self.side.labels["role"] == SOUND)

    def of(self, rows: NDArray[np.bool_]) -> "Judged":
        """Return the throws of some switches."""
        switches = np.unique(self.side.groups[rows])
        kept = np.isin(self.known.groups, switches)
        whole = np.isin(self.everything.groups, switches)
        return Judged(
            self.side.of(rows), self.known.of(kept), self.layout, self.reference[rows],
            self.everything.of(whole), self.amplitude, self.history,
        )  # fmt: skip


def object_touched(side: Side) -> NDArray[np.bool_]:
    """Return which throws have an object that was touched."""
    return np.asarray((side.labels["role"] == OBJECT) & (side.labels["object_force"] > TOUCH_FORCE))


def judged_of(bench: Benchmark, split: str) -> Judged:
    """Return the judged throws of one side with known throws of their switches."""
    side: Side = getattr(bench, split)
    known = side.of(side.known(bench.history))
    judged = side.of(side.judged)
    sound = np.isin(bench.train.labels["role"], [SOUND, HISTORY])
    reference = np.empty_like(judged.histories)
    for machine in np.unique(judged.labels["machine"]):
        own = sound & (bench.train.labels["machine"] == machine)
        usual = bench.train.histories[own if own.any() else sound].mean(axis=0)
        reference[judged.labels["machine"] == machine] = usual
    for switch in np.unique(known.groups):
        mean = known.histories[known.groups == switch].mean(axis=0)
        reference[judged.groups == switch] = mean
    return Judged(judged, known, bench.layout, reference, side, bench.amplitude, bench.history)


class Model(Protocol):
    """A fitted method."""

    def score(self, judged: Judged) -> Floats:
        """Return a score that rises with the likelihood of an object, shape (n,)."""

    def judge(self, judged: Judged) -> tuple[Floats, Mapping[str, Any]]:
        """Return the same, and further fields of `Verdicts`."""


class Method(Protocol):
    """A way to judge throws."""

    @property
    def name(self) -> str:
        """Of files."""

    @property
    def title(self) -> str:
        """In tables."""

    @property
    def settings(self) -> Sequence[Mapping[str, Any]]:
        """Tried in turn."""

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Model:
        """Learn from training throws; finally with all that `judge` needs."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitted:
    """A tuned method.

    Attributes
    ----------
    model : Model
        Fitted on all training switches.
    setting : mapping
        The one that was taken.
    tried : sequence of (mapping, float)
        All settings with the share of touched objects that each detects at `TUNED_RATE`.
    thresholds : tuple of float
        For `RATES`.
    """

    model: Model
    setting: Mapping[str, Any]
    tried: Sequence[tuple[Mapping[str, Any], float]]
    thresholds: tuple[float, ...]


def fold_of_panels(panels: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the fold of each throw, the same for all switches of a panel.

    Raises
    ------
    StudyError
        When there are fewer panels than folds.
    """
    different = np.unique(panels)
    if len(different) < FOLDS:
        message = (
            f"{len(different)} panels are there to train on; {FOLDS} are needed: make a larger size"
        )
        raise StudyError([message], source="benchmark")
    place = np.random.default_rng(0).permutation(len(different)) % FOLDS
    found: NDArray[np.intp] = place[np.searchsorted(different, panels)]
    return found


Keep = Callable[[int, int, Callable[[], Floats]], Floats]
"""Given the numbers of a fold and of a setting and what computes its scores, returns the scores."""


def compute(fold: int, setting: int, scores: Callable[[], Floats]) -> Floats:
    """Return the scores of a setting on a fold, and keep nothing."""
    return scores()


def tune(method: Method, train: Judged, folds: NDArray[np.intp], keep: Keep = compute) -> Fitted:
    """Fit every setting on folds of the training panels, and the best one on all of them.

    Parameters
    ----------
    method : Method
        To tune.
    train : Judged
        Training throws.
    folds : ndarray of int, shape (n,)
        From `fold_of_panels`.
    keep : callable, optional
        Keeps scores of settings for a run that goes on later.
    """
    scores = np.empty((len(method.settings), len(folds)))
    for fold in range(FOLDS):
        own = folds == fold
        seen = Lazy(train, ~own), Lazy(train, own)
        for number, setting in enumerate(method.settings):
            scores[number, own] = keep(fold, number, partial(_scores, method, setting, *seen))
    shares = []
    for row in scores:
        level = float(np.quantile(row[train.sound], 1.0 - TUNED_RATE))
        shares.append(float(np.mean(row[train.touched] > level)))
    best = int(np.argmax(shares))
    sound = scores[best, train.sound]
    return Fitted(
        model=method.fit(train, method.settings[best], final=True),
        setting=method.settings[best],
        tried=list(zip(method.settings, shares, strict=True)),
        thresholds=tuple(threshold_for(sound, rate=rate) for rate in RATES),
    )


class Lazy:
    """Some throws, taken out when they are needed first.

    Parameters
    ----------
    whole : Judged
        All of them.
    rows : ndarray of bool, shape (n,)
        Which.
    """

    def __init__(self, whole: Judged, rows: NDArray[np.bool_]) -> None:
        self._whole, self._rows = whole, rows

    @cached_property
    def judged(self) -> Judged:
        """The throws."""
        return self._whole.of(self._rows)


def _scores(method: Method, setting: Mapping[str, Any], seen: Lazy, held_back: Lazy) -> Floats:
    return method.fit(seen.judged, setting).score(held_back.judged)
