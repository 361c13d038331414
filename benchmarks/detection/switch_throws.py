"""The throws of one switch: its states over a year, objects of all kinds, other causes.

The first half of its year gives sound throws, its history. In the other half it is thrown without
and with objects and with other causes, each of these in the state of a sound throw of that half.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.definition import (
    HISTORY,
    OBJECT,
    SEED,
    SOUND,
    TRAIN,
    Counts,
    Switch,
    panels_study,
    population_of,
)
from turnout.core.errors import PanelError, StudyError
from turnout.detection.detector.training_plan import (
    LARGEST,
    OBJECT_AT,
    OBJECT_SIZE,
    SMALLEST,
    Plan,
    Population,
)
from turnout.detection.reference import TEMPERATURE
from turnout.detection.throws import places_of
from turnout.panel.load import LoadedPanel
from turnout.study.defects import DEFECTS, Row
from turnout.study.scenario import Output
from turnout.study.study import Study

KIND = "object.kind"
KINDS = {"stone": 0.4, "metal": 0.2, "wood": 0.15, "ice": 0.15, "snow": 0.1}
"""Objects and their shares; assumed [-]."""
SPRING = "spring"
"""Kind that stands in the rows of throws without an object."""
WARMTH = (-9.0, -8.0, -3.0, 3.0, 10.0, 15.0, 18.0, 17.0, 11.0, 5.0, -1.0, -6.0)
"""Mean temperature of each month, inland northern Europe; assumed [degC]."""
WARMTH_SCATTER = 5.0
"""Standard deviation of the temperature of a throw about that of its month [K]."""
SIZE_POWER = 1.5
r"""Sizes are :math:`a_0 + (a_1 - a_0)\,u^{1.5}`: more small objects, which are hard to see."""
LARGEST_AT_DRIVES = 26e-3
"""Largest object at the outermost places; mid-span it is that of the training population [m]."""
ROUND = 1000
"""Numbers of states between those of the history and the judged ones."""
FORCES, MACHINE_CHANNELS = ("drive_force", "sensor_gap"), ("drive_current", "drive_power")
FIXED, MOST_DRAWN = 5 * ROUND, 100
"""First state that what is fixed for a switch may be taken from, and how many are tried."""
SHIFTED = ("over_travel_closed", "stress_free")
"""Ends of the names of values of the reference case that are moved to those of a panel."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SwitchThrows:
    """Throws of a switch and their true labels.

    Attributes
    ----------
    plan : Plan
        Its study; `partner` is the row of the sound throw in the same state, -1 of sound throws.
    inputs : tuple of str
        Names of what is fixed for a switch, the columns of `plan.inputs`.
    role : tuple of str, shape (n,)
        "history", "sound", "object", or the other cause.
    kind, place : tuple of str, shape (n,)
        Of the object; empty without one.
    size, x : ndarray, shape (n,)
        Of the object, 0 and NaN without one [m].
    moment : ndarray, shape (n,)
        In years from the first of January of the first year [-].
    """

    plan: Plan
    inputs: tuple[str, ...]
    role: tuple[str, ...]
    kind: tuple[str, ...]
    place: tuple[str, ...]
    size: NDArray[np.float64]
    x: NDArray[np.float64]
    moment: NDArray[np.float64]


def panel_of(switch: Switch) -> LoadedPanel:
    """Return the panel of a switch, with its machines."""
    study = panels_study()
    overrides: dict[str, object] = dict(study.scenario(switch.panel).overrides)
    overrides |= {
        f"drive.{name}.machine": machine
        for name, machine in zip(study.panel.drive, switch.machines, strict=False)
    }
    return study.panel.with_overrides(overrides)


def study_of(switch: Switch) -> Study:
    """Return the reference case on a switch's panel; values are drawn as for the default panel.

    `shifts_of` says by how much they move to those of the panel.
    """
    return replace(population_of(panel_of(switch)), design=population_of().design)


