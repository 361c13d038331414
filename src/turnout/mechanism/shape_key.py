"""Key of the parts of a panel that shape the rails and rows of its mechanism.

Friction, contact and drive parameters and the motion are no part of it. Whatever is not known to
be without influence counts, so that a new field of a panel can cost time but never a result.
"""

import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from operator import attrgetter

from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.panel.model import Panel
from turnout.panel.records import Fastening

_NO_SHAPE = (
    *("schema_version", "name", "instrumented_rail", "schedule", "movement", "object_defaults"),
    *("object", "lock", "flangeway", "gauge", "machine"),
)
_LAW_ALONE: dict[str, tuple[str, ...]] = {
    "chair": (
        *("friction_coefficient", "normal_stiffness", "stick_stiffness", "clearance"),
        *("friction_opening", "friction_factor", "friction_state"),
        *("static_ratio", "stribeck_speed", "friction_rise"),
        *("roller_lift", "roller_stiffness", "roller_friction"),
    ),
    "drive": (
        *("stiffness", "saturation_force", "saturated_stiffness", "extension", "force", "machine"),
        *("over_travel_open", "over_travel_closed", "gap_limit", "lost_motion"),
    ),
    "rail": (*("stress_free", "fit_gap", "stock_rail_gap", "head_width", "gauge_widening"),),
}
"""Fields that end up in laws, markers or gaps, of which neither rows nor matrices depend."""
_SCALES = ("section_scale", "lateral_inertia_scale")
_HOLDS = tuple(name for name in Fastening.model_fields if name.startswith(("stiffness", "damping")))
_DIRECTIONS = sum(name.startswith("stiffness") for name in _HOLDS)
_VARIED = {"rail": _SCALES, "stock_rail": _SCALES, "fastening": _HOLDS, "stock_fastening": _HOLDS}
"""Fields that change the matrices of rails, of which rows and meshes do not depend."""
SHAPELESS = frozenset(
    [(name, "") for name in _NO_SHAPE]
    + [(family, field) for family, fields in _LAW_ALONE.items() for field in fields]
    + [(family, field) for family, fields in _VARIED.items() for field in fields]
)
"""Families and fields of a panel that shape neither rows nor meshes."""
_MOTION = ("schedule", "movement")


def change_of(place: Sequence[str]) -> str:
    """Return what another value at a place of a panel's document changes in a mechanism.

    Parameters
    ----------
    place : sequence of str
        Such as ("chair", "5", "friction_coefficient").

    Examples
    --------
    >>> change_of(("drive", "1", "stiffness")), change_of(("chair", "1", "x"))
    ('laws', 'rails and their shapes')
    >>> change_of(("rail", "straight", "section_scale")), change_of(("movement", "return", "start"))
    ('rails in nominal shapes', 'motion')
    """
    family, fields = place[0], {*place[1:]}
    if family in _MOTION:
        return "motion"
    if fields & {*_VARIED.get(family, ())}:
        return "rails in nominal shapes"
    alone = family in _NO_SHAPE or fields & {*_LAW_ALONE.get(family, ())}
    return "laws" if alone else "rails and their shapes"


_scales_of, _holds_of = attrgetter(*_SCALES), attrgetter(*_HOLDS)


@dataclass(frozen=True, slots=True)
class Variation:
    """Values by which rails of the same rows and meshes differ.

    Attributes
    ----------
    scales : tuple of (float, float)
        `section_scale` and `lateral_inertia_scale` of each switch rail, then of each stock rail.
    holds : tuple of tuple of tuple of float
        Stiffness and damping of each fastening, of switch rails and of stock rails.
    holding : tuple of tuple of float
        Factors of this stiffness by direction (x, y, z, roll, pitch, yaw), of switch rails and of
        stock rails; none for a panel's own.
    """

    scales: tuple[tuple[float, float], ...]
    holds: tuple[tuple[tuple[float, ...], ...], ...]
    holding: tuple[tuple[float, ...], ...] = ()

    def like(self, other: "Variation") -> bool:
        """Return True if another one is of as many rails and fastenings."""
        counts = [[len(item.scales), *map(len, item.holds)] for item in (self, other)]
        return counts[0] == counts[1]

    def stiffness_ratios(self, other: "Variation") -> list[list[float]]:
        """Return the mean ratios of the stiffness of fastenings to another's, as `holding`."""
        groups = zip(self.holds, other.holds, strict=True)
        return [[_mean_ratio(own, of, place) for place in range(_DIRECTIONS)] for own, of in groups]


def _mean_ratio(
    holds: Sequence[tuple[float, ...]], others: Sequence[tuple[float, ...]], place: int
) -> float:
    """Return the geometric mean of the ratios of values at a place that are not zero."""
    pairs = [(own[place], of[place]) for own, of in zip(holds, others, strict=True)]
    logs = [math.log(own / of) for own, of in pairs if own > 0.0 and of > 0.0]
    return math.exp(sum(logs) / len(logs)) if logs else 1.0


def variation_of(panel: Panel) -> Variation:
    """Return the values of a panel that change the matrices of its rails alone."""
    rails = [*panel.rail.values(), *panel.stock_rail.values()]
    fastenings = (panel.fastening, panel.stock_fastening)
    holds = tuple(tuple(map(_holds_of, family.values())) for family in fastenings)
    return Variation(tuple(map(_scales_of, rails)), holds)


def shape_of(panel: LoadedPanel, objects: Sequence[PlacedObject]) -> Hashable:
    """Return a key of all that shapes rows and meshes, by its values.

    What changes the matrices of rails alone is the `Variation` of a panel.

    Parameters
    ----------
    panel : LoadedPanel
        The panel.
    objects : sequence of PlacedObject
        Foreign objects, of which names and places count, and whether their faces slope.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("sb1")
    >>> dry = panel.with_overrides({"chair.friction_coefficient": 0.5})
    >>> shape_of(dry, ()) == shape_of(panel, ())
    True
    >>> damped = panel.with_overrides({"chair.damping": 7.0})
    >>> shape_of(damped, ()) == shape_of(panel, ())
    False
    """
    rails = tuple([(rail.fit_gap is None, rail.has_stock_rail) for rail in panel.rail.values()])
    places = tuple(
        [(item.name, item.rail, item.x, item.height, item.face_slope != 0.0) for item in objects]
    )
    rollers = tuple([chair.roller_lift is not None for chair in panel.chair.values()])
    return panel.digest_without(SHAPELESS), rails, rollers, places
