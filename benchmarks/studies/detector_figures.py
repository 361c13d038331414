"""Figures of a detector on throws of switches that it never saw."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.studies.detector_unknown import Scores, left_out_scores
from turnout.core.files import write_atomic
from turnout.detection.alarm_threshold import share_interval
from turnout.detection.detector.calibrating import AT_ONCE, Errors, alarms_of, learn_history
from turnout.detection.detector.judging import CYCLE, View, evidence_of, make_view
from turnout.detection.detector.knowledge import Knowledge
from turnout.detection.detector.object_posterior import Interval
from turnout.detection.detector.throw_set import ThrowSet
from turnout.detection.detector.throw_verdict import ALARM, Change, Gap, Verdict, verdict_on
from turnout.detection.detector.training_plan import HISTORY, OBJECT, SOUND
from turnout.detection.floor import TOUCH_FORCE

Floats = NDArray[np.float64]
RESAMPLES = 200
LIMIT_RESAMPLES = 1000
"""Switches drawn with replacement that the upper limit of a90 rests on."""


@dataclass(slots=True)
class Judged:
    """Verdicts, each with the truth of its throw."""

    kind: list[str] = field(default_factory=list)
    switch: list[int] = field(default_factory=list)
    size: list[float] = field(default_factory=list)
    x: list[float] = field(default_factory=list)
    touched: list[bool] = field(default_factory=list)
    gaps: list[Floats] = field(default_factory=list)
    change: list[float] = field(default_factory=list)
    verdict: list[Verdict] = field(default_factory=list)

    def of(self, kind: str) -> NDArray[np.intp]:
        """Return which throws are of a kind."""
        return np.flatnonzero(np.array(self.kind) == kind)

    def alarms(self, which: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return which of some throws are alarms."""
        return np.array([self.verdict[i].alarm for i in which], dtype=bool)

    def add(
        self, kind: str, throws: ThrowSet, verdicts: Sequence[Verdict], *, change: Floats
    ) -> None:
        """Add verdicts on throws of a kind, with the changes of each (`changes_of`)."""
        for number, verdict in enumerate(verdicts):
            self.kind.append(kind)
            self.switch.append(int(throws.switch[number]))
            self.size.append(float(throws.size[number]))
            self.x.append(float(throws.x[number]))
            self.touched.append(bool(throws.force[number] > TOUCH_FORCE))
            self.gaps.append(throws.gaps[number])
            self.change.append(float(change[number]))
            self.verdict.append(verdict)

    def record(self) -> dict[str, list[Any]]:
        """Return it as lists that JSON can hold."""
        found = {name: getattr(self, name) for name in self.__slots__}
        found["gaps"] = [item.tolist() for item in self.gaps]
        found["verdict"] = [asdict(item) for item in self.verdict]
        return found

    def extend(self, record: Mapping[str, list[Any]]) -> None:
        """Add the verdicts of a `record`."""
        for name in self.__slots__:
            values = record[name]
            if name == "gaps":
                values = [np.array(item) for item in values]
            if name == "verdict":
                values = [verdict_of(item) for item in values]
            getattr(self, name).extend(values)


def verdict_of(record: Mapping[str, Any]) -> Verdict:
    """Return a verdict from its fields as JSON keeps them."""
    given = dict(record)
    given["gaps"] = tuple(Gap(**item) for item in given["gaps"])
    given["changes"] = tuple(Change(**item) for item in given["changes"])
    for name in ("x", "size"):
        given[name] = None if given[name] is None else Interval(**given[name])
    return Verdict(**given)


def measured_by_switch(throws: ThrowSet, errors: Errors) -> Floats:
    """Return features as if measured, with errors that are the same in all throws of a switch."""
    fixed = errors.of_switches(int(throws.switch.max()) + 1)[throws.switch]
    return np.asarray(throws.features + fixed + errors.of_throws(throws.rates))


def alone_of(sets: Mapping[str, ThrowSet], *, known: int = 20) -> dict[str, ThrowSet]:
    """Return throws that are judged after a history, by kind, to be judged without one."""
    sound = sets[HISTORY]
    first = int(np.bincount(sound.switch).max())
    found = {SOUND: sound.of(sound.row % first >= known)}
    return found | {
        name.removeprefix(f"{HISTORY}, "): item
        for name, item in sets.items()
        if name.startswith(f"{HISTORY}, ")
    }


