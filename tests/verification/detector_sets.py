"""The throws behind the figures of the detector: for training, for judging, and further cases."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from tests.verification.detector_cases import case_plans

from turnout.detection.training_plan import Plan
from turnout.detection.training_sets import TEST_SEED, Counts, throw_plans, training_plans
from turnout.study.study import Study
from turnout.sweep.run import SweepProgress


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """How many throws the figures rest on; by default as on docs/detection.md."""

    sound: int = 4000
    objects: int = 3000
    switches: int = 100
    test_sound: int = 2000
    test_objects: int = 1300

    @property
    def training(self) -> Counts:
        """For training."""
        defects = max(40, self.sound // 10)
        return Counts(
            sound=self.sound,
            objects=self.objects,
            defects=defects,
            switches=max(10, self.sound // 100),
        )

    @property
    def test(self) -> Counts:
        """For judging: other switches, of which some have a history of 20 throws."""
        return Counts(
            sound=self.test_sound,
            objects=self.test_objects,
            defects=max(20, self.test_sound // 13),
            switches=self.switches,
            repeats=23,
            judged=3,
            objects_each=3,
        )


def show(name: str) -> "Watch":
    """Return what prints how far a sweep is."""
    return Watch(name)


class Watch:
    """Prints each tenth of a sweep.

    Parameters
    ----------
    name : str
        Of the sweep.
    """

    def __init__(self, name: str) -> None:
        self._name, self._next = name, 0.0

    def __call__(self, state: SweepProgress) -> None:
        """Print what is done."""
        if state.done >= self._next * state.total or state.done == state.total:
            self._next = np.floor(10.0 * state.done / state.total + 1.0) / 10.0
            print(f"{self._name}: {state.done} of {state.total}", flush=True)


def plans_of(study: Study, sizes: Sizes) -> dict[str, dict[str, Plan]]:
    """Return all sweeps by folder."""
    return {
        "train": training_plans(study, sizes.training),
        "test": training_plans(study, sizes.test, seed=TEST_SEED),
        "cases": case_plans(study),
    }


def throw_all(
    plans: Mapping[str, Mapping[str, Plan]], folder: Path, *, workers: int = 1
) -> dict[str, dict[str, xr.Dataset]]:
    """Throw what is missing, and open all."""
    return {
        name: throw_plans(own, folder / name, workers=workers, report=show)
        for name, own in plans.items()
    }
