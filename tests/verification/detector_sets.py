"""The throws behind the figures of the detector: for training, for judging, and further cases."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tests.verification.detector_cases import case_plans

from turnout.detection.throw_layout import Layout
from turnout.detection.throw_set import ThrowSet
from turnout.detection.training import read_set
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


def sets_of(plans: Mapping[str, Plan], folder: Path, layout: Layout) -> dict[str, ThrowSet]:
    """Throw what is missing, and return features and labels, kept beside the sweeps as arrays.

    Parameters
    ----------
    plans : mapping of str to Plan
        By name.
    folder : Path
        Keeps the sweeps, and `NAME.npz` of each, which is read where it is of the same plan.
    layout : Layout
        Of the features.
    """
    found = {}
    for name, plan in plans.items():
        path = folder / f"{name.replace(', ', '-').replace(' ', '-')}.npz"
        kept = _kept(path, plan)
        if kept is None:
            dataset = throw_plans({name: plan}, folder, report=show)[name]
            kept = read_set(plan, dataset, layout)
            np.savez(
                path,
                allow_pickle=False,
                study=np.array(plan.study.digest),
                **{field: getattr(kept, field) for field in ThrowSet.__slots__},
            )
        found[name] = kept
    return found


def _kept(path: Path, plan: Plan) -> ThrowSet | None:
    if not path.exists():
        return None
    with np.load(path, allow_pickle=False) as content:
        if str(content["study"]) != plan.study.digest:
            return None
        return ThrowSet(**{field: content[field] for field in ThrowSet.__slots__})


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