def of_each_switch(
    switches: NDArray[np.intp], folder: Path, work: Callable[[int], Mapping[str, list[Any]]]
) -> list[dict[str, list[Any]]]:
    """Return the results of each switch, kept in a folder so that a stopped run goes on."""
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for done, switch in enumerate(switches.tolist(), 1):
        path = folder / f"{switch}.json"
        if not path.exists():
            write_atomic(path, json.dumps(work(switch)).encode())
            if done % 20 == 0:
                print(f"{folder.name}: {done} of {len(switches)} switches", flush=True)
        found.append(json.loads(path.read_text()))
    return found


def verdicts_on(
    knowledge: Knowledge, view: View, features: Floats, *, rate: float
) -> list[Verdict]:
    """Judge throws by their features."""
    calibrated = knowledge.calibration(part=view.part, history=view.history)
    assert calibrated is not None, "the detector has thresholds"
    found = []
    for first in range(0, len(features), AT_ONCE):
        rows = features[first : first + AT_ONCE]
        evidence = evidence_of(view, rows)
        found += [
            verdict_on("", view, evidence, i, knowledge=knowledge, calibrated=calibrated, rate=rate)
            for i in range(len(rows))
        ]
    return found


def with_true_gaps(throws: ThrowSet, errors: Errors) -> ThrowSet:
    """Return throws whose end gaps differ from the simulated ones as is assumed."""
    (gaps,) = errors.true_gaps(throws, 1)
    return replace(throws, gaps=gaps)


def judge_alone(
    knowledge: Knowledge,
    sets: Mapping[str, ThrowSet],
    *,
    rate: float = 1e-3,
    draws: int = 2,
    part: str = CYCLE,
    seed: int = 5,
) -> Judged:
    """Judge throws without a history, each several times with other errors.

    What the errors keep is drawn for each switch.
    """
    errors = drawn_errors(knowledge, seed)
    view = make_view(knowledge, part=part)
    judged = Judged()
    for kind, throws in sets.items():
        if kind.startswith("history"):
            continue
        change = changes_of(throws, sets.get("sound", throws), knowledge)
        for _ in range(draws):
            features = measured_by_switch(throws, errors)
            said = verdicts_on(knowledge, view, features, rate=rate)
            judged.add(kind, with_true_gaps(throws, errors), said, change=change)
    return judged


@dataclass(frozen=True, slots=True, kw_only=True)
class Uses:
    """How often each throw after a history is used, with other errors.

    Attributes
    ----------
    verdicts : int
        For a whole verdict.
    sound, causes : int
        For the alarm alone, of sound throws, and of dry chairs and adjustments.
    unknown : bool
        Whether each cause is left out in turn as well.
    """

    verdicts: int = 1
    sound: int = 50
    causes: int = 10
    unknown: bool = True


def judge_with_history(
    knowledge: Knowledge,
    sets: Mapping[str, ThrowSet],
    folder: Path,
    *,
    history: int = 20,
    rate: float = 1e-3,
    uses: Uses = Uses(),  # noqa: B008 - frozen
    seed: int = 6,
) -> tuple[Judged, list[dict[str, list[float]]], list[Scores]]:
    """Judge throws of switches whose first throws are known.

    Returns
    -------
    judged : Judged
        Whole verdicts.
    ratios : list of dict
        For each switch the log likelihood ratios of further uses, by kind.
    unknown : list of dict
        For each switch how badly throws fit when their cause is left out.
    """
    population = make_view(knowledge)
    calibrated = knowledge.calibration(part=CYCLE, history=history)
    assert calibrated is not None
    sound = sets[HISTORY]
    first = int(np.bincount(sound.switch).max())

    def of_switch(switch: int) -> dict[str, Any]:
        errors = drawn_errors(knowledge, seed, switch)
        own, fixed = sound.of(sound.switch == switch), errors.of_switches(1)
        known = own.of(own.row % first < history)
        expected = learn_history(
            knowledge, known.features + fixed + errors.of_throws(known.rates), view=population
        )
        view = make_view(knowledge, known=expected)
        judged, ratios = Judged(), {}
        measured: dict[str, tuple[Floats, Floats]] = {}
        for name, item in sets.items():
            kind = SOUND if name == HISTORY else name.removeprefix(f"{HISTORY}, ")
            if not name.startswith(HISTORY):
                continue
            mine = item.of(item.switch == switch)
            if name == HISTORY:
                mine = mine.of(mine.row % first >= history)
            change = changes_of(mine, own, knowledge)
            for _ in range(uses.verdicts):
                features = mine.features + fixed + errors.of_throws(mine.rates)
                said = verdicts_on(knowledge, view, features, rate=rate)
                judged.add(kind, with_true_gaps(mine, errors), said, change=change)
            if len(mine.row):
                held = mine.force > TOUCH_FORCE if kind == OBJECT else np.full(len(change), True)
                measured[kind] = features[held], change[held]
            again = uses.sound if kind == SOUND else uses.causes
            if again and len(mine.row) and kind in (SOUND, "dry chairs", "adjustment"):
                rows = [mine.features + fixed + errors.of_throws(mine.rates) for _ in range(again)]
                found = alarms_of(view, np.concatenate(rows)).tolist()
                ratios[kind] = found
                if kind == "dry chairs":
                    for label, part in dry_by_friction(np.tile(mine.level, again)).items():
                        ratios[label] = np.array(found)[part].tolist()
        unknown = left_out_scores(knowledge, view, calibrated, measured) if uses.unknown else {}
        return {"judged": judged.record(), "ratios": ratios, "unknown": unknown}

    found = of_each_switch(np.unique(sound.switch), folder, of_switch)
    whole = Judged()
    for item in found:
        whole.extend(item["judged"])
    return whole, [item["ratios"] for item in found], [item["unknown"] for item in found]


