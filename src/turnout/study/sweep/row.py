"""Throw the scenarios of a sweep and reduce each to the row that is stored of it.

Labels and features are taken from every instant that the solver kept, histories at the rate of the
study. What is not requested is never computed. A throw ends with little more than its history in
the processor's caches: what need not be done beside it is done before and after, for many throws at
once, which takes half the time: panels, mechanisms and motions before, signals and labels after.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import PanelError, TurnoutError
from turnout.core.scheme import Scheme
from turnout.core.threads import one_blas_thread
from turnout.mechanism.build import vary_rails
from turnout.panel.foreign_object import PlacedObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.solver.outcome import Code
from turnout.study.scenario import Scenario
from turnout.study.study import Study
from turnout.study.sweep.extract import extract_signals, save_at_of
from turnout.study.sweep.labels import compute_labels
from turnout.study.sweep.throw_group import (
    ThrowSignals,
    group_by_layout,
    kept_histories,
    lay_together,
)
from turnout.throw.coordinates import (
    default_stations,
    dimensions_of,
    object_coordinate,
    shared_coordinates,
)
from turnout.throw.signals import Channel
from turnout.throw.simulate import PlannedThrow, Solved, plan_throw, solve_planned

Floats = NDArray[np.float64]
Variables = dict[str, Channel]

OUTCOMES = ("complete", "failed", "invalid", "skipped", "inaccurate")
"""Outcome of a scenario: to its end; not even with a finer step; not possible; left out by the
rule of its chain; to its end, but with an energy balance that does not close, not even with a finer
step."""
COMPLETE, FAILED, INVALID, SKIPPED, INACCURATE = OUTCOMES
UNUSABLE = (FAILED, INVALID, INACCURATE)
"""Outcomes of scenarios that were to be thrown and gave no numbers."""

THROWS_PER_PASS = 128
"""Throws evaluated together; more save no time and take more memory."""

AT_ONCE = 32
"""Throws that are planned, then made, then extracted together: each change from one to the other
makes Python find its own objects in the processor's caches again."""

STEPS_AT_ONCE = 136_000
"""Steps of the throws that are made together: of longer throws there are fewer, since each leaves
the more in memory."""


@dataclass(frozen=True, slots=True)
class SolverTime:
    """Time that a solver took.

    Attributes
    ----------
    wall, processor : float
        By the clock, and of processors [s].
    build : float
        The part of the first in which mechanisms were built [s].
    """

    wall: float = 0.0
    processor: float = 0.0
    build: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class StoredThrows:
    """Stored values of throws that are alike.

    Attributes
    ----------
    variables : dict of str to (dims, ndarray)
        Histories, labels and features, throws first; the dimensions are those of one.
    coordinates : dict of str to (dims, ndarray)
        Of these; those of dimensions once for all throws, all others with throws first too.
    instants : ndarray of int, shape (n,)
        Of histories each throw has so many; what follows them means nothing.
    """

    variables: Variables
    coordinates: Variables
    instants: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class ScenarioRow:
    """Stored values of one scenario.

    Attributes
    ----------
    scenario : Scenario
        Scenario that was thrown.
    outcome : str
        One of `OUTCOMES`.
    reason : str
        Why it is not complete, else empty.
    attempts : int
        Throws that were made.
    solver : SolverTime
        In building and integrating the throw that counted.
    stored : StoredThrows, optional
        Stored results of this throw and of others; none unless complete.
    number : int
        Of the throw among these.
    """

    scenario: Scenario
    outcome: str
    reason: str
    attempts: int
    solver: SolverTime = SolverTime()
    stored: StoredThrows | None = None
    number: int = 0

    @property
    def slipped(self) -> bool:
        """True if a drive slipped in the last movement."""
        return self.stored is not None and bool(self.stored.variables["slipped"][1][self.number])


