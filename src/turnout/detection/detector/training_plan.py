"""Which throws a detector learns from and is judged on: sound, with objects, with other causes.

Every throw is a row of values, so that a throw with an object or a defect can be paired with the
sound throw of the same state: what the two differ by is the signature of the cause alone. Each
chair is a chair a rail, since chairs run dry under one rail too.
"""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.detection.drive_quantities import stored_channels
from turnout.detection.reference import FRICTION, PER_THROW, SLIP_LEVEL, TEMPERATURE
from turnout.panel.load import LoadedPanel, panel_from_document
from turnout.study.defects import (
    DEFECT_FIELDS,
    OTHER_RAIL,
    Rng,
    Row,
    chair_factor,
    defect,
    over_travel,
    supply_voltage,
)
from turnout.study.random_inputs import TemperatureLaw
from turnout.study.sampling import FIELDS
from turnout.study.scenario import Value
from turnout.study.seeds import generators
from turnout.study.study import Study
from turnout.study.throw_table import compile_throws

OBJECT_AT, OBJECT_SIZE, OBJECT_KIND = "object.x", "object.size", "object.kind"
SMALLEST, LIKELIEST, LARGEST = 1e-3, 6e-3, 31e-3
"""Sizes of objects to learn from, a triangular distribution [m]."""
CHANNELS = ("drive_force", "sensor_gap")
SOUND, OBJECT, HISTORY = "sound", "object", "history"

