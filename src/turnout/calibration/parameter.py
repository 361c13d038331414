"""Parameters of a calibration: named values of a panel with bounds, unit and transform."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import PanelError
from turnout.panel.load import LoadedPanel
from turnout.panel.model import PANEL_KEYS

Floats = NDArray[np.float64]
TRANSFORMS = ("log", "linear")
# A free key may come to between a third and three times of what the panel says.
REACH = 3.0
# One unit of the coordinate of a linear parameter with a prior, in its standard deviations [-].
PRIOR_SCALE = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One value to calibrate.

    Attributes
    ----------
    name : str
        What it is called in stages, records and messages.
    keys : tuple of str
        Keys of the panel that it sets, all to the same value; none for a parameter that acts on
        the simulated signals alone.
    start, lower, upper : float
        Start value and bounds in SI; lower < upper.
    unit : str
        SI unit; "1" for a plain number.
    vary : bool
        Whether stages that name it may change it.
    transform : str
        "log" (steps are shares of the value, which must be positive) or "linear".
    scatter : float
        Standard deviation from movement to movement, as a share of the value, that is expected
        before the measurement is seen; 0 for a value that all movements share.
    prior : float
        Standard deviation about `start` before the measurement, as a share of the value with the
        transform "log", else in its unit; 0 for a flat density between the bounds.

    Examples
    --------
    >>> stiffness = Parameter(
    ...     name="k1", keys=("drive.1.stiffness",), start=7e5, lower=1e5, upper=1e7, unit="N/m"
    ... )
    >>> round(stiffness.value(stiffness.coordinate(8e5)))
    800000
    """

    name: str
    keys: tuple[str, ...]
    start: float
    lower: float
    upper: float
    unit: str = "1"
    vary: bool = True
    transform: str = "log"
    scatter: float = 0.0
    prior: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what cannot be, all at once."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        problems = []
        if self.transform not in TRANSFORMS:
            problems.append(f'transform = "{self.transform}": must be "log" or "linear"')
        if not self.lower < self.upper:
            problems.append(
                f"bounds {self.lower:g} ... {self.upper:g}: the lower must be below the upper"
            )
        elif not self.lower <= self.start <= self.upper:
            problems.append(
                f"start = {self.start:g}{unit}: is outside its bounds {self.lower:g} ... "
                f"{self.upper:g}{unit}; widen them, or start inside (--set)"
            )
        if self.transform == "log" and not self.lower > 0:
            problems.append(
                f'lower = {self.lower:g}: must be positive for the transform "log"; '
                'raise it, or take "linear"'
            )
        if not self.scatter >= 0:
            problems.append(f"scatter = {self.scatter:g}: must be at least 0")
        if not self.prior >= 0:
            problems.append(f"prior = {self.prior:g}: must be at least 0")
        if problems:
            raise PanelError([f"{self.name}: {text}" for text in problems], source="parameter")

    @property
    def scale(self) -> float:
        """Size of one unit of the coordinate of a linear parameter [its unit]."""
        if self.prior > 0.0:
            return PRIOR_SCALE * self.prior
        return max(abs(self.start), 0.1 * (self.upper - self.lower))

    @property
    def prior_width(self) -> float:
        """Standard deviation of the prior in the coordinate [-]; infinite for a flat one."""
        if self.prior == 0.0:
            return math.inf
        return self.prior if self.transform == "log" else self.prior / self.scale

    def coordinate(self, value: float) -> float:
        """Return the coordinate in which a fit moves: a change of 0.01 is about one per cent."""
        return math.log(value) if self.transform == "log" else value / self.scale

    def value(self, coordinate: float) -> float:
        """Return the value of a coordinate, within the bounds [its unit]."""
        raw = math.exp(coordinate) if self.transform == "log" else coordinate * self.scale
        return min(max(raw, self.lower), self.upper)

    def slope(self, value: float) -> float:
        """Return the change of the value with its coordinate [its unit]."""
        return value if self.transform == "log" else self.scale

    def at_bound(self, value: float) -> bool:
        """Return whether a value lies on a bound, so that the fit would have gone on."""
        reach = 1e-6 * (self.upper - self.lower)
        return value - self.lower <= reach or self.upper - value <= reach


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """One parameter as it came out.

    Attributes
    ----------
    name, keys, unit
        As of the parameter.
    value : float
        Best fit, in SI.
    deviation : float
        Standard deviation; NaN where it was not fitted or is not identified.
    lower, upper : float
        Bounds of the fit in SI.
    interval : tuple of float
        95 % interval.
    start : float
        Where the first stage began.
    state : str
        "fitted", "fixed", "at its bound" or "not identified".
    """

    name: str
    keys: tuple[str, ...]
    unit: str
    value: float
    deviation: float
    lower: float
    upper: float
    interval: tuple[float, float]
    start: float
    state: str = "fitted"


