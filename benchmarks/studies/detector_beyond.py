"""Throws beyond the training of a detector: another speed or start: ``... .detector_beyond DIR``.

    python -m benchmarks.studies.detector_beyond DIR --detector FILE.detector

Switches that the detector did not learn from are thrown with all drives or one off the schedule,
and free of force at the start, each sound and with 20 mm at sleeper 6. Each throw is recorded with
the errors that the detector assumes, from exact onsets, and judged without a history.
"""

import argparse
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.studies.detector_over_time import Recorder
from benchmarks.studies.detector_sets import Throws
from turnout.detection.detector.detector import Detector
from turnout.detection.detector.training import layout_of_panel
from turnout.detection.detector.training_plan import OBJECT_AT, OBJECT_SIZE, Plan, Population
from turnout.detection.detector.training_sets import TEST_SEED
from turnout.detection.reference import reference_study
from turnout.panel.load import load_panel
from turnout.study.defects import Row

SIZE, PLACE = 20e-3, 3.6
"""Of the object, at sleeper 6, where 13.7 mm are seen in nine of ten throws [m]."""
LONGER = (0.0, 0.01, 0.02, 0.03, 0.05, 0.08, 0.12)
"""Shares by which movements take longer, or shorter [-]."""
STATES, STARTS = 8, 100
"""Switches off their schedule, and those that start unloaded."""
DRIVES = ("1", "2")


def main() -> None:
    """Throw, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps the throws")
    parser.add_argument("--detector", type=Path, required=True, help="of `turnout detect train`")
    given = parser.parse_args()
    cases = {name: plan_of(name) for name in ("all drives", *DRIVES, "loaded", "unloaded")}
    plans = {"beyond": {name: plan for name, (plan, _) in cases.items()}}
    throws = Throws(plans, given.folder, layout_of_panel(reference_study().panel))
    print("| | sound | 20 mm at sleeper 6 |\n|---|---|---|")
    for name, (plan, labels) in cases.items():
        said = judged(Detector.load(given.detector), throws, name, plan, labels)
        for label in dict.fromkeys(labels):
            print(f"| {label} | {said[label, False]} | {said[label, True]} |", flush=True)


def plan_of(name: str) -> tuple[Plan, list[str]]:
    """Return the throws of a case, sound and then with the object, and the label of each."""
    study = reference_study()
    if name == "unloaded":
        study = replace(study, panel=load_panel("uic60-760-1-15", overrides=FREE))
    population, rows, labels = Population(study, seed=TEST_SEED), [], []
    if name in ("loaded", "unloaded"):
        rows = [population.row(state) for state in range(STARTS)]
        labels = [name] * STARTS
    else:
        for share in sorted({sign * share + 0.0 for share in LONGER for sign in (-1.0, 1.0)}):
            own = [population.row(state) for state in range(STATES)]
            slow = DRIVES if name == "all drives" else (name,)
            rows += [off_schedule(row, population, slow, share) for row in own]
            who = name if name == "all drives" else f"drive {name}"
            labels += [f"{who} {100.0 * share:+.0f} %"] * STATES
    held = [row | {OBJECT_SIZE: SIZE, OBJECT_AT: PLACE} for row in rows]
    return population.plan(name, rows + held), labels


FREE = {"schedule.loaded": False}


def off_schedule(row: Row, population: Population, slow: tuple[str, ...], share: float) -> Row:
    """Return a row in which movements of some drives take longer by a share."""
    changed = dict(row)
    for name, movement in population.study.panel.movement.items():
        keys = {drive: f"movement.{name}.extra_time.{drive}" for drive in DRIVES}
        usual = {d: float(row.get(keys[d], movement.extra_time.get(d, 0.0))) for d in DRIVES}
        takes = {
            drive: (float(movement.duration) + usual[drive]) * (1.0 + share * (drive in slow))
            for drive in DRIVES
        }
        changed[f"movement.{name}.duration"] = least = min(takes.values())
        changed |= {keys[drive]: takes[drive] - least for drive in DRIVES}
    return changed


def judged(
    detector: Detector, throws: Throws, name: str, plan: Plan, labels: list[str]
) -> Mapping[tuple[str, bool], str]:
    """Return how often each verdict is given, in words."""
    made = throws.forces("beyond", name)
    found: dict[tuple[str, bool], Counter[str]] = {}
    for force, row in zip(made["force"], made["row"], strict=True):
        recorder = Recorder(
            detector.knowledge.setting, made["time"], np.random.default_rng([TEST_SEED, int(row)])
        )
        throw = recorder.record(np.asarray(force, dtype=np.float64), exact=True)
        late = float(plan.start[row]) - detector.knowledge.layout.parts[-1].start
        onsets = throw.onsets | {"closing": throw.onsets["closing"] + late}
        verdict = detector.judge(replace(throw, onsets=onsets))
        key = labels[row % len(labels)], bool(row >= len(labels))
        said = f"{verdict.status}: {verdict.cause}" if verdict.cause else verdict.status
        found.setdefault(key, Counter())[said] += 1
    return {
        key: ", ".join(f"{name} {count}" for name, count in counts.most_common())
        for key, counts in found.items()
    }


if __name__ == "__main__":
    main()
