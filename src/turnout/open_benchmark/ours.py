"""The detector of this program on the benchmark: trained on the benchmark's own training throws.

It learns from simulations as it does elsewhere: sound throws, and objects and other causes each
with the sound throw of the same state, whose difference is the signature. Discrepancy, noise and
the rest are assumed, not learned. Thresholds come from the protocol of all methods.

What is fixed for a switch are here the largest principal components of what the sound throws of
training switches have in common beyond friction: their panels differ in more numbers than some
hundred switches could determine.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.threads import one_blas_thread
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import learn_history
from turnout.detection.detector.interval_widths import AT_ONCE
from turnout.detection.detector.judging import View, best_square, evidence_of, make_view, ratios_of
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.object_posterior import posterior_of
from turnout.detection.detector.throw_layout import Layout
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.training import setting_of, teach
from turnout.detection.detector.training_plan import DEFECTS
from turnout.detection.likelihood import Evidence
from turnout.open_benchmark.definition import HISTORY, OBJECT, SOUND, panels_study
from turnout.open_benchmark.make_throws import STEP, fine_layout
from turnout.open_benchmark.method import Judged, Model
from turnout.open_benchmark.recorder_errors import slopes
from turnout.open_benchmark.sides import Side, window_features

Floats = NDArray[np.float64]
Settings = Sequence[Mapping[str, Any]]

NAMED = 6.9
"""Log likelihood ratio against a sound switch from which on another cause is named [-]."""
LEVEL_DEGREE = 3
"""Of the friction level in what all switches have in common."""


def throw_set_of(side: Side, roles: Sequence[str], layout: Layout, inputs: Floats) -> ThrowSet:
    """Return simulated training throws of some roles as the detector learns from them."""
    rows = np.flatnonzero(np.isin(side.labels["role"], roles))
    clean = side.clean[rows]
    fine = fine_layout(layout)
    # a throw that is late is lower where it rises
    rates = -slopes(clean, fine.part[: fine.windows], STEP)
    return ThrowSet(
        features=window_features(clean, layout),
        rates=window_features(rates, layout),
        gaps=side.gaps[rows],
        level=side.labels["level"][rows],
        inputs=inputs[rows],
        switch=side.groups[rows],
        partner=side.partner[rows],
        row=rows,
        size=side.labels["size"][rows],
        x=side.labels["x"][rows],
        force=side.labels["object_force"][rows],
    )


def switch_components(side: Side, layout: Layout, *, count: int) -> Floats:
    """Return what is fixed for the switch of each throw, shape (n_throws, count) [-].

    Parameters
    ----------
    side : Side
        Training throws.
    layout : Layout
        Of the features.
    count : int
        Principal components of the mean residual of each switch.
    """
    sound = np.isin(side.labels["role"], [SOUND, HISTORY])
    features = window_features(side.clean[sound], layout)
    level = side.labels["level"][sound]
    along = np.vander((level - level.mean()) / np.ptp(level), LEVEL_DEGREE + 1)
    found, *_ = np.linalg.lstsq(along, features, rcond=None)
    rest = features - along @ found
    switches, own = np.unique(side.groups, return_inverse=True)
    means = np.array([rest[side.groups[sound] == number].mean(axis=0) for number in switches])
    left, sizes, _ = np.linalg.svd(means - means.mean(axis=0), full_matrices=False)
    scores = left[:, :count] * sizes[:count]
    return np.asarray(scores[own] / scores.std(axis=0))


@dataclass(frozen=True, eq=False)
class Taught:
    """A trained detector."""

    knowledge: Knowledge

    def weighed(self, judged: Judged) -> Iterator[tuple[NDArray[np.intp], View, Evidence]]:
        """Yield some throws of a switch, what they are judged with, and the evidence."""
        population = make_view(self.knowledge)
        for switch in np.unique(judged.side.groups):
            own = np.flatnonzero(judged.side.groups == switch)
            known = judged.known.features[judged.known.groups == switch]
            view = population
            if len(known):
                expected = learn_history(self.knowledge, known, view=population)
                view = make_view(self.knowledge, known=expected)
            for first in range(0, len(own), AT_ONCE):
                rows = own[first : first + AT_ONCE]
                yield rows, view, evidence_of(view, judged.side.features[rows])

    def score(self, judged: Judged) -> Floats:
        """Return the log likelihood ratio, object against all else."""
        found = np.empty(len(judged.side.throw))
        with one_blas_thread():
            for rows, view, evidence in self.weighed(judged):
                found[rows] = ratios_of(view, evidence).alarm
        return found

    def extras(self, judged: Judged) -> Mapping[str, Any]:
        """Return place, size, gaps, cause, probability and what no hypothesis explains."""
        count, gaps = len(judged.side.throw), len(self.knowledge.setting.gaps)
        x, size = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
        gap, novelty = np.full((count, gaps, 3), np.nan), np.empty(count)
        cause, ratio = np.full(count, SOUND, dtype="<U24"), np.empty(count)
        limits = np.array(self.knowledge.setting.limits)
        with one_blas_thread():
            for rows, view, evidence in self.weighed(judged):
                ratios = ratios_of(view, evidence)
                novelty[rows], ratio[rows] = best_square(evidence), ratios.alarm
                cause[rows] = [_named(view, ratios.alarm[i], ratios.cause[:, i])
                               for i in range(len(rows))]  # fmt: skip
                for number, row in enumerate(rows):
                    said = posterior_of(view, evidence, number, limits=limits)
                    x[row] = (said.x.middle, said.x.low, said.x.high)
                    size[row] = (said.size.middle, said.size.low, said.size.high)
                    gap[row] = [(item.middle, item.low, item.high) for item in said.gaps]
        probability = 1.0 / (1.0 + np.exp(-np.clip(ratio, -50.0, 50.0)))
        return {
            "x": x, "size": size, "gap": gap, "cause": cause, "probability": probability,
            "novelty": novelty,
        }  # fmt: skip


def _named(view: View, alarm: float, causes: Floats) -> str:
    known = np.where(view.identifiable, causes, -np.inf)
    best = int(known.argmax())
    if alarm > 0.0 and alarm > NAMED - 1.0:
        return OBJECT
    return view.kinds[view.objects + best] if known[best] > NAMED else SOUND


@dataclass(frozen=True)
class DetectorMethod:
    """Local likelihood ratio with sampled signatures: `turnout.detection.Detector`."""

    errors: Allowances
    name: str = "turnout"
    title: str = "turnout detector"
    settings: Settings = ({"components": 4}, {"components": 8})

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Model:
        """Teach a detector with the training throws."""
        whole = train.everything
        inputs = switch_components(whole, train.layout, count=int(setting["components"]))
        sets = {
            name: throw_set_of(whole, [name], train.layout, inputs)
            for name in (SOUND, HISTORY, OBJECT, *DEFECTS)
            if np.any(whole.labels["role"] == name)
        }
        made_for = setting_of(
            panels_study().panel, amplitude=train.amplitude, allowances=self.errors
        )
        with one_blas_thread():
            return Taught(teach(sets, made_for))
