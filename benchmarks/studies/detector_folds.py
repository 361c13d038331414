"""Thresholds after a history, with folds that learn from switches with one, and without.

    python -m benchmarks.studies.detector_folds DIR

Drives that are machines; 900 sound throws, 16 switches with 26 throws each and 120 objects, kept in
DIR. Thresholds by current and by force: as they were until folds learned from the switches with a
history that they do not judge, and as they are, with four folds and with eight.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from benchmarks.studies.detector_machines import MACHINES, SignalThrows, of_quantity, one_setting
from turnout.core.threads import one_blas_thread
from turnout.detection.conditions import CURRENT, FORCE
from turnout.detection.detector.calibrating import calibrate_alone, calibrate_history
from turnout.detection.detector.judging import CYCLE
from turnout.detection.detector.train_detector import FOLDS, folds_of
from turnout.detection.detector.training_plan import HISTORY, OBJECT, SOUND
from turnout.detection.detector.training_sets import Counts, after_history
from turnout.detection.reference import reference_study
from turnout.panel.load import load_panel

LEARNED = Counts(sound=900, objects=120, kinds=0, defects=0, switches=16, objects_each=1, judged=1)
KNOWN = 20


def main() -> None:
    """Throw, learn and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="keeps the throws")
    given = parser.parse_args()
    study = reference_study(load_panel("uic60-760-1-15", overrides=MACHINES))
    throws = SignalThrows(study, given.folder, switches=1, learned=LEARNED)
    learned = throws.sets("train", SOUND, HISTORY, OBJECT, after_history(OBJECT))
    print("| by | folds | learn from switches with a history | alone | 20 known |")
    print("|---|--|--|--|--|")
    for quantity in (CURRENT, FORCE):
        sets, setting = of_quantity(learned, quantity), one_setting(study, quantity)
        single = {name: item for name, item in sets.items() if name != HISTORY}
        for own, count in ((single, 4), (sets, 4), (sets, FOLDS)):
            with one_blas_thread():
                folds = folds_of(own, setting, count=count)
                alone = calibrate_alone(folds, draws=4)
                (known,) = calibrate_history(
                    folds,
                    sets[HISTORY],
                    history=KNOWN,
                    alone={CYCLE: replace(alone, thresholds={})},
                    draws=1,
                    again=8,
                )
            cells = [
                " / ".join(f"{value:.1f}" for value in item.thresholds.values())
                for item in (alone, known)
            ]
            learns = "yes" if HISTORY in own else "no"
            print(f"| {quantity} | {count} | {learns} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
