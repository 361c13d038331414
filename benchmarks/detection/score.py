"""Score verdicts: every figure of merit of the benchmark for one method."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.detection.data import Side
from benchmarks.detection.definition import EQUAL, HARD, MID_SPAN, OBJECT, SOUND
from benchmarks.detection.method import object_touched
from benchmarks.detection.metrics import (
    Accuracy,
    Detectable,
    Rate,
    accuracy,
    auroc,
    calibration_error,
    clustered_rate,
    detectable,
    macro_f1,
    weighted_a90,
)
from benchmarks.detection.verdicts import Verdicts
from turnout.study.defects import DEFECTS

Floats = NDArray[np.float64]

OBVIOUS = 25e-3
"""Size that every method must see at its best place [m]."""
KNOWN_PLACE = {
    0: (0.7, 1.7, 4.1, 7.3, 10.2, 12.4, 13.1, 11.2, 9.0, 6.1, 4.3, 3.4, 3.4),
    20: (0.6, 1.0, 3.1, 6.1, 8.7, 10.5, 11.1, 10.1, 7.7, 5.6, 4.0, 3.1, 3.1),
}
"""a90 of the bound at a known place on the default panel by history, 5 % discrepancy, from Drive 1
to Drive 2 [mm]; from docs/evidence/blind-zones.md."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Figures of merit of one method under one set of conditions.

    Attributes
    ----------
    false_alarms, rare_alarms : Rate or None
        Of sound throws, at thresholds meant for 1 in 1,000 and in 10,000 [-].
    other_alarms : mapping of str to Rate
        Of throws with another cause that are called an object [-].
    place, kind : mapping of str to Detectable
        a90 by place, of stones and metal; by kind, sleepers 4 to 8.
    equal_place : mapping of str to float
        a90 by place where exactly 1 in 1,000 of the sound test throws is called, by the probit
        curve of `weighted_a90` [m].
    mid_span, equal_mid_span : float
        Mean a90 of sleepers 4 to 8 [m].
    excess : mapping of str to float
        a90 less that of the bound at a known place [m].
    obvious : tuple
        Best place, share of objects from 25 mm on that is called there, and their number.
    gap : mapping of str to Accuracy
        Virtual sensors, by position, of throws without and with an object.
    x, size : Accuracy or None
        Of objects that were called.
    macro_f1, unknown_auroc, calibration : float
        NaN where nothing is said [-].
    """

    false_alarms: Rate
    rare_alarms: Rate | None
    other_alarms: Mapping[str, Rate]
    place: Mapping[str, Detectable]
    kind: Mapping[str, Detectable]
    equal_place: Mapping[str, float]
    mid_span: float
    equal_mid_span: float
    excess: Mapping[str, float]
    obvious: tuple[str, float, int]
    gap: Mapping[str, Accuracy] = field(default_factory=dict)
    x: Accuracy | None = None
    size: Accuracy | None = None
    macro_f1: float = float("nan")
    unknown_auroc: float = float("nan")
    calibration: float = float("nan")


def places_in_order(side: Side) -> list[str]:
    """Return the places of objects from the toe on."""
    place = side.labels["place"]
    names = [str(name) for name in np.unique(place) if name]
    return sorted(names, key=lambda name: float(np.nanmean(side.labels["x"][place == name])))


def score_verdicts(verdicts: Verdicts, side: Side, *, history: int) -> Score:
    """Score verdicts on the judged test throws.

    Parameters
    ----------
    verdicts : Verdicts
        In the order of `side`.
    side : Side
        Judged test throws; what was recorded of them is not needed.
    history : int
        Sound throws that were known of each switch.
    """
    role, groups = side.labels["role"], side.groups
    sound = role == SOUND
    level = float(np.quantile(verdicts.score[sound], 1.0 - EQUAL, method="higher"))
    places = places_in_order(side)
    found = {name: _at(side, verdicts.alarm, name) for name in places}
    equal = {name: _equal_at(side, verdicts.score > level, name) for name in places}
    middle = np.isin(side.labels["place"], MID_SPAN)
    kinds = {}
    for kind in np.unique(side.labels["kind"][role == OBJECT]):
        own = middle & (side.labels["kind"] == kind)
        kinds[str(kind)] = detectable(
            side.labels["size"][own], verdicts.alarm[own], groups[own], grouped=False
        )
    others = {
        str(name): clustered_rate(verdicts.alarm[role == name], groups[role == name])
        for name in np.unique(role) if name not in (SOUND, OBJECT)
    }  # fmt: skip
    rare = verdicts.rare_alarm
    return Score(
        false_alarms=clustered_rate(verdicts.alarm[sound], groups[sound]),
        rare_alarms=None if rare is None else clustered_rate(rare[sound], groups[sound]),
        other_alarms=others,
        place=found,
        kind=kinds,
        equal_place=equal,
        mid_span=_mean_of({name: item.a90 for name, item in found.items()}),
        equal_mid_span=_mean_of(equal),
        excess=_excess(found, places, history),
        obvious=obvious_share(side, verdicts.alarm, places),
        **_said(side, verdicts),
    )


def _hard_at(side: Side, place: str) -> NDArray[np.bool_]:
    return np.asarray((side.labels["place"] == place) & np.isin(side.labels["kind"], HARD))


def _at(side: Side, alarm: NDArray[np.bool_], place: str) -> Detectable:
    own = _hard_at(side, place)
    return detectable(side.labels["size"][own], alarm[own], side.groups[own])


def _equal_at(side: Side, called: NDArray[np.bool_], place: str) -> float:
    own = _hard_at(side, place)
    once = np.ones((1, int(own.sum())))
    return weighted_a90(side.labels["size"][own], called[np.newaxis, own], once).item()


def _mean_of(found: Mapping[str, float]) -> float:
    own = [found[name] for name in MID_SPAN if name in found]
    return float(np.mean(own)) if own else float("nan")


def _excess(found: Mapping[str, Detectable], places: list[str], history: int) -> dict[str, float]:
    bound = KNOWN_PLACE.get(history)
    if bound is None or len(bound) != len(places):
        return {}
    return {name: found[name].a90 - 1e-3 * a90
            for name, a90 in zip(places, bound, strict=True)}  # fmt: skip


def obvious_share(
    side: Side, alarm: NDArray[np.bool_], places: list[str]
) -> tuple[str, float, int]:
    """Return the place at which most obvious objects are called, that share, and their number."""
    best = ("", -1.0, 0)
    for name in places:
        own = (side.labels["place"] == name) & (side.labels["size"] >= OBVIOUS)
        own &= np.isin(side.labels["kind"], HARD)
        if own.any() and (float(alarm[own].mean()), int(own.sum())) > best[1:]:
            best = (name, float(alarm[own].mean()), int(own.sum()))
    return best


def _said(side: Side, verdicts: Verdicts) -> dict[str, Any]:
    """Return figures of merit of the optional columns of verdicts."""
    role = side.labels["role"]
    sound, touched = role == SOUND, object_touched(side)
    found: dict[str, Any] = {}
    unknown = np.isin(role, [name for name, d in DEFECTS.items() if not d.trained])
    called = touched & verdicts.alarm
    if verdicts.x is not None:
        found["x"] = accuracy(verdicts.x[called], side.labels["x"][called])
    if verdicts.size is not None:
        found["size"] = accuracy(verdicts.size[called], side.labels["size"][called])
    if verdicts.gap is not None:
        found["gap"] = {
            f"{name}, {text}": accuracy(verdicts.gap[own, at], side.gaps[own, at])
            for at, name in enumerate(side.positions)
            for text, own in (("sound", sound), ("object", touched))
        }
    if verdicts.cause is not None:
        own = ~unknown & (touched | (role != OBJECT))
        names = [str(name) for name in np.unique(role[own])]
        found["macro_f1"] = macro_f1(role[own].tolist(), verdicts.cause[own].tolist(), names)
    if verdicts.novelty is not None:
        found["unknown_auroc"] = auroc(verdicts.novelty[unknown], verdicts.novelty[sound])
    if verdicts.probability is not None:
        # an object is as likely as none: throws with one count as much as those without
        own = touched | (role != OBJECT)
        said, true = verdicts.probability[own], touched[own]
        rng = np.random.default_rng(0)
        count = min(int(true.sum()), int((~true).sum()))
        rows = np.concatenate([rng.permutation(np.flatnonzero(kind))[:count]
                               for kind in (true, ~true)])  # fmt: skip
        found["calibration"] = calibration_error(said[rows], true[rows])
    return found
