"""The verdict on one throw: alarm, place, size, gaps, cause, and what to do next."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from turnout.detection.detector.judging import (
    Ratios,
    View,
    level_of,
    ratios_of,
    support_of,
    unexplained,
)
from turnout.detection.detector.knowledge import RESIDUAL_LEVELS, Calibrated, Knowledge
from turnout.detection.detector.object_kinds import kinds_in_words
from turnout.detection.detector.object_posterior import (
    NEGLIGIBLE,
    EndGaps,
    Interval,
    TrappedObject,
    gaps_of,
    object_of,
    objects_near,
)
from turnout.detection.detector.throw_layout import CLOSING
from turnout.detection.likelihood import Evidence, log_sum
from turnout.study.defects import DEFECTS

Floats = NDArray[np.float64]

SOUND, ALARM, CAUSE = "sound", "object", "other cause"
UNKNOWN, CANNOT, OBJECTS = "unknown deviation", "cannot judge", "cannot judge objects"
NOT_VERIFIED = "not verified for recordings"
"""Reason not to judge current or power but from exact onsets: training counts from the command, and
recordings begin with the inrush, 0.06 s later, beyond the 40 ms of the alignment."""
OPEN_ADVICE = "check lock and end positions before trains pass: a gap is inferred above its limit"
MOST_SAID = 3
"""Causes whose odds are said in words."""

ADVICE = {
    SOUND: "nothing",
    ALARM: "throw again; if it is called again, inspect the place before trains pass",
    CAUSE: "no object is needed to explain it; maintenance at the next opportunity",
    UNKNOWN: "fits neither a sound switch nor a known cause: throw again, then inspect",
    CANNOT: "record again; the throw counts as not supervised",
}
NOT_SUPERVISED = "the throw counts as not supervised"
UNVERIFIED_ADVICE = f"judge the forces of the drives; {NOT_SUPERVISED}"
START_ADVICE = f"make one whole throw, then record the next one; {NOT_SUPERVISED}"
FAULT_ADVICE = {
    "other speed": "check supply, sampling rate, and whether the panel has the durations of these "
    "drives; until then an object may go unnoticed",
    "force sensor": "check gain and zero of the force sensor; until then an object may go "
    "unnoticed",
}
"""Of causes that are no defects of the switch."""

UNKNOWN_SHARE = 1e-4
"""Share of throws that fit worse than any hypothesis explains, from which on that is said [-]."""
NAMED_SHARE = 1e-8
"""The same, below which no cause is named: right ones fit to 1e-6, spikes to 1e-10 [-]."""
SEEN_SHARE = 0.01
"""Change of a drive force that is worth naming, share of its amplitude [-]."""


def advice_on(cause: str, otherwise: str = ADVICE[CAUSE]) -> str:
    """Return what to do about a cause other than an object."""
    return DEFECTS[cause].advice if cause in DEFECTS else FAULT_ADVICE.get(cause, otherwise)


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """A gap at the end of the throw that no sensor measured.

    Attributes
    ----------
    name : str
        Of the sensor or drive.
    middle, low, high : float
        Median and 95 % interval [m].
    limit : float
        From which on it is open [m].
    above : float
        Probability that it is above its limit [-].
    called : bool
        Whether it is called above its limit: sooner than at a probability of one half, so that
        gaps clearly above it are called in 97 % at least.
    """

    name: str
    middle: float
    low: float
    high: float
    limit: float
    above: float
    called: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Change of one drive by the most likely cause: of its force, or what else is judged."""

    drive: str
    force: float
    time: float
    unit: str = "N"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Verdict on one throw.

    Attributes
    ----------
    name : str
        Of the recording or movement.
    status : str
        "sound", "object", "other cause", "unknown deviation", "cannot judge" or "cannot judge
        objects".
    reason : str
        Why it or objects cannot be judged; empty otherwise.
    part : str
        "cycle", or "closing" where no opening was recorded.
    history : int
        Sound throws known of the switch.
    false_alarm_rate : float
        At which "object" is said of sound throws [-].
    log_ratio, threshold : float
        Logarithm of the likelihood ratio, object against all else, and the alarm threshold [-].
    odds : mapping of str to float
        Likelihood ratio of each cause against a sound switch [-].
    cause : str
        That other than an object which is named; empty where none is.
    fit : float
        Share of throws that fit their best explanation worse than this one [-].
    friction : float
        Friction level [-].
    peaks : mapping of str to float
        Largest mean force of each drive over a window, whatever its sign [N].
    places : mapping of str to float
        Likeliest places, so many that 90 % of such sets hold the object, with probabilities.
    x, size : Interval or None
        Of the object [m], where there is an alarm.
    kinds : mapping of str to float
        Odds of each kind of object against the likeliest, the first; empty without an alarm [-].
    gaps : tuple of Gap
        Virtual sensors.
    locked, in_control : bool or None
        As inferred from these gaps: none is called above its limit.
    changes : tuple of Change
        Evidence: which drive, how much [N], when after the onset of closing [s].
    excluded : tuple of str
        Causes that explain the throw at most a hundredth as well as the best.
    advice : str
        What to do.
    """

    name: str
    status: str
    reason: str = ""
    part: str = ""
    history: int = 0
    false_alarm_rate: float = float("nan")
    log_ratio: float = float("nan")
    threshold: float = float("nan")
    odds: Mapping[str, float] = field(default_factory=dict)
    cause: str = ""
    fit: float = float("nan")
    friction: float = float("nan")
    peaks: Mapping[str, float] = field(default_factory=dict)
    places: Mapping[str, float] = field(default_factory=dict)
    x: Interval | None = None
    size: Interval | None = None
    kinds: Mapping[str, float] = field(default_factory=dict)
    gaps: tuple[Gap, ...] = ()
    locked: bool | None = None
    in_control: bool | None = None
    changes: tuple[Change, ...] = ()
    excluded: tuple[str, ...] = ()
    advice: str = ""

    @property
    def alarm(self) -> bool:
        """True if an object is called."""
        return self.status == ALARM

    def lines(self) -> list[str]:
        """Return the verdict in words, a few lines."""
        return _verdict_lines(self)


def cannot_judge(name: str, reason: str) -> Verdict:
    """Return the verdict on what cannot be judged, and why."""
    advice = UNVERIFIED_ADVICE if reason.startswith(NOT_VERIFIED) else ADVICE[CANNOT]
    return Verdict(name=name, status=CANNOT, reason=reason, advice=advice)


def verdict_on(
    name: str,
    view: View,
    evidence: Evidence,
    number: int,
    *,
    knowledge: Knowledge,
    calibrated: Calibrated,
    rate: float,
) -> Verdict:
    """Put the verdict on one of some throws together.

    Parameters
    ----------
    name : str
        Of the throw.
    view : View
        That the evidence was weighed with.
    evidence : Evidence
        Of some throws.
    number : int
        Which one.
    knowledge : Knowledge
        Trained.
    calibrated : Calibrated
        Thresholds for this history.
    rate : float
        Of false alarms.
    """
    own = evidence.of_throw(number)
    ratios = ratios_of(view, own)
    log_ratio = float(ratios.alarm[0])
    threshold = calibrated.thresholds[f"{rate:g}"]
    odds = _odds(view, ratios)
    square, irregularity = unexplained(view, own)
    fit = float(share_worse(square, irregularity, calibrated=calibrated)[0])
    cause = named_cause(view, ratios, irregularity, fit, calibrated)
    alarm = log_ratio > threshold
    near = objects_near(view, own, 0) if alarm else None
    end = gaps_of(
        view,
        own,
        0,
        limits=np.array(knowledge.setting.limits),
        factor=calibrated.object_gap_factor if alarm else calibrated.gap_factor,
        near=near,
    )
    widths = {"size_factor": calibrated.size_factor, "x_factor": calibrated.x_factor}
    trapped = None if near is None else object_of(view, own, 0, near=near, **widths)
    gaps = _gaps(knowledge, end, reach=calibrated.gap_reach)
    status = _status(alarm, cause, fit, gaps=gaps)
    best = cause if status == CAUSE else max(odds, key=lambda item: odds[item])
    advice = advice_on(cause) if status == CAUSE else ADVICE[status]
    if any(gap.called for gap in gaps):
        fits = status == UNKNOWN and fit >= UNKNOWN_SHARE
        advice = f"{OPEN_ADVICE}; {'throw again' if fits else advice}"
    return Verdict(
        name=name,
        status=status,
        part=view.part,
        history=view.history,
        false_alarm_rate=rate,
        log_ratio=log_ratio,
        threshold=threshold,
        odds={item: float(np.exp(min(value, 700.0))) for item, value in odds.items()},
        cause=cause if status == CAUSE else "",
        fit=fit,
        friction=float(level_of(view, own, levels=knowledge.model.level)[0]),
        places=_places(knowledge, trapped, level=calibrated.place_level) if trapped else {},
        x=trapped.x if trapped else None,
        size=trapped.size if trapped else None,
        kinds=view.object_kinds.odds_of(own, 0) if trapped and view.object_kinds else {},
        gaps=gaps,
        locked=_below(gaps, "drive "),
        in_control=_below(gaps, "sensor "),
        changes=_changes(knowledge, view, own, best) if status != SOUND else (),
        excluded=_excluded(odds, best),
        advice=advice,
    )


def _odds(view: View, ratios: Ratios) -> dict[str, float]:
    """Return log likelihood ratios of one throw against a sound switch, of causes to be named."""
    found = {"object": float(ratios.object[0])}
    identifiable = view.identifiable
    for at, name in enumerate(view.kinds[view.objects :]):
        if identifiable[at]:
            found[name] = float(ratios.cause[at, 0])
    return found


def named_cause(
    view: View, ratios: Ratios, irregularity: Floats, fit: float, calibrated: Calibrated
) -> str:
    """Return the cause with most support of those that have enough to be named; empty without.

    None is named that explains the throw no better than a sound switch, or in a throw that is far
    from everything. What is more irregular than in any sound throw speaks for no dry chairs.
    """
    counted = irregularity if fit >= UNKNOWN_SHARE else np.zeros_like(irregularity)
    support = support_of(view, ratios, counted)[:, 0]
    enough = {
        name: float(support[at])
        for at, name in enumerate(view.kinds[view.objects :])
        if view.identifiable[at]
        and fit >= NAMED_SHARE
        and ratios.cause[at, 0] > 0.0
        and support[at] > calibrated.cause_thresholds.get(name, np.inf)
    }
    return max(enough, key=lambda name: enough[name], default="")


def _status(alarm: bool, cause: str, fit: float, *, gaps: tuple[Gap, ...]) -> str:
    if alarm or cause:
        return ALARM if alarm else CAUSE
    return UNKNOWN if fit < UNKNOWN_SHARE or any(gap.called for gap in gaps) else SOUND


def share_worse(square: Floats, irregularity: Floats, *, calibrated: Calibrated) -> Floats:
    """Return the share of sound throws that fit their best explanation worse.

    The smaller of the shares that leave more, times 5, and that are more irregular, times 5/4: two
    tests at 0.2 and 0.8 of the level (weighted Bonferroni, Holm 1979). The latter sees dry chairs.

    Parameters
    ----------
    square, irregularity : ndarray, shape (n_throws,)
        From `unexplained` [-].
    calibrated : Calibrated
        Quantiles of both.

    Returns
    -------
    ndarray, shape (n_throws,)
        NaN where there are no quantiles.
    """
    by_size = _share_above(square, calibrated.residual)
    by_kind = _share_above(irregularity, calibrated.irregularity)
    least = np.minimum(by_size / LARGE_LEVEL, by_kind / (1.0 - LARGE_LEVEL))
    return np.asarray(np.minimum(1.0, least))


LARGE_LEVEL = 0.2
"""Part of the level that how large it is gets [-]."""


def _share_above(values: Floats, quantiles: tuple[float, ...]) -> Floats:
    """Return the share of sound throws above some values, of which quantiles are known."""
    if not quantiles:
        return np.full(values.shape, np.nan)
    within = 1.0 - np.interp(values, quantiles, RESIDUAL_LEVELS)
    # beyond what was seen, as the normal tail of a sum of many squares falls
    middle, high = quantiles[RESIDUAL_LEVELS.index(0.5)], quantiles[RESIDUAL_LEVELS.index(0.999)]
    fall = np.log(0.5 / 1e-3) / (high - middle)
    beyond = (1.0 - RESIDUAL_LEVELS[-1]) * np.exp(-fall * np.maximum(values - quantiles[-1], 0.0))
    return np.asarray(np.where(values <= quantiles[-1], within, beyond))


def _gaps(knowledge: Knowledge, found: EndGaps, *, reach: Sequence[float]) -> tuple[Gap, ...]:
    each = np.broadcast_to(reach, len(found.gaps)).tolist()
    return tuple(
        Gap(
            name=name,
            middle=item.middle,
            low=item.low,
            high=item.high,
            limit=limit,
            above=float(above),
            called=item.middle + far * (item.high - item.middle) > limit,
        )
        for name, limit, item, above, far in zip(
            knowledge.setting.gaps,
            knowledge.setting.limits,
            found.gaps,
            found.above,
            each,
            strict=True,
        )
    )


def _below(gaps: tuple[Gap, ...], family: str) -> bool | None:
    """Return whether no gap of a family is called above its limit; None without any."""
    own = [not gap.called for gap in gaps if gap.name.startswith(family)]
    return all(own) if own else None


def _places(knowledge: Knowledge, found: TrappedObject, *, level: float) -> dict[str, float]:
    """Return the fewest places whose probabilities sum to a level, likeliest first."""
    order = np.argsort(found.place)[::-1]
    count = int(np.searchsorted(np.cumsum(found.place[order])[:-1], level)) + 1
    return {knowledge.places[at]: float(found.place[at]) for at in order[:count]}


def _changes(
    knowledge: Knowledge, view: View, evidence: Evidence, cause: str
) -> tuple[Change, ...]:
    """Return the largest change of each drive force that the likeliest cause makes in closing."""
    hypotheses = evidence.hypotheses
    if cause == "object":
        own = slice(0, hypotheses.before(view.objects))
    else:
        own = hypotheses.of_kind(view.kinds.index(cause))
    logs = evidence.component[own, 0]
    near = np.flatnonzero(logs > logs.max() - NEGLIGIBLE)
    logs, near = logs[near], near + own.start
    share = np.exp(logs - log_sum(logs)) * evidence.factors(near, 0)
    signature = hypotheses.number[near]
    change = hypotheses.basis @ (share @ view.signatures.change[signature]).astype(np.float32)
    layout = knowledge.layout
    closing = layout.parts[-1]
    in_closing = layout.part[view.features] == len(layout.parts) - 1
    drives, times = layout.drive[view.features], layout.time[view.features]
    found = []
    for row, drive in enumerate(layout.drives):
        mine = np.flatnonzero(in_closing & (drives == row))
        at = mine[np.argmax(np.abs(change[mine]))]
        if abs(change[at]) >= SEEN_SHARE * knowledge.setting.amplitude[row]:
            time = float(times[at]) - closing.start
            found.append(
                Change(drive=drive, force=float(change[at]), time=time, unit=knowledge.setting.unit)
            )
    return tuple(sorted(found, key=lambda item: -abs(item.force)))


def _excluded(odds: Mapping[str, float], best: str) -> tuple[str, ...]:
    limit = max(odds[best], 0.0) - float(np.log(100.0))
    return tuple(name for name in odds if odds[name] < limit and name != best)


def _verdict_lines(verdict: Verdict) -> list[str]:
    """Return a verdict in words, a few lines."""
    head = f"{verdict.name}: {verdict.status}"
    likelier = _likelier(verdict)
    causes = [f"  likelier than a sound switch: {likelier}"] if likelier else []
    if verdict.status in (CANNOT, OBJECTS):
        return [f"{head}: {verdict.reason}", *causes, f"  next: {verdict.advice}"]
    if verdict.status == ALARM and verdict.size is not None:
        size = size_in_words(verdict.size.middle, verdict.size.low, verdict.size.high)
        head += f", {size} at {' or '.join(verdict.places)}"
        head += f", kind {kinds_in_words(verdict.kinds)}" if verdict.kinds else ""
    elif verdict.status == CAUSE:
        head += f": {verdict.cause}"
    if called := [gap.name for gap in verdict.gaps if gap.called]:
        head += f", gap above its limit at {', '.join(called)}"
    head += (
        f" (log odds {verdict.log_ratio:+.1f}, alarm from {verdict.threshold:.1f} = "
        f"{verdict.false_alarm_rate:g} false alarms per simulated throw, "
        f"{verdict.history} throws known"
        f"{', by its closing alone' if verdict.part == CLOSING else ''})"
    )
    found = [head]
    for gap in verdict.gaps:
        flag = "above" if gap.called else "below"
        gap_size = size_in_words(gap.middle, gap.low, gap.high)
        found.append(
            f"  gap at {gap.name}: {gap_size}, {flag} its limit "
            f"of {1e3 * gap.limit:.0f} mm (probability above {gap.above:.2f})"
        )
    if inferred := _inferred(verdict):
        found.append(f"  inferred: {inferred}")
    for item in verdict.changes:
        change = f"{item.force:+.{2 if item.unit == 'A' else 0}f} {item.unit}"
        found.append(f"  drive {item.drive}: {change}, {item.time:.2f} s after closing began")
    if verdict.status != SOUND:
        found += causes
    if verdict.excluded and verdict.status != SOUND:
        found.append(f"  not: {', '.join(verdict.excluded)}")
    found.append(f"  next: {verdict.advice}")
    return found


def _inferred(verdict: Verdict) -> str:
    """Return what lock and control would report; nothing of one without a gap."""
    both = (("locked", verdict.locked), ("in control", verdict.in_control))
    return ", ".join(
        f"{name} {'yes' if is_so else 'no'}" for name, is_so in both if is_so is not None
    )


def _likelier(verdict: Verdict) -> str:
    """Return the causes with the highest odds above 1, with the logarithms of these."""
    above = sorted((-odds, name) for name, odds in verdict.odds.items() if odds > 1.0)
    return ", ".join(f"{name} (log odds {np.log(-odds):.1f})" for odds, name in above[:MOST_SAID])


def size_in_words(middle: float, low: float, high: float) -> str:
    """Return a length and its interval in millimetres."""
    return f"{1e3 * middle:z.1f} mm ({1e3 * low:z.1f} to {1e3 * high:z.1f})"