def throws_of_switch(switch: Switch, counts: Counts) -> SwitchThrows:
    """Return the throws of a switch.

    Parameters
    ----------
    switch : Switch
        One of the benchmark.
    counts : Counts
        Of the benchmark.
    """
    study = study_of(switch)
    population = Population(study, seed=SEED + 10 * ROUND * switch.number)
    shifts = shifts_of(study)
    fixed = fixed_state(population, shifts)
    rng = np.random.default_rng([SEED, 5, switch.number])
    known, later = np.sort(0.5 * rng.random(counts.known)), 0.5 + np.sort(0.5 * rng.random(
        counts.sound))  # fmt: skip
    moments = switch.phase + np.concatenate([known, later])
    states = [*range(counts.known), *range(ROUND, ROUND + counts.sound)]
    rows = [
        {**_about(population.row(state, switch=fixed), shifts), KIND: SPRING}
        for state in states
    ]  # fmt: skip
    for state, row, moment in zip(states, rows, moments, strict=True):
        own = np.random.default_rng([SEED, 6, switch.number, state])
        month = int(12.0 * moment) % 12
        row[TEMPERATURE] = 273.15 + WARMTH[month] + WARMTH_SCATTER * own.standard_normal()
    role = [HISTORY] * counts.known + [SOUND] * counts.sound
    partner = [-1] * len(rows)
    kind, place = [""] * len(rows), [""] * len(rows)
    sound = list(rows)
    places = places_of(study.panel)
    own = np.random.default_rng([SEED, 7, switch.number])
    for number in range(counts.objects):
        at = counts.known + number % counts.sound
        made, what, where = _with_object(sound[at], own, places, number + switch.number)
        rows.append(made)
        role.append(OBJECT)
        partner.append(at)
        kind.append(what)
        place.append(where)
    for name in causes_of(switch):
        for _ in range(counts.causes):
            at = counts.known + int(own.integers(counts.sound))
            rows.append(_with_cause(name, sound[at], own, population))
            role.append(name)
            partner.append(at)
            kind.append("")
            place.append("")
    rows = _alike(rows, population)
    before = [row if at < 0 else sound[at] for row, at in zip(rows, partner, strict=True)]
    plan = population.plan(
        f"benchmark switch {switch.number}", rows, partner=partner,
        switch=[switch.number] * len(rows), sound=before,
    )  # fmt: skip
    channels = FORCES + (MACHINE_CHANNELS if switch.machines else ())
    output = Output(rate=plan.study.output.rate, channels=channels)
    return SwitchThrows(
        plan=replace(plan, study=replace(plan.study, output=output)),
        inputs=population.of_switch,
        role=tuple(role),
        kind=tuple(kind),
        place=tuple(place),
        size=np.array([float(row[OBJECT_SIZE]) for row in rows]),
        x=np.array([float(row[OBJECT_AT]) if row[OBJECT_SIZE] else np.nan for row in rows]),
        moment=np.array([moments[i] if i < len(moments) else moments[partner[i]]
                         for i in range(len(rows))]),
    )  # fmt: skip


def fixed_state(population: Population, shifts: Mapping[str, float]) -> int:
    """Return the first state whose drives hold their rails at rest, which fixes a switch.

    Panels were chosen with their own slip levels; a lower one that is drawn for a switch may be
    below the force with which a drive holds a rail open.
    """
    for state in range(FIXED, FIXED + MOST_DRAWN):
        if holds_at_rest(population, _about(population.row(state), shifts)):
            return state
    message = (
        f"{population.study.name}: none of {MOST_DRAWN} states drawn holds the rails at rest; "
        "lower an over-travel of the panel or raise a slip level"
    )
    raise StudyError([message], source="benchmark")


def holds_at_rest(population: Population, row: Row) -> bool:
    """Return whether all drives hold their rails at rest without slip, as every throw begins."""
    study = population.plan("at rest", [row]).study
    try:
        study.panel.with_overrides(dict(study.scenario(0).overrides))
    except PanelError:
        return False
    return True


def _with_cause(name: str, row: Row, rng: np.random.Generator, population: Population) -> Row:
    """Return a row with another cause, which leaves the drives able to hold the rails."""
    cause = DEFECTS[name].change
    assert cause is not None
    made = cause(row, rng, population)
    for _ in range(MOST_DRAWN if DEFECTS[name].weakens else 0):
        if holds_at_rest(population, made):
            break
        made = cause(row, rng, population)
    return made


def shifts_of(study: Study) -> Mapping[str, float]:
    """Return by how much values of the reference case move to those of a panel, by name.

    What the reference case multiplies is about the panel's value anyway.
    """
    usual = population_of().panel
    found = {}
    for name, variable in study.variables.items():
        if not variable.factor and name.endswith(SHIFTED):
            own, reference = (
                study.panel.values_at(variable.key),
                usual.values_at(variable.key),
            )
            found[name] = float(own[variable.key]) - float(reference[variable.key])
    return found


def _about(row: Row, shifts: Mapping[str, float]) -> Row:
    return row | {name: max(0.0, float(row[name]) + shift) for name, shift in shifts.items()}


def _with_object(
    row: Row, rng: np.random.Generator, places: Mapping[str, float], number: int
) -> tuple[Row, str, str]:
    """Trap an object at each place in turn; return the row, its kind and its place."""
    where = list(places)[number % len(places)]
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    x = np.array(list(places.values()))
    middle = float(np.sin(np.pi * (places[where] - x[0]) / (x[-1] - x[0])))
    largest = LARGEST_AT_DRIVES + (LARGEST - LARGEST_AT_DRIVES) * middle
    size = SMALLEST + (largest - SMALLEST) * float(rng.random()) ** SIZE_POWER
    return {**row, OBJECT_AT: places[where], OBJECT_SIZE: size, KIND: kind}, kind, where


def causes_of(switch: Switch) -> list[str]:
    """Return the causes other than objects that a switch is thrown with.

    Those that no detector of turnout learns only switches for testing have: what a method makes of
    what it never saw.
    """
    learned = switch.split == TRAIN
    own = {name: d for name, d in DEFECTS.items() if d.benchmark and d.change is not None}
    return [name for name, d in own.items() if d.trained or not learned]


def _alike(rows: list[Row], population: Population) -> list[Row]:
    """Return rows with the same keys, those of a slow drive included."""
    usual = {
        f"movement.{name}.extra_time.{drive}": float(movement.extra_time.get(drive, 0.0))
        for name, movement in population.study.panel.movement.items()
        for drive in population.study.panel.drive
    }
    keys = dict.fromkeys(key for row in rows for key in row)
    return [{key: row[key] if key in row else usual[key] for key in keys} for row in rows]
