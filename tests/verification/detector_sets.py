"""The throws behind the figures of the detector: for training, for judging, and further cases."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tests.verification.detector_cases import case_plans

from turnout.detection.detector.throw_layout import Layout
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.training import read_set
from turnout.detection.detector.training_plan import HISTORY, OBJECT_AT, OBJECT_SIZE, Plan
from turnout.detection.detector.training_sets import Counts, throw_plans, training_plans
from turnout.study.load_study import load_study
from turnout.study.study import Study
from turnout.sweep.run import SweepProgress


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """How many throws the figures rest on; by default as on docs/detection.md."""

    sound: int = 4000
    objects: int = 3000
    switches: int = 200

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
        """For judging: other switches, each thrown 20 times before what is judged."""
        return Counts(
            sound=0, objects=0, defects=0, switches=self.switches, repeats=23, judged=3,
            objects_each=3,
        )  # fmt: skip


def sets_of(
    plans: Mapping[str, Plan], folder: Path, layout: Layout, *, workers: int = 1
) -> dict[str, ThrowSet]:
    """Throw what is missing, and return features and labels, kept beside the sweeps as arrays.

    Parameters
    ----------
    plans : mapping of str to Plan
        By name.
    folder : Path
        Keeps the sweeps, and `NAME.npz` of each, which is read where it is of the same plan.
    layout : Layout
        Of the features.
    workers : int
        Processes.
    """
    found = {}
    for name, plan in plans.items():
        path = folder / f"{_stem(name)}.npz"
        kept = _kept(path, plan)
        if kept is None:
            dataset = throw_plans({name: plan}, folder, workers=workers, report=show)[name]
            kept = read_set(plan, dataset, layout)
            np.savez(
                path,
                allow_pickle=False,
                study=np.array(plan.study.digest),
                **{field: getattr(kept, field) for field in ThrowSet.__slots__},
            )
        found[name] = kept
    return found


def forces_of(plan: Plan, folder: Path) -> dict[str, np.ndarray]:
    """Return the drive forces of a plan as they are sampled, and labels, kept as arrays."""
    path = folder / f"{_stem(plan.name)} forces.npz"
    if path.exists():
        with np.load(path, allow_pickle=False) as content:
            if str(content["study"]) == plan.study.digest:
                return {name: content[name] for name in content.files}
    dataset = throw_plans({plan.name: plan}, folder, report=show)[plan.name]
    complete = (dataset["outcome"].astype(str) == "complete").to_numpy()
    row = dataset["scenario"].to_numpy()[complete]
    arrays = {
        "time": dataset["time"].to_numpy(),
        "force": dataset["drive_force"].to_numpy()[complete],
        "switch": plan.switch[row],
        "row": row,
        "size": dataset[OBJECT_SIZE].to_numpy()[complete],
        "x": dataset[OBJECT_AT].to_numpy()[complete],
        "touch": dataset["object_force_peak"].to_numpy()[complete],
        "study": np.array(plan.study.digest),
    }
    np.savez(path, allow_pickle=False, **arrays)
    return arrays


def _stem(name: str) -> str:
    return name.replace(", ", "-").replace(" ", "-")


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
        "test": judged_plans(study, sizes.test, seed=JUDGED_SEED),
        "narrow": narrow_plans(sizes),
        "cases": case_plans(study),
    }


JUDGED_SEED = 530_000
"""Of switches that no choice in the detector was made on [-]."""


def judged_plans(study: Study, counts: Counts, *, seed: int) -> dict[str, Plan]:
    """Return throws of switches with a history: judged after it, and as if there were none."""
    found = training_plans(study, counts, seed=seed)
    return {name: plan for name, plan in found.items() if name.startswith(HISTORY)}


def narrow_plans(sizes: Sizes) -> dict[str, Plan]:
    """Return switches of the narrow population: no variation of sections, fit or stress-free state.

    Their numbers compare with the study that the goals of the detector come from.
    """
    counts = replace(sizes.test, switches=min(NARROW_SWITCHES, sizes.switches))
    return judged_plans(load_study(NARROW), counts, seed=JUDGED_SEED + 1)


NARROW = Path(__file__).with_name("detector_narrow.toml")
NARROW_SWITCHES = 100
