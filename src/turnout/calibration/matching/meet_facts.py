"""Facts of one panel: each throw is made once, costly facts only where all others hold."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.matching.facts import Facts, Sum, Term
from turnout.calibration.matching.measures import MEASURES, Thrown
from turnout.core.errors import PanelError, TurnoutError
from turnout.core.scheme import Mode
from turnout.panel.foreign_object import ForeignObject, parse_object
from turnout.panel.load import LoadedPanel, as_written
from turnout.throw.save import Save
from turnout.throw.simulate import simulate

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]

SAVE = Save(
    fields=(
        *("drive_force", "drive_displacement", "drive_gap", "end_gap", "sensor_gap"),
        *("object_force", "chair_normal_force", "force_margin", "drive_slipping"),
        *("in_control", "locked"),
        *("least_flangeway", "least_flangeway_x", "least_flangeway_rail"),
        *("least_gauge", "drive_current"),
    )
)
"""What measures need of a throw."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation:
    """What a panel does with the facts.

    Attributes
    ----------
    values : ndarray, shape (n_facts,)
        In SI; NaN where a throw failed, or a late fact was not tried.
    accepted : bool
        Whether all facts hold.
    fault : str
        Why there are no values: the panel is refused, or a throw ended early; else empty.
    throws : int
        That were made.
    """

    values: Floats
    accepted: bool
    fault: str
    throws: int


@dataclass(slots=True)
class Thrower:
    """Throws of one panel by object and changed values, each made once.

    Attributes
    ----------
    panel : LoadedPanel
        Whose throws.
    mode : str
        Level of detail of the throws.
    by_machines : LoadedPanel, optional
        The same with drives that are machines, for measures of currents.
    """

    panel: LoadedPanel
    mode: Mode = "quick"
    by_machines: LoadedPanel | None = None
    made: int = 0
    _values: dict[Term, float] = field(default_factory=dict)
    _panels: dict[object, LoadedPanel] = field(default_factory=dict)

    def sum(self, wanted: Sum, *, among: tuple[Sum, ...] = ()) -> float:
        """Return the value of a sum; throws that others of `among` need too are used for them."""
        return sum(term.factor * self._value(term, among) for term in wanted.terms)

    def _value(self, term: Term, among: tuple[Sum, ...]) -> float:
        if term not in self._values:
            panel = self._changed(term)
            dataset = self._throw(panel, parse_object(term.object) if term.object else None)
            thrown = Thrown(panel, dataset, lambda item: self._throw(panel, item))
            for other in (term, *_of_same_throw(term, among)):
                if other not in self._values:
                    measure = MEASURES[other.measure]
                    self._values[other] = measure.compute(thrown, other.of)
        return self._values[term]

    def _changed(self, term: Term) -> LoadedPanel:
        _, changes, by_machines = term.throw
        panel = (self.by_machines if by_machines else None) or self.panel
        if not changes:
            return panel
        if (changes, by_machines) not in self._panels:
            made = panel.with_overrides(dict(changes), si=False)
            self._panels[changes, by_machines] = made
        return self._panels[changes, by_machines]

    def _throw(self, panel: LoadedPanel, item: ForeignObject | None) -> "xr.Dataset":
        self.made += 1
        return simulate(panel, foreign_object=item, mode=self.mode, save=SAVE)


def _of_same_throw(term: Term, among: tuple[Sum, ...]) -> list[Term]:
    """Return the terms of some sums that the throw of a term gives as well, but costly ones."""
    return [
        other
        for item in among
        for other in item.terms
        if other.throw == term.throw and MEASURES[other.measure].cost == 1
    ]


def panel_at(facts: Facts, point: Floats) -> LoadedPanel:
    """Return the panel at a point of the unit cube.

    Its values count as those of a file, so that throws may change them as they may a file's.

    Raises
    ------
    PanelError
        When its values contradict each other.
    """
    return as_written(facts.panel.with_overrides(facts.overrides(point)))


def thrower_at(facts: Facts, point: Floats, mode: Mode = "quick") -> Thrower:
    """Return the throws of the panel at a point of the unit cube, and of its machines.

    Raises
    ------
    PanelError
        When its values contradict each other.
    """
    panel, machines = panel_at(facts, point), None
    if facts.machines:
        machines = panel.with_overrides(dict(facts.machines), si=False)
        machines = as_written(machines.with_overrides(facts.overrides(point, of_machines=True)))
    return Thrower(panel, mode, machines)


def is_valid(facts: Facts, point: Floats) -> bool:
    """Return whether the values at a point of the unit cube go together."""
    try:
        panel_at(facts, point)
    except PanelError:
        return False
    return True


def evaluate(
    facts: Facts, point: Floats, *, failures: int | None = None, mode: Mode = "quick"
) -> Evaluation:
    """Return what the panel at a point of the unit cube does with the facts.

    Facts are tried in the order of the file, those that need fewer throws first, late ones last and
    only where all others hold.

    Parameters
    ----------
    facts : Facts
        What must hold.
    point : ndarray, shape (n_parameters,)
        Shares of the ranges, 0 to 1.
    failures : int, optional
        Facts after whose failure the rest is not tried; default all that are not late are.
    mode : {"quick", "waveform"}
        Of the throws.
    """
    values = np.full(len(facts.facts), np.nan)
    try:
        thrower = thrower_at(facts, point, mode)
    except PanelError as error:
        return Evaluation(values=values, accepted=False, fault=error.problems[0], throws=0)
    fault = ""
    try:
        for late in (False, True):
            chosen = in_order(facts, late=late)
            among = tuple(facts.facts[number] for number in chosen)
            allowed = 1 if late else failures or len(chosen)
            for number in chosen:
                values[number] = thrower.sum(facts.facts[number], among=among)
                if _failed(facts, values, chosen) >= allowed:
                    break
            if _failed(facts, values, chosen):
                break
    except TurnoutError as error:
        fault = str(error).splitlines()[0]
    accepted = all(map(holds, facts.facts, values))
    return Evaluation(values=values, accepted=accepted, fault=fault, throws=thrower.made)


def in_order(facts: Facts, *, late: bool) -> list[int]:
    """Return the numbers of facts in the order in which they are tried: cheap ones first."""
    chosen = [number for number, fact in enumerate(facts.facts) if fact.late is late]
    return sorted(chosen, key=lambda number: _cost(facts.facts[number]))


def _cost(fact: Sum) -> tuple[int, bool]:
    """Return the cost of a fact in throws, and whether it takes more than the plain one."""
    throws = {term.throw for term in fact.terms}
    further = {term: MEASURES[term.measure].cost - 1 for term in fact.terms}
    return len(throws) + sum(further.values()), throws != {("", (), False)}


def _failed(facts: Facts, values: Floats, chosen: list[int]) -> int:
    """Return how many of some facts were tried and do not hold."""
    tried = [number for number in chosen if np.isfinite(values[number])]
    return sum(not holds(facts.facts[number], values[number]) for number in tried)


def holds(fact: Sum, value: float) -> bool:
    """Return whether a value is within the bounds of a fact; NaN is not."""
    return bool(fact.least <= value <= fact.most)
