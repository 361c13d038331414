"""The throws behind the figures of the detector: for training, for judging, and further cases."""

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr

from turnout.calibration.load_study import load_study
from turnout.core.files import write_atomic
from turnout.core.progress import Pace, Progress
from turnout.core.scheme import Scheme
from turnout.core.sources import THROWS, digest_of_sources
from turnout.detection.detector.throw_layout import Layout
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.training import read_set
from turnout.detection.detector.training_plan import (
    HISTORY,
    LARGEST,
    OBJECT,
    OBJECT_AT,
    OBJECT_SIZE,
    Plan,
    Population,
    with_object,
)
from turnout.detection.detector.training_sets import (
    Counts,
    after_history,
    throw_plans,
    training_plans,
)
from turnout.detection.reference import FRICTION, TEMPERATURE
from turnout.detection.throws import places_of
from turnout.law.object_kind import OBJECT_KINDS
from turnout.panel.load import load_panel
from turnout.study.defects import OTHER_RAIL, Row, chair_factor, defect, over_travel
from turnout.study.read_study import scheme_for
from turnout.study.scenario import Output
from turnout.study.study import Study
from turnout.study.sweep.read import open_batches

KIND = "object.kind"
SEED = 700_000
KNOWN = 20
"""Sound throws that each switch begins with."""
YEAR_SWITCHES, A_MONTH = 100, 3
WARMTH = (-9.0, -8.0, -3.0, 3.0, 10.0, 15.0, 18.0, 17.0, 11.0, 5.0, -1.0, -6.0)
"""Mean temperature of each month, inland northern Europe; assumed [degC]."""
ICE_STEP, ICE_THROWS = 0.2e-3, 90
ICE_PLACES = ("drive 1", "sleeper 3", "sleeper 6", "sleeper 9", "drive 2")
SOFT_STATES = 60
SOFT_KINDS = tuple(OBJECT_KINDS)
OTHER_SWITCHES, OTHER_SOUND, OTHER_OBJECTS = 20, 12, 12
MESHES = ("0.1 m", "0.2 m")


def year_plan(study: Study) -> Plan:
    """Return a year of some switches: 20 throws in January, then 3 a month.

    Friction between two greasings, which last six weeks, rises and scatters; clutches lose 8 % and
    over-travels 0.2 mm until December. The number of the switch is 12 times its own plus the month;
    that of the throws known is less than 0.
    """
    population = Population(study, seed=SEED)
    rng = np.random.default_rng([study.seed, SEED, 1])
    rows, switch = [], []
    each = KNOWN + 12 * A_MONTH
    for number in range(YEAR_SWITCHES):
        greased = rng.uniform(0.0, 1.5)
        for repeat in range(each):
            month = max(0, repeat - KNOWN) // A_MONTH
            time = month + rng.random()
            row = population.row(number * each + repeat, switch=number * each)
            age = (time + greased) % 1.5 / 1.5
            row[FRICTION] = float(
                np.clip(0.14 + 0.22 * age + 0.05 * rng.standard_normal(), 0.1, 0.5)
            )
            row[TEMPERATURE] = 273.15 + float(WARMTH[month] + 5.0 * rng.standard_normal())
            for drive in study.panel.drive:
                row[defect(drive, "saturation_force")] = 1.0 - 0.08 * time / 12.0
                row[over_travel(drive)] -= 0.2e-3 * time / 12.0
            rows.append(row)
            switch.append(12 * number + month if repeat >= KNOWN else -1 - number)
    return population.plan("year", rows, switch=switch)


def ice_plan(study: Study, *, switches: int = len(ICE_PLACES), seed: int = SEED) -> Plan:
    """Return switches with ice at five places in turn: 20 sound throws, then 0.2 mm more each."""
    population = Population(study, seed=seed + 50_000)
    rows, switch = [], []
    each = KNOWN + ICE_THROWS
    places = places_of(study.panel)
    for number in range(switches):
        x = places[ICE_PLACES[number % len(ICE_PLACES)]]
        for repeat in range(each):
            row = population.row(number * each + repeat, switch=number * each)
            row |= {OBJECT_AT: x, OBJECT_SIZE: max(0, repeat - KNOWN + 1) * ICE_STEP, KIND: "ice"}
            rows.append(row)
            switch.append(number)
    return population.plan("ice", rows, switch=switch)


