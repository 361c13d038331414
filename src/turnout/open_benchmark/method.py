"""How methods are fitted and tuned alike: on training switches, with thresholds at equal rates.

Each method has some settings, its budget. Every setting is fitted on two thirds of the training
panels and scores the rest, three times, so that every training throw has a score of a model that
did not see its panel. The setting that detects most touched objects at 1 false alarm in 100 is
taken, thresholds for 1 in 1,000 and 1 in 10,000 come from the scores of its sound throws, and it is
fitted again on all training switches.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from turnout.detection.alarm_threshold import threshold_for
from turnout.detection.detector.throw_layout import Layout
from turnout.detection.floor import TOUCH_FORCE
from turnout.errors import StudyError
from turnout.open_benchmark.definition import OBJECT, SOUND
from turnout.open_benchmark.sides import Benchmark, Side, window_features

Floats = NDArray[np.float64]

FOLDS = 3
TUNED_RATE = 1e-2
RATES = (1e-3, 1e-4)
"""Of false alarms a sound throw, at which alarms are called."""


@dataclass(frozen=True, eq=False)
class Judged:
    """Throws that a method learns from or judges, and what is known of their switches.

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
        mean of the sound training throws.
    everything : Side
        All throws of these switches, histories whole.
    amplitude : ndarray, shape (n_signals,)
        Of the benchmark.
    """

    side: Side
    known: Side
    layout: Layout
    reference: Floats
    everything: Side
    amplitude: Floats

    @property
    def relative(self) -> Floats:
        """Histories less the reference curve."""
        return self.side.histories - self.reference

    def features(self, *, relative: bool) -> Floats:
        """Return means over windows, of the throws or of what they differ by."""
        if not relative:
            return self.side.features
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
            self.everything.of(whole), self.amplitude,
        )  # fmt: skip


def object_touched(side: Side) -> NDArray[np.bool_]:
    """Return which throws have an object that was touched."""
    return np.asarray((side.labels["role"] == OBJECT) & (side.labels["object_force"] > TOUCH_FORCE))


def judged_of(bench: Benchmark, split: str) -> Judged:
    """Return the judged throws of one side with what is known of their switches."""
    side: Side = getattr(bench, split)
    known = side.of(side.known(bench.history))
    judged = side.of(side.judged)
    usual = bench.train.histories[np.isin(bench.train.labels["role"], [SOUND, "history"])].mean(0)
    reference = np.broadcast_to(usual, judged.histories.shape).copy()
    for switch in np.unique(known.groups):
        own = known.histories[known.groups == switch].mean(axis=0)
        reference[judged.groups == switch] = own
    return Judged(judged, known, bench.layout, reference, side, bench.amplitude)


class Model(Protocol):
    """A fitted method."""

    def score(self, judged: Judged) -> Floats:
        """Return what is higher where an object is likelier, shape (n,)."""

    def extras(self, judged: Judged) -> Mapping[str, Any]:
        """Return further fields of `Verdicts`."""


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
        """Learn from training throws; finally with all that `extras` needs."""


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


def tune(method: Method, train: Judged, folds: NDArray[np.intp]) -> Fitted:
    """Fit every setting on folds of the training panels, and the best one on all of them."""
    best: tuple[float, Mapping[str, Any], Floats] | None = None
    tried = []
    for setting in method.settings:
        scores = np.empty(len(folds))
        for fold in range(FOLDS):
            model = method.fit(train.of(folds != fold), setting)
            scores[folds == fold] = model.score(train.of(folds == fold))
        level = float(np.quantile(scores[train.sound], 1.0 - TUNED_RATE))
        share = float(np.mean(scores[train.touched] > level))
        tried.append((setting, share))
        if best is None or share > best[0]:
            best = (share, setting, scores)
    assert best is not None
    sound = best[2][train.sound]
    return Fitted(
        model=method.fit(train, best[1], final=True),
        setting=best[1],
        tried=tried,
        thresholds=tuple(threshold_for(sound, rate=rate) for rate in RATES),
    )
