r"""Probability of detection from a test campaign, as in non-destructive testing.

Follows MIL-HDBK-1823A (2009) and Berens (1989, Metals Handbook 17, 689-701): a response that grows
with the size (a-hat versus a), or hits and misses. Beyond them: an effect of each switch, and a
confidence bound that holds for few switches. Probability of detection is the share over all
switches and all their throws, so it contains what differs between switches.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, xlogy
from scipy.stats import chi2

from turnout.core.errors import StudyError
from turnout.detection.alarm_threshold import share_interval
from turnout.detection.pod.pod_bound import confidence_bound, separated, upper_bound
from turnout.detection.pod.pod_fit import Fit, detected_size, is_endless, maximise
from turnout.detection.pod.pod_likelihood import (
    INTERCEPT,
    KNOWN,
    SCALE,
    SLOPE,
    SPREAD,
    Campaigns,
)
from turnout.detection.pod.pod_result import Pod, PodModel, alarms_of
from turnout.detection.pod.pod_table import TestThrows

Floats = NDArray[np.float64]

WANTED, CONFIDENCE = 0.9, 0.95
CURVE = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98)
"""Probabilities of detection at which the curve and its bound are given [-]."""
ASYMPTOTE_GAIN = float(chi2.isf(0.1, 1))
"""Likelihood ratio from which a floor or ceiling is kept: 5 % at a bound (Self and Liang 1987)."""
SCREENED = (-5.0, -3.5, -2.2, -1.2)
"""Floors and ceilings of 0.3, 1.5, 5 and 12 %, on the scale of the search, that are tried first."""
SHARPEST = 6.0
"""Spread of switches in errors of a throw beyond which hits and misses have no reliable bound [-].