def coordinates(parameters: Sequence[Parameter], values: Mapping[str, float]) -> Floats:
    """Return the coordinates of values, in the order of the parameters."""
    return np.array([item.coordinate(values[item.name]) for item in parameters])


def prior_slopes(parameters: Sequence[Parameter]) -> Floats:
    """Return the inverse standard deviation of each prior, 0 for flat ones, shape (p,)."""
    return np.array([1.0 / item.prior_width for item in parameters], dtype=np.float64)


def prior_information(parameters: Sequence[Parameter]) -> Floats:
    """Return the inverse variance of each coordinate: of a flat density, and of its prior."""
    widths = [item.coordinate(item.upper) - item.coordinate(item.lower) for item in parameters]
    flat = np.array([12.0 / width**2 for width in widths])
    return flat + prior_slopes(parameters) ** 2


def prior_residuals(parameters: Sequence[Parameter], point: Floats) -> Floats:
    """Return how far coordinates are from their priors' means, in deviations, shape (..., p).

    Examples
    --------
    >>> fit = Parameter(
    ...     name="g", keys=(), start=2e-3, lower=-1e-2, upper=1e-2, transform="linear", prior=1e-3
    ... )
    >>> prior_residuals([fit], coordinates([fit], {"g": 4e-3})).round(6)
    array([2.])
    """
    means = np.array([item.coordinate(item.start) for item in parameters], dtype=np.float64)
    return np.asarray((point - means) * prior_slopes(parameters))


def values_at(parameters: Sequence[Parameter], point: Floats) -> dict[str, float]:
    """Return values by name at coordinates."""
    return {item.name: item.value(float(x)) for item, x in zip(parameters, point, strict=True)}


def overrides_of(parameters: Iterable[Parameter], values: Mapping[str, float]) -> dict[str, float]:
    """Return the overrides of a panel that values stand for, in SI.

    Examples
    --------
    >>> friction = Parameter(name="mu", keys=("a", "b"), start=0.4, lower=0.1, upper=1.0)
    >>> overrides_of([friction], {"mu": 0.3})
    {'a': 0.3, 'b': 0.3}
    """
    return {key: values[item.name] for item in parameters for key in item.keys}


def value_in(panel: LoadedPanel, key: str) -> float:
    """Return the value of a panel at a key; of a family, that of its first member.

    Raises
    ------
    PanelError
        When there is no such key, or no number there.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> value_in(load_panel("sb1"), "chair.friction_coefficient")
    0.4
    """
    found = next(iter(panel.values_at(key).values()), None)
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise PanelError([f"{key}: is not a number, so it cannot be fitted"], source="parameter")
    return float(found)


def unit_in(key: str) -> str:
    """Return the SI unit of a panel's key, "1" for a plain number.

    Examples
    --------
    >>> unit_in("drive.1.stiffness"), unit_in("chair.friction_coefficient"), unit_in("gravity")
    ('N/m', '1', 'm/s^2')
    """
    found = PANEL_KEYS.find(key)
    return (found.unit if found else "") or "1"


def free_parameter(panel: LoadedPanel, key: str, *, scatter: float = 0.0) -> Parameter:
    """Return a parameter for a key of a panel, with wide bounds about what the panel says.

    Raises
    ------
    PanelError
        When there is no number at the key.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> free_parameter(load_panel("sb1"), "drive.1.stiffness").upper
    2250000.0
    """
    value = value_in(panel, key)
    if value <= 0:
        problem = f"{key} = {value:g}: is not positive; state its bounds in a plan"
        raise PanelError([problem], source="parameter")
    found = PANEL_KEYS.find(key)
    least, most = found.bounds if found else (-math.inf, math.inf)
    return Parameter(
        name=key,
        keys=(key,),
        start=value,
        lower=max(value / REACH, least),
        upper=min(value * REACH, most),
        unit=unit_in(key),
        scatter=scatter,
    )
