"""Least gauges at rest and under a wheel, and limits of gauge by line speed from a file."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from turnout.core.errors import PanelError
from turnout.core.library import open_toml
from turnout.core.problems import choices, nearest, show_value
from turnout.core.units import LENGTH, SPEED, parse_quantity
from turnout.metric.finding import HEADLINE, Finding, Severity

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]

DEFAULT_LIMITS = "immediate-action"
"""Limits of the library that are taken unless others are named."""
_TOP, _OF_CLASS = ("schema_version", "name", "class"), ("up_to", "narrowing")


@dataclass(frozen=True, slots=True)
class LeastGauges:
    """Three least gauges beside a closed rail for one load of a wheel, each with its place.

    Attributes
    ----------
    lateral, vertical : float
        The load [N].
    at_rest, at_wheel, under_wheel : float
        Without a wheel; at the wheel, wherever it is; anywhere while the wheel rolls [m].
    rest_place, wheel_place, place : str
        Where each of them is.
    wheel : float
        Place of the wheel at the least gauge anywhere [m].
    roll : float
        Largest roll of the rail in either direction [rad].
    slipping : tuple of str
        Drives that reach their saturation force under the wheel.
    """

    lateral: float
    vertical: float
    at_rest: float
    rest_place: str
    at_wheel: float
    wheel_place: str
    under_wheel: float
    place: str
    wheel: float
    roll: float
    slipping: tuple[str, ...]

    @property
    def load(self) -> str:
        """The load in words."""
        return f"Y = {1e-3 * self.lateral:g} kN, Q = {1e-3 * self.vertical:g} kN"

    @property
    def where(self) -> str:
        """Place of the least gauge anywhere, and of the wheel then."""
        return f"at {self.place}, wheel at {self.wheel:g} m"

    @property
    def least(self) -> float:
        """The least of the three [m]."""
        return min(self.at_rest, self.at_wheel, self.under_wheel)


def least_gauges(dataset: "xr.Dataset") -> list[LeastGauges]:
    """Return the least gauges for each load of a wheel.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `turnout.gauge_under_wheel`.
    """
    return [_least_of(dataset.isel(load=number)) for number in range(dataset.sizes["load"])]


def gauges_of_load(one: "xr.Dataset") -> tuple[Floats, Floats, NDArray[np.intp]]:
    """Return the gauge by place of the wheel and node, and at the wheel [m], with its nodes.

    Parameters
    ----------
    one : xarray.Dataset
        One load of a dataset from `turnout.gauge_under_wheel`.
    """
    gauge, wheel = one["gauge"].transpose("wheel", "x").values, one["wheel"].values
    own = np.searchsorted(one["x"].values, wheel - 1e-9)
    return gauge, gauge[np.arange(wheel.size), own], own


def _least_of(one: "xr.Dataset") -> LeastGauges:
    x, wheel, places = one["x"].values, one["wheel"].values, one["place"].values
    rest, (gauge, at_wheel, own) = one["gauge_at_rest"].values, gauges_of_load(one)
    lowest, least = int(at_wheel.argmin()), divmod(int(gauge.argmin()), x.size)
    force = abs(one["drive_force"]).max("wheel")
    over = (force >= one["saturation_force"]).values
    return LeastGauges(
        lateral=float(one["lateral_force"]),
        vertical=float(one["vertical_force"]),
        at_rest=float(rest.min()),
        rest_place=str(places[rest.argmin()]),
        at_wheel=float(at_wheel[lowest]),
        wheel_place=str(places[own[lowest]]),
        under_wheel=float(gauge[least]),
        place=str(places[least[1]]),
        wheel=float(wheel[least[0]]),
        roll=float(abs(one["rail_roll"]).max()),
        slipping=tuple(one["drive"].values[over].tolist()),
    )


def wheel_findings(dataset: "xr.Dataset") -> list[Finding]:
    """Return the findings of a wheel that rolled along a closed rail, the worst load of each.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `turnout.gauge_under_wheel`.
    """
    found, attributes = least_gauges(dataset), dataset.attrs
    nominal, limit = (float(attributes[f"gauge_{name}"]) for name in ("nominal", "limit"))
    rest = found[0]
    wheel = min(found, key=lambda item: item.at_wheel)
    worst = min(found, key=lambda item: item.under_wheel)
    answers = [
        ("At rest", rest.at_rest, f"at {rest.rest_place}"),
        ("At the wheel", wheel.at_wheel, f"at {wheel.wheel_place}, {wheel.load}"),
        ("Under the wheel", worst.under_wheel, f"{worst.where}, {worst.load}"),
    ]
    least = min(item.least for item in found)
    level: Severity = "fact" if limit != limit else "bad" if least < limit else "good"
    head = "Gauge too narrow" if level == "bad" else "Gauge"
    required = "the panel gives no limit" if limit != limit else f"limit {1e3 * limit:g} mm"
    text = f"{1e3 * least:.1f} mm at the least beside rail {attributes['rail']} ({required})"
    made = [Finding(level, HEADLINE, head, text)]
    made += [
        Finding("look" if value < limit else "fact", what, f"{1e3 * value:.1f} mm", where)
        for what, value, where in answers
    ]
    limits = load_gauge_limits(DEFAULT_LIMITS)
    speed = 3.6 * limits.highest_speed(nominal - least)
    answer = f"up to {speed:.0f} km/h" if speed else "none"
    return [*made, Finding("fact", "Allowed speed", answer, f"by the limits of {limits.name}")]


@dataclass(frozen=True, slots=True)
class GaugeClass:
    """Greatest narrowing of the gauge [m] up to a line speed [m/s]."""

    up_to: float
    narrowing: float


@dataclass(frozen=True, slots=True)
class GaugeLimits:
    """Limits of gauge by line speed: a name, and classes whose speeds rise."""

    name: str
    classes: tuple[GaugeClass, ...]

    def highest_speed(self, narrowing: float) -> float:
        """Return the speed up to which a narrowing is allowed [m/s]; 0 if no class allows it.

        Examples
        --------
        >>> limits = load_gauge_limits("immediate-action")
        >>> [round(3.6 * limits.highest_speed(narrowing)) for narrowing in (7e-3, 8.2e-3, 0.01)]
        [230, 120, 0]
        """
        allowed = [item.up_to for item in self.classes if narrowing <= item.narrowing]
        return max(allowed, default=0.0)


def load_gauge_limits(name_or_path: str | Path) -> GaugeLimits:
    """Load limits of gauge by line speed, of the library or a file.

    Parameters
    ----------
    name_or_path : str or Path
        "immediate-action", or the path of a TOML file with ``schema_version = 1``, a `name`, and a
        table ``[[class]]`` for each class with `up_to`, a speed, and `narrowing`, a length.

    Raises
    ------
    FileError
        When the file cannot be read or is not TOML.
    PanelError
        When it has no classes or other faults; with all of them at once.

    Examples
    --------
    >>> [item.narrowing for item in load_gauge_limits("immediate-action").classes]
    [0.009, 0.008, 0.007]
    """
    file = open_toml("turnout.metric", name_or_path, kind="table of limits")
    problems: list[str] = []
    found = list(_classes(file.data.get("class"), problems))
    problems += [
        f"{key}: unknown key{nearest(key, _TOP)}; there are {choices(_TOP)}"
        for key in file.data
        if key not in _TOP
    ]
    if file.data.get("schema_version") != 1:
        problems.append("schema_version: must be 1")
    speeds = [item.up_to for item in found]
    if any(after <= before for before, after in zip(speeds, speeds[1:], strict=False)):
        problems.append("class: the speeds `up_to` must rise from class to class")
    if problems:
        raise PanelError(problems, source=f"limits of gauge {file.source}")
    return GaugeLimits(str(file.data.get("name", file.source)), tuple(found))


def _classes(given: Any, problems: list[str]) -> Iterator[GaugeClass]:
    """Yield the valid classes of a file, and note what is wrong with it."""
    example = '[[class]] with up_to = "120 km/h" and narrowing = "9 mm"'
    if not isinstance(given, list) or not given:
        problems.append(f"has no classes; give at least one {example}")
        return
    for number, item in enumerate(given, 1):
        if not isinstance(item, dict) or sorted(item) != sorted(_OF_CLASS):
            problems.append(f"class {number}: must have {' and '.join(_OF_CLASS)}, as {example}")
            continue
        values = []
        for key, dimension in zip(_OF_CLASS, (SPEED, LENGTH), strict=True):
            try:
                values.append(parse_quantity(item[key], dimension))
            except ValueError as error:
                problems.append(f"class {number}: {key} = {show_value(item[key])}: {error}")
                continue
            if values[-1] <= 0.0:
                text = f"class {number}: {key} = {show_value(item[key])}: must be more than 0"
                problems.append(text)
        if len(values) == len(_OF_CLASS):
            yield GaugeClass(*values)
