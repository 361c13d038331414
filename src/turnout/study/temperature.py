"""What temperature does to friction: a stated law that multiplies the friction of a study."""

from dataclasses import dataclass

import numpy as np

KEY = "chair.friction_coefficient"


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperatureLaw:
    r"""A factor on values of the panel as a function of temperature.

    Either linear,

    .. math:: f(T) = 1 + c\,(T - T_0),

    or from a table between whose points the factor is linear. Beyond the table there is no law.

    Attributes
    ----------
    key : str
        What is multiplied.
    reference : float
        :math:`T_0` [K].
    coefficient : float
        :math:`c` [1/K].
    temperatures, factors : tuple of float
        The table [K], [-]; empty for the linear law.
    """

    key: str = KEY
    reference: float = 293.15
    coefficient: float = 0.0
    temperatures: tuple[float, ...] = ()
    factors: tuple[float, ...] = ()

    def factor(self, temperature: float) -> float:
        """Return the factor at a temperature [K].

        Examples
        --------
        >>> TemperatureLaw(coefficient=-0.01).factor(303.15)
        0.9
        >>> TemperatureLaw(temperatures=(250.0, 290.0), factors=(1.5, 1.0)).factor(270.0)
        1.25
        """
        if self.temperatures:
            return float(np.interp(temperature, self.temperatures, self.factors))
        return round(1.0 + self.coefficient * (temperature - self.reference), 12)

    def faults(self, least: float, largest: float) -> list[str]:
        """Say what keeps the law from holding between two temperatures [K]."""
        problems = []
        if self.temperatures:
            ends = self.temperatures[0], self.temperatures[-1]
            if least < ends[0] or largest > ends[1]:
                problems.append(
                    f"the law is given from {celsius(ends[0])} to {celsius(ends[1])}, "
                    f"the study goes from {celsius(least)} to {celsius(largest)}"
                )
        lowest = min(self.factor(least), self.factor(largest), *self.factors)
        if not lowest > 0:
            problems.append(
                f"friction would be {lowest:.2g} times that of the panel between "
                f"{celsius(least)} and {celsius(largest)}; must stay more than 0"
            )
        return problems


def celsius(temperature: float) -> str:
    """Show a temperature in degrees Celsius.

    Examples
    --------
    >>> celsius(253.15)
    '-20 °C'
    """
    return f"{temperature - 273.15:.4g} °C"
