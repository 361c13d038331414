"""The sweeps behind a detector: how many throws of what, and where each is kept."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from turnout.core.progress import Pace
from turnout.core.workers import Workers
from turnout.detection.detector.training_plan import (
    HISTORY,
    OBJECT,
    OBJECT_KIND,
    SOUND,
    Plan,
    Population,
    with_object,
)
from turnout.detection.throws import of_kind, places_of
from turnout.law.object_kind import OBJECT_KINDS
from turnout.study.defects import DEFECTS, Change, Row, later_changes, trained_changes
from turnout.study.study import Study
from turnout.study.sweep.run import throw_studies

TEST_SEED = 500_000
"""Added to the seed of a study for switches that a detector is judged on [-]."""
HISTORY_SEED = 1_000_000
MARGIN = 0.3
"""Objects to learn from lie up to so far beyond the outermost places [m]."""
GRID = 0.3
"""Between the places of objects to learn from; any place would double the time of a throw [m]."""


def learned_kinds() -> tuple[str, ...]:
    """Return the kinds of objects beside those that stay as they are, of all "object" throws.

    Steel does not yield to what a drive can press with, and is one of the latter.
    """
    return tuple(name for name, kind in OBJECT_KINDS.items() if kind.learned)


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """Number of throws of a set.

    Attributes
    ----------
    sound, objects : int
        Sound throws, each of another switch; objects in the first of these states.
    kinds : int
        The first of the throws with objects that are also thrown with one of each learned kind.
    defects : int
        Throws of each other cause, paired as objects are, as often as `DEFECTS` says.
    switches, repeats : int
        Switches with a history, and sound throws of each.
    judged : int
        The last of these that are also thrown with objects, and for judging with causes.
    objects_each : int
        Objects in each of them.
    """

    sound: int = 4000
    objects: int = 3000
    kinds: int = 800
    defects: int = 400
    switches: int = 80
    repeats: int = 26
    judged: int = 4
    objects_each: int = 4

    def of_cause(self, name: str) -> int:
        """Return how many throws another cause gets."""
        return self.defects * (DEFECTS[name].times if name in DEFECTS else 1)


def training_plans(study: Study, counts: Counts, *, seed: int = 0) -> dict[str, Plan]:
    """Return the sweeps that a detector is trained on, or judged on with another seed.

    Parameters
    ----------
    study : Study
        Population of sound switches.
    counts : Counts
        Throws of each kind.
    seed : int
        0 for training, `TEST_SEED` for other switches.
    """
    population = Population(study, seed=seed)
    places = np.array(list(places_of(study.panel).values()))
    sound = population.rows(range(counts.sound))
    plans = {SOUND: population.plan(SOUND, sound)} if sound else {}
    test = seed != 0
    if counts.objects:
        rng = np.random.default_rng([study.seed, seed, 7])
        rows = [
            object_at(sound[i % counts.sound], rng, places, number=i, exact=test)
            for i in range(counts.objects)
        ]
        plans[OBJECT] = _paired(population, OBJECT, rows, sound)
        for kind in learned_kinds() if counts.kinds and not test else ():
            own = [{**row, OBJECT_KIND: kind} for row in rows[: counts.kinds]]
            name = of_kind(OBJECT, kind)
            plans[name] = _paired(population, name, own, sound)
    for number, (name, change) in enumerate(trained_changes().items()):
        if counts.defects:
            rng = np.random.default_rng([study.seed, seed, 9, number])
            count = counts.of_cause(name)
            rows = [change(sound[i % counts.sound], rng, population) for i in range(count)]
            plans[name] = _paired(population, name, rows, sound)
    if counts.switches:
        plans |= _history_plans(study, counts, seed=seed, places=places)
    return plans


def object_at(
    row: Row, rng: np.random.Generator, places: np.ndarray, *, number: int, exact: bool
) -> Row:
    """Trap an object anywhere, or at each place in turn and then in a size near what is seen."""
    if not exact:
        first, last = max(0.0, places[0] - MARGIN), places[-1] + MARGIN
        x = GRID * round(float(rng.uniform(first - 0.5 * GRID, last + 0.5 * GRID)) / GRID)
        return with_object(row, rng, x=max(0.0, x))
    x = float(places[number % places.size])
    middle = np.sin(np.pi * (x - places[0]) / (places[-1] - places[0]))
    return with_object(row, rng, x=x, largest=float(8e-3 + 14e-3 * middle))


def _paired(population: Population, name: str, rows: list[Row], sound: list[Row]) -> Plan:
    partner = [number % len(sound) for number in range(len(rows))]
    return population.plan(
        name, rows, partner=partner, switch=partner, sound=[sound[i] for i in partner]
    )


def _history_plans(
    study: Study, counts: Counts, *, seed: int, places: np.ndarray
) -> dict[str, Plan]:
    """Return repeated throws of some switches, and the last of them with objects.

    For judging, defects that differ after a history follow in the same throws, and every other one
    in the last throw of each switch.
    """
    population = Population(study, seed=seed + HISTORY_SEED)
    rng = np.random.default_rng([study.seed, seed, 8])
    states = range(counts.switches * counts.repeats)
    switch = [state // counts.repeats for state in states]
    rows = population.rows(states, switches=[number * counts.repeats for number in switch])
    plans = {HISTORY: population.plan(HISTORY, rows, switch=switch)}
    if not counts.objects_each:
        return plans
    first = counts.repeats - counts.judged
    judged = [i for i in range(len(rows)) if i % counts.repeats >= first]
    kinds: Mapping[str, Callable[[Row, int], Row]] = {
        OBJECT: lambda row, i: object_at(row, rng, places, number=i, exact=True),
        **{name: _numbered(change, rng, population) for name, change in later_changes().items()},
    }
    for kind, change in kinds.items():
        if not (seed or kind == OBJECT):
            continue
        each = counts.objects_each if kind == OBJECT else 1
        partner = [i for i in judged for _ in range(each)]
        made = [change(rows[i], number) for number, i in enumerate(partner)]
        plans[after_history(kind)] = _later(population, kind, made, rows, partner, switch)
    if seed:
        last = [i for i in judged if i % counts.repeats == counts.repeats - 1]
        for kind, cause in trained_changes().items():
            if kind not in kinds:
                made = [cause(rows[i], rng, population) for i in last]
                plans[after_history(kind)] = _later(population, kind, made, rows, last, switch)
    return plans


def _numbered(
    change: Change, rng: np.random.Generator, population: Population
) -> Callable[[Row, int], Row]:
    """Return a change of a defect that is called with the number of a throw."""
    return lambda row, number: change(row, rng, population)


def _later(
    population: Population,
    kind: str,
    made: list[Row],
    rows: list[Row],
    partner: list[int],
    switch: list[int],
) -> Plan:
    """Return what a cause made of throws of switches with a history."""
    return population.plan(
        after_history(kind),
        made,
        partner=partner,
        switch=[switch[i] for i in partner],
        sound=[rows[i] for i in partner],
    )


def after_history(kind: str) -> str:
    """Return the name of the plan of what happens to switches with a history.

    Examples
    --------
    >>> after_history("object")
    'history, object'
    """
    return f"{HISTORY}, {kind}"


def throw_plans(
    plans: Mapping[str, Plan],
    folder: Path,
    *,
    workers: int | Workers = 1,
    pace: Pace | None = None,
) -> dict[str, Path]:
    """Throw the missing scenarios of some sweeps in the same processes; return their folders."""
    paths = {name: folder / name.replace(", ", "-").replace(" ", "-") for name in plans}
    studies = {paths[name]: plan.study for name, plan in plans.items()}
    throw_studies(studies, workers=workers, pace=pace)
    return paths
