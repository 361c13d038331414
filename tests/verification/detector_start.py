"""What the preload that a switch starts with adds to detection: ``... .detector_start DIR``.

    python -m tests.verification.detector_start DIR

The narrow population (sections, fit and stress-free state do not vary) is thrown twice in the same
states, with the same objects: once pressed home as the last return left it, once free of force as
in the study that the goals of the detector come from. The same method learns from each, with the
same numbers of throws and the same assumed errors, and judges other switches of its kind without a
history. Differences of a90 are of the same states and draws of errors, their limits over drawn
states.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tests.verification.detector import DETECTOR
from tests.verification.detector_figures import (
    a90,
    drawn_errors,
    false_alarm_limits,
    measured_by_switch,
)
from tests.verification.detector_sets import NARROW, Throws

from turnout.core.files import write_atomic
from turnout.core.sources import digest_of_sources
from turnout.core.threads import one_blas_thread
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import alarms_of
from turnout.detection.detector.judging import CYCLE, make_view
from turnout.detection.detector.knowledge import Setting
from turnout.detection.detector.train_detector import knowledge_of_sets
from turnout.detection.detector.training import setting_of
from turnout.detection.detector.training_plan import OBJECT, SOUND
from turnout.detection.detector.training_sets import Counts, training_plans
from turnout.detection.reference import NOMINAL_FRICTION
from turnout.detection.throws import nominal_amplitude
from turnout.panel.load import load_panel
from turnout.study.load_study import load_study
from turnout.study.study import Study

Seen = NDArray[np.bool_]

LEARNED = Counts(sound=1200, objects=1040, defects=40, switches=0)
JUDGED = Counts(sound=1040, objects=1040, defects=0, switches=0)
SEED = 570_000
STARTS = {"pressed home": "true", "free of force": "false"}
DRAWS = 3
"""Uses of each judged throw, with other errors."""
RESAMPLES = 200


def main() -> None:
    """Throw, learn, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps throws and figures")
    folder = parser.parse_args().folder
    kept = folder / f"start-{digest_of_sources(DETECTOR)[:8]}.json"
    if not kept.exists():
        with one_blas_thread():
            write_atomic(kept, json.dumps(figures(folder), indent=1).encode())
    print("\n".join(table(json.loads(kept.read_text()))))


def study_of(loaded: str) -> Study:
    """Return the narrow population with or without a preload at the start."""
    study = load_study(NARROW)
    panel = load_panel("uic60-760-1-15", overrides={"schedule.loaded": loaded == "true"})
    return replace(study, panel=panel)


def figures(folder: Path) -> dict[str, dict[str, object]]:
    """Return false alarms, a90 by place of each start and the difference with its limits [m]."""
    amplitude = nominal_amplitude(study_of("true"), friction=NOMINAL_FRICTION)
    found: dict[str, dict[str, object]] = {}
    seen: dict[str, Seen] = {}
    for name, loaded in STARTS.items():
        study = study_of(loaded)
        setting = setting_of(study.panel, amplitude=amplitude, allowances=Allowances())
        seen[name], found[name], size, near = _judged(
            study, setting, folder / name.replace(" ", "-")
        )
    rng = np.random.default_rng(1)
    assert len({len(item[0]) for item in seen.values()}) == 1, "the same throws ended"
    for number, place in enumerate(setting.places):
        own = np.flatnonzero(near == number)
        both = [_a90_of(size, seen[name], own) for name in STARTS]
        for name, value in zip(STARTS, both, strict=True):
            found[name][place] = value
        drawn = [rng.choice(own, own.size) for _ in range(RESAMPLES)]
        apart = [
            _a90_of(size, seen["free of force"], i) - _a90_of(size, seen["pressed home"], i)
            for i in drawn
        ]
        limits = np.quantile(apart, [0.025, 0.975]).tolist()
        found.setdefault("difference", {})[place] = [both[1] - both[0], *limits]
    return found


def _a90_of(size: NDArray[np.float64], seen: Seen, rows: NDArray[np.intp]) -> float:
    return a90(np.tile(size[rows], len(seen)), seen[:, rows].ravel())


def _judged(
    study: Study, setting: Setting, folder: Path
) -> tuple[Seen, dict[str, object], NDArray[np.float64], NDArray[np.intp]]:
    """Return which objects are called in each draw, false alarms, sizes [m] and places."""
    plans = {
        "train": training_plans(study, LEARNED),
        "test": training_plans(study, JUDGED, seed=SEED),
    }
    throws = Throws(plans, folder, setting.layout)
    knowledge = knowledge_of_sets(throws.sets("train"), setting, draws=8, histories=())
    test = throws.sets("test")
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    assert calibrated is not None
    threshold, view = calibrated.thresholds["0.001"], make_view(knowledge)
    errors = drawn_errors(knowledge, 33)
    called = {
        name: np.array(
            [
                alarms_of(view, measured_by_switch(test[name], errors)) > threshold
                for _ in range(DRAWS)
            ]
        )
        for name in (OBJECT, SOUND)
    }
    objects = test[OBJECT]
    near = np.abs(objects.x[:, np.newaxis] - np.array(list(setting.places.values()))).argmin(axis=1)
    alarms = false_alarm_limits(called[SOUND].T)
    return called[OBJECT], {"threshold": threshold, "false alarms": alarms}, objects.size, near


def table(found: dict[str, dict[str, object]]) -> list[str]:
    """Return the figures as a table of docs/detection.md."""
    places = list(found["difference"])
    heads = [name.replace("sleeper ", "").replace("drive ", "D") for name in places]
    lines = [f"| a90 [mm] | {' | '.join(heads)} |", "|---|" + "--|" * len(heads)]
    for name in STARTS:
        cells = [f"{1e3 * float(str(found[name][place])):.1f}" for place in places]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    for label, number in (("difference", 0), ("from", 1), ("to", 2)):
        cells = [f"{1e3 * found['difference'][place][number]:.1f}" for place in places]  # type: ignore[index]
        lines.append(f"| {label} | {' | '.join(cells)} |")
    return [*lines, "", *(f"{name}: {found[name]['false alarms']}" for name in STARTS)]


if __name__ == "__main__":
    main()
