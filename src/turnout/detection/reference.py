"""The reference case of detection: what stands beside the population of its study file.

The study `detection-reference` of the library holds the population of switches and throws; this
record holds what a test adds to them: the discrepancy between model and switch, the noise, the
history that is known of a switch, and the rates of false alarms.
"""

from dataclasses import dataclass, replace

from turnout.errors import StudyError
from turnout.panel.load import LoadedPanel
from turnout.study.load_study import load_study
from turnout.study.study import Study
from turnout.study.variable import values_at

STUDY = "detection-reference"

PER_THROW = ("chair.friction_coefficient", "temperature", "movement.return.start", "chair field")
"""Inputs of the study that differ from throw to throw; all others are fixed for a switch."""

FRICTION, TEMPERATURE, FIELD_MEAN = "chair.friction_coefficient", "temperature", "chair field.mean"

NOMINAL_FRICTION = 0.3
"""Friction coefficient of the nominal sound throw, whose peak forces are the amplitudes [-]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    r"""What a detector meets besides the population.

    Attributes
    ----------
    discrepancy : float
        Standard deviation of the difference between model and switch, a share of the amplitude:
        the peak absolute force of the nominal sound throw, a constant of each drive [-].
    kernel : str
        Correlation of the discrepancy over time: "exponential", :math:`e^{-|t|/\tau}`, or
        "matern 3/2".
    correlation_time : float
        :math:`\tau` of the exponential kernel; of the Matern kernel the time in which it falls to
        1/e too [s].
    fixed_share : float
        Share of the variance of the discrepancy that stays the same for a switch [-].
    noise : float
        Standard deviation of white noise of a sample [N].
    rate : float
        Samples a second [Hz].
    history : int
        Sound throws that are known of the switch.
    false_alarm_rate : float
        Alarms a sound throw [-].
    level_deviation : float
        How well a throw's friction level is known beside its own forces [-].
    """

    discrepancy: float = 0.05
    kernel: str = "exponential"
    correlation_time: float = 0.5
    fixed_share: float = 0.5
    noise: float = 20.0
    rate: float = 125.0
    history: int = 0
    false_alarm_rate: float = 1e-3
    level_deviation: float = 0.03

    def __post_init__(self) -> None:
        """Refuse what has no meaning, all of it at once."""
        faults = []
        if not 0.0 <= self.discrepancy < 1.0:
            faults.append(f"discrepancy = {self.discrepancy:g}: must be from 0 to below 1")
        if not 0.0 < self.false_alarm_rate < 0.5:
            text = "must be more than 0 and below 0.5; without false alarms nothing is detected"
            faults.append(f"false alarm rate = {self.false_alarm_rate:g}: {text}")
        if self.history < 0:
            faults.append(f"history = {self.history}: must be a number of throws, 0 or more")
        if not self.noise > 0.0:
            faults.append(f"noise = {self.noise:g} N: must be more than 0")
        if self.kernel not in KERNELS:
            faults.append(f'kernel = "{self.kernel}": allowed are {", ".join(KERNELS)}')
        if faults:
            raise StudyError(faults)


KERNELS = ("exponential", "matern 3/2")

DISCREPANCIES = (0.03, 0.05, 0.10)
"""The reference, and what is shown beside it [-]."""
HISTORIES = (0, 5, 20)
FALSE_ALARM_RATES = (1e-3, 1e-4)
THROWS_A_DAY = 20


def reference_study(panel: LoadedPanel | None = None, *, count: int | None = None) -> Study:
    """Load the population of the reference case.

    Parameters
    ----------
    panel : LoadedPanel, optional
        In place of the default panel; values of the study that are no factors, such as the closing
        over-travel, are those of the study.
    count : int, optional
        States; fewer give the first of them.

    Examples
    --------
    >>> reference_study(count=3).count
    3
    """
    study = load_study(STUDY)
    if panel is not None:
        study = replace(study, panel=_fitting(panel, study))
    return study if count is None else replace(study, design=replace(study.design, draws=count))


def _fitting(panel: LoadedPanel, study: Study) -> LoadedPanel:
    """Return a panel that has all that the population varies, or refuse it."""
    keys = [*(item.key for item in study.variables.values()), *(item.key for item in study.fields)]
    lacking = []
    for key in dict.fromkeys(keys):
        try:
            found = key == TEMPERATURE or bool(values_at(panel, key))
        except (AttributeError, KeyError, TypeError):
            found = False
        if not found:
            lacking.append(f"panel {panel.name} has no {key}, which the reference case varies")
    if lacking:
        lacking.append(f"take a panel such as {study.panel.name}, or a calibration of it")
        raise StudyError(lacking, source=STUDY)
    return panel


def switch_inputs(study: Study) -> tuple[str, ...]:
    """Return the inputs that are fixed for a switch.

    Examples
    --------
    >>> "drive.2.over_travel_closed" in switch_inputs(reference_study())
    True
    """
    return tuple(name for name in study.variables if name not in PER_THROW)
