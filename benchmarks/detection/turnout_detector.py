"""The detector of this program on the benchmark: trained on the benchmark's own training throws.

It learns from simulations as it does elsewhere: sound throws, and objects and other causes each
with the sound throw of the same state, whose difference is the signature. Discrepancy, noise and
the rest are assumed, not learned. Thresholds of alarms come from the protocol of all methods. What
else is in a verdict follows as for any user of the detector: widths of intervals and the thresholds
of causes and of what is unknown come from a third of the training panels, which a detector like it
did not see.

What is fixed for a switch are here the largest principal components of what the sound throws of
training switches have in common beyond friction: their panels differ in more numbers than some
hundred switches could determine. Machines of several kinds move differently: what a kind has in
common is taken off all throws, or each kind gets a detector of its own.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.data import Side, slopes, window_features
from benchmarks.detection.definition import HISTORY, MACHINES, OBJECT, SOUND, panels_study
from benchmarks.detection.make_throws import STEP, fine_layout
from benchmarks.detection.method import FOLDS, Judged, Model, fold_of_panels
from turnout.core.threads import one_blas_thread
from turnout.detection.alarm_threshold import RATES
from turnout.detection.conditions import FORCE
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import (
    Fold,
    calibrate_alone,
    calibrate_history,
    learn_history,
    with_calibration,
)
from turnout.detection.detector.interval_widths import AT_ONCE
from turnout.detection.detector.judging import (
    CYCLE,
    View,
    evidence_of,
    make_view,
    ratios_of,
)
from turnout.detection.detector.knowledge import Knowledge, Setting
from turnout.detection.detector.throw_layout import Layout
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.throw_verdict import ALARM, CAUSE, UNKNOWN, Verdict, verdict_on
from turnout.detection.detector.training import LEAST_SOUND, setting_of, teach
from turnout.detection.detector.training_sets import Counts
from turnout.detection.detector.unexplained import least_squares
from turnout.detection.likelihood import Evidence
from turnout.study.defects import trained_changes

Floats = NDArray[np.float64]
Settings = Sequence[Mapping[str, Any]]

CALIBRATED, AGAIN = 200, 4
"""Throws of a kind that widths without a history are taken from, and uses of later ones."""
LEVEL_DEGREE = 3
"""Of the friction level in what all switches have in common."""
LEAST_COMPONENT = 1e-9
"""Size of a component that is more than rounding, as a share of the largest one [-]."""


def throw_set_of(
    side: Side, roles: Sequence[str], layout: Layout, inputs: Floats, *, most: int | None = None
) -> ThrowSet:
    """Return simulated training throws of some roles as the detector learns from them.

    At most so many, evenly among all.
    """
    rows = np.flatnonzero(np.isin(side.labels["role"], roles))
    rows = rows[_even(len(rows), most or len(rows))]
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
    """Return the inputs of the switch of each throw, shape (n_throws, count or fewer) [-].

    Few switches have fewer components: n of them differ in n - 1.

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
    kept = np.flatnonzero(sizes > LEAST_COMPONENT * sizes[0])[:count]
    scores = left[:, kept] * sizes[kept]
    return np.asarray(scores[own] / scores.std(axis=0))