@dataclass(frozen=True, slots=True)
class PreparedScenario:
    """A scenario that can be thrown, or the reason for not throwing it.

    Attributes
    ----------
    scenario : Scenario
        Scenario to be thrown.
    panel : LoadedPanel
        With the changes of the scenario.
    objects : tuple of PlacedObject
        All that is trapped.
    outcome, fault : str
        Outcome and fault of a throw that cannot be made; else empty.
    attempts : int
        Throws that were made until that was known.
    planned : PlannedThrow, optional
        Its throw, of a scenario that can be thrown.
    """

    scenario: Scenario
    panel: LoadedPanel
    objects: tuple[PlacedObject, ...]
    outcome: str = ""
    fault: str = ""
    attempts: int = 0
    planned: PlannedThrow | None = None


@dataclass(frozen=True, slots=True)
class ThrowResult:
    """A scenario after its throws.

    Of a "complete" one `solved` is there until what is stored of it has been `extracted`.
    """

    ready: PreparedScenario
    outcome: str
    reason: str
    attempts: int
    solver: SolverTime = SolverTime()
    solved: Solved | None = None
    extracted: ThrowSignals | None = None


def throw_scenarios(study: Study, scenarios: Sequence[Scenario]) -> list[ScenarioRow]:
    """Throw some scenarios, a second time with half the step if the first does not get to its end.

    Parameters
    ----------
    study : Study
        Panel, scheme, and what is kept.
    scenarios : sequence of Scenario
        Of its own; a batch at a time, since their panels are all made first.

    Returns
    -------
    list of Row
        In the same order.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C.
    """
    ready = [prepare_scenario(study, scenario) for scenario in scenarios]
    throws: list[ThrowResult] = []
    with one_blas_thread():
        at_once = throws_at_once(study, ready)
        for first in range(0, len(ready), at_once):
            group = ready[first : first + at_once]
            vary_rails([item.panel for item in group if not item.fault], study.panel)
            planned = [plan_scenario(study, item) for item in group]
            # Each takes megabytes and is let go with its turn; what is last in a list is next.
            planned.reverse()
            thrown = [throw_scenario(study, planned.pop()) for _ in range(len(planned))]
            thrown.reverse()
            throws += [extract_scenario(study, thrown.pop()) for _ in range(len(thrown))]
        return make_rows(study, throws)


def throws_at_once(study: Study, ready: Sequence[PreparedScenario]) -> int:
    """Return the number of throws that are planned and made before they are extracted."""
    longest = max((item.panel.schedule.end for item in ready), default=0.0)
    most = max(1, int(STEPS_AT_ONCE * study.scheme.step / max(longest, 1.0)))
    return min(AT_ONCE, most)


def prepare_scenario(study: Study, scenario: Scenario) -> PreparedScenario:
    """Make the panel of a scenario and place its objects."""
    panel = study.panel
    try:
        if scenario.overrides:
            panel = panel.with_overrides(dict(scenario.overrides))
        return PreparedScenario(scenario, panel, resolve_objects(panel, scenario.foreign_objects))
    except TurnoutError as error:
        return PreparedScenario(scenario, panel, (), INVALID, _fault(error))


def plan_scenario(study: Study, ready: PreparedScenario) -> PreparedScenario:
    """Plan the throw of a scenario that can be thrown."""
    if ready.fault:
        return ready
    save_at = save_at_of(study, ready.panel)
    try:
        planned = plan_throw(
            ready.panel, ready.objects, scheme=study.scheme, save_at=save_at, nominal=study.panel
        )
    except TurnoutError as error:
        return replace(ready, outcome=_ending(error), fault=_fault(error), attempts=1)
    return PreparedScenario(ready.scenario, ready.panel, ready.objects, planned=planned)


