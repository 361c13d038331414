"""How good the detector is on switches it never saw: ``python -m tests.verification.detector DIR``.

Throws, training and judging go on where they were stopped. A population of switches is thrown with
the seed of the study for training and with another for judging; each test throw gets a discrepancy,
noise, timing, gain and zero of its own. Alarms are counted by switch.
"""

import argparse
import json
import sys
from pathlib import Path

from tests.verification.detector_figures import (
    Judged,
    a90_of_places,
    cause_figures,
    false_alarms,
    gap_figures,
    judge_alone,
    judge_with_history,
    object_figures,
)

from turnout.core.threads import one_blas_thread
from turnout.detection.detector import Detector
from turnout.detection.knowledge import Knowledge
from turnout.detection.reference import reference_study
from turnout.detection.train_detector import train_detector
from turnout.detection.training import read_set
from turnout.detection.training_sets import TEST_SEED, Counts, throw_plans, training_plans
from turnout.study.load_study import load_study

KINDS = ("sound", "object", "dry chairs", "clutch", "loose rod")


def main() -> None:
    """Throw, train, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps throws and the detector")
    parser.add_argument("--study", type=Path, help="population in place of the reference case")
    parser.add_argument("--sound", type=int, default=8000)
    parser.add_argument("--objects", type=int, default=6000)
    parser.add_argument("--switches", type=int, default=100)
    parser.add_argument("--draws", type=int, default=4, help="uses of each throw")
    parser.add_argument("--rate", type=float, default=1e-3)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    study = reference_study() if given.study is None else load_study(given.study)
    path = given.folder / "switch.detector"
    if not path.exists():
        counts = Counts(
            sound=given.sound,
            objects=given.objects,
            defects=max(150, given.sound // 10),
            switches=given.switches // 2,
            judged=4,
            objects_each=2,
        )
        knowledge = train_detector(
            given.folder / "train", study=study, counts=counts, workers=given.workers
        )
        Detector(knowledge).save(path)
    knowledge = Detector.load(path).knowledge
    counts = Counts(
        sound=given.sound // 2,
        objects=given.objects // 3,
        defects=max(100, given.sound // 20),
        switches=given.switches,
        judged=6,
        objects_each=4,
    )
    plans = training_plans(study, counts, seed=TEST_SEED)
    datasets = throw_plans(plans, given.folder / "test", workers=given.workers)
    sets = {name: read_set(plans[name], datasets[name], knowledge.layout) for name in plans}
    with one_blas_thread():
        alone = judge_alone(knowledge, sets, rate=given.rate, draws=given.draws)
        print(json.dumps({"history": 0, **figures(knowledge, alone)}, indent=1))
        sys.stdout.flush()
        known = judge_with_history(knowledge, sets, rate=given.rate, again=given.draws)
        print(json.dumps({"history": 20, **figures(knowledge, known)}, indent=1))


def figures(knowledge: Knowledge, judged: Judged) -> dict[str, object]:
    """Return all figures of some verdicts."""
    places, gaps = knowledge.setting.places, knowledge.setting.gaps
    kinds = [kind for kind in (*KINDS, "adjustment") if judged.of(kind).size]
    return {
        "false alarms": {kind: false_alarms(judged, kind) for kind in kinds if kind != "object"},
        "a90": a90_of_places(judged, places),
        "gaps": {kind: gap_figures(judged, kind, gaps) for kind in ("sound", "object")},
        "objects": object_figures(judged, places),
        "causes": cause_figures(judged, kinds),
    }


if __name__ == "__main__":
    main()
