"""What a detector meets besides the population: discrepancy, noise, history, false alarms."""

from dataclasses import dataclass

from turnout.errors import StudyError

KERNELS = ("exponential", "matern 3/2")
FORCE, CURRENT, POWER = "force", "current", "power"
UNITS = {FORCE: "N", CURRENT: "A", POWER: "W"}
"""Quantities of a drive."""


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
        Standard deviation of white noise of a sample of a force [N].
    current_noise, power_noise : float
        The same of a motor current [A], and of the power from the supply [W]; assumptions.
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
    current_noise: float = 0.02
    power_noise: float = 5.0
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
        for name, unit in (("noise", "N"), ("current_noise", "A"), ("power_noise", "W")):
            if not getattr(self, name) > 0.0:
                text = f"{name.replace('_', ' ')} = {getattr(self, name):g} {unit}"
                faults.append(f"{text}: must be more than 0")
        if self.kernel not in KERNELS:
            faults.append(f'kernel = "{self.kernel}": allowed are {", ".join(KERNELS)}')
        if faults:
            raise StudyError(faults)
