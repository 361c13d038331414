"""Least gauges at rest and under a wheel, and the line speed that they allow."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from turnout.metric.finding import HEADLINE, Finding, Severity
from turnout.panel.gauge_limits import allowed_speed

if TYPE_CHECKING:
    import xarray as xr

Floats = NDArray[np.float64]


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
    limit = float(attributes["gauge_limit"])
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
    speed, by = allowed_speed(attributes, least)
    return [*made, Finding("fact", "Allowed speed", speed or "none", by)]