def dry_by_friction(level: Floats) -> dict[str, NDArray[np.bool_]]:
    """Return which throws are from low and which from high friction."""
    return {
        "dry chairs, low friction": level < MIDDLE,
        "dry chairs, high friction": level >= MIDDLE,
    }


MIDDLE = 0.3
"""Friction level that parts low from high [-]."""


def changes_of(throws: ThrowSet, sound: ThrowSet, knowledge: Knowledge) -> Floats:
    """Return how much causes change the forces at most, in shares of the drive's amplitude [-].

    NaN where the paired sound throw did not end; 0 of sound throws.
    """
    scale = knowledge.setting.amplitude[knowledge.layout.drive]
    rows = {int(row): number for number, row in enumerate(sound.row)}
    found = []
    for features, partner in zip(throws.features, throws.partner, strict=True):
        at = rows.get(int(partner))
        if partner < 0:
            found.append(0.0)
        elif at is None:
            found.append(np.nan)
        else:
            found.append(float(np.abs((features - sound.features[at]) / scale).max()))
    return np.array(found)


def drawn_errors(knowledge: Knowledge, *seed: int) -> Errors:
    """Return a source of errors of measured throws, as large as the detector assumes."""
    rng = np.random.default_rng([*seed, 12])
    return Errors(knowledge.errors(), part=knowledge.layout.part, rng=rng)


# ---- figures


def a90(size: Floats, seen: NDArray[np.bool_]) -> float:
    """Return the size that is seen in nine of ten throws, by logistic regression on its logarithm.

    At least the smallest size that was thrown: below it nothing is known.

    Examples
    --------
    >>> sizes = np.linspace(1e-3, 20e-3, 400)
    >>> bool(abs(a90(sizes, sizes > 10e-3) - 10e-3) < 0.3e-3)
    True
    """
    if seen.all():
        return float(size.min())
    z, sign = np.log(size * 1e3), np.where(seen, 1.0, -1.0)

    def cost(p: Floats) -> float:
        gain = np.exp(np.clip(p[1], -3.0, 5.0))
        return float(np.logaddexp(0.0, -sign * gain * (z - p[0])).sum() + 0.01 * p[1] ** 2)

    found = minimize(cost, [float(np.median(z)), 1.0], method="Nelder-Mead")
    gain = np.exp(np.clip(found.x[1], -3.0, 5.0))
    return max(float(size.min()), 1e-3 * float(np.exp(found.x[0] + np.log(9.0) / gain)))


