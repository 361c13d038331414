r"""Probability of detection from a test campaign, as in non-destructive testing.

Follows MIL-HDBK-1823A (2009) and Berens (1989, Metals Handbook 17, 689-701): a response that grows
with the size (a-hat versus a), or hits and misses. Beyond them: an effect of each switch, and a
confidence bound that holds for few switches. Probability of detection is the share over all
switches and all their throws, so it contains what differs between switches.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, xlogy
from scipy.stats import beta, chi2

from turnout.detection.pod_bound import DRAWN, confidence_bound, separated, upper_bound
from turnout.detection.pod_fit import Fit, detected_size, maximise
from turnout.detection.pod_likelihood import (
    INTERCEPT,
    SCALE,
    SLOPE,
    SPREAD,
    Campaigns,
    marginal_probability,
)
from turnout.detection.pod_table import TestThrows
from turnout.errors import StudyError

Floats = NDArray[np.float64]

SCALES = ("log", "linear")
LINKS = ("probit", "logit")
WANTED, CONFIDENCE = 0.9, 0.95
CURVE = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98)
"""Probabilities of detection at which the curve and its bound are given [-]."""
ASYMPTOTE_GAIN = float(chi2.isf(0.1, 1))
"""Likelihood ratio from which a floor or ceiling is kept: 5 % at a bound (Self and Liang 1987)."""
FEWEST_THROWS, FEWEST_SWITCHES = 10, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class PodModel:
    """How a campaign is evaluated.

    Attributes
    ----------
    threshold : float or None
        Response from which an object counts as detected; None for hits and misses.
    least, most : float
        Responses at or below and at or above these are censored: noise, slip of a drive.
    size_scale, response_scale : str
        "log" or "linear".
    link : str
        Of hits and misses: "probit" or "logit".
    grouped : bool
        Whether switches differ; False pools all throws.
    drawn : int
        Simulated campaigns that calibrate the bound; 0 gives the plain profile likelihood.
    seed : int
        Of them.
    """

    threshold: float | None = None
    least: float = -np.inf
    most: float = np.inf
    size_scale: str = "log"
    response_scale: str = "log"
    link: str = "probit"
    grouped: bool = True
    drawn: int = DRAWN
    seed: int = 1

    def __post_init__(self) -> None:
        """Refuse what has no meaning, all of it at once."""
        faults = [
            f'{name} = "{value}": allowed are {" and ".join(allowed)}'
            for name, value, allowed in (
                ("size scale", self.size_scale, SCALES),
                ("response scale", self.response_scale, SCALES),
                ("link", self.link, LINKS),
            )
            if value not in allowed
        ]
        if self.threshold is not None and not self.least < self.threshold < self.most:
            faults.append(
                f"threshold = {self.threshold:g}: must lie between the floor "
                f"{self.least:g} and the limit {self.most:g} of the response"
            )
        if self.drawn < 0:
            faults.append(f"simulated campaigns = {self.drawn}: must be 0 or more")
        if faults:
            raise StudyError(faults, source="POD")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pod:
    """Probability of detection of a campaign.

    Attributes
    ----------
    a50, a90 : float
        Size that 50 and 90 % of throws detect [m]; NaN where none does.
    a90_95 : float
        Upper 95 % confidence bound of `a90` [m]; NaN if there is none.
    a90_95_profile : float
        The same without calibration by simulated campaigns [m].
    size, size_bound : ndarray
        Size that each probability of `probability` needs, and its upper 95 % bound [m].
    probability : ndarray
        [-]
    low, high : float
        Probability of a hit at the smallest and largest sizes [-].
    intercept, slope, switch_deviation, error_deviation : float
        Of the response, or of a latent one in units of the error, on the scales of the model.
    switches, throws, sound_throws, alarms, simulated : int
        Counts; `alarms` are those of sound throws, `simulated` all throws of a model.
    alarm_rate_high : float
        Upper 95 % bound of the false-alarm rate (Clopper and Pearson 1934) [-]; NaN without
        sound throws.
    log_likelihood : float
        Its maximum.
    parameters : ndarray, shape (4,)
        a0, a1, w and gamma of the likelihood.
    model : PodModel
        How it was evaluated.
    notes : tuple of str
        What to know before using the numbers.
    throws_read : TestThrows
        The data.
    """

    a50: float
    a90: float
    a90_95: float
    a90_95_profile: float
    probability: Floats
    size: Floats
    size_bound: Floats
    low: float
    high: float
    intercept: float
    slope: float
    switch_deviation: float
    error_deviation: float
    switches: int
    throws: int
    sound_throws: int
    alarms: int
    simulated: int
    alarm_rate_high: float
    log_likelihood: float
    parameters: Floats
    model: PodModel
    notes: tuple[str, ...]
    throws_read: TestThrows

    @property
    def model_assisted(self) -> bool:
        """Whether any throw is one of a model."""
        return self.simulated > 0


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
    campaigns, best = _with_asymptotes(campaigns, int(alarms.sum()), int(sound.sum()))
    _check(campaigns, best, throws.size[~sound])
    reachable = campaigns.low < WANTED < campaigns.high
    bound = plain = limit = np.nan
    if reachable:
        bound, plain, limit = confidence_bound(
            campaigns, best, probability=WANTED, confidence=CONFIDENCE,
            drawn=model.drawn, seed=model.seed,
        )  # fmt: skip
    row = best.parameters[0]
    shares = np.array([p for p in CURVE if campaigns.low < p < campaigns.high])
    sizes = np.array([float(detected_size(best.parameters, campaigns, p)[0]) for p in shares])
    bounds = [
        upper_bound(campaigns, best, probability=float(p), limit=limit)[0] if reachable else np.nan
        for p in shares
    ]
    scale = row[SCALE] if not campaigns.binary else 1.0
    count = int(sound.sum())
    high_rate = (
        float(beta.ppf(0.95, alarms.sum() + 1, count - alarms.sum()))
        if count > alarms.sum() else np.nan
    )  # fmt: skip
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
        alarm_rate_high=high_rate,
        log_likelihood=float(best.value[0]),
        parameters=row,
        model=model,
        notes=_notes(campaigns, throws, model, given=len(set(throws.switch))),
        throws_read=throws,
    )


def curve_of(pod: Pod, size: Floats) -> Floats:
    """Return the probability of detection at some sizes [m]."""
    none = np.zeros((0, 0))
    shape = Campaigns(
        x=none[:0].ravel(), switch=np.zeros(0, np.intp), y=none, side=none.astype(np.int8),
        link=pod.model.link if pod.model.threshold is None else "probit",
        low=pod.low, high=pod.high,
    )  # fmt: skip
    x = np.log(size) if pod.model.size_scale == "log" else np.asarray(size, dtype=np.float64)
    return marginal_probability(x, pod.parameters, shape)


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


def alarms_of(throws: TestThrows, model: PodModel) -> NDArray[np.bool_]:
    """Return which throws gave an alarm; unknown ones did not."""
    if model.threshold is not None and throws.response is not None:
        return np.asarray(np.nan_to_num(throws.response, nan=-np.inf) >= model.threshold)
    assert throws.hit is not None
    return throws.hit


def _with_asymptotes(campaigns: Campaigns, alarms: int, sound: int) -> tuple[Campaigns, Fit]:
    """Fit, with a floor and a ceiling of the probability where the likelihood asks for them."""
    best = maximise(campaigns)
    if not campaigns.binary:
        return campaigns, best

    def fitted(low: float, high: float) -> tuple[Campaigns, Fit, float]:
        trial = replace(campaigns, low=low, high=high)
        fit = maximise(trial)
        extra = xlogy(alarms, low) + xlogy(sound - alarms, 1.0 - low)
        return trial, fit, float(fit.value[0] + extra)

    def searched(*, floor: bool, ceiling: bool) -> tuple[Campaigns, Fit, float]:
        def ends(values: Floats) -> tuple[float, float]:
            low = 0.5 * float(expit(values[0])) if floor else 0.0
            return low, 1.0 - (0.5 * float(expit(values[-1])) if ceiling else 0.0)

        found = minimize(
            lambda values: -fitted(*ends(values))[2], np.full(floor + ceiling, -3.0),
            method="Nelder-Mead", options={"xatol": 0.02, "fatol": 1e-3, "maxfev": 60},
        )  # fmt: skip
        return fitted(*ends(found.x))

    chosen = (campaigns, best, float(best.value[0]) if not alarms else -np.inf)
    for floor, ceiling in ((True, False), (False, True), (True, True)):
        if alarms and not floor:
            continue
        more = (floor + ceiling) - (chosen[0].low > 0.0) - (chosen[0].high < 1.0)
        trial = searched(floor=floor, ceiling=ceiling)
        if 2.0 * (trial[2] - chosen[2]) > ASYMPTOTE_GAIN * max(more, 0) and trial[2] > chosen[2]:
            chosen = trial
    return chosen[0], chosen[1]


def _check(campaigns: Campaigns, best: Fit, sizes: Floats) -> None:
    """Refuse a campaign from which no size can be estimated."""
    smallest, largest = 1e3 * sizes.min(), 1e3 * sizes.max()
    span = f"{smallest:g} to {largest:g} mm"
    if campaigns.binary and len(set(campaigns.side[0])) == 1:
        what, remedy = ("hit", "smaller") if campaigns.side[0, 0] > 0 else ("missed", "larger")
        message = f"every object from {span} was {what}; throw {remedy} ones too"
        raise StudyError([message], source="POD")
    if best.parameters[0, SLOPE] <= 0.0 or np.ptp(campaigns.x) == 0.0:
        message = f"detection does not grow with the size from {span}; throw a wider range of sizes"
        raise StudyError([message], source="POD")
    if campaigns.binary and separated(best, campaigns):
        message = (
            "hits and misses do not overlap: every object above some size was hit, every one below "
            "missed; throw more sizes between the largest miss and the smallest hit"
        )
        raise StudyError([message], source="POD")


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


UNITS = {
    "probability": ("1", "probability of detection"),
    "required_size": ("m", "size that is detected with this probability"),
    "required_size_bound": ("m", "upper 95 % confidence bound of that size"),
    "size": ("m", "size of the object, 0 for a sound throw"),
    "response": ("1", "what the detector compares with its threshold"),
    "hit": ("1", "whether the throw gave an alarm"),
}


def pod_dataset(pod: Pod) -> xr.Dataset:
    """Return the curve and the throws as a dataset; key figures are attributes, in SI."""
    throws = pod.throws_read
    variables = {
        "required_size": (("probability",), pod.size),
        "required_size_bound": (("probability",), pod.size_bound),
        "size": (("throw",), throws.size),
        "switch": (("throw",), list(throws.switch)),
        "hit": (("throw",), alarms_of(throws, pod.model).astype(np.int8)),
    }
    if throws.response is not None:
        variables["response"] = (("throw",), throws.response)
    dataset = xr.Dataset(variables, {"probability": pod.probability})
    for name, (units, long_name) in UNITS.items():
        if name in dataset:
            dataset[name].attrs |= {"units": units, "long_name": long_name}
    if throws.response is not None and throws.unit:
        dataset["response"].attrs["units"] = throws.unit
    dataset.attrs = key_figures(pod) | {"notes": list(pod.notes)}
    return dataset


def key_figures(pod: Pod) -> dict[str, float | int | bool | str]:
    """Return the numbers of a result by name, lengths in metres."""
    names = (
        *("a50", "a90", "a90_95", "a90_95_profile", "low", "high", "intercept", "slope"),
        *("switch_deviation", "error_deviation", "switches", "throws", "sound_throws", "alarms"),
        *("alarm_rate_high", "simulated", "model_assisted", "log_likelihood"),
    )
    found = {name: getattr(pod, name) for name in names}
    plain = {name: value for name, value in asdict(pod.model).items() if value is not None}
    return found | plain
