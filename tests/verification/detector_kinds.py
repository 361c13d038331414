"""How well kinds of objects are named: ``python -m tests.verification.detector_kinds DIR``.

The detector and the switches are those of `tests.verification.detector`, with the same options. The
first object of each judged throw is thrown once of each kind, at the same place and of the same
size. Of those that raise an alarm it is counted whether their kind is named, and whether the kinds
that a verdict leaves open hold the true one.
"""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tests.verification.detector import detector_file
from tests.verification.detector_figures import drawn_errors
from tests.verification.detector_sets import JUDGED_SEED, Sizes, Throws, plans_of

from turnout.core.threads import one_blas_thread
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import learn_history
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.judging import CYCLE, View, evidence_of, make_view, ratios_of
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.object_kinds import HARD, LEAST_ODDS
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.training import setting_of
from turnout.detection.detector.training_plan import (
    HISTORY,
    OBJECT,
    OBJECT_KIND,
    Plan,
    Population,
)
from turnout.detection.detector.training_sets import HISTORY_SEED, KINDS, after_history
from turnout.detection.floor import TOUCH_FORCE
from turnout.detection.reference import NOMINAL_FRICTION, reference_study
from turnout.detection.throws import nominal_amplitude

KNOWN = 20
NEAR = 1.3
"""Distance from a drive within which a place counts as near it [m]."""
DRAWS = 2
"""Uses of each throw, with other errors."""
NAMES = (HARD, *KINDS)


def main() -> None:
    """Throw, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps throws and the detector")
    for name, value in (("sound", 4000), ("objects", 3000), ("switches", 200)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--seed", type=int, default=JUDGED_SEED, help="of the switches judged")
    given = vars(parser.parse_args())
    folder, seed = given.pop("folder"), given.pop("seed")
    study = reference_study()
    amplitude = nominal_amplitude(study, friction=NOMINAL_FRICTION)
    setting = setting_of(study.panel, amplitude=amplitude, allowances=Allowances())
    plans = plans_of(study, Sizes(**given), seed=seed)
    population = Population(study, seed=seed + HISTORY_SEED)
    plans["kinds"] = kind_plans(population, plans["test"][after_history(OBJECT)])
    throws = Throws(plans, folder, setting.layout)
    path, _ = detector_file(throws, setting, folder)
    knowledge = Detector.load(path).knowledge
    drives = np.array([item.x for item in study.panel.drive.values()])
    sound = throws.sets("test", HISTORY)[HISTORY]
    with one_blas_thread():
        for history in (0, KNOWN):
            found = judged_kinds(knowledge, sound, throws.sets("kinds"), history=history)
            print(f"{history} throws known")
            print("\n".join(table(found, drives)), flush=True)


def kind_plans(population: Population, objects: Plan) -> dict[str, Plan]:
    """Return the first object of each judged throw as one of each kind, one plan a kind."""
    (axis,) = objects.study.design.axes
    _, first = np.unique(objects.partner, return_index=True)
    rows = [dict(zip(axis.names, axis.rows[i], strict=True)) for i in first]
    labels = {name: getattr(objects, name)[first] for name in ("partner", "switch", "level")}
    return {
        kind: replace(
            population.plan(kind, [{**row, OBJECT_KIND: stored} for row in rows]), **labels
        )
        for kind, stored in zip(NAMES, ("spring", *KINDS), strict=True)
    }


def judged_kinds(
    knowledge: Knowledge, sound: ThrowSet, held: Mapping[str, ThrowSet], *, history: int
) -> dict[str, NDArray[np.float64]]:
    """Return place, alarm and odds of every kind of each touched object, by its true kind.

    Returns
    -------
    dict of str to ndarray, shape (n, 2 + n_kinds)
        [m], 1 for an alarm, and [-].
    """
    calibrated = knowledge.calibration(part=CYCLE, history=history)
    assert calibrated is not None
    threshold = calibrated.thresholds["0.001"]
    found: dict[str, list[NDArray[np.float64]]] = {kind: [] for kind in held}
    population = make_view(knowledge)
    for switch in np.unique(sound.switch).tolist():
        errors = drawn_errors(knowledge, 7, switch)
        fixed, view = errors.of_switches(1), population
        if history:
            own = sound.of(sound.switch == switch)
            known = own.of(slice(history))
            features = known.features + fixed + errors.of_throws(known.rates)
            expected = learn_history(knowledge, features, view=population)
            view = make_view(knowledge, known=expected)
        for kind, throws in held.items():
            mine = throws.of((throws.switch == switch) & (throws.force > TOUCH_FORCE))
            for _ in range(DRAWS if len(mine.level) else 0):
                features = mine.features + fixed + errors.of_throws(mine.rates)
                found[kind].append(_weighed(view, features, mine.x, threshold))
    return {kind: np.concatenate(rows) for kind, rows in found.items()}


def _weighed(
    view: View, features: NDArray[np.float64], x: NDArray[np.float64], threshold: float
) -> NDArray[np.float64]:
    assert view.object_kinds is not None
    evidence = evidence_of(view, features)
    alarm = ratios_of(view, evidence).alarm > threshold
    return np.column_stack([x, alarm, view.object_kinds.odds(evidence).T])


def table(found: Mapping[str, NDArray[np.float64]], drives: NDArray[np.float64]) -> Iterator[str]:
    """Yield the rows of a table: near the drives and between them, by the true kind."""
    yield "| kind | place | touched | alarms | kind named | of these right | set holds it |"
    yield "|---|---|---|---|---|---|---|"
    for number, (kind, rows) in enumerate(found.items()):
        near = np.abs(rows[:, :1] - drives).min(axis=1) < NEAR
        for place, where in (("near a drive", near), ("between", ~near)):
            likely = rows[where, 2:] >= LEAST_ODDS
            alarm, holds = rows[where, 1] > 0.0, likely[:, number]
            named = alarm & (likely.sum(axis=1) == 1)
            yield (
                f"| {kind} | {place} | {len(alarm)} | {alarm.sum()} | {named.sum()} "
                f"| {(named & holds).sum()} | {(alarm & holds).sum()} |"
            )


if __name__ == "__main__":
    main()
