"""In-drive faults and a weak supply, by force and by current: ``python -m MODULE DIR``.

Both drives are machines. Small detectors of forces and of currents learn from the same throws, and
judge other switches without a history. MODULE is `benchmarks.studies.detector_in_drive`; DIR keeps
the throws.
"""

import argparse
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from benchmarks.studies.detector_figures import judge_alone
from benchmarks.studies.detector_machines import (
    FORCE,
    MACHINES,
    SignalThrows,
    of_quantity,
    one_setting,
)
from turnout.core.threads import one_blas_thread
from turnout.detection.conditions import CURRENT
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.train_detector import knowledge_of_sets
from turnout.detection.detector.training_plan import OBJECT, SOUND
from turnout.detection.detector.training_sets import TEST_SEED, Counts, training_plans
from turnout.detection.reference import reference_study
from turnout.panel.load import load_panel
from turnout.study.study import Study

LEARNED = Counts(sound=600, objects=200, kinds=0, defects=60, switches=0)
JUDGED = Counts(sound=60, objects=60, kinds=0, defects=60, switches=0)
SHOWN = (SOUND, OBJECT, "in-drive", "supply")


def main() -> None:
    """Throw, learn, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps the throws")
    folder = parser.parse_args().folder
    study = reference_study(load_panel("uic60-760-1-15", overrides=MACHINES))
    throws = CauseThrows(study, folder)
    learned, judged = throws.sets("train"), throws.sets("test")
    for quantity in (FORCE, CURRENT):
        print(f"by {quantity}")
        with one_blas_thread():
            for cause, named in judged_causes(study, learned, judged, quantity).items():
                found = ", ".join(f"{name} {count}" for name, count in sorted(named.items()))
                print(f"- {cause}, {named.total()} throws: {found}", flush=True)


def judged_causes(
    study: Study, learned: Mapping[str, ThrowSet], judged: Mapping[str, ThrowSet], quantity: str
) -> dict[str, "Counter[str]"]:
    """Return verdicts on throws of each cause, by a detector of a quantity."""
    knowledge = knowledge_of_sets(
        of_quantity(learned, quantity), one_setting(study, quantity), draws=8, histories=()
    )
    found = judge_alone(knowledge, of_quantity(judged, quantity), draws=1)
    return {
        cause: Counter(found.verdict[i].cause or found.verdict[i].status for i in found.of(cause))
        for cause in SHOWN
    }


class CauseThrows(SignalThrows):
    """Throws of machines with causes, of switches to learn from and of others.

    Parameters
    ----------
    study : Study
        Population whose drives are machines.
    folder : Path
        That holds the throws.
    """

    def __init__(self, study: Study, folder: Path) -> None:
        super().__init__(study, folder, switches=1, learned=LEARNED)
        test = training_plans(study, JUDGED, seed=TEST_SEED)
        self.plans = {**self.plans, "test": {name: test[name] for name in SHOWN}}


if __name__ == "__main__":
    main()