@dataclass(frozen=True, eq=False)
class Taught:
    """A trained detector, or one for each machine.

    Attributes
    ----------
    knowledge : mapping of str to Knowledge
        By machine; one for all has the name "".
    """

    knowledge: Mapping[str, Knowledge]

    def weighed(
        self, judged: Judged
    ) -> Iterator[tuple[NDArray[np.intp], Knowledge, View, Evidence]]:
        """Yield some throws of a switch, their detector and view, and the evidence."""
        populations = {name: make_view(item) for name, item in self.knowledge.items()}
        for switch in np.unique(judged.side.groups):
            own = np.flatnonzero(judged.side.groups == switch)
            machine = str(judged.side.labels["machine"][own[0]])
            name = machine if machine in self.knowledge else next(iter(self.knowledge))
            knowledge, view = self.knowledge[name], populations[name]
            known = judged.known.features[judged.known.groups == switch]
            if len(known):
                expected = learn_history(knowledge, known, view=view)
                view = make_view(knowledge, known=expected)
            for first in range(0, len(own), AT_ONCE):
                rows = own[first : first + AT_ONCE]
                yield rows, knowledge, view, evidence_of(view, judged.side.features[rows])

    def score(self, judged: Judged) -> Floats:
        """Return the log likelihood ratio, object against all else."""
        found = np.empty(len(judged.side.throw))
        with one_blas_thread():
            for rows, _, view, evidence in self.weighed(judged):
                found[rows] = ratios_of(view, evidence).alarm
        return found

    def judge(self, judged: Judged) -> tuple[Floats, Mapping[str, Any]]:
        """Return the ratio, and place, size, gaps, cause, probability and novelty.

        Without thresholds of its own the detector names no cause, place, size or gap.
        """
        count, gaps = len(judged.side.throw), len(judged.side.positions)
        ratio, novelty = np.empty(count), np.empty(count)
        said: dict[str, Any] = {}
        if all(item.calibrated for item in self.knowledge.values()):
            said["cause"] = np.full(count, SOUND, dtype="<U24")
            said |= {name: np.full((count, 3), np.nan) for name in ("x", "size")}
            said["gap"] = np.full((count, gaps, 3), np.nan)
        with one_blas_thread():
            for rows, knowledge, view, evidence in self.weighed(judged):
                novelty[rows] = least_squares(evidence)
                ratio[rows] = ratios_of(view, evidence).alarm
                calibrated = knowledge.calibration(part=CYCLE, history=judged.history)
                if calibrated is None:
                    continue
                for number, row in enumerate(rows):
                    own = verdict_on(
                        "", view, evidence, number,
                        knowledge=knowledge, calibrated=calibrated, rate=RATES[0],
                    )  # fmt: skip
                    said["cause"][row] = cause_of(own)
                    said["gap"][row] = [(item.middle, item.low, item.high) for item in own.gaps]
                    if own.x is not None and own.size is not None:
                        said["x"][row] = (own.x.middle, own.x.low, own.x.high)
                        said["size"][row] = (own.size.middle, own.size.low, own.size.high)
        probability = 1.0 / (1.0 + np.exp(-np.clip(ratio, -50.0, 50.0)))
        return ratio, {**said, "probability": probability, "novelty": novelty}


def cause_of(verdict: Verdict) -> str:
    """Return the cause of a verdict in the words of the benchmark."""
    if verdict.status == ALARM:
        return OBJECT
    if verdict.status == CAUSE:
        return verdict.cause
    return "unknown" if verdict.status == UNKNOWN else SOUND


MARKER_SETTINGS: Settings = ({"components": 4}, {"components": 8})


@dataclass(frozen=True)
class DetectorMethod:
    """Local likelihood ratio with sampled signatures: `turnout.detection.Detector`.

    Attributes
    ----------
    errors : Allowances
        What is assumed of a recorder.
    quantity : str
        "force", "current" or "power".
    details : bool
        Whether it says place, size, gaps and causes beside its ratio, which take thresholds and
        widths from a third of the panels.
    """

    errors: Allowances
    quantity: str = FORCE
    details: bool = True
    name: str = "turnout"
    title: str = "turnout detector"
    settings: Settings = MARKER_SETTINGS

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Model:
        """Teach a detector with the training throws."""
        with one_blas_thread():
            return Taught({"": self.taught(train, setting, final=final)})

    def taught(self, train: Judged, setting: Mapping[str, Any], *, final: bool) -> Knowledge:
        """Return a detector; finally with thresholds and widths from panels held back."""
        made_for = self._made_for(train)
        knowledge = teach(training_sets(train, setting), made_for)
        if not (final and self.details):
            return knowledge
        of_fold = fold_of_panels(train.side.labels["panel"])
        others, held_back = train.of(of_fold != 0), train.of(of_fold == 0)
        if sound_count(others) < LEAST_SOUND:
            others = train
        less = teach(training_sets(others, setting), made_for)
        sets = training_sets(held_back, setting)
        objects = sets[OBJECT].of(sets[OBJECT].force > 0.0)
        sound = _spread(sets[SOUND], CALIBRATED)
        fold = Fold(
            knowledge=less,
            sound=sound,
            group=sound.switch,
            objects=_spread(objects, CALIBRATED),
        )
        alone = calibrate_alone([fold], draws=AGAIN)
        if not train.history:
            return with_calibration(knowledge, [alone])
        whole = held_back.everything
        repeated = throw_set_of(
            whole, [HISTORY, SOUND], train.layout, np.zeros((len(whole.throw), 1))
        )
        after = calibrate_history(
            [fold],
            repeated,
            history=train.history,
            alone={CYCLE: alone},
            objects=_spread(objects, 2 * CALIBRATED),
            draws=1,
            again=AGAIN,
        )
        return with_calibration(knowledge, [alone, *after])

    def _made_for(self, train: Judged) -> Setting:
        panel = panels_study().panel
        if self.quantity != FORCE:
            panel = panel.with_overrides({
                f"drive.{name}.machine": machine
                for name, machine in zip(panel.drive, MACHINES[0], strict=True)
            })  # fmt: skip
        own = [train.amplitude[str(name)] for name in np.unique(train.side.labels["machine"])]
        return setting_of(
            panel, amplitude=np.mean(own, axis=0), allowances=self.errors, quantity=self.quantity
        )


