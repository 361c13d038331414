"""Evaluation of a test campaign: its settings and results."""

from dataclasses import asdict, dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from turnout.core.channels import SCHEMA_VERSION
from turnout.core.errors import StudyError
from turnout.detection.pod.pod_bound import DRAWN
from turnout.detection.pod.pod_likelihood import Campaigns, marginal_probability
from turnout.detection.pod.pod_table import TestThrows

Floats = NDArray[np.float64]

SCALES = ("log", "linear")
LINKS = ("probit", "logit")
FEWEST_DRAWN = 100
"""Simulated campaigns whose 5 % quantile is near enough to calibrate a bound."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PodModel:
    """Settings of the evaluation of a campaign.

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
        if self.drawn != 0 and self.drawn < FEWEST_DRAWN:
            text = f"must be 0, or {FEWEST_DRAWN} or more: a quantile of fewer is left to chance"
            faults.append(f"simulated campaigns = {self.drawn}: {text}")
        if faults:
            raise StudyError(faults, source="POD model")


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
        """True if any throw is one of a model."""
        return self.simulated > 0


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


def alarms_of(throws: TestThrows, model: PodModel) -> NDArray[np.bool_]:
    """Return which throws gave an alarm; unknown ones did not."""
    if model.threshold is not None and throws.response is not None:
        return np.asarray(np.nan_to_num(throws.response, nan=-np.inf) >= model.threshold)
    assert throws.hit is not None
    return throws.hit


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
    dataset.attrs = {"schema_version": SCHEMA_VERSION, **key_figures(pod), "notes": list(pod.notes)}
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
