"""One scenario of a sweep thrown and boiled down to what is stored of it.

Labels and features are taken from every instant that the solver kept, histories at the rate of the
study. What is not asked for is never computed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turnout.errors import FileError, PanelError, TurnoutError
from turnout.integrate.outcome import Code
from turnout.integrate.run import History
from turnout.integrate.scheme import Scheme
from turnout.mechanism.threads import one_blas_thread
from turnout.metric.features import FEATURES, run_features
from turnout.metric.movement import Span
from turnout.panel.load import LoadedPanel
from turnout.response.dataset import coordinates_of, response_channels
from turnout.response.route import throws
from turnout.response.save import Save
from turnout.response.signals import Variable
from turnout.response.simulate import Solved, solve
from turnout.study.scenario import Scenario
from turnout.study.study import Study

Floats = NDArray[np.float64]
Variables = dict[str, Variable]

OUTCOMES = ("complete", "failed", "invalid", "skipped")
"""How a scenario ended: to its end; not even with a finer step; not possible; left out by the
rule of its chain."""
COMPLETE, FAILED, INVALID, SKIPPED = OUTCOMES

FORCES = (
    *("drive_force", "drive_displacement", "drive_slipping", "object_force", "force_margin"),
    *("object_placed", "object_touched", "contact_time", "least_flangeway", "least_flangeway_x"),
)
"""What is made of every instant, or of some that need not be kept."""
ENDS = ("end_gap", "locked", "in_control")
LABELS = {
    "object_force_peak": ("N", "largest force on foreign objects"),
    "object_force_end": ("N", "force on foreign objects at the end"),
    "slipped": ("1", "whether a drive slipped in the last movement"),
    "slipped_free": ("1", "whether a drive slipped before any object was touched"),
    "end_locked": ("1", "lock rule met at the end"),
    "end_in_control": ("1", "sensor gap below its limit at the end"),
}
"""Unit and meaning of the labels that only a sweep has."""


@dataclass(frozen=True, slots=True)
class Spent:
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
    solver : Spent
        In building and integrating the throw that counted.
    """

    scenario: Scenario
    outcome: str
    reason: str
    attempts: int
    variables: Variables
    coordinates: Variables
    solver: Spent

    @property
    def slipped(self) -> bool:
        """Whether a drive slipped in the last movement."""
        return bool(self.variables["slipped"][1])


def throw_scenario(study: Study, scenario: Scenario) -> Row:
    """Throw one scenario, a second time with half the step if the first does not get to its end.

    Parameters
    ----------
    study : Study
        Panel, scheme, and what is kept.
    scenario : Scenario
        One of its own.

    Returns
    -------
    Row

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C.
    """
    reason, attempts = "", 0
    try:
        panel = study.panel
        if scenario.overrides:
            panel = panel.with_overrides(dict(scenario.overrides))
        for scheme in (study.scheme, tighter(study.scheme)):
            attempts += 1
            solved = solve(panel, foreign_object=scenario.foreign_objects, scheme=scheme)
            outcome = solved.history.outcome
            if outcome.code is Code.INTERRUPTED:
                raise KeyboardInterrupt
            if outcome.complete:
                variables, coordinates = boiled_down(study, panel, solved)
                spent = Spent(solved.solver_time, solved.processor_time, solved.build_time)
                return Row(scenario, COMPLETE, "", attempts, variables, coordinates, spent)
            reason = outcome.message()
    except PanelError as error:
        return Row(scenario, INVALID, "; ".join(error.problems), attempts, {}, {}, Spent())
    except TurnoutError as error:
        return Row(scenario, FAILED, str(error), attempts, {}, {}, Spent())
    return Row(scenario, FAILED, reason, attempts, {}, {}, Spent())


def skipped(scenario: Scenario, *, reason: str) -> Row:
    """Return a scenario that the rule of its chain leaves out."""
    return Row(scenario, SKIPPED, reason, 0, {}, {}, Spent())


def tighter(scheme: Scheme) -> Scheme:
    """Return a scheme with half the step and more patience, for a second attempt."""
    return replace(
        scheme,
        step=0.5 * scheme.step,
        iterations=2 * scheme.iterations,
        halvings=scheme.halvings + 2,
        output_interval=scheme.output_interval,
    )


