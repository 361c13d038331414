"""Further figures of the detector on the switches of ``benchmarks.studies.detector``, by histories.

    python -m benchmarks.studies.detector_histories DIR --seed 550000

Five known throws, closings alone, soft objects and a larger assumed discrepancy, each without and
with throws of the switch known. DIR and seed are those of `benchmarks.studies.detector`, whose
throws and detector are read, or made where they are not there. Verdicts are kept in DIR by switch,
so that a stopped run goes on.
"""

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.detector import detector_file
from benchmarks.studies.detector_figures import a90, false_alarm_limits, of_each_switch
from benchmarks.studies.detector_sets import JUDGED_SEED, KIND, Sizes, Throws, plans_of
from turnout.core.files import write_atomic
from turnout.core.threads import one_blas_thread
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import (
    Errors,
    alarms_of,
    calibrate_alone,
    calibrate_history,
    learn_history,
    with_calibration,
)
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.judging import CYCLE, make_view
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.throw_layout import CLOSING
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.train_detector import folds_of, knowledge_of_sets
from turnout.detection.detector.training import setting_of
from turnout.detection.detector.training_plan import (
    HISTORY,
    OBJECT,
    SOUND,
    Plan,
    Population,
    with_object,
)
from turnout.detection.detector.training_sets import HISTORY_SEED, after_history
from turnout.detection.floor import TOUCH_FORCE
from turnout.detection.reference import NOMINAL_FRICTION, reference_study
from turnout.detection.throws import nominal_amplitude, places_of
from turnout.study.defects import Row
from turnout.study.study import Study

Floats = NDArray[np.float64]
Ratios = list[dict[str, list[float]]]

KNOWN = 20
SOFT_KINDS = ("metal", "stone", "wood", "ice", "snow")
SOFT_PLACES = {"sleeper 2": 9e-3, "sleeper 6": 22e-3, "sleeper 9": 14e-3}
"""Where objects of every kind are trapped, and how large they are at most [m]."""
LARGER = 0.08
"""Discrepancy in place of 5 % [-]."""
SEED = 34