Each switch then has a size of its own from which it hits, and its likelihood over the effect of the
switch is a box, which seven nodes of a quadrature around its middle do not resolve.
"""
FEWEST_THROWS, FEWEST_SWITCHES, FEWEST = 10, 3, 5


def estimate_pod(throws: TestThrows, model: PodModel | None = None) -> Pod:
    """Estimate the probability of detection over size from a campaign.

    Parameters
    ----------
    throws : TestThrows
        From `read_test_throws`.
    model : PodModel, optional
        With a threshold responses are used, without one hits and misses.

    Raises
    ------
    StudyError
        When the campaign says too little, with what to add.
    """
    model = model if model is not None else PodModel()
    campaigns = _campaigns(throws, model)
    sound = throws.size == 0.0
    alarms = alarms_of(throws, model)[sound]
    _refuse_without_range(campaigns, throws)
    _refuse_without_overlap(campaigns, throws)
    best = maximise(campaigns)
    _refuse_endless(campaigns, best, throws)
    campaigns, best = _with_asymptotes(campaigns, best, int(alarms.sum()), int(sound.sum()))
    _refuse_without_growth(campaigns, best, throws)
    _refuse_endless(campaigns, best, throws)
    reachable = campaigns.low < WANTED < campaigns.high
    bounded = reachable and not _too_sharp(campaigns, best)
    bound = plain = limit = np.nan
    if bounded:
        bound, plain, limit = confidence_bound(
            campaigns, best, probability=WANTED, confidence=CONFIDENCE,
            drawn=model.drawn, seed=model.seed,
        )  # fmt: skip
    row = best.parameters[0]
    shares = np.array([p for p in CURVE if campaigns.low < p < campaigns.high])
    sizes = np.array([float(detected_size(best.parameters, campaigns, p)[0]) for p in shares])
    bounds = [
        upper_bound(campaigns, best, probability=float(p), limit=limit)[0] if bounded else np.nan
        for p in shares
    ]
    scale = row[SCALE] if not campaigns.binary else 1.0
    count = int(sound.sum())
    return Pod(
        a50=_unscaled(_size_of(best, campaigns, 0.5), model),
        a90=_unscaled(_size_of(best, campaigns, WANTED), model),
        a90_95=_unscaled(bound, model),
        a90_95_profile=_unscaled(plain, model),
        probability=shares,
        size=np.array([_unscaled(value, model) for value in sizes]),
        size_bound=np.array([_unscaled(value, model) for value in bounds]),
        low=campaigns.low,
        high=campaigns.high,
        intercept=float(row[INTERCEPT] / scale + _threshold(model)),
        slope=float(row[SLOPE] / scale),
        switch_deviation=float(row[SPREAD] / scale),
        error_deviation=float(1.0 / scale),
        switches=int(campaigns.starts.size),
        throws=int(campaigns.x.size),
        sound_throws=count,
        alarms=int(alarms.sum()),
        simulated=int(throws.simulated.sum()),
        alarm_rate_high=_alarm_rate_high(int(alarms.sum()), count),
        log_likelihood=float(best.value[0]),
        parameters=row,
        model=model,
        notes=(
            *_notes(campaigns, throws, model, given=len(set(throws.switch))),
            *_unbounded(campaigns, best),
            *_extrapolated(_unscaled(_size_of(best, campaigns, WANTED), model), throws),
        ),
        throws_read=throws,
    )


def _refuse_unusable(throws: TestThrows, model: PodModel) -> None:
    """Refuse a table that lacks what the model needs, with everything that is wrong."""
    problems = []
    used = throws.size > 0.0
    if model.threshold is None:
        if throws.hit is None:
            problems.append("has no column hit that is filled in every row; or give a threshold")
    elif throws.response is None:
        problems.append("has no column response; leave the threshold away to use hits and misses")
    else:
        lacking = int((~np.isfinite(throws.response[used])).sum())
        if lacking:
            problems.append(f"has {lacking} throws with objects but without a response")
        inside = throws.response[used & (throws.response > model.least)]
        if model.response_scale == "log" and (np.any(inside <= 0.0) or model.threshold <= 0.0):
            problems.append(
                "has responses of 0 or less: give a floor above 0, or take a linear response scale"
            )
    if int(used.sum()) < FEWEST_THROWS:
        problems.append(
            f"has {int(used.sum())} throws with objects; {FEWEST_THROWS} are the least, 60 or more "
            "are usual"
        )
    if problems:
        raise StudyError(problems, source=throws.source)


def _campaigns(throws: TestThrows, model: PodModel) -> Campaigns:
    """Return the throws with objects as the likelihood takes them, or refuse them."""
    _refuse_unusable(throws, model)
    used = throws.size > 0.0
    names = np.array(throws.switch)[used]
    known = {name: number for number, name in enumerate(dict.fromkeys(names))}
    switch = np.array([known[name] for name in names], dtype=np.intp)
    order = np.argsort(switch, kind="stable")
    size = throws.size[used][order]
    x = np.log(size) if model.size_scale == "log" else size
    grouped = model.grouped and 1 < len(known) < len(names)
    if model.threshold is None:
        assert throws.hit is not None
        hit = throws.hit[used][order]
        return Campaigns(
            x=x, switch=switch[order], y=np.zeros((1, x.size)),
            side=np.where(hit, 1, -1).astype(np.int8)[np.newaxis],
            link=model.link, grouped=grouped,
        )  # fmt: skip
    assert throws.response is not None
    y, least, most = (
        _response(values, model)
        for values in (throws.response[used][order], model.least, model.most)
    )
    side = (y >= most).astype(np.int8) - (y <= least).astype(np.int8)
    return Campaigns(
        x=x, switch=switch[order], y=np.clip(y, least, most)[np.newaxis], side=side[np.newaxis],
        binary=False, grouped=grouped, least=float(least), most=float(most),
    )  # fmt: skip


def _response(values: Floats | float, model: PodModel) -> Floats:
    """Return responses on the scale of the model, less the threshold."""
    given = np.asarray(values, dtype=np.float64)
    if model.response_scale == "log":
        safe = np.where(given > 0.0, given, 1.0)
        given = np.where(given > 0.0, np.log(safe), -np.inf)
    return given - _threshold(model)


def _threshold(model: PodModel) -> float:
    if model.threshold is None:
        return 0.0
    return float(np.log(model.threshold)) if model.response_scale == "log" else model.threshold


def _unscaled(x: float, model: PodModel) -> float:
    return float(np.exp(x)) if model.size_scale == "log" else float(x)


def _size_of(best: Fit, campaigns: Campaigns, share: float) -> float:
    if not campaigns.low < share < campaigns.high:
        return float("nan")
    return float(detected_size(best.parameters, campaigns, share)[0])


def _with_asymptotes(
    campaigns: Campaigns, best: Fit, alarms: int, sound: int
) -> tuple[Campaigns, Fit]:
    """Fit, with a floor and a ceiling of the probability if the likelihood asks for them.

    Not beyond `SHARPEST`: the gain of a floor is then that of a quadrature which resolves nothing.
    """
    if not campaigns.binary or _too_sharp(campaigns, best):
        return campaigns, best

    def fitted(low: float, high: float) -> tuple[Campaigns, Fit, float]:
        trial = replace(campaigns, low=low, high=high)
        fit = maximise(trial, start=best.parameters)
        extra = xlogy(alarms, low) + xlogy(sound - alarms, 1.0 - low)
        return trial, fit, float(fit.value[0] + extra)

    def searched(*, floor: bool, ceiling: bool) -> tuple[Campaigns, Fit, float]:
        def ends(values: Floats) -> tuple[float, float]:
            low = 0.5 * float(expit(values[0])) if floor else 0.0
            return low, 1.0 - (0.5 * float(expit(values[-1])) if ceiling else 0.0)

        def height(values: Floats) -> float:
            return -fitted(*ends(values))[2]

        tried = [np.full(int(floor) + int(ceiling), value) for value in SCREENED]
        heights = [height(values) for values in tried]
        begin = tried[int(np.argmin(heights))]
        if -min(heights) <= chosen[2]:  # no asymptote is likelier than some
            return fitted(*ends(begin))
        found = minimize(height, begin, method="Nelder-Mead", tol=2e-3)
        return fitted(*ends(np.asarray(found.x, dtype=np.float64)))

    chosen = (campaigns, best, float(best.value[0]) if not alarms else -np.inf)
    for floor, ceiling in ((True, False), (False, True), (True, True)):
        if alarms and not floor:
            continue
        more = (floor + ceiling) - (chosen[0].low > 0.0) - (chosen[0].high < 1.0)
        trial = searched(floor=floor, ceiling=ceiling)
        if 2.0 * (trial[2] - chosen[2]) > ASYMPTOTE_GAIN * max(more, 0) and trial[2] > chosen[2]:
            chosen = trial
    return chosen[0], chosen[1]


def _refuse_without_range(campaigns: Campaigns, throws: TestThrows) -> None:
    """Refuse a campaign of one size or one outcome."""
    sizes = throws.size[throws.size > 0.0]
    span = f"{1e3 * sizes.min():g} to {1e3 * sizes.max():g} mm"
    message = ""
    if np.ptp(campaigns.x) == 0.0:
        message = f"all objects are {1e3 * sizes[0]:g} mm; throw other sizes too"
    elif campaigns.binary and len(set(campaigns.side[0])) == 1:
        what, remedy = ("hit", "smaller") if campaigns.side[0, 0] > 0 else ("missed", "larger")
        message = f"every object from {span} was {what}; throw {remedy} ones too"
    elif not campaigns.binary and len(set(campaigns.y[0][campaigns.side[0] == KNOWN])) < FEWEST:
        message = f"fewer than {FEWEST} different responses lie between floor and slip; throw more"
    if message:
        raise StudyError([message], source=throws.source)


def _refuse_without_overlap(campaigns: Campaigns, throws: TestThrows) -> None:
    """Refuse a campaign whose throws do not say how they scatter."""
    if not separated(campaigns):
        return
    message = (
        "hits and misses do not overlap: every object above some size was hit, every one below "
        "missed; throw more sizes between the largest miss and the smallest hit"
    )
    raise StudyError([message], source=throws.source)


def _refuse_without_growth(campaigns: Campaigns, best: Fit, throws: TestThrows) -> None:
    """Refuse a campaign whose size of detection is not defined."""
    sizes = throws.size[throws.size > 0.0]
    span = f"{1e3 * sizes.min():g} to {1e3 * sizes.max():g} mm"
    if best.parameters[0, SLOPE] <= 0.0:
        message = f"detection does not grow with the size from {span}; throw a wider range of sizes"
        raise StudyError([message], source=throws.source)


def _refuse_endless(campaigns: Campaigns, best: Fit, throws: TestThrows) -> None:
    """Refuse hits and misses that do not say how the throws of a switch scatter."""
    if is_endless(best.parameters, campaigns)[0]:
        message = (
            "hits and misses of single switches hardly overlap, so how throws of a switch scatter "
            "has no finite estimate; throw sizes between its largest miss and its smallest hit, "
            "several times"
        )
        raise StudyError([message], source=throws.source)


def _alarm_rate_high(alarms: int, count: int) -> float:
    """Return the upper 95 % limit of false alarms a sound throw; NaN where every one is called."""
    return float(share_interval(alarms, count, tail=0.05)[1]) if count > alarms else float("nan")


def _too_sharp(campaigns: Campaigns, best: Fit) -> bool:
    return campaigns.binary and bool(best.parameters[0, SPREAD] > SHARPEST)


def _unbounded(campaigns: Campaigns, best: Fit) -> tuple[str, ...]:
    """Return a note where switches differ by far more than their throws scatter."""
    if not _too_sharp(campaigns, best):
        return ()
    return (
        f"no a90/95: switches differ by {best.parameters[0, SPREAD]:.0f} times what throws of one "
        f"switch scatter by, and beyond {SHARPEST:g} hits and misses give no reliable bound; use "
        "responses with a threshold",
    )


def _extrapolated(a90: float, throws: TestThrows) -> tuple[str, ...]:
    """Return a note where a90 lies outside the sizes that were thrown."""
    sizes = throws.size[throws.size > 0.0]
    if a90 > sizes.max():
        return (f"a90 is extrapolated: the largest object was {1e3 * sizes.max():g} mm",)
    if a90 < sizes.min():
        return (f"a90 is extrapolated: the smallest object was {1e3 * sizes.min():g} mm",)
    return ()


def _notes(
    campaigns: Campaigns, throws: TestThrows, model: PodModel, *, given: int
) -> tuple[str, ...]:
    """Return what to know before using the numbers."""
    found = []
    simulated, count = int(throws.simulated.sum()), throws.simulated.size
    if simulated:
        found.append(
            f"model-assisted: {simulated} of {count} throws are simulated, so the result is no "
            "better than the model"
        )
    if given == 1:
        found.append("one switch: the result holds for this switch, not for others")
    elif not model.grouped:
        found.append("throws are pooled: the bound is too low where switches differ")
    elif given < FEWEST_SWITCHES:
        found.append(f"{given} switches: their spread is hardly known")
    if campaigns.low > 0.0:
        found.append(f"floor: {100 * campaigns.low:.2g} % of the smallest objects are hit")
    if campaigns.high < 1.0:
        found.append(
            f"ceiling: {100 * (1 - campaigns.high):.2g} % of the largest objects are missed; the "
            "bound takes floor and ceiling as known"
        )
    if campaigns.high <= WANTED:
        found.append(f"a90 does not exist: no size is hit in {100 * WANTED:g} % of throws")
    return tuple(found)
