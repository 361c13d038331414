"""What a detector makes of throws that differ from what it assumes: errors of other sizes."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.studies.detector_figures import (
    a90,
    false_alarm_limits,
    measured_by_switch,
    verdicts_on,
)
from turnout.detection.detector.allowances import Allowances
from turnout.detection.detector.calibrating import Errors, alarms_of, learn_history
from turnout.detection.detector.judging import CYCLE, make_view
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.throw_layout import Layout, means_on
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.throw_verdict import ALARM, UNKNOWN
from turnout.detection.floor import TOUCH_FORCE

Floats = NDArray[np.float64]

CASES: dict[str, dict[str, float | str]] = {
    "as assumed": {},
    "onsets 10 ms": {"timing": 10e-3},
    "noise 60 N": {"noise": 60.0},
    "sensor gains 3 %": {"gain": 0.03},
    "sensor zeros 100 N": {"zero": 100.0},
    "discrepancy 8 %": {"discrepancy": 0.08},
    "discrepancy of each throw alone": {"fixed_share": 0.0},
    "discrepancy of each switch alone": {"fixed_share": 1.0},
    "discrepancy over 0.2 s": {"correlation_time": 0.2},
    "discrepancy over 1 s": {"correlation_time": 1.0},
    "smooth discrepancy": {"kernel": "matern 3/2"},
}
"""Changes of what test throws are drawn with."""

KERNELS: dict[str, Callable[[Floats], Floats]] = {
    "noise 20 N, correlated over 0.05 s": lambda lag: 20.0**2 * np.exp(-lag / 0.05),
    "noise 60 N, correlated over 0.05 s": lambda lag: 60.0**2 * np.exp(-lag / 0.05),
    "hum of 50 N at 16.7 Hz": lambda lag: 0.5 * 50.0**2 * np.cos(2.0 * np.pi * 16.7 * lag),
    "zeros that wander by 50 N in 2 s": lambda lag: 50.0**2 * np.exp(-lag / 2.0),
}
"""Covariance of what the samples of each drive hold besides, by the time between them [N^2]."""
FINE_RATE = 250.0
"""At which these are averaged over windows [Hz]."""


def besides(layout: Layout, kernel: Callable[[Floats], Floats]) -> Floats:
    """Return the covariance of features of what the samples of each drive hold besides [N^2]."""
    time, means = means_on(layout, rate=FINE_RATE)
    one = means @ kernel(np.abs(time[:, np.newaxis] - time)) @ means.T
    return np.asarray(np.kron(np.eye(len(layout.drives)), one))


def robustness(
    knowledge: Knowledge, sound: ThrowSet, objects: ThrowSet, *, draws: int = 2
) -> dict[str, dict[str, float]]:
    """Return false alarms without a history at 1/1,000, and what is seen of objects.

    Parameters
    ----------
    knowledge : Knowledge
        As it is: it does not know that errors differ.
    sound, objects : ThrowSet
        Of switches that it never saw.
    draws : int
        Uses of each sound throw.
    """
    view = make_view(knowledge)
    calibrated = knowledge.calibration(part=CYCLE, history=0)
    assert calibrated is not None
    threshold = calibrated.thresholds["0.001"]
    held = objects.of(objects.force > TOUCH_FORCE)
    middle = np.abs(held.x - knowledge.setting.places["sleeper 6"]) < 0.3
    found = {}
    for name in (*CASES, *KERNELS):
        errors = errors_of_case(knowledge, name, 41, len(found))
        alarms = np.array(
            [alarms_of(view, measured_by_switch(sound, errors)) > threshold for _ in range(draws)]
        )
        seen = alarms_of(view, measured_by_switch(held, errors)) > threshold
        by_switch = [alarms[:, sound.switch == own].ravel() for own in np.unique(sound.switch)]
        found[name] = false_alarm_limits(by_switch) | {
            "seen": float(seen.mean()),
            "a90 at sleeper 6": a90(held.size[middle], seen[middle]),
        }
    return found


def errors_of_case(knowledge: Knowledge, name: str, *seed: int) -> Errors:
    """Return what draws the errors of one of `CASES` or `KERNELS`."""
    usual: Allowances = knowledge.setting.allowances
    drawn = knowledge.errors(replace(usual, **CASES.get(name, {})))  # type: ignore[arg-type]
    if name in KERNELS:
        more = besides(knowledge.layout, KERNELS[name])
        drawn = replace(drawn, changing=drawn.changing + more)
    return Errors(drawn, part=knowledge.layout.part, rng=np.random.default_rng(seed))


def robustness_known(
    knowledge: Knowledge,
    sound: ThrowSet,
    objects: ThrowSet,
    *,
    history: int = 20,
    switches: int = 10,
    draws: int = 10,
) -> dict[str, dict[str, float]]:
    """Return what is said after a history whose throws have these errors too.

    Parameters
    ----------
    knowledge : Knowledge
        As it is: what it knows of the errors it has from the history.
    sound, objects : ThrowSet
        Of switches that it never saw, each thrown as often.
    history : int
        Throws known.
    switches : int
        The first of them are judged.
    draws : int
        Uses of each later sound throw.

    Returns
    -------
    dict
        For each case throws, alarms and unknown deviations of sound throws, share of touched
        objects that are called, median and largest scatter.
    """
    population = make_view(knowledge)
    first = int(np.bincount(sound.switch).max())
    found = {}
    for name in (*CASES, *KERNELS):
        said: dict[str, list[str]] = {"sound": [], "object": []}
        scatter = []
        for switch in range(switches):
            errors = errors_of_case(knowledge, name, 43, len(found), switch)
            own, fixed = sound.of(sound.switch == switch), errors.of_switches(1)
            known, later = (own.of((own.row % first < history) == early) for early in (True, False))
            rows = known.features + fixed + errors.of_throws(known.rates)
            expected = learn_history(knowledge, rows, view=population)
            scatter.append(expected.scatter)
            view = make_view(knowledge, known=expected)
            held = objects.of((objects.switch == switch) & (objects.force > TOUCH_FORCE))
            for kind, throws, uses in (("sound", later, draws), ("object", held, 1)):
                drawn = [throws.features + errors.of_throws(throws.rates) for _ in range(uses)]
                verdicts = verdicts_on(knowledge, view, fixed + np.concatenate(drawn), rate=1e-3)
                said[kind] += [item.status for item in verdicts]
        found[name] = {
            "throws": float(len(said["sound"])),
            "alarms": float(said["sound"].count(ALARM)),
            "unknown": float(said["sound"].count(UNKNOWN)),
            "objects": float(len(said["object"])),
            "seen": said["object"].count(ALARM) / len(said["object"]),
            "scatter": float(np.median(scatter)),
            "largest scatter": max(scatter),
        }
    return found