def main() -> None:
    """Make the missing throws, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="that of benchmarks.studies.detector")
    parser.add_argument("--seed", type=int, default=JUDGED_SEED, help="of the switches judged")
    parser.add_argument("--only", nargs="*", help="figures wanted; default all that are missing")
    given = parser.parse_args()
    study = reference_study()
    amplitude = nominal_amplitude(study, friction=NOMINAL_FRICTION)
    setting = setting_of(study.panel, amplitude=amplitude, allowances=Allowances())
    plans = plans_of(study, Sizes(), seed=given.seed)
    plans["soft"] = {"soft": soft_plan(study, Sizes(), seed=given.seed)}
    throws = Throws(plans, given.folder, setting.layout)
    path, made = detector_file(throws, setting, given.folder)
    kept = given.folder / f"histories-{made}-{given.seed}.json"
    said = json.loads(kept.read_text()) if kept.exists() else {}
    folder = given.folder / f"histories-{made}-{given.seed}"
    knowledge = Detector.load(path).knowledge
    judge = Judge(knowledge, throws, folder)

    def whole() -> Judge:
        kept_whole = given.folder / f"whole-{made}.detector"
        return replace(judge, knowledge=completed(knowledge, throws, kept_whole))

    figures: dict[str, Callable[[], dict[str, Any]]] = {
        "5 known": lambda: whole().figures("5", history=5),
        "closings alone": lambda: whole().figures("closings", history=0, part=CLOSING),
        "soft": judge.soft,
        "price": lambda: price(judge, throws.sets("train")),
    }
    with one_blas_thread():
        for name, figure in figures.items():
            if name in said if given.only is None else name not in given.only:
                continue
            said[name] = figure()
            print(json.dumps({name: said[name]}, indent=1), flush=True)
            write_atomic(kept, json.dumps(said, indent=1).encode())


def completed(knowledge: Knowledge, throws: Throws, path: Path) -> Knowledge:
    """Return a detector with the thresholds that it lacks: of closings alone, after five throws."""
    if path.exists():
        return Detector.load(path).knowledge
    found = list(knowledge.calibrated)
    lacking = {(CLOSING, 0), (CYCLE, 5)} - {(item.part, item.history) for item in found}
    if not lacking:
        return knowledge
    train = throws.sets("train")
    folds = folds_of(train, knowledge.setting)
    alone = {item.part: item for item in found if item.history == 0}
    if (CLOSING, 0) in lacking:
        alone[CLOSING] = calibrate_alone(folds, part=CLOSING, draws=DRAWS)
        found.append(alone[CLOSING])
    if (CYCLE, 5) in lacking:
        found += calibrate_history(
            folds,
            train[HISTORY],
            history=5,
            alone={CYCLE: alone[CYCLE]},
            objects=train[after_history(OBJECT)],
            draws=2,
            report=None,
        )
    made = with_calibration(knowledge, found)
    Detector(made).save(path)
    return made


DRAWS = 8
"""Uses of each held-back throw that a threshold of closings is taken from."""


def soft_plan(study: Study, sizes: Sizes, *, seed: int) -> Plan:
    """Return the last throw of every switch with an object of each kind, of the same size."""
    population = Population(study, seed=seed + HISTORY_SEED)
    repeats = sizes.test.repeats
    rows = [
        population.row(number * repeats + turn, switch=number * repeats)
        for number in range(sizes.switches)
        for turn in range(repeats)
    ]
    rng = np.random.default_rng([study.seed, seed, 35])
    places = places_of(study.panel)
    last = range(repeats - 1, len(rows), repeats)
    held: list[Row] = []
    for number, at in enumerate(last):
        name = list(SOFT_PLACES)[number % len(SOFT_PLACES)]
        held.append(with_object(rows[at], rng, x=places[name], largest=SOFT_PLACES[name]))
    made = [{**row, KIND: kind} for kind in SOFT_KINDS for row in held]
    partner = [at for _ in SOFT_KINDS for at in last]
    return population.plan(
        "soft",
        made,
        partner=partner,
        switch=[at // repeats for at in partner],
        sound=[rows[at] for at in partner],
    )


@dataclass(frozen=True, slots=True)
class Judge:
    """Judges the throws of switches whose first throws are known, or as if none were.

    Attributes
    ----------
    knowledge : Knowledge
        Trained.
    throws : Throws
        Of the switches.
    folder : Path
        Keeps log ratios by switch.
    """

    knowledge: Knowledge
    throws: Throws
    folder: Path

    @property
    def sound(self) -> ThrowSet:
        """Sound throws of all switches, in the order of time."""
        return self.throws.sets("test", HISTORY)[HISTORY]

    @property
    def objects(self) -> ThrowSet:
        """Objects in the last of these."""
        name = after_history(OBJECT)
        return self.throws.sets("test", name)[name]

    def ratios(
        self,
        name: str,
        judged: Mapping[str, tuple[ThrowSet, int]],
        *,
        history: int,
        part: str = CYCLE,
        drawn: Allowances | None = None,
    ) -> Ratios:
        """Return the log likelihood ratios of throws, each used several times, by switch.

        Parameters
        ----------
        name : str
            Of the folder that keeps them.
        judged : mapping of str to (ThrowSet, int)
            By kind, with how often each is used with other errors.
        history : int
            First throws of the switch that are known.
        part : str
            What is recorded of the throws that are judged.
        drawn : Allowances, optional
            Errors of measured throws; default those that are assumed.
        """
        own_view = make_view(self.knowledge)
        first = int(np.bincount(self.sound.switch).max())
        alone = None if history else make_view(self.knowledge, part=part)

        def of_switch(switch: int) -> dict[str, list[float]]:
            errors = Errors(
                self.knowledge.errors(drawn),
                part=self.knowledge.layout.part,
                rng=np.random.default_rng([SEED, switch, 12]),
            )
            fixed, view = errors.of_switches(1), alone
            if view is None:
                known = self.sound.of(self.sound.switch == switch)
                known = known.of(known.row % first < history)
                rows = known.features + fixed + errors.of_throws(known.rates)
                expected = learn_history(self.knowledge, rows, view=own_view)
                view = make_view(self.knowledge, part=part, known=expected)
            found = {}
            for kind, (throws, uses) in judged.items():
                own = throws.of(throws.switch == switch)
                rows = [own.features + fixed + errors.of_throws(own.rates) for _ in range(uses)]
                found[kind] = alarms_of(view, np.concatenate(rows)).tolist() if len(own.row) else []
            return found

        return of_each_switch(np.unique(self.sound.switch), self.folder / name, of_switch)

    def threshold(self, *, history: int, part: str = CYCLE) -> float:
        """Return the threshold of 1 false alarm in 1,000."""
        calibrated = self.knowledge.calibration(part=part, history=history)
        assert calibrated is not None
        return float(calibrated.thresholds["0.001"])

    def figures(
        self,
        name: str,
        *,
        history: int,
        part: str = CYCLE,
        uses: int = 50,
        drawn: Allowances | None = None,
    ) -> dict[str, Any]:
        """Return threshold, false alarms of sound throws and a90 by place [m]."""
        first = int(np.bincount(self.sound.switch).max())
        sound = self.sound.of(self.sound.row % first >= KNOWN)
        judged = {SOUND: (sound, uses), OBJECT: (self.objects, 1)}
        found = self.ratios(name, judged, history=history, part=part, drawn=drawn)
        threshold = self.threshold(history=history, part=part)
        called = by_row(found, OBJECT, self.objects, 1) > threshold
        places = self.knowledge.setting.places
        near = nearest(self.objects.x, np.array(list(places.values())))
        return {
            "threshold": threshold,
            "false alarms": false_alarm_limits(
                [np.array(item[SOUND]) > threshold for item in found]
            ),
            "a90": {
                place: a90(self.objects.size[near == number], called[0, near == number])
                for number, place in enumerate(places)
            },
        }

    def soft(self, *, uses: int = 4) -> dict[str, Any]:
        """Return for each kind, of touched objects, the share called and a90 by place [m]."""
        soft = self.throws.sets("soft", "soft")["soft"]
        each = (int(soft.row.max()) + 1) // len(SOFT_KINDS)
        names = list(SOFT_PLACES)
        near = nearest(soft.x, np.array([self.knowledge.setting.places[i] for i in names]))
        found: dict[str, Any] = {}
        for history in (0, KNOWN):
            ratios = self.ratios(f"soft-{history}", {"soft": (soft, uses)}, history=history)
            called = by_row(ratios, "soft", soft, uses) > self.threshold(history=history)
            for number, kind in enumerate(SOFT_KINDS):
                own = soft.row // each == number
                touched = own & (soft.force > TOUCH_FORCE)
                found[f"{kind}, {history} known"] = {
                    "touched": int(touched.sum()),
                    "called": float(called[:, touched].mean()),
                } | {
                    place: a90(np.tile(soft.size[rows], uses), called[:, rows].ravel())
                    for at, place in enumerate(names)
                    if (rows := np.flatnonzero(own & (near == at))).size
                }
        return found


def nearest(x: Floats, places: Floats) -> NDArray[np.intp]:
    """Return the number of the place next to each object."""
    return np.abs(x[:, np.newaxis] - places).argmin(axis=1)


def by_row(ratios: Ratios, kind: str, throws: ThrowSet, uses: int) -> Floats:
    """Return log ratios in the order of the throws, shape (uses, n_throws); switches count up."""
    found = np.full((uses, len(throws.row)), np.nan)
    for switch, item in enumerate(ratios):
        own = np.flatnonzero(throws.switch == switch)
        found[:, own] = np.array(item[kind]).reshape(uses, own.size)
    return found


def price(judge: Judge, train: Mapping[str, ThrowSet]) -> dict[str, Any]:
    """Return losses and gains of a detector that assumes 8 %, with 20 throws known."""
    setting = judge.knowledge.setting
    drawn, larger = setting.allowances, replace(setting.allowances, discrepancy=LARGER)
    robust = knowledge_of_sets(
        train,
        replace(setting, allowances=larger),
        draws=4,
        history_draws=2,
        histories=(KNOWN,),
    )
    judges = {"5 %": judge, "8 %": replace(judge, knowledge=robust)}
    return {
        f"assumed {assumed}, in the throws {share}": own.figures(
            f"price-{assumed[0]}-{share[0]}", history=KNOWN, uses=10, drawn=errors
        )
        for assumed, own in judges.items()
        for share, errors in (("5 %", drawn), ("8 %", larger))
    }


if __name__ == "__main__":
    main()