def soft_plan(study: Study) -> Plan:
    """Return objects of every kind in the same states, of the same sizes at the same places."""
    population = Population(study, seed=SEED + 100_000)
    rng = np.random.default_rng([study.seed, SEED, 2])
    sound = [population.row(state) for state in range(SOFT_STATES)]
    rows: list[Row] = []
    partner = []
    places = [x for name, x in places_of(study.panel).items() if name in SOFT_PLACES]
    held = [
        with_object(row, rng, x=places[i % len(places)], largest=0.8 * LARGEST)
        for i, row in enumerate(sound)
    ]
    for kind in SOFT_KINDS:
        rows += [{**row, KIND: kind} for row in held]
        partner += list(range(SOFT_STATES))
    return population.plan(
        "soft", rows, partner=partner, switch=partner, sound=[sound[i] for i in partner]
    )


SOFT_PLACES = ("sleeper 2", "sleeper 6", "sleeper 9")


def other_plans(study: Study) -> list[Plan]:
    """Return throws of switches unlike those of the population, one plan a mesh.

    Sections and lateral inertia +-15 %, each chair's friction alone, other meshes, mode
    waveform, 100 Hz. Of each switch 20 sound throws, then 12 sound ones and 12 with objects; every
    other switch has one to three chairs at 0.6 to 0.8 under one rail in the last 12 sound throws
    and with the objects.
    """
    found = []
    for number, mesh in enumerate(MESHES):
        panel = load_panel(study.panel.source, overrides={"discretisation.element_length": mesh})
        output = Output(rate=100.0)
        other = replace(
            study, panel=panel, output=output, scheme=scheme_for(Scheme.of("waveform"), output)
        )
        seed = SEED + 200_000 + 1000 * number
        population = Population(other, seed=seed)
        rng = np.random.default_rng([study.seed, seed])
        rows: list[Row] = []
        switch: list[int] = []
        for own in range(OTHER_SWITCHES // len(MESHES)):
            rows += _of_other_switch(population, rng, own)
            switch += [own] * (KNOWN + OTHER_SOUND + OTHER_OBJECTS)
        found.append(population.plan(f"other {mesh}", rows, switch=switch))
    return found


def _of_other_switch(population: Population, rng: np.random.Generator, number: int) -> list[Row]:
    each = KNOWN + OTHER_SOUND + OTHER_OBJECTS
    places = list(places_of(population.study.panel).values())
    fixed = {
        "rail.section_scale": float(rng.uniform(0.85, 1.15)),
        "rail.lateral_inertia_scale": float(rng.uniform(0.85, 1.15)),
    }
    chairs = [name for name in population.chairs if not name.endswith(OTHER_RAIL)]
    count = int(rng.integers(1, 4))
    first = int(rng.integers(0, len(chairs) - count + 1))
    rail = str(rng.choice(["", OTHER_RAIL]))
    rows = []
    for repeat in range(each):
        row = population.row(number * each + repeat, switch=number * each) | fixed
        for name in chairs:
            factor = float(np.exp(0.15 * rng.standard_normal()))
            row |= {chair_factor(name): factor, chair_factor(name + OTHER_RAIL): factor}
        if number % 2 and repeat >= KNOWN:
            for name in chairs[first : first + count]:
                wanted = float(rng.uniform(0.6, 0.8)) / population.friction(row)
                row[chair_factor(name + rail)] = max(wanted, float(row[chair_factor(name)]))
        if repeat >= KNOWN + OTHER_SOUND:
            row = with_object(row, rng, x=places[int(rng.integers(len(places)))])
        rows.append(row)
    return rows


def case_plans(study: Study) -> dict[str, Plan]:
    """Return all of these plans by name."""
    plans = [year_plan(study), ice_plan(study), soft_plan(study), *other_plans(study)]
    return {plan.name: plan for plan in plans}


Arrays = dict[str, np.ndarray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """How many throws the figures rest on; by default as on docs/evidence/detection-results.md."""

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
            switches=max(10, self.sound // 50),
        )

    @property
    def test(self) -> Counts:
        """Counts for judging: other switches, each thrown 20 times before the judged throws."""
        return Counts(
            sound=0, objects=0, defects=0, switches=self.switches, repeats=23, judged=3,
            objects_each=9,
        )  # fmt: skip


class Throws:
    """The throws of all plans, made when they are first needed and kept as arrays.

    Beside each sweep lies `NAME.npz` with its features and labels, or `NAME forces.npz`. It is read
    where it is of the same plan and of the same sources; where it comes from other sources, some of
    its throws are thrown again, and it counts as it is only if these are the same.

    Parameters
    ----------
    plans : mapping of str to mapping of str to Plan
        By folder and name.
    folder : Path
        That holds these folders.
    layout : Layout
        Of the features.
    workers : int
        Processes.
    """

    def __init__(
        self,
        plans: Mapping[str, Mapping[str, Plan]],
        folder: Path,
        layout: Layout,
        *,
        workers: int = 1,
    ) -> None:
        self.plans, self._folder = plans, folder
        self._layout, self._workers = layout, workers
        self._read: dict[tuple[str, str], ThrowSet] = {}

    def sets(self, folder: str, *names: str) -> dict[str, ThrowSet]:
        """Return features and labels of some plans of a folder, or of all of them."""
        found = {}
        for name in names or self.plans[folder]:
            if (folder, name) not in self._read:
                arrays = self._arrays(folder, name, _stem(name), self._features)
                own = ThrowSet(**{field: arrays[field] for field in ThrowSet.__slots__})
                self._read[folder, name] = own
            found[name] = self._read[folder, name]
        return found

    def forces(self, folder: str, name: str) -> Arrays:
        """Return the drive forces of a plan as they are sampled, and labels."""
        return self._arrays(folder, name, f"{_stem(name)} forces", _forces)

    def _features(self, plan: Plan, dataset: xr.Dataset) -> Arrays:
        found = read_set(plan, dataset, self._layout)
        return {field: getattr(found, field) for field in ThrowSet.__slots__}

    def _arrays(
        self, folder: str, name: str, stem: str, read: Callable[[Plan, xr.Dataset], Arrays]
    ) -> Arrays:
        plan, place = self.plans[folder][name], self._folder / folder
        path = place / f"{stem}.npz"
        sources = digest_of_sources(THROWS)
        arrays = _kept(path, plan)
        if arrays is not None and str(arrays.pop("sources", "")) != sources:
            if not self._same(plan, arrays, place / "again" / stem, read):
                print(f"{path}: other sources gave other throws; they are thrown again", flush=True)
                arrays = None
            else:
                print(f"{path}: {SAMPLE} of its throws thrown again are the same", flush=True)
                _keep(path, plan, sources, arrays)
        if arrays is None:
            run = {"workers": self._workers, "pace": Pace(show(name))}
            arrays = read(plan, open_batches(throw_plans({name: plan}, place, **run)[name]))
            _keep(path, plan, sources, arrays)
        return arrays

    def _same(
        self,
        plan: Plan,
        arrays: Arrays,
        place: Path,
        read: Callable[[Plan, xr.Dataset], Arrays],
    ) -> bool:
        """Whether some throws come out as they are kept, thrown again in a folder of its own."""
        every = np.linspace(0, len(arrays["row"]) - 1, SAMPLE).astype(np.intp)
        made = read(*_thrown_again(plan, arrays["row"][every], place / digest_of_sources(THROWS)))
        return all(
            np.allclose(made[name], arrays[name][every], rtol=0.0, atol=same, equal_nan=True)
            for name, same in SAME.items()
            if name in made
        )


SAMPLE = 6
"""Throws of a kept sweep that are thrown again where the sources changed."""
SAME = {"features": 1e-3, "force": 1e-3, "gaps": 1e-9}
"""Difference that counts as rounding [N], [N], [m]: sweeps keep forces in single precision, so that
5 kN move by 5e-4 N where a solver rounds otherwise."""


def _thrown_again(plan: Plan, rows: np.ndarray, place: Path) -> tuple[Plan, xr.Dataset]:
    """Throw some rows of a plan, and return them as a plan of their own."""
    (axis,) = plan.study.design.axes
    chosen = replace(axis, rows=tuple(axis.rows[row] for row in rows))
    design = replace(plan.study.design, axes=(chosen,))
    labels = {
        name: getattr(plan, name)[rows]
        for name in ("partner", "switch", "inputs", "level", "start")
    }
    own = replace(plan, study=replace(plan.study, design=design), **labels)
    return own, open_batches(throw_plans({"again": own}, place)["again"])


def _forces(plan: Plan, dataset: xr.Dataset) -> Arrays:
    complete = (dataset["outcome"].astype(str) == "complete").to_numpy()
    row = dataset["scenario"].to_numpy()[complete]
    return {
        "time": dataset["time"].to_numpy(),
        "force": dataset["drive_force"].to_numpy()[complete],
        "switch": plan.switch[row],
        "row": row,
        "size": dataset[OBJECT_SIZE].to_numpy()[complete],
        "x": dataset[OBJECT_AT].to_numpy()[complete],
        "touch": dataset["object_force_peak"].to_numpy()[complete],
    }


def _stem(name: str) -> str:
    return name.replace(", ", "-").replace(" ", "-")


def _keep(path: Path, plan: Plan, sources: str, arrays: Arrays) -> None:
    content = io.BytesIO()
    of = {"study": np.array(plan.study.digest), "sources": np.array(sources)}
    np.savez(content, allow_pickle=False, **of, **arrays)
    write_atomic(path, content.getvalue())


def _kept(path: Path, plan: Plan) -> Arrays | None:
    if not path.exists():
        return None
    with np.load(path, allow_pickle=False) as content:
        if str(content["study"]) != plan.study.digest:
            return None
        return {name: content[name] for name in content.files if name != "study"}


def show(name: str) -> "Watch":
    """Return a report that prints the progress of a sweep."""
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

    def __call__(self, state: Progress) -> None:
        """Print the progress at each tenth."""
        if state.done >= self._next * state.total or state.done == state.total:
            self._next = np.floor(10.0 * state.done / state.total + 1.0) / 10.0
            print(f"{self._name}: {state.done} of {state.total}", flush=True)


JUDGED_SEED = 540_000
"""Of switches that no choice in the detector was made on [-]."""


def plans_of(study: Study, sizes: Sizes, *, seed: int = JUDGED_SEED) -> dict[str, dict[str, Plan]]:
    """Return all sweeps by folder; another seed judges other switches."""
    return {
        "train": training_plans(study, sizes.training),
        "test": judged_plans(study, sizes.test, seed=seed),
        "narrow": narrow_plans(sizes, seed=seed + 1),
        "cases": case_plans(study),
    }


def judged_plans(study: Study, counts: Counts, *, seed: int) -> dict[str, Plan]:
    """Return throws of switches with a history: judged after it, and as if there were none."""
    found = training_plans(study, counts, seed=seed)
    return {name: plan for name, plan in found.items() if name.startswith(HISTORY)}


def narrow_plans(sizes: Sizes, *, seed: int) -> dict[str, Plan]:
    """Return switches of the narrow population: no variation of sections, fit or stress-free state.

    Their numbers compare with the study that the goals of the detector come from. Every judged
    throw comes with an object at each place, so that a90/95 rests on some 300 objects a place.
    """
    study = load_study(NARROW)
    each = len(places_of(study.panel))
    switches = min(NARROW_SWITCHES, sizes.switches)
    counts = replace(sizes.test, switches=switches, objects_each=each)
    plans = judged_plans(study, counts, seed=seed)
    return {name: plans[name] for name in (HISTORY, after_history(OBJECT))}


NARROW = Path(__file__).with_name("detector_narrow.toml")
NARROW_SWITCHES = 300
