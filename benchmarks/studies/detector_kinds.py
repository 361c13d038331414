"""How well kinds of objects are named: ``python -m benchmarks.studies.detector_kinds DIR``.

A small detector without a history learns what `turnout detect train` throws, in smaller numbers,
and judges switches that it never saw. Each object is thrown once of each kind, in the same state,
at the same place and of the same size. Of those that raise an alarm it is counted whether their
kind is named, and whether the kinds that a verdict leaves open hold the true one. DIR keeps throws.
"""

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.detector_figures import drawn_errors, measured_by_switch
from benchmarks.studies.detector_sets import Sizes, Throws
from turnout.core.threads import one_blas_thread
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import calibrate_alone, with_calibration
from turnout.detection.detector.judging import CYCLE, evidence_of, make_view, ratios_of
from turnout.detection.detector.knowledge import Knowledge, Setting
from turnout.detection.detector.object_kinds import LEAST_ODDS, RIGID
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.train_detector import folds_of, sets_of_kinds
from turnout.detection.detector.training import setting_of, teach
from turnout.detection.detector.training_plan import OBJECT_KIND, Plan, Population
from turnout.detection.detector.training_sets import (
    HISTORY_SEED,
    learned_kinds,
    object_at,
    training_plans,
)
from turnout.detection.floor import TOUCH_FORCE
from turnout.detection.reference import NOMINAL_FRICTION, reference_study
from turnout.detection.throws import nominal_amplitude, places_of
from turnout.study.study import Study

SIZES = Sizes(sound=1800, objects=900, switches=40)
SEED = 660_000
JUDGED = 3
"""Throws of each switch that are judged, the last of `SIZES.test.repeats`."""
FOLDS, DRAWS, USES = 4, 6, 4
"""Folds and uses of sound throws behind the threshold, and uses of each object."""
NEAR = 1.3
"""Distance from a drive within which a place counts as near it [m]."""
NAMES = {RIGID: "spring"} | {kind: kind for kind in learned_kinds()}
"""Kinds of objects as panels have them, by the name in a verdict."""


def main() -> None:
    """Throw, learn, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps the throws")
    folder = parser.parse_args().folder
    study = reference_study()
    amplitude = nominal_amplitude(study, friction=NOMINAL_FRICTION)
    setting = setting_of(study.panel, amplitude=amplitude, allowances=Allowances())
    plans = {"train": training_plans(study, SIZES.training), "kinds": {"kinds": kinds_plan(study)}}
    throws = Throws(plans, folder, setting.layout)
    drives = np.array([item.x for item in study.panel.drive.values()])
    learned, held = throws.sets("train"), throws.sets("kinds")["kinds"]
    with one_blas_thread():
        found = judged_kinds(small_detector(learned, setting), held)
    print("\n".join(table(found, drives)), flush=True)


def small_detector(sets: Mapping[str, ThrowSet], setting: Setting) -> Knowledge:
    """Return a detector with a threshold for no history, of fewer folds and uses."""
    weighed = {name: item for name, item in sets.items() if name not in sets_of_kinds()}
    folds = folds_of(weighed, setting, count=FOLDS)
    return with_calibration(teach(sets, setting), [calibrate_alone(folds, draws=DRAWS)])


def kinds_plan(study: Study) -> Plan:
    """Return the last throws of some switches with an object, once of each kind."""
    population = Population(study, seed=SEED + HISTORY_SEED)
    rng = np.random.default_rng([study.seed, SEED, 44])
    places = np.array(list(places_of(study.panel).values()))
    repeats = SIZES.test.repeats
    rows = [
        population.row(number * repeats + repeat, switch=number * repeats)
        for number in range(SIZES.switches)
        for repeat in range(repeats)
    ]
    last = [i for i in range(len(rows)) if i % repeats >= repeats - JUDGED]
    held = [object_at(rows[i], rng, places, number=n, exact=True) for n, i in enumerate(last)]
    partner = last * len(NAMES)
    return population.plan(
        "kinds",
        [{**row, OBJECT_KIND: kind} for kind in NAMES.values() for row in held],
        partner=partner,
        switch=[i // repeats for i in partner],
        sound=[rows[i] for i in partner],
    )


def judged_kinds(knowledge: Knowledge, held: ThrowSet) -> dict[str, NDArray[np.float64]]:
    """Return place, alarm and odds of every kind of each touched object, by its true kind.

    Returns
    -------
    dict of str to ndarray, shape (n, 2 + n_kinds)
        [m], 1 for an alarm, and [-].
    """
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    view, errors = make_view(knowledge), drawn_errors(knowledge, 5)
    assert calibrated is not None
    assert view.object_kinds is not None
    kind = held.row // (SIZES.switches * JUDGED)
    found: dict[str, list[NDArray[np.float64]]] = {name: [] for name in NAMES}
    for _ in range(USES):
        evidence = evidence_of(view, measured_by_switch(held, errors))
        alarm = ratios_of(view, evidence).alarm > calibrated.thresholds["0.001"]
        rows = np.column_stack([held.x, alarm, view.object_kinds.odds(evidence).T])
        for number, name in enumerate(NAMES):
            found[name].append(rows[(kind == number) & (held.force > TOUCH_FORCE)])
    return {name: np.concatenate(rows) for name, rows in found.items()}


def table(found: Mapping[str, NDArray[np.float64]], drives: NDArray[np.float64]) -> Iterator[str]:
    """Yield the rows of a table: near the drives and between them, by the true kind."""
    yield "| kind | place | touched | alarms | set holds it | kind named | of these right |"
    yield "|---|---|---|---|---|---|---|"
    for number, (kind, rows) in enumerate(found.items()):
        near = np.abs(rows[:, :1] - drives).min(axis=1) < NEAR
        for place, where in (("near a drive", near), ("between", ~near)):
            likely = rows[where, 2:] >= LEAST_ODDS
            alarm, holds = rows[where, 1] > 0.0, likely[:, number]
            named = alarm & (likely.sum(axis=1) == 1)
            yield (
                f"| {kind} | {place} | {len(alarm)} | {alarm.sum()} | {(alarm & holds).sum()} "
                f"| {named.sum()} | {(named & holds).sum()} |"
            )


if __name__ == "__main__":
    main()