SLOW, BLOCK = ("section_scale", "lateral_inertia_scale", "rod_slope"), 100
"""Inputs that need a new rail, which takes five times as long as a throw, and how many states in
a row share one draw of them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """Throws of one sweep.

    Attributes
    ----------
    name : str
        Of its folder.
    study : Study
        One scenario a row.
    partner : ndarray of int, shape (n,)
        The scenario of the sound sweep in the same state; -1 without one.
    switch : ndarray of int, shape (n,)
        Number of the switch, the same in all throws of it.
    inputs : ndarray, shape (n, n_inputs)
        What is fixed for the switch, in SI.
    level : ndarray, shape (n,)
        Mean friction coefficient of the chairs [-].
    start : ndarray, shape (n,)
        When the last movement begins [s].
    """

    name: str
    study: Study
    partner: NDArray[np.intp]
    switch: NDArray[np.intp]
    inputs: NDArray[np.float64]
    level: NDArray[np.float64]
    start: NDArray[np.float64]


def chairs_by_rail(panel: LoadedPanel) -> LoadedPanel:
    """Return the same panel with a chair of its own under each of two rails.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("uic60-760-1-15")
    >>> len(panel.chair), len(chairs_by_rail(panel).chair)
    (25, 50)
    """
    other = [name for name in panel.rail if name != panel.instrumented_rail]
    tree = deepcopy(panel.document.tree)
    chairs = tree["chair"]
    for name, chair in panel.chair.items():
        if chair.rails is None and len(other) == 1:
            chairs[name + OTHER_RAIL] = {**chairs[name], "rails": other}
            chairs[name] = {**chairs[name], "rails": [panel.instrumented_rail]}
    return panel_from_document(
        replace(panel.document, tree=tree),
        source=panel.source,
        folder=panel.folder,
        overrides=panel.overrides,
    )


class Population:
    """Draws rows of a population of switches; the same for the same numbers.

    Parameters
    ----------
    study : Study
        With drawn variables and at most one field, over the friction of the chairs.
    seed : int
        Added to that of the study.
    """

    def __init__(self, study: Study, *, seed: int = 0) -> None:
        shifted = study.seed + seed
        design = replace(study.design, seed=shifted, draws=10_000_000)
        self._drawn = replace(study, seed=shifted, design=design)
        self.study = replace(study, panel=chairs_by_rail(study.panel))
        self.per_throw = tuple(name for name in study.variables if name in PER_THROW)
        self.of_switch = tuple(name for name in study.variables if name not in PER_THROW)
        self.chairs = tuple(self.study.panel.chair)
        self._factors = frozenset(map(chair_factor, self.chairs))
        self._defects = {
            defect(drive, field): _defect_key(self.study.panel, drive, field)
            for drive in self.study.panel.drive
            for field in DEFECT_FIELDS
        }

    def row(self, state: int, *, switch: int | None = None) -> Row:
        """Return the row of `rows` of one state."""
        return self.rows([state], switches=None if switch is None else [switch])[0]

    def rows(self, states: Sequence[int], *, switches: Sequence[int] | None = None) -> list[Row]:
        """Return sound throws: what changes from throw to throw of one state, the rest of another.

        Parameters
        ----------
        states : sequence of int
            From 0.
        switches : sequence of int, optional
            For each the state that gives what is fixed; default the same one.
        """
        slow = [name for name in self.of_switch if name.endswith(SLOW)]
        fixed, names = list(switches or states), list(self.of_switch)
        if slow and switches is None:
            fixed, names = [state // BLOCK * BLOCK for state in states], slow
        needed = list(dict.fromkeys([*states, *fixed]))
        drawn = dict(zip(needed, self._drawn.scenarios_of(needed), strict=True))
        fields = [
            item.drawn(generators([self._drawn.seed, FIELDS, number], states)).tolist()
            for number, item in enumerate(self._drawn.fields)
        ]
        found = []
        for place, (state, switch) in enumerate(zip(states, fixed, strict=True)):
            inputs = {name: drawn[state].inputs[name] for name in self._drawn.variables}
            inputs |= {name: drawn[switch].inputs[name] for name in names}
            field = {
                chair: value
                for item, values in zip(self._drawn.fields, fields, strict=True)
                for chair, value in zip(item.members, values[place], strict=True)
            }
            found.append(self._row(inputs, field))
        return found

    def _row(self, inputs: Row, field: Mapping[str, float]) -> Row:
        """Return a row with chairs, drives and motors as they are, and no object."""
        row = dict(inputs)
        for chair in self.chairs:
            row[chair_factor(chair)] = field.get(chair.removesuffix(OTHER_RAIL), 1.0)
        for drive, record in self.study.panel.drive.items():
            row.setdefault(over_travel(drive), float(record.over_travel_closed))
            row |= {defect(drive, field): 1.0 for field in DEFECT_FIELDS}
            if record.machine is not None:
                motor = self.study.panel.machine[record.machine].motor
                row.setdefault(supply_voltage(record.machine), float(motor.voltage))
        return row | {OBJECT_AT: 0.0, OBJECT_SIZE: 0.0}

    def level(self, row: Mapping[str, Value]) -> float:
        """Return the mean friction coefficient of a row [-]."""
        return self.friction(row) * float(np.mean([row[chair_factor(c)] for c in self.chairs]))

    def friction(self, row: Mapping[str, Value]) -> float:
        """Return the friction coefficient that factors of chairs multiply [-]."""
        law = self.study.law or TemperatureLaw()
        warmth = law.factor(float(row[TEMPERATURE])) if TEMPERATURE in row else 1.0
        own = np.mean([item.friction_coefficient for item in self.study.panel.chair.values()])
        return float(row.get(FRICTION, own)) * warmth

    def plan(
        self,
        name: str,
        rows: Sequence[Row],
        *,
        partner: Sequence[int] | None = None,
        switch: Sequence[int] | None = None,
        sound: Sequence[Row] | None = None,
    ) -> Plan:
        """Return rows as a study whose scenarios they are.

        Parameters
        ----------
        name : str
            Of the sweep.
        rows : sequence of dict
            All with the same keys.
        partner, switch : sequence of int, optional
            Of `Plan`; default none and each row a switch.
        sound : sequence of dict, optional
            Sound rows that friction levels are taken from; default the rows.
        """
        names = tuple(rows[0])
        panel = self.study.panel
        known = {item.name: item for item in self.study.variables.values()}
        keys = {n: known[n].key if n in known else self._defects.get(n, n) for n in names}
        factors = [n for n in names if n not in known and (n != keys[n] or n in self._factors)]
        made = compile_throws(
            panel,
            keys,
            factors=[*factors, *(item.name for item in known.values() if item.factor)],
            channels=tuple(dict.fromkeys((*CHANNELS, *stored_channels(panel)))),
            rate=self.study.output.rate,
        ).study([[row[n] for n in names] for row in rows])
        study = replace(
            self.study,
            name=f"{self.study.name}, {name}",
            design=made.design,
            variables=made.variables,
            fields=(),
            output=made.output,
        )
        count = len(rows)
        start = max(panel.movement, key=lambda key: float(panel.movement[key].start))
        key = f"movement.{start}.start"
        nominal = float(panel.movement[start].start)
        return Plan(
            name=name,
            study=study,
            partner=np.array(partner if partner is not None else [-1] * count, dtype=np.intp),
            switch=np.array(switch if switch is not None else range(count), dtype=np.intp),
            inputs=np.array([[float(row[n]) for n in self.of_switch] for row in rows]),
            level=np.array([self.level(row) for row in (sound or rows)]),
            start=np.array([float(row.get(key, nominal)) for row in rows]),
        )


def _defect_key(panel: LoadedPanel, drive: str, field: str) -> str:
    """Return what a defect multiplies; the slip level of a machine is that of its clutch."""
    machine = panel.drive[drive].machine
    if machine is not None and field == SLIP_LEVEL:
        return f"machine.{machine}.clutch.torque"
    return f"drive.{drive}.{field}"


def with_object(row: Row, rng: Rng, *, x: float, largest: float = LARGEST) -> Row:
    """Trap an object of a random size."""
    likeliest = min(LIKELIEST, 0.5 * (SMALLEST + largest))
    return {
        **row,
        OBJECT_AT: x,
        OBJECT_SIZE: float(rng.triangular(SMALLEST, likeliest, largest)),
    }
