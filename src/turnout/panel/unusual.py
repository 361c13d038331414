"""Values of a panel that no railway switch has: allowed, but more likely a slip of a unit.

`USUAL` is the table, one row a key, with a least and a largest value that leave room around what
switches have. What lies outside is not refused: studies of limits go there on purpose. A wrong
prefix or unit is what it finds: N/mm taken for N/m is a factor of a thousand.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from turnout.panel.model import PANEL_KEYS, Panel

_SPRING, _DASHPOT, _TURNING = (1e3, 1e11), (0.0, 1e6), (0.0, 1e9)
_HEIGHT = (-0.3, 0.3)

USUAL: Mapping[str, tuple[float, float]] = {
    "gravity": (0.0, 30.0),
    "material.youngs_modulus": (5e10, 5e11),
    "material.density": (1e3, 3e4),
    "damping.ratio": (0.0, 0.3),
    "damping.frequencies": (0.01, 1e4),
    "discretisation.element_length": (0.01, 1.0),
    "discretisation.superelement_cutoff": (20.0, 2e4),
    "rail.start": (-50.0, 50.0),
    "rail.end": (1.0, 150.0),
    "stock_rail.start": (-50.0, 50.0),
    "stock_rail.end": (1.0, 150.0),
    "stock_rail.foot_height": _HEIGHT,
    "chair.foot_height": _HEIGHT,
    "chair.normal_stiffness": (1e4, 1e11),
    "chair.friction_coefficient": (0.0, 1.0),
    "chair.stick_stiffness": (1e4, 1e10),
    "chair.damping": _DASHPOT,
    "chair.clearance": (-0.05, 0.2),
    **{
        f"{family}.{name}": usual
        for family in ("fastening", "stock_fastening")
        for name, usual in {
            "height": _HEIGHT,
            "offset": _HEIGHT,
            **dict.fromkeys(("stiffness_x", "stiffness_y", "stiffness_z"), (0.0, 1e11)),
            **dict.fromkeys(("stiffness_roll", "stiffness_pitch", "stiffness_yaw"), _TURNING),
            **dict.fromkeys(("damping_x", "damping_y", "damping_z"), _DASHPOT),
        }.items()
    },
    **{
        f"{family}.{name}": usual
        for family in ("stop", "stud")
        for name, usual in {
            "height": _HEIGHT,
            "stiffness": (1e4, 1e11),
            "clearance": (-0.05, 0.3),
        }.items()
    },
    "drive.height": (-0.5, 0.5),
    "drive.roll_stiffness": _TURNING,
    "drive.stroke": (0.01, 0.4),
    "drive.over_travel_open": (-0.05, 0.05),
    "drive.over_travel_closed": (-0.05, 0.05),
    "drive.stiffness": (1e3, 1e9),
    "drive.saturation_force": (100.0, 1e5),
    "drive.saturated_stiffness": (0.0, 1e6),
    "drive.extension": (-0.5, 0.5),
    "drive.force": (-1e6, 1e6),
    "link.height": (-0.5, 0.5),
    "link.stiffness": _SPRING,
    "sensor.height": _HEIGHT,
    "sensor.limit": (1e-4, 0.2),
    "schedule.end": (0.1, 3600.0),
    "movement.start": (0.0, 3600.0),
    "movement.duration": (0.1, 60.0),
    "object_defaults.stiffness": (1e3, 1e10),
    "object.size": (1e-4, 0.3),
    "object.stiffness": (1e3, 1e10),
    "lock.gap_limit": (1e-4, 0.05),
    "flangeway.limit": (0.01, 0.2),
    "gauge.nominal": (0.5, 2.0),
    "gauge.height": _HEIGHT,
    "gauge.limit": (1e-3, 0.05),
}
"""Least and largest usual value by key, in SI; a family's key holds for each of its members."""


@dataclass(frozen=True, slots=True)
class Unusual:
    """A value outside the usual range, in SI.

    Attributes
    ----------
    given, usual : str
        Key with its value, of the family where all members have it; the usual range.
    """

    given: str
    usual: str

    @property
    def text(self) -> str:
        """Key, value and usual range in one line."""
        return f"{self.given}: {self.usual}"


def unusual_values(panel: Panel) -> list[Unusual]:
    """Return the values of a panel that lie outside their usual range, in the order of its keys.

    Parameters
    ----------
    panel : Panel
        The panel; lists are judged by their most distant value.

    Returns
    -------
    list of Unusual
        Empty for a panel like those of the library.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("sb1").with_overrides({"material.density": 1e6})
    >>> [item.text for item in unusual_values(panel)]
    ['material.density = 1e+06 kg/m^3: usual is 1000 to 30000 kg/m^3']
    """
    found = []
    for name, (least, most) in USUAL.items():
        key = PANEL_KEYS.find(name)
        try:
            values = PANEL_KEYS.values(panel, name)
        except LookupError:  # in a table that the panel lacks
            continue
        unit = key.unit if key else ""
        usual = f"usual is {least:g} to {most:g} {unit}".rstrip()
        found += [
            Unusual(f"{place} = {value:g} {unit}".rstrip(), usual)
            for place, value in _outside(name, values, least, most)
        ]
    return found


def _outside(
    name: str, values: Mapping[str, Any], least: float, most: float
) -> Iterator[tuple[str, float]]:
    """Yield the keys of values outside the range, once for a family that agrees."""
    far = {key: _farthest(value, least, most) for key, value in values.items()}
    outside = {key: value for key, value in far.items() if not math.isnan(value)}
    if outside and len(outside) == len(values) and len(set(outside.values())) == 1:
        yield name, next(iter(outside.values()))
    else:
        yield from outside.items()


def _farthest(given: object, least: float, most: float) -> float:
    """Return the value that lies farthest outside; NaN if none does."""
    values = given if isinstance(given, list | tuple) else (given,)
    outside = [
        float(value)
        for value in values
        if isinstance(value, int | float) and not least <= value <= most
    ]
    return max(outside, key=lambda value: max(least - value, value - most), default=math.nan)