def weighted_a90(size: Floats, seen: NDArray[np.bool_], weights: NDArray[Any]) -> Floats:
    """Return `a90` for many weights of the same throws [m].

    Scoring with Levenberg's damping, all weights at once: eta = g (z - p), g = exp(q), and the
    expected second derivatives of the cost by (p, q) are those of eta, (-g, eta).

    Parameters
    ----------
    size, seen : ndarray, shape (n,)
        Of the throws [m].
    weights : ndarray, shape (n_weights, n)
        How often each counts.

    Examples
    --------
    >>> sizes = np.linspace(1e-3, 20e-3, 400)
    >>> seen = sizes + 2e-3 * np.sin(999 * np.arange(400)) > 10e-3
    >>> found = weighted_a90(sizes, seen, np.ones((1, 400)))[0]
    >>> bool(abs(found - a90(sizes, seen)) < 1e-5)
    True
    """
    z, sign = np.log(size * 1e3), np.where(seen, 1.0, -1.0)
    count = len(weights)

    def cost(p: Floats, q: Floats) -> Floats:
        eta = np.exp(np.clip(q, -3.0, 5.0))[:, np.newaxis] * (z - p[:, np.newaxis])
        return np.asarray((weights * np.logaddexp(0.0, -sign * eta)).sum(axis=1) + 0.01 * q**2)

    p, q, damping = np.full(count, float(np.median(z))), np.ones(count), np.full(count, 1.0)
    best = cost(p, q)
    for _ in range(STEPS):
        gain = np.exp(np.clip(q, -3.0, 5.0))[:, np.newaxis]
        eta = gain * (z - p[:, np.newaxis])
        away = -sign * weights / (1.0 + np.exp(np.clip(sign * eta, -500.0, 500.0)))
        spread = weights / (2.0 + 2.0 * np.cosh(np.clip(eta, -500.0, 500.0)))
        slope_p, slope_q = (-gain * away).sum(axis=1), (eta * away).sum(axis=1) + 0.02 * q
        pp = (gain**2 * spread).sum(axis=1) + damping
        pq = (-gain * eta * spread).sum(axis=1)
        qq = (eta**2 * spread).sum(axis=1) + 0.02 + damping
        both = pp * qq - pq**2
        new_p = p - (qq * slope_p - pq * slope_q) / both
        new_q = np.clip(q - (pp * slope_q - pq * slope_p) / both, -3.0, 5.0)
        tried = cost(new_p, new_q)
        better = tried <= best
        p, q = np.where(better, new_p, p), np.where(better, new_q, q)
        best = np.where(better, tried, best)
        damping = np.clip(np.where(better, 0.2 * damping, 5.0 * damping), 1e-9, 1e9)
    found = 1e-3 * np.exp(p + np.log(9.0) / np.exp(q))
    all_seen = (weights[:, ~seen] == 0).all(axis=1)
    smallest = np.where(weights > 0, size, np.inf).min(axis=1)
    return np.where(all_seen, smallest, np.maximum(found, smallest))


STEPS = 40
"""Of the search for a90 with weights; most need some twenty."""


def a90_of_places(
    judged: Judged,
    places: Mapping[str, float],
    *,
    threshold: float | None = None,
    seed: int = 1,
) -> dict[str, tuple[float, float, int, int]]:
    """Return a90 and its upper 95 % limit over drawn switches [m], throws and misses at each place.

    By the alarms, or by log ratios above another threshold. Where none is missed a90 is the
    smallest size that was thrown: it is no larger than that.
    """
    own = judged.of("object")
    x, size = np.array(judged.x)[own], np.array(judged.size)[own]
    seen, switch = judged.alarms(own), np.array(judged.switch)[own]
    if threshold is not None:
        seen = np.array([judged.verdict[i].log_ratio > threshold for i in own])
    near = np.abs(x[:, np.newaxis] - np.array(list(places.values()))).argmin(axis=1)
    rng = np.random.default_rng(seed)
    found = {}
    for number, name in enumerate(places):
        mine = np.flatnonzero(near == number)
        if mine.size < 10:
            continue
        numbers, group = np.unique(switch[mine], return_inverse=True)
        drawn = rng.multinomial(numbers.size, [1.0 / numbers.size] * numbers.size, LIMIT_RESAMPLES)
        several = weighted_a90(size[mine], seen[mine], drawn[:, group])
        limit = float(np.quantile(several, 0.95))
        missed = int(np.count_nonzero(~seen[mine]))
        found[name] = (a90(size[mine], seen[mine]), limit, mine.size, missed)
    return found


def false_alarms(judged: Judged, kind: str = "sound") -> dict[str, float]:
    """Return the share of throws of a kind that are called an object, with its upper limit."""
    own = judged.of(kind)
    alarm, switch = judged.alarms(own), np.array(judged.switch, dtype=np.intp)[own]
    return false_alarm_limits([alarm[switch == number] for number in np.unique(switch)])