def throw_scenario(study: Study, ready: PreparedScenario) -> ThrowResult:
    """Throw a scenario, if need be twice.

    What a throw leaves as a whole is reduced at once; a watched one leaves little.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C.
    """
    planned, attempts = ready.planned, 0
    if planned is None:
        return ThrowResult(ready, ready.outcome, ready.fault, ready.attempts)
    # without its plan, so that rails, which may be its own, are let go
    ready = PreparedScenario(ready.scenario, ready.panel, ready.objects)
    try:
        for again in (False, True):
            attempts += 1
            if again:
                scheme, save_at = refine_scheme(study.scheme), save_at_of(study, ready.panel)
                planned = plan_throw(
                    ready.panel, ready.objects, scheme=scheme, save_at=save_at, nominal=study.panel
                )
            solved = solve_planned(planned)
            outcome = solved.history.outcome
            if outcome.code is Code.INTERRUPTED:
                raise KeyboardInterrupt
            if outcome.complete:
                spent = SolverTime(solved.solver_time, solved.processor_time, solved.build_time)
                found = ThrowResult(ready, COMPLETE, "", attempts, spent, solved)
                whole = solved.history.watched is None
                return extract_scenario(study, found) if whole else found
            reason = outcome.message()
            ending = INACCURATE if outcome.code is Code.INACCURATE else FAILED
    except TurnoutError as error:
        return ThrowResult(ready, _ending(error), _fault(error), attempts)
    return ThrowResult(ready, ending, reason, attempts)


def extract_scenario(study: Study, thrown: ThrowResult) -> ThrowResult:
    """Take all that is needed later from the history of a complete throw, once."""
    solved, ready = thrown.solved, thrown.ready
    if solved is None:
        return thrown
    try:
        recorder = ready.scenario.recorder
        extracted = extract_signals(study, ready.panel, solved, recorder=recorder)
    except TurnoutError as error:
        return ThrowResult(ready, _ending(error), _fault(error), thrown.attempts)
    about = (ready, thrown.outcome, thrown.reason, thrown.attempts, thrown.solver)
    return ThrowResult(*about, extracted=extracted)


def _ending(error: TurnoutError) -> str:
    """Return the outcome of a scenario with an error."""
    return INVALID if isinstance(error, PanelError) else FAILED


def _fault(error: TurnoutError) -> str:
    """Return the message of an error in one line."""
    return "; ".join(error.problems) if isinstance(error, PanelError) else str(error)


def make_rows(study: Study, throws: Sequence[ThrowResult]) -> list[ScenarioRow]:
    """Return the rows of some throws."""
    complete = [item.extracted for item in throws if item.extracted is not None]
    stored: list[tuple[StoredThrows, int]] = []
    for first in range(0, len(complete), THROWS_PER_PASS):
        stored += reduce_signals(study, complete[first : first + THROWS_PER_PASS])
    rows, made = [], iter(stored)
    for item in throws:
        about = (item.ready.scenario, item.outcome, item.reason, item.attempts, item.solver)
        rows.append(ScenarioRow(*about, *(() if item.extracted is None else next(made))))
    return rows


def reduce_signals(study: Study, runs: Sequence[ThrowSignals]) -> list[tuple[StoredThrows, int]]:
    """Return histories, labels and features of some throws, alike ones at once."""
    found = dict[int, tuple[StoredThrows, int]]()
    for numbers in group_by_layout(runs):
        alike = [runs[number] for number in numbers]
        together = lay_together(alike)
        variables = kept_histories(together, study.output.channels) | compute_labels(together)
        used = dimensions_of(variables)
        coordinates = shared_coordinates([run.panel for run in alike], used=used)
        coordinates |= object_coordinate(alike[0].index, used=used)
        if "x" in used:
            coordinates["x"] = (("x",), default_stations(alike[0].panel))
        instants = -(-together.sizes // alike[0].watched.stride)
        stored = StoredThrows(variables, coordinates, instants)
        for place, number in enumerate(numbers):
            found[number] = stored, place
    return [found[number] for number in range(len(runs))]


def skipped_row(scenario: Scenario, *, reason: str) -> ScenarioRow:
    """Return a scenario that the rule of its chain leaves out."""
    return ScenarioRow(scenario, SKIPPED, reason, 0)


def refine_scheme(scheme: Scheme) -> Scheme:
    """Return a scheme with half the step and more patience, for a second attempt."""
    return replace(
        scheme,
        step=0.5 * scheme.step,
        iterations=2 * scheme.iterations,
        halvings=scheme.halvings + 2,
        output_interval=scheme.output_interval,
    )


def rule_inputs(row: ScenarioRow) -> Mapping[str, object]:
    """Return the inputs of the rule of a chain."""
    return {"slipped": row.slipped, **row.scenario.inputs}
