"""Checks of a throw: each value with its limit and the margin between them."""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from turnout.metric.channel_features import final_value
from turnout.metric.slip import last_instant_at, margins

if TYPE_CHECKING:
    import xarray as xr

Side = Literal["below", "at least"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitCheck:
    """One value and its limit.

    Attributes
    ----------
    key : str
        Short and stable, such as "sensor_gap:TKK1".
    label : str
        What it is, such as "TKK1 gap".
    meaning : str
        In a sentence, with the rule.
    value, limit : float
        In SI.
    unit : str
        SI unit, "m" or "N".
    side : str
        Whether the value must be "below" the limit or "at least" the limit.
    """

    key: str
    label: str
    meaning: str
    value: float
    limit: float
    unit: str
    side: Side = "below"

    @property
    def margin(self) -> float:
        """Distance to the limit, negative beyond it."""
        return self.limit - self.value if self.side == "below" else self.value - self.limit

    @property
    def passed(self) -> bool:
        """True if the value is on the good side of its limit."""
        return self.margin > 0 or (self.side == "at least" and self.margin == 0)


def limit_checks(dataset: "xr.Dataset") -> list[LimitCheck]:
    """Return the values that a throw is judged by, each with its limit.

    Parameters
    ----------
    dataset : xarray.Dataset
        A simulated run; what it has not kept is left out.

    Returns
    -------
    list of LimitCheck
        Gap of each sensor when the instrumented rail rests closed, raw gap at each drive at the
        end where the lock rule looks at it, largest force of each drive against its slip level,
        least flangeway.

    Examples
    --------
    >>> import xarray as xr
    >>> run = xr.Dataset({"least_flangeway": 0.0607}, attrs={"flangeway_limit": 0.058})
    >>> check = limit_checks(run)[0]
    >>> check.label, check.passed, round(check.margin, 4)
    ('Flangeway', True, 0.0027)
    """
    found = [
        *_sensors(dataset),
        *_drive_gaps(dataset),
        *_drive_forces(dataset),
        *_flangeway(dataset),
    ]
    return [item for item in found if math.isfinite(item.value) and math.isfinite(item.limit)]


def _sensors(dataset: "xr.Dataset") -> Iterator[LimitCheck]:
    if "sensor_gap" not in dataset or not dataset.sizes.get("time", 0):
        return
    # Cutting these only: cutting all that a run holds takes ten times as long.
    rest = last_instant_at(dataset[["sensor_gap"]], to="closed")
    for name in dataset["sensor"].values:
        sensor = rest.sel(sensor=name)
        yield LimitCheck(
            key=f"sensor_gap:{name}",
            label=f"{name} gap",
            meaning=f"Gap between switch rail and stock rail at sensor {name} when the rail rests "
            "closed; the sensor reports control below its limit.",
            value=float(sensor["sensor_gap"]),
            limit=float(sensor["sensor_limit"]),
            unit="m",
        )


def _drive_gaps(dataset: "xr.Dataset") -> Iterator[LimitCheck]:
    if "drive_gap" not in dataset or dataset.attrs.get("lock_rule") == "no slip":
        return
    own = json.loads(dataset.attrs.get("lock_gap_limits", "{}"))
    usual = dataset.attrs.get("lock_gap_limit", math.nan)
    gaps = final_value(dataset["drive_gap"])
    for name in dataset["drive"].values:
        yield LimitCheck(
            key=f"drive_gap:{name}",
            label=f"Drive {name} gap",
            meaning=f"Raw gap at Drive {name} at the end, of the rail that should be closed; the "
            "lock is refused at its limit.",
            value=float(gaps.sel(drive=name)),
            limit=float(own.get(str(name), usual)),
            unit="m",
        )


def _drive_forces(dataset: "xr.Dataset") -> Iterator[LimitCheck]:
    if "force_margin" not in dataset or "saturation_force" not in dataset.coords:
        return
    known = margins(dataset)
    for name in dict.fromkeys(item.drive for item in known):
        least = min((item for item in known if item.drive == name), key=lambda item: item.force)
        yield LimitCheck(
            key=f"drive_force:{name}",
            label=f"Drive {name} force",
            meaning=f"Largest force of Drive {name} in the direction in which it moves "
            f"({least.direction}); it slips at its limit.",
            value=least.largest,
            limit=least.limit,
            unit="N",
        )


def _flangeway(dataset: "xr.Dataset") -> Iterator[LimitCheck]:
    if "least_flangeway" in dataset:
        yield LimitCheck(
            key="flangeway",
            label="Flangeway",
            meaning="Least distance between the open switch rail and its stock rail, which wheel "
            "flanges pass; it must not be less than its limit.",
            value=float(dataset["least_flangeway"]),
            limit=float(dataset.attrs.get("flangeway_limit", math.nan)),
            unit="m",
            side="at least",
        )