def false_alarm_limits(
    alarms: Sequence[NDArray[np.bool_]] | NDArray[np.bool_], *, uses: int = 1, seed: int = 1
) -> dict[str, float]:
    """Return the share of alarms and its upper 95 % limit.

    The larger of two limits: by switches drawn with replacement, and of as many independent throws
    (Clopper and Pearson 1934), which counts where the former knows too few alarms.

    Parameters
    ----------
    alarms : sequence of ndarray
        Whether each throw of a switch is an alarm, by switch.
    uses : int
        How often each throw is used: of so many fewer throws the states differ.

    Examples
    --------
    >>> found = false_alarm_limits(np.zeros((100, 30), dtype=bool))
    >>> round(1e3 * found["upper"], 2)
    1.0
    """
    called = np.array([np.count_nonzero(item) for item in alarms], dtype=np.float64)
    thrown = np.array([len(item) for item in alarms], dtype=np.float64)
    throws, total = float(thrown.sum()), float(called.sum())
    if not throws:
        return dict.fromkeys(("throws", "distinct", "switches", "alarms", "share", "upper"), 0.0)
    rng = np.random.default_rng(seed)
    drawn = rng.integers(0, len(called), (RESAMPLES * 5, len(called)))
    shares = called[drawn].sum(axis=1) / thrown[drawn].sum(axis=1)
    exact = float(share_interval(total, int(throws), tail=0.05)[1])
    return {
        "throws": throws,
        "distinct": throws / uses,
        "switches": float(len(called)),
        "alarms": total,
        "share": total / throws,
        "upper": max(float(np.quantile(shares, 0.95)), exact),
    }


def gap_figures(judged: Judged, kind: str, names: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return error and coverage of virtual gaps [m, -], and how gaps above it are reported."""
    own = judged.of(kind)
    if kind == "object":
        own = own[np.array(judged.touched)[own]]
    found = {}
    for number, name in enumerate(names):
        gaps = [judged.verdict[i].gaps[number] for i in own]
        truth = np.array([judged.gaps[i][number] for i in own])
        middle = np.array([gap.middle for gap in gaps])
        inside = [gap.low <= t <= gap.high for gap, t in zip(gaps, truth, strict=True)]
        above = truth >= gaps[0].limit + 2e-3
        called = np.array([gap.called for gap in gaps])
        below = truth <= gaps[0].limit - 2e-3
        found[name] = {
            "median_error": float(np.median(np.abs(middle - truth))),
            "coverage": float(np.mean(inside)),
            "above": float(above.sum()),
            "called": float(called[above].mean()) if above.any() else float("nan"),
            "called_below": float(called[below].mean()) if below.any() else float("nan"),
        }
    return found


def object_figures(judged: Judged, places: Mapping[str, float]) -> dict[str, float]:
    """Return errors of place and size of detected objects [m], and coverage of their intervals."""
    own = [i for i in judged.of("object") if judged.verdict[i].status == ALARM]
    off, wrong, inside, within, around = [], [], [], [], []
    for i in own:
        verdict = judged.verdict[i]
        assert verdict.size is not None
        assert verdict.x is not None
        off.append(abs(verdict.x.middle - judged.x[i]))
        wrong.append(abs(verdict.size.middle - judged.size[i]))
        inside.append(_holds(verdict.size, judged.size[i]))
        around.append(_holds(verdict.x, judged.x[i]))
        near = min(places, key=lambda name: abs(places[name] - judged.x[i]))
        within.append(near in verdict.places)
    return {
        "detected": float(len(own)),
        "place_median": float(np.median(off)),
        "place_90": float(np.quantile(off, 0.9)),
        "place_in_set": float(np.mean(within)),
        "place_coverage": float(np.mean(around)),
        "size_median": float(np.median(wrong)),
        "size_90": float(np.quantile(wrong, 0.9)),
        "size_coverage": float(np.mean(inside)),
    }


def _holds(interval: Interval, value: float) -> bool:
    return interval.low <= value <= interval.high


def cause_figures(judged: Judged, kinds: Sequence[str], *, least: float = 0.0) -> dict[str, object]:
    """Return how throws are named, and the macro-F1 of those of the given kinds that occur.

    Parameters
    ----------
    judged : Judged
        Verdicts.
    kinds : sequence of str
        Those counted.
    least : float
        Smallest change of a drive force that a cause or object must make, in shares of the
        amplitude: the severity [-].
    """
    table: dict[str, dict[str, int]] = {}
    for i, kind in enumerate(judged.kind):
        if kind not in kinds or (kind == "object" and not judged.touched[i]):
            continue
        if kind != "sound" and not judged.change[i] >= least:
            continue
        said = name_of(judged.verdict[i])
        table.setdefault(kind, {})
        table[kind][said] = table[kind].get(said, 0) + 1
    scores = []
    for kind in kinds:
        hits = table.get(kind, {}).get(kind, 0)
        said = sum(row.get(kind, 0) for row in table.values())
        true = sum(table.get(kind, {}).values())
        scores.append(2.0 * hits / (said + true) if true else float("nan"))
    return {"table": table, "macro_f1": float(np.nanmean(scores))}


def name_of(verdict: Verdict) -> str:
    """Return the name of a verdict: its cause, "object", "sound" or "unknown deviation"."""
    if verdict.status != "other cause":
        return verdict.status
    return verdict.cause