def boiled_down(study: Study, panel: LoadedPanel, solved: Solved) -> tuple[Variables, Variables]:
    """Return what is stored of a complete throw, and its coordinates.

    Parameters
    ----------
    study : Study
        What is kept, at which rate.
    panel : LoadedPanel
        What was thrown.
    solved : Solved
        The throw.
    """
    given = panel, solved.mechanism
    every, stride = solved.history, stride_of(study)
    sparse, end = (
        at_instants(every, part) for part in (slice(None, None, stride), slice(-1, None))
    )
    wanted = study.output.channels
    with one_blas_thread():
        forces = response_channels(*given, every, save=Save(fields=FORCES))
        further = tuple(name for name in wanted if name not in forces)
        kept = response_channels(*given, sparse, save=Save(fields=further)) if further else {}
        last = response_channels(*given, end, save=Save(fields=ENDS))
    kept |= {
        name: (dims, values[..., ::stride])
        for name, (dims, values) in forces.items()
        if name in wanted and "time" in dims
    }
    variables = {name: (dims, _small(values)) for name, (dims, values) in kept.items()}
    variables |= {name: value for name, value in forces.items() if "time" not in value[0]}
    variables["end_gap"] = last["end_gap"]
    for name in ("locked", "in_control"):
        if name in last:
            dims, values = last[name]
            variables[f"end_{name}"] = (dims[:-1], np.asarray(values[..., -1]))
    variables |= force_labels(panel, every.time, forces)
    coordinates = coordinates_of(variables, *given, time=every.time, save=Save())
    del coordinates["time"]  # of the solver, not of what is kept
    return variables, coordinates


def force_labels(panel: LoadedPanel, time: Floats, every: Variables) -> Variables:
    """Return features of each drive and movement, and what `object_labels` tells.

    Parameters
    ----------
    panel : LoadedPanel
        What was thrown.
    time : ndarray, shape (n_times,)
        [s]
    every : dict
        As for `object_labels`.
    """
    spans = [Span(throw.name, throw.to, throw.start, throw.end) for throw in throws(panel)]
    found = run_features(
        time,
        _floats(every["drive_force"]),
        spans=spans,
        limits=np.array([drive.saturation_force for drive in panel.drive.values()]),
        travel=_floats(every["drive_displacement"]),
    )
    dims = ("drive", "direction")
    features: Variables = {name: (dims, row) for name, row in zip(FEATURES, found, strict=True)}
    return features | object_labels(time, every, spans=spans)


def object_labels(time: Floats, every: Variables, *, spans: Sequence[Span]) -> Variables:
    """Return the largest and last force on the objects, and whether drives slipped.

    Parameters
    ----------
    time : ndarray, shape (n_times,)
        [s]
    every : dict
        `object_force`, `drive_force`, `drive_slipping` and `contact_time` as bare arrays.
    spans : sequence of Span
        The movements.
    """
    force = _floats(every["object_force"])
    sense, onset = np.zeros(time.size), 0.0
    for span in spans:
        onset = span.start - 1e-9
        sense[time >= onset] = 1.0 if span.to == "closed" else -1.0
    # At the onset of a movement a drive may still hold with the force of the one before.
    working = sense * _floats(every["drive_force"]) > 0
    slipping = np.any(every["drive_slipping"][1].astype(np.bool_) & working, axis=0)
    contact = float(_floats(every["contact_time"]))
    alone = time < (contact if np.isfinite(contact) else np.inf)
    return {
        "object_force_peak": ((), np.asarray(np.max(force, initial=0.0))),
        "object_force_end": ((), np.asarray(force[-1])),
        "slipped": ((), np.asarray(slipping[time >= onset].any())),
        "slipped_free": ((), np.asarray(slipping[alone].any())),
    }


def at_instants(history: History, index: NDArray[np.int64] | slice) -> History:
    """Return a history at some of its instants; what was gathered from every step stays.

    A slice copies nothing.
    """
    names = ("time", "inputs", "q", "g", "law_force", "friction_force", "stored", "ledger")
    return replace(history, **{name: getattr(history, name)[index] for name in names})


def stride_of(study: Study) -> int:
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


def _small(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return numbers in single precision; logical values stay."""
    return values.astype(np.float32) if values.dtype.kind == "f" else values


def _floats(variable: Variable) -> Floats:
    return np.asarray(variable[1], dtype=np.float64)


def labels_of(row: Row) -> Mapping[str, object]:
    """Return what the rule of a chain looks at."""
    return {"slipped": row.slipped, **row.scenario.inputs}
