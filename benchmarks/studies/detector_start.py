"""Gain in detection by the preload that a switch starts with: ``... .detector_start DIR``.

    python -m benchmarks.studies.detector_start DIR

The narrow population (sections, fit and stress-free state do not vary) is thrown twice in the same
states, with the same objects: once pressed home as the last return left it, once free of force as
in the study that the goals of the detector come from. The same method learns from each, with the
same numbers of throws and the same assumed errors, and judges other switches of its kind without a
history: at the threshold that each takes from its own training, and at equal false alarms, where 1
in 1,000 uses of the judged sound throws is called. Differences of a90 are of the same states and
draws of errors, their limits over drawn states.
"""

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.detector import DETECTOR
from benchmarks.studies.detector_figures import (
    a90,
    drawn_errors,
    false_alarm_limits,
    measured_by_switch,
)
from benchmarks.studies.detector_page import alarms, heads, row
from benchmarks.studies.detector_sets import NARROW, Throws
from turnout.calibration.load_study import load_study
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
from turnout.study.study import Study

Floats = NDArray[np.float64]
Seen = NDArray[np.bool_]

LEARNED = Counts(sound=4000, objects=3000, kinds=0, defects=120, switches=0)
JUDGED = Counts(sound=3000, objects=2600, kinds=0, defects=0, switches=0)
SEED = 570_000
STARTS = {"pressed home": "true", "free of force": "false"}
DRAWS = 3
"""Uses of each judged throw, with other errors."""
RESAMPLES = 200
RATE = 1e-3
"""Of false alarms, at which both starts are compared [-]."""


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


def figures(folder: Path) -> dict[str, dict[str, Any]]:
    """Return threshold, false alarms and a90 by place of each start, and differences [m]."""
    amplitude = nominal_amplitude(study_of("true"), friction=NOMINAL_FRICTION)
    judged = {}
    for name, loaded in STARTS.items():
        study = study_of(loaded)
        setting = setting_of(study.panel, amplitude=amplitude, allowances=Allowances())
        judged[name] = _judged(study, setting, folder / name.replace(" ", "-"))
    first, second = judged.values()
    assert np.array_equal(first.row, second.row), "the same throws ended"
    return {
        label: _compared(judged, setting.places, equal=equal)
        for label, equal in (("own thresholds", False), ("equal false alarms", True))
    }


def _compared(
    judged: Mapping[str, "Start"], places: Mapping[str, float], *, equal: bool
) -> dict[str, Any]:
    """Return a90 of two starts at thresholds of one kind."""
    limits = {
        name: float(np.quantile(item.sound, 1.0 - RATE)) if equal else item.threshold
        for name, item in judged.items()
    }
    found: dict[str, Any] = {
        name: {
            "threshold": limits[name],
            "false alarms": false_alarm_limits(list(limits[name] < item.sound.T), uses=DRAWS),
        }
        for name, item in judged.items()
    }
    loaded, free = (item.objects > limits[name] for name, item in judged.items())
    first = next(iter(judged.values()))
    near = np.abs(first.x[:, np.newaxis] - np.array(list(places.values()))).argmin(axis=1)
    rng = np.random.default_rng(1)
    for number, place in enumerate(places):
        own = np.flatnonzero(near == number)
        both = [_a90_of(first.size, seen, own) for seen in (loaded, free)]
        drawn = [rng.choice(own, own.size) for _ in range(RESAMPLES)]
        apart = [_a90_of(first.size, free, i) - _a90_of(first.size, loaded, i) for i in drawn]
        for name, value in zip(judged, both, strict=True):
            found[name][place] = value
        limit = np.quantile(apart, [0.025, 0.975]).tolist()
        found.setdefault("difference", {})[place] = [both[1] - both[0], *limit]
    return found


def _a90_of(size: Floats, seen: Seen, rows: NDArray[np.intp]) -> float:
    """Return a90 of some throws, at most the largest of them [m]."""
    found = a90(np.tile(size[rows], len(seen)), seen[:, rows].ravel())
    return min(found, float(size[rows].max()))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Start:
    """Verdicts of a detector on throws that start alike.

    Attributes
    ----------
    threshold : float
        That it takes from its training for 1/1,000 [-].
    objects, sound : ndarray, shape (draws, n)
        Log likelihood ratios of throws with and without an object [-].
    row, size, x : ndarray, shape (n,)
        Of throws with an object: scenario, size and place [m].
    """

    threshold: float
    objects: Floats
    sound: Floats
    row: NDArray[np.intp]
    size: Floats
    x: Floats


def _judged(study: Study, setting: Setting, folder: Path) -> Start:
    """Learn from throws of one start, and judge others."""
    plans = {
        "train": training_plans(study, LEARNED),
        "test": training_plans(study, JUDGED, seed=SEED),
    }
    throws = Throws(plans, folder, setting.layout)
    knowledge = knowledge_of_sets(throws.sets("train"), setting, draws=8, histories=())
    test = throws.sets("test")
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    assert calibrated is not None
    view, errors = make_view(knowledge), drawn_errors(knowledge, 33)
    ratios = {
        name: np.array(
            [alarms_of(view, measured_by_switch(test[name], errors)) for _ in range(DRAWS)]
        )
        for name in (OBJECT, SOUND)
    }
    held = test[OBJECT]
    return Start(
        threshold=float(calibrated.thresholds["0.001"]),
        objects=ratios[OBJECT],
        sound=ratios[SOUND],
        row=held.row,
        size=held.size,
        x=held.x,
    )


def table(found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the figures as tables of docs/evidence/detection-results.md."""
    lines: list[str] = []
    for label, own in found.items():
        places = own["difference"]
        lines += heads(list(places))
        lines[-2] = lines[-2].replace("| |", f"| a90 [mm], {label} |", 1)
        lines += [row(name, [own[name][place] for place in places]) for name in STARTS]
        lines += [
            row(name, [item[number] for item in places.values()])
            for name, number in (("difference", 0), ("from", 1), ("to", 2))
        ]
        lines += [""] + [
            f"- {name}: threshold {own[name]['threshold']:.2f}, {alarms(own[name]['false alarms'])}"
            for name in STARTS
        ]
        middle = median(1e3 * item[0] for item in places.values())
        lines += [f"- median of the differences {middle:.1f} mm", ""]
    return lines


if __name__ == "__main__":
    main()