def training_sets(train: Judged, setting: Mapping[str, Any]) -> dict[str, ThrowSet]:
    """Return the throws that a detector learns from, by their role.

    No more than `turnout detect train` makes, evenly among all: the time of a verdict grows with
    the signatures.
    """
    whole = train.everything
    inputs = switch_components(whole, train.layout, count=int(setting["components"]))
    usual = Counts()
    most = {HISTORY: usual.sound, OBJECT: usual.objects} | {
        name: usual.of_cause(name) for name in trained_changes()
    }
    found = {}
    for name in (SOUND, HISTORY, OBJECT, *trained_changes()):
        if np.any(whole.labels["role"] == name):
            # of sound throws all that others pair with
            found[name] = throw_set_of(whole, [name], train.layout, inputs, most=most.get(name))
    return found


def sound_count(train: Judged) -> int:
    """Return how many throws without an object or another cause a detector may learn from."""
    return int(np.isin(train.everything.labels["role"], [SOUND, HISTORY]).sum())


def _spread(throws: ThrowSet, most: int) -> ThrowSet:
    """Return at most so many throws, evenly among all."""
    return throws.of(_even(len(throws.level), most))


def _even(count: int, most: int) -> NDArray[np.intp]:
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.intp))


# ---- machines of several kinds

AS_ONE, CENTRED, EACH = "as one", "less their means", "each"
"""How machines are learned: all alike, all but less what a kind has in common, or each alone."""
MACHINE_SETTINGS: Settings = (
    {"components": 4, "machines": AS_ONE},
    {"components": 4, "machines": CENTRED},
    {"components": 8, "machines": CENTRED},
    {"components": 4, "machines": EACH},
)


@dataclass(frozen=True)
class MachineDetectorMethod(DetectorMethod):
    """The detector of markers, for machines of several kinds."""

    settings: Settings = MACHINE_SETTINGS

    def fit(self, train: Judged, setting: Mapping[str, Any], *, final: bool = False) -> Model:
        """Teach a detector, or one for each machine, with the training throws."""
        how = setting["machines"]
        if how == CENTRED:
            offset = machine_offsets(train.everything)
            return Centred(super().fit(less_offset(train, offset), setting, final=final), offset)
        if how == AS_ONE:
            return super().fit(train, setting, final=final)
        machines = [str(name) for name in np.unique(train.side.labels["machine"])]
        found = {}
        with one_blas_thread():
            for name in machines:
                own = train.of(train.side.labels["machine"] == name)
                panels = np.unique(own.side.labels["panel"])
                if sound_count(own) >= LEAST_SOUND and len(panels) >= FOLDS:
                    found[name] = self.taught(own, setting, final=final)
            if len(found) < len(machines):
                # too few of some machine: one detector of all of them
                found = {"": self.taught(train, setting, final=final)} | found
        return Taught(found)


@dataclass(frozen=True, eq=False)
class Centred:
    """A model of throws less the mean curve of their kind of machine.

    Attributes
    ----------
    model : Model
        Of what is left.
    offset : mapping of str to ndarray, shape (n_signals, n_samples)
        By machine.
    """

    model: Model
    offset: Mapping[str, Floats]

    def score(self, judged: Judged) -> Floats:
        """Return the score of the differences."""
        return self.model.score(less_offset(judged, self.offset))

    def judge(self, judged: Judged) -> tuple[Floats, Mapping[str, Any]]:
        """Return the same, and further fields of `Verdicts`."""
        return self.model.judge(less_offset(judged, self.offset))


def machine_offsets(side: Side) -> dict[str, Floats]:
    """Return by how much the mean sound throw of each machine differs from that of all of them."""
    machine = side.labels["machine"]
    sound = np.isin(side.labels["role"], [SOUND, HISTORY])
    means = {str(name): side.clean[sound & (machine == name)].mean(axis=0)
             for name in np.unique(machine[sound])}  # fmt: skip
    middle = np.mean(list(means.values()), axis=0)
    return {name: mean - middle for name, mean in means.items()}


def less_offset(judged: Judged, offset: Mapping[str, Floats]) -> Judged:
    """Return throws less the offset of their machine; a machine without one keeps its throws."""
    if not offset:
        return judged
    nothing = np.zeros_like(next(iter(offset.values())))

    def less(side: Side) -> Side:
        own = np.array([offset.get(str(name), nothing) for name in side.labels["machine"]])
        own = own.reshape(len(side.throw), *nothing.shape)
        return replace(
            side,
            histories=side.histories - own,
            features=side.features - window_features(own, judged.layout),
            clean=side.clean - own if len(side.clean) else side.clean,
        )

    return replace(
        judged,
        side=less(judged.side),
        known=less(judged.known),
        everything=less(judged.everything),
    )
