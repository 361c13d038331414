"""Match a panel to facts, wave by wave; every panel tried is kept in a folder and never again.

Each throw of a panel is made once, costly facts only where all others hold.
"""

import gc
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.calibration.matching.fact_emulator import (
    FEWEST,
    Emulation,
    Emulator,
    fit_emulator,
    latin_hypercube,
    plausible_points,
)
from turnout.calibration.matching.facts import Facts, Sum, Term
from turnout.calibration.matching.measures import MEASURES, Thrown
from turnout.core.errors import FileError, PanelError, StudyError, TurnoutError
from turnout.core.kept_lines import append_line, claim_for, read_lines
from turnout.core.progress import Pace, Report
from turnout.core.scheme import Mode
from turnout.core.threads import one_blas_thread
from turnout.core.workers import Workers
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
"""Outputs of a throw that measures need."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation:
    """Values of the facts for one panel.

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
    """Return the values of the facts for the panel at a point of the unit cube.

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


FIRST_WAVE, WAVE = 160, 40
"""Panels of the first wave, which cover the ranges, and of each later one."""
CUT_OFFS = (3.0, 3.0, 2.0, 0.5, -0.5)
"""Implausibility up to which points are tried, in the waves after the first; the last holds on."""
MOST_TRAINING = 400
SPARE = 4
"""Times the points of a wave that are drawn at most, to have enough whose values go together."""
FAR = 3.0
"""Values further from a bound than so many times the usual distance are taken as that far."""
FAILURES = 2
"""After the first wave, facts that fail until the rest is not tried."""
HEAD, TRIED = "match.json", "tried.jsonl"


@dataclass(frozen=True, slots=True, kw_only=True)
class Tried:
    """One panel that was tried.

    Attributes
    ----------
    wave, number : int
        From 0, and its place among the panels of the wave.
    share : float
        Of the ranges that its wave was drawn from, as the emulators say [-].
    point, values : tuple of float
        Shares of the ranges, and the facts in SI, NaN where there is none.
    accepted : bool
        Whether all facts hold.
    fault : str
        Why there are no values; else empty.
    throws : int
        That were made.
    seconds : float
        Processor time [s].
    """

    wave: int
    number: int
    share: float
    point: tuple[float, ...]
    values: tuple[float, ...]
    accepted: bool
    fault: str
    throws: int
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Matching:
    """All panels that were tried.

    Attributes
    ----------
    facts : Facts
        What was asked.
    tried : tuple of Tried
        In order.
    """

    facts: Facts
    tried: tuple[Tried, ...]

    @property
    def points(self) -> Floats:
        """Points of the accepted panels, shape (n_accepted, n_parameters)."""
        found = [item.point for item in self.tried if item.accepted]
        return np.array(found).reshape(-1, len(self.facts.parameters))


def match_panel(
    facts: Facts,
    folder: Path,
    *,
    count: int = 200,
    most: int = 2000,
    workers: int | Workers = 1,
    report: Report | None = None,
) -> Matching:
    """Collect panels that meet all facts.

    Parameters
    ----------
    facts : Facts
        What is not known, and what must hold.
    folder : Path
        Keeps every panel that was tried; the same call goes on where it was interrupted.
    count : int
        Accepted panels wanted; the wave in which the last is found is finished.
    most : int
        Panels tried at most.
    workers : int or Workers
        Processes; with one, all is done in this one. Or those of `panel_workers`.
    report : callable, optional
        Called after every panel.

    Raises
    ------
    FileError
        When the folder holds a matching of other facts, or cannot be written.
    """
    names = [item.name for item in facts.parameters] + [item.name for item in facts.facts]
    identity = {"name": facts.name, "digest": facts.digest, "columns": names}
    claim_for(folder, HEAD, identity, what="matching")
    tried = _read(folder, facts)
    pace, wave = Pace(report), 0
    with panel_workers(facts, workers) as processes:
        while True:
            before = [item for item in tried if item.wave < wave]
            accepted = sum(item.accepted for item in before)
            if accepted >= count or len(before) >= most:
                return Matching(facts=facts, tried=tuple(tried))
            wanted = min(WAVE if wave else FIRST_WAVE, most - len(before))
            there = frozenset(item.number for item in tried if item.wave == wave)
            stage = f"wave {wave + 1}, {accepted} of {count} panels accepted before"
            pace.begin(stage, wanted, there=len(there))
            if len(there) < wanted:
                own = _Wave(number=wave, wanted=wanted, there=there)
                for made in _missing_panels(facts, before, own, processes):
                    append_line(folder / TRIED, made)
                    tried.append(made)
                    pace.count(stage, failed=bool(made.fault), cost=made.seconds)
                tried.sort(key=lambda item: (item.wave, item.number))
            wave += 1


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wave:
    """A wave of panels: its number, those that are wanted, and which of them are there."""

    number: int
    wanted: int
    there: frozenset[int]


def _missing_panels(
    facts: Facts, before: list[Tried], wave: _Wave, processes: Workers
) -> Iterator[Tried]:
    """Try the panels of a wave that are missing, and yield them as they are done."""
    with one_blas_thread():  # small matrices: threads would take ten times as long
        points, share = _points(facts, before, wave.number)
    if not len(points):
        message = "the emulators leave no panel whose values go together; widen the ranges"
        raise StudyError([message], source=facts.name)
    jobs = [
        partial(_try, point, wave.number, number, share)
        for number, point in enumerate(points[: wave.wanted])
        if number not in wave.there
    ]
    for _, made in processes.run(jobs):
        yield made


def _points(facts: Facts, before: list[Tried], wave: int) -> tuple[Floats, float]:
    """Return the points of a wave, and the share of the ranges that they are drawn from."""
    rng = np.random.default_rng([facts.seed, wave])
    if not wave:
        return latin_hypercube(FIRST_WAVE, len(facts.parameters), rng=rng), 1.0
    found = emulators_of(facts, before, wave)
    chosen = [facts.facts[number] for number in found]
    emulation = Emulation.of(list(found.values()), chosen)
    known = [item.point for item in before if item.accepted]
    points, share = plausible_points(
        emulation,
        SPARE * WAVE,
        start=np.array(known).reshape(-1, len(facts.parameters)),
        limit=CUT_OFFS[min(wave, len(CUT_OFFS)) - 1],
        rng=rng,
    )
    valid: list[Floats] = []
    for point in points:
        if len(valid) < WAVE and is_valid(facts, point):
            valid.append(point)
    return np.array(valid).reshape(-1, len(facts.parameters)), share


def emulators_of(facts: Facts, before: Sequence[Tried], wave: int) -> dict[int, Emulator]:
    """Fit emulators to panels that were tried, to those nearest to meeting the facts if many.

    Parameters
    ----------
    facts : Facts
        What must hold.
    before : sequence of Tried
        Panels of earlier waves.
    wave : int
        For which it is.

    Returns
    -------
    dict of int to Emulator
        By the number of the fact; late facts have none.

    Raises
    ------
    StudyError
        When too few panels gave facts.
    """
    rng = np.random.default_rng([facts.seed, wave, 1])
    early = [number for number, fact in enumerate(facts.facts) if not fact.late]
    usable = [item for item in before if not item.fault]
    if len(usable) < FEWEST:
        faults = {item.fault for item in before if item.fault}
        message = (
            f"only {len(usable)} of {len(before)} panels gave facts; "
            f"{next(iter(faults), 'no throw failed')}; narrow the ranges"
        )
        raise StudyError([message], source=facts.name)
    points = np.array([item.point for item in usable])
    values = np.array([item.values for item in usable])
    order = np.argsort(_misses(facts, values, early), kind="stable")
    found = {}
    for number in early:
        near = order[np.isfinite(values[order, number])][:MOST_TRAINING]
        near_bounds = _clipped(facts.facts[number], values[near, number])
        found[number] = fit_emulator(points[near], near_bounds, rng=rng)
    return found


def _clipped(fact: Sum, values: Floats) -> Floats:
    """Return values of which none is far outside the bounds, where a fact may bend.

    A drive that slips moves on at nearly constant force: its slip travel grows ten times as fast as
    before. Only where it begins matters.
    """
    beyond = np.maximum(fact.least - values, values - fact.most)
    reach = FAR * float(np.median(np.abs(beyond)))
    return np.clip(values, fact.least - reach, fact.most + reach)


def _misses(facts: Facts, values: Floats, early: list[int]) -> Floats:
    """Return by how much panels miss the facts that were tried, in their deviations, summed."""
    total = np.zeros(len(values))
    for number in early:
        fact, column = facts.facts[number], values[:, number]
        beyond = np.maximum(fact.least - column, column - fact.most)
        total += np.nan_to_num(np.maximum(beyond, 0.0) / (np.nanstd(column) or 1.0))
    return total


_facts: list[Facts] = []
"""Of the panels that this process tries; sent once."""


def begin_panels(facts: Facts) -> None:
    """Keep the facts that panels of this process are held against."""
    _facts[:] = [facts]
    gc.enable()


@contextmanager
def panel_workers(facts: Facts, workers: int | Workers) -> Iterator[Workers]:
    """Give the processes that try panels; one works in this process."""
    begin_panels(facts)
    if isinstance(workers, Workers):
        yield workers
        return
    with Workers(workers if workers > 1 else 0, facts, prepare=begin_panels) as found:
        yield found


def panel_facts() -> Facts:
    """Return the facts that panels of this process are held against."""
    return _facts[0]


def _try(point: Floats, wave: int, number: int, share: float) -> Tried:
    began = time.process_time()
    found = evaluate(panel_facts(), point, failures=FAILURES if wave else None)
    return Tried(
        wave=wave,
        number=number,
        share=share,
        point=tuple(map(float, point)),
        values=tuple(map(float, found.values)),
        accepted=found.accepted,
        fault=found.fault,
        throws=found.throws,
        seconds=time.process_time() - began,
    )


def _read(folder: Path, facts: Facts) -> list[Tried]:
    """Read the panels that were tried; those of older files are in the order of their numbers."""
    path, found = folder / TRIED, list[Tried]()
    counted = Counter[int]()
    for line, record in enumerate(read_lines(path), 1):
        try:
            record.setdefault("number", counted[record["wave"]])
            counted[record["wave"]] += 1
            record["point"] = tuple(map(float, record["point"]))
            record["values"] = tuple(map(float, record["values"]))
            item = Tried(**record)
        except (ValueError, TypeError, KeyError) as error:
            message = f"{path}, line {line}: is damaged ({error}); remove the line or the folder"
            raise FileError(message) from None
        if len(item.values) != len(facts.facts) or len(item.point) != len(facts.parameters):
            message = f"{path}, line {line}: belongs to other facts; name another folder"
            raise FileError(message)
        found.append(item)
    return sorted(found, key=lambda item: (item.wave, item.number))
