"""Throw the scenarios of a sweep and reduce each to the row that is stored of it.

Labels and features are taken from every instant that the solver kept, histories at the rate of the
study. What is not requested is never computed. A throw ends with little more than its history in
the processor's caches: what need not be done beside it is done before and after, for many throws at
once, which takes half the time.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.core.threads import one_blas_thread
from turnout.errors import FileError, PanelError, TurnoutError
from turnout.integrate.integration import History
from turnout.integrate.outcome import Code
from turnout.measurement.chain.recorder import Recorder, clocked, recorded_force
from turnout.panel.foreign_object import PlacedObject, resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.response.dataset import coordinates_of, response_channels
from turnout.response.drives import machine_signals, machine_slips, moved_throws
from turnout.response.gaps import drive_and_sensor_gaps
from turnout.response.labels import contact_labels, flangeway_labels
from turnout.response.recovery import Motion, recover_motion
from turnout.response.save import Save
from turnout.response.signals import Variable, drive_signals, object_memory, object_signals
from turnout.response.simulate import Solved, solve_placed
from turnout.scheme import Scheme
from turnout.study.scenario import Scenario
from turnout.study.study import Study
from turnout.sweep.labels import ThrowSignals, compute_labels, float_values

Floats = NDArray[np.float64]
Variables = dict[str, Variable]

OUTCOMES = ("complete", "failed", "invalid", "skipped", "inaccurate")
"""How a scenario ended: to its end; not even with a finer step; not possible; left out by the
rule of its chain; to its end, but with an energy balance that does not close, not even with a finer
step."""
COMPLETE, FAILED, INVALID, SKIPPED, INACCURATE = OUTCOMES
UNUSABLE = (FAILED, INVALID, INACCURATE)
"""Outcomes of scenarios that were to be thrown and gave no numbers."""

THROWS_PER_PASS = 16
"""So many throws are evaluated together; more would not fit the processor's caches."""

UNCHANGED_LABELS = (
    "object_placed",
    "object_touched",
    "contact_time",
    "least_flangeway",
    "least_flangeway_x",
)
"""Stored of each throw as they are."""

MACHINE_LABELS = ("throw_time", "mean_current", "end_current")
"""Stored likewise where drives are machines."""


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


@dataclass(frozen=True, slots=True)
class Row:
    """What is stored of one scenario.

    Attributes
    ----------
    scenario : Scenario
        What was thrown.
    outcome : str
        One of `OUTCOMES`.
    reason : str
        Why it is not complete, else empty.
    attempts : int
        Throws that were made.
    variables : dict of str to (dims, ndarray)
        Histories, labels and features; empty unless complete.
    coordinates : dict of str to (dims, ndarray)
        Of these.
    solver : SolverTime
        In building and integrating the throw that counted.
    """

    scenario: Scenario
    outcome: str
    reason: str
    attempts: int
    variables: Variables
    coordinates: Variables
    solver: SolverTime

    @property
    def slipped(self) -> bool:
        """Whether a drive slipped in the last movement."""
        return bool(self.variables["slipped"][1])


@dataclass(frozen=True, slots=True)
class PreparedScenario:
    """A scenario that can be thrown, or why it cannot.

    Attributes
    ----------
    scenario : Scenario
        What is to be thrown.
    panel : LoadedPanel
        With the changes of the scenario.
    objects : tuple of PlacedObject
        All that is trapped.
    fault : str
        What is wrong with it, else empty.
    """

    scenario: Scenario
    panel: LoadedPanel
    objects: tuple[PlacedObject, ...]
    fault: str


@dataclass(frozen=True, slots=True)
class ThrowResult:
    """A scenario after its throws; `extracted` is None unless `outcome` is "complete"."""

    scenario: Scenario
    outcome: str
    reason: str
    attempts: int
    extracted: ThrowSignals | None
    solver: SolverTime


