"""Conditions of a detector besides the population: discrepancy, noise, history, false alarms."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from turnout.core.errors import StudyError

KERNELS = ("exponential", "matern 3/2")
FORCE, CURRENT, POWER = "force", "current", "power"
UNITS = {FORCE: "N", CURRENT: "A", POWER: "W"}
"""Quantities of a drive."""
SIMULATED = "all switches are simulated; no field recording was compared with these results"
"""Origin of sizes and rates: said by every page, report and JSON object that states any."""
TRAINED = (
    "thresholds, error rates and intervals are those of simulated switches; no field recording was "
    "compared with them"
)
"""The same of verdicts, since the throws that they judge may be recordings of a switch."""
CAMPAIGN = (
    "throws are those of the table; the method was verified on simulated campaigns, no field "
    "recording was compared"
)
"""The same of a table of throws that a user evaluates."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorModel:
    r"""Differences of a measured throw from a simulated one: discrepancy and noise.

    Attributes
    ----------
    discrepancy : float
        Standard deviation of the difference between model and switch, a share of the amplitude:
        the peak absolute force of the nominal sound throw, a constant of each drive [-].
    machine_discrepancy : float
        The same of what current and power are for a given force, a share of their peak after the
        inrush; assumption [-].
    kernel : str
        Correlation of the discrepancy over time: "exponential", :math:`e^{-|t|/\tau}`, or
        "matern 3/2".
    correlation_time : float
        :math:`\tau` of the exponential kernel; of the Matern kernel the time in which it falls to
        1/e too [s].
    fixed_share : float
        Share of the variance of the discrepancy that stays the same for a switch [-].
    noise : float
        Standard deviation of white noise of a sample of a force [N].
    current_noise, power_noise : float
        The same of a motor current [A], and of the power from the supply [W]; assumptions.
    rate : float
        Samples a second [Hz].
    """

    discrepancy: float = 0.05
    machine_discrepancy: float = 0.02
    kernel: str = "exponential"
    correlation_time: float = 0.5
    fixed_share: float = 0.5
    noise: float = 20.0
    current_noise: float = 0.02
    power_noise: float = 5.0
    rate: float = 125.0

    def __post_init__(self) -> None:
        """Refuse what has no meaning, all of it at once."""
        faults = condition_faults(self)
        if faults:
            listed = [f"{name} = {given}: {text}" for name, (given, text) in faults.items()]
            raise StudyError(listed, source="conditions of detection")


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions(ErrorModel):
    """Conditions of a detector besides the population: errors, history, rate of false alarms.

    Attributes
    ----------
    history : int
        Sound throws that are known of the switch.
    false_alarm_rate : float
        Alarms a sound throw [-].
    level_deviation : float
        How well a throw's friction level is known beside its own forces [-].
    """

    history: int = 0
    false_alarm_rate: float = 1e-3
    level_deviation: float = 0.03


def condition_faults(given: object) -> dict[str, tuple[str, str]]:
    """Return what is wrong with conditions: the value as text and what is allowed, by name.

    Parameters
    ----------
    given : object
        With the attributes of `ErrorModel` or `Conditions`, or some of them.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> condition_faults(SimpleNamespace(rate=0.0))
    {'rate': ('0 Hz', 'must be more than 0')}
    """
    faults: dict[str, tuple[str, str]] = {}
    for name, (holds, unit, text) in RULES.items():
        value = getattr(given, name, None)
        if value is not None and not holds(value):
            faults[name] = (f"{value:g} {unit}".rstrip(), text)
    kernel = getattr(given, "kernel", None)
    if kernel is not None and kernel not in KERNELS:
        faults["kernel"] = (f'"{kernel}"', f"allowed are {', '.join(KERNELS)}")
    return faults


def _share(value: float) -> bool:
    return 0.0 <= value < 1.0


def _positive(value: float) -> bool:
    return 0.0 < value < math.inf


RULES: dict[str, tuple[Callable[[float], bool], str, str]] = {
    "discrepancy": (_share, "", "must be from 0 to below 1"),
    "machine_discrepancy": (_share, "", "must be from 0 to below 1"),
    "correlation_time": (_positive, "s", "must be more than 0"),
    "fixed_share": (lambda value: 0.0 <= value <= 1.0, "", "must be from 0 to 1"),
    "noise": (_positive, "N", "must be more than 0"),
    "current_noise": (_positive, "A", "must be more than 0"),
    "power_noise": (_positive, "W", "must be more than 0"),
    "rate": (_positive, "Hz", "must be more than 0"),
    "history": (lambda value: value >= 0, "", "must be a number of throws, 0 or more"),
    "false_alarm_rate": (
        lambda value: 0.0 < value < 0.5,  # noqa: PLR2004
        "",
        "must be more than 0 and below 0.5; without false alarms nothing is detected",
    ),
    "level_deviation": (lambda value: 0.0 <= value < math.inf, "", "must be 0 or more"),
}
"""Condition on each value, its unit, and the message where it does not hold."""
