"""Key of the parts of a panel that shape the rails and rows of its mechanism.

Friction, contact and drive parameters and the motion are no part of it. Whatever is not known to
be without influence counts, so that a new field of a panel can cost time but never a result.
"""

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from operator import attrgetter, itemgetter

from turnout.core.quantity import Record
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.panel.model import Panel
from turnout.panel.records import Chair, Drive, Fastening, Rail, StockRail

_NO_SHAPE = frozenset(
    ("schema_version", "name", "description", "instrumented_rail", "schedule", "movement")
    + ("object_defaults", "object", "lock", "flangeway", "gauge", "chair", "drive")
    + ("machine", "rail", "stock_rail", "fastening", "stock_fastening")
)
_LAW_ALONE: dict[type[Record], frozenset[str]] = {
    Chair: frozenset(
        (
            *("friction_coefficient", "normal_stiffness", "stick_stiffness", "clearance"),
            *("friction_opening", "friction_factor"),
        )
    ),
    Drive: frozenset(
        ("stiffness", "saturation_force", "saturated_stiffness", "extension", "force", "machine")
        + ("over_travel_open", "over_travel_closed", "gap_limit")
    ),
    Rail: frozenset(
        ("stress_free", "fit_gap", "stock_rail_gap", "running_edge", "head_width")
        + ("gauge_widening",)
    ),
}
"""Fields that end up in laws, markers or gaps, of which neither rows nor matrices depend."""
LAWS_ALONE = frozenset(
    (family, field)
    for family, record in (("chair", Chair), ("drive", Drive), ("rail", Rail))
    for field in _LAW_ALONE[record] - {"fit_gap"}  # whether a rail has one matters
)
"""The same as families and fields of a panel."""
_SCALES = ("section_scale", "lateral_inertia_scale")
_HOLDS = tuple(name for name in Fastening.model_fields if name.startswith(("stiffness", "damping")))
_DIRECTIONS = sum(name.startswith("stiffness") for name in _HOLDS)
_VARIED: dict[type[Record], tuple[str, ...]] = {
    Rail: _SCALES,
    StockRail: _SCALES,
    Fastening: _HOLDS,
}
"""Fields that change the matrices of rails, of which rows and meshes do not depend."""
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


def shape_of(
    panel: LoadedPanel, objects: Sequence[PlacedObject]
) -> tuple[Hashable, tuple[object, ...]]:
    """Return a key of all that shapes rows and meshes, and the records that it names.

    What changes the matrices of rails alone is the `Variation` of a panel.

    Records are named by identity: those that an override leaves alone stay the same. Who keeps
    something by the key must keep the records too, so that no other takes their place.

    Parameters
    ----------
    panel : LoadedPanel
        The panel.
    objects : sequence of PlacedObject
        Foreign objects, of which names and places count.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> panel = load_panel("sb1")
    >>> dry = panel.with_overrides({"chair.friction_coefficient": 0.5})
    >>> shape_of(dry, ())[0] == shape_of(panel, ())[0]
    True
    >>> damped = panel.with_overrides({"chair.damping": 7.0})
    >>> shape_of(damped, ())[0] == shape_of(panel, ())[0]
    False
    """
    key: list[Hashable] = [given.digest for given in panel.matrices.values()]
    named: list[object] = []
    for field in _shaping(type(panel)):
        value = getattr(panel, field)
        records = list(value.values()) if isinstance(value, dict) else [value]
        names = tuple(value) if isinstance(value, dict) else ()
        key.append((field, names, tuple(map(id, records))))
        named += records
    key += [(name, rail.fit_gap is None) for name, rail in panel.rail.items()]
    families: tuple[tuple[Mapping[str, Record], type[Record]], ...] = (
        (panel.chair, Chair),
        (panel.drive, Drive),
        (panel.rail, Rail),
        (panel.stock_rail, StockRail),
        (panel.fastening, Fastening),
        (panel.stock_fastening, Fastening),
    )
    for family, record in families:
        values = _geometry(record)
        for name, member in family.items():
            found = values(vars(member))
            key.append((name, *(map(_plain, found) if list in map(type, found) else found)))
    key += [(item.name, item.rail, item.x, item.height) for item in objects]
    return tuple(key), tuple(named)


def _plain(value: object) -> Hashable:
    return tuple(value) if isinstance(value, list) else value


@cache
def _shaping(panel: type[Record]) -> tuple[str, ...]:
    return tuple(name for name in panel.model_fields if name not in _NO_SHAPE)


@cache
def _geometry(record: type[Record]) -> Callable[[Mapping[str, object]], tuple[object, ...]]:
    """Return a getter of the geometry among the values of a record; far quicker than asking.

    The record has more than one such field.
    """
    left_out = _LAW_ALONE.get(record, frozenset()) | frozenset(_VARIED.get(record, ()))
    fields = (name for name in record.model_fields if name not in left_out)
    return itemgetter(*fields)
