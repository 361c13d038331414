"""Throws that a detector is judged on beside the reference case: what else happens to switches.

A year of seasons, a growing ridge of ice, soft objects, and switches of another kind: of other
sections and meshes than any it was trained on, thrown in mode waveform and recorded at 100 Hz.
"""

from dataclasses import replace

import numpy as np

from turnout.core.scheme import Scheme
from turnout.detection.detector.training_plan import (
    LARGEST,
    OBJECT_AT,
    OBJECT_SIZE,
    OTHER_RAIL,
    Plan,
    Population,
    Row,
    chair_factor,
    defect,
    over_travel,
    with_object,
)
from turnout.detection.reference import FRICTION, TEMPERATURE
from turnout.detection.throws import places_of
from turnout.panel.load import load_panel
from turnout.study.read_study import scheme_for
from turnout.study.scenario import Output
from turnout.study.study import Study

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
SOFT_KINDS = ("spring", "stone", "ice", "snow", "wood", "metal")
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