def throw_scenarios(study: Study, scenarios: Sequence[Scenario]) -> list[Row]:
    """Throw some scenarios, a second time with half the step if the first does not get to its end.

    Parameters
    ----------
    study : Study
        Panel, scheme, and what is kept.
    scenarios : sequence of Scenario
        Of its own; a few of them at a time, since their panels are all made first.

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
    with one_blas_thread():
        return make_rows([throw_scenario(study, item) for item in ready])


def prepare_scenario(study: Study, scenario: Scenario) -> PreparedScenario:
    """Make the panel of a scenario and place its objects."""
    panel = study.panel
    try:
        if scenario.overrides:
            panel = panel.with_overrides(dict(scenario.overrides))
        return PreparedScenario(
            scenario, panel, resolve_objects(panel, scenario.foreign_objects), ""
        )
    except PanelError as error:
        return PreparedScenario(scenario, panel, (), "; ".join(error.problems))
    except TurnoutError as error:
        return PreparedScenario(scenario, panel, (), str(error))


def throw_scenario(study: Study, ready: PreparedScenario) -> ThrowResult:
    """Throw a scenario, if need be twice, and take from its history what is needed later.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C.
    """
    scenario, reason, attempts = ready.scenario, ready.fault, 0
    if reason:
        return ThrowResult(scenario, INVALID, reason, attempts, None, SolverTime())
    try:
        for again in (False, True):
            attempts += 1
            scheme = refine_scheme(study.scheme) if again else study.scheme
            solved = solve_placed(ready.panel, ready.objects, scheme=scheme)
            outcome = solved.history.outcome
            if outcome.code is Code.INTERRUPTED:
                raise KeyboardInterrupt
            if outcome.complete:
                spent = SolverTime(solved.solver_time, solved.processor_time, solved.build_time)
                recorder = scenario.recorder
                extracted = extract_signals(study, ready.panel, solved, recorder=recorder)
                return ThrowResult(scenario, COMPLETE, "", attempts, extracted, spent)
            reason = outcome.message()
            ending = INACCURATE if outcome.code is Code.INACCURATE else FAILED
    except PanelError as error:
        return ThrowResult(
            scenario, INVALID, "; ".join(error.problems), attempts, None, SolverTime()
        )
    except TurnoutError as error:
        return ThrowResult(scenario, FAILED, str(error), attempts, None, SolverTime())
    return ThrowResult(scenario, ending, reason, attempts, None, SolverTime())


def extract_signals(
    study: Study, panel: LoadedPanel, solved: Solved, *, recorder: Recorder
) -> ThrowSignals:
    """Return what is stored of a complete throw and what its labels are made of.

    Parameters
    ----------
    study : Study
        What is kept, at which rate.
    panel : LoadedPanel
        What was thrown.
    solved : Solved
        The throw.
    recorder : Recorder
        Of what is kept of forces and currents over time, and of their features.
    """
    given, every, stride = (panel, solved.mechanism), solved.history, output_stride(study)
    signals = drive_signals(*given, every) | object_signals(solved.mechanism, every)
    signals |= contact_labels(solved.mechanism, every) | object_memory(solved.mechanism, every)
    machine_slips(every, np.asarray(signals["drive_slipping"][1]))
    signals |= machine_signals(panel, every)
    recorded = _recorded(signals, every.time, recorder)
    moved = moved_throws(panel, every)
    wanted = study.output.channels
    sparse = select_instants(every, slice(None, None, stride))
    kept = {
        name: (dims, values[..., ::stride])
        for name, (dims, values) in (signals | recorded).items()
        if name in wanted and "time" in dims
    }
    motion = recover_motion(solved.mechanism, every)
    signals |= flangeway_labels(panel, motion, every.time, moved)
    gaps = [name for name in ("drive_gap", "sensor_gap") if name in wanted]
    found = _gap_signals(panel, replace(motion, history=sparse)) if gaps else None
    if found is not None:
        kept |= {name: found[name] for name in gaps if found[name][1].size}
    further = tuple(name for name in wanted if name not in {*signals, *gaps})
    if further:
        kept |= response_channels(*given, sparse, save=Save(fields=further))
    if found is None or (every.time.size - 1) % stride:
        last = select_instants(every, slice(-1, None))
        found = _gap_signals(panel, replace(motion, history=last))
    ends = float_values(found["drive_gap"])[:, -1:], float_values(found["sensor_gap"])[:, -1:]
    small = {name: (dims, _to_single_precision(values)) for name, (dims, values) in kept.items()}
    force = float_values(recorded["drive_force"])
    return ThrowSignals(panel, solved.mechanism, every.time, signals, force, small, ends, moved)


def _recorded(signals: Variables, time: Floats, recorder: Recorder) -> Variables:
    """Return drive forces and motor currents as a recorder gives them."""
    dims, force = signals["drive_force"]
    found: Variables = {"drive_force": (dims, recorded_force(np.asarray(force), time, recorder))}
    if "drive_current" in signals:
        dims, current = signals["drive_current"]
        found["drive_current"] = (dims, clocked(np.asarray(current), time, recorder))
    return found


def _gap_signals(panel: LoadedPanel, motion: Motion) -> Variables:
    """Return gaps at drives and sensors at all instants of a history."""
    at_drives, at_sensors = drive_and_sensor_gaps(panel, motion, motion.history.time)
    return {
        "drive_gap": (("drive", "time"), at_drives),
        "sensor_gap": (("sensor", "time"), at_sensors),
    }


def make_rows(throws: Sequence[ThrowResult]) -> list[Row]:
    """Return what is stored of some throws."""
    complete = [item.extracted for item in throws if item.extracted is not None]
    labels: list[Variables] = []
    for first in range(0, len(complete), THROWS_PER_PASS):
        labels += compute_labels(complete[first : first + THROWS_PER_PASS])
    rows, made = [], iter(labels)
    for item in throws:
        about = (item.scenario, item.outcome, item.reason, item.attempts)
        if item.extracted is None:
            rows.append(Row(*about, {}, {}, item.solver))
            continue
        extracted = item.extracted
        variables = {
            **extracted.kept,
            **{name: extracted.signals[name] for name in UNCHANGED_LABELS},
            **{name: v for name in MACHINE_LABELS if (v := extracted.signals.get(name))},
            **next(made),
        }
        coordinates = coordinates_of(
            variables, extracted.panel, extracted.mechanism, time=extracted.time, save=Save()
        )
        del coordinates["time"]  # of the solver, not of what is kept
        rows.append(Row(*about, variables, coordinates, item.solver))
    return rows


def skipped_row(scenario: Scenario, *, reason: str) -> Row:
    """Return a scenario that the rule of its chain leaves out."""
    return Row(scenario, SKIPPED, reason, 0, {}, {}, SolverTime())


def refine_scheme(scheme: Scheme) -> Scheme:
    """Return a scheme with half the step and more patience, for a second attempt."""
    return replace(
        scheme,
        step=0.5 * scheme.step,
        iterations=2 * scheme.iterations,
        halvings=scheme.halvings + 2,
        output_interval=scheme.output_interval,
    )


def select_instants(history: History, index: NDArray[np.int64] | slice) -> History:
    """Return a history at some of its instants; what was gathered from every step stays.

    A slice copies nothing.
    """
    names = ("time", "inputs", "q", "g", "law_force", "friction_force", "stored", "ledger")
    machines = history.machines.select(index) if history.machines is not None else None
    found = {name: getattr(history, name)[index] for name in names}
    return replace(history, **found, machines=machines)


def output_stride(study: Study) -> int:
    """Return how many instants of the solver there are to one that is kept.

    Raises
    ------
    FileError
        When the rates do not fit together.
    """
    fine = study.scheme.output_interval
    stride = round(study.output.interval / fine)
    if stride < 1 or not math.isclose(stride * fine, study.output.interval, rel_tol=1e-6):
        message = (
            f"output.rate = {study.output.rate:g} Hz: the solver keeps an instant every "
            f"{1e3 * fine:g} ms; take a rate that divides {1.0 / fine:g} Hz"
        )
        raise FileError(message)
    return stride


def _to_single_precision(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return numbers in single precision; logical values stay."""
    return values.astype(np.float32) if values.dtype.kind == "f" else values


def rule_inputs(row: Row) -> Mapping[str, object]:
    """Return what the rule of a chain looks at."""
    return {"slipped": row.slipped, **row.scenario.inputs}
