"""Key of the parts of a panel that shape the rails and rows of its mechanism.

Friction, contact and drive parameters and the motion are no part of it. Whatever is not known to
be without influence counts, so that a new field of a panel can cost time but never a result.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import cache
from operator import itemgetter

from turnout.core.quantity import Record
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.panel.records import Chair, Drive, Rail

_NO_SHAPE = frozenset(
    ("schema_version", "name", "description", "instrumented_rail", "schedule", "movement")
    + ("object_defaults", "object", "lock", "flangeway", "gauge", "chair", "drive")
    + ("machine", "rail")
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
"""Fields of a switch rail that scale its sections: rows and meshes do not depend on them."""


def shape_of(
    panel: LoadedPanel, objects: Sequence[PlacedObject]
) -> tuple[tuple[Hashable, Hashable], tuple[object, ...]]:
    """Return a key of all that shapes rails and rows, and the records that it names.

    Its second part are the scales of sections, of which rows and meshes do not depend.

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
    >>> shape_of(dry, ()) [0] == shape_of(panel, ())[0]
    True
    >>> damped = panel.with_overrides({"chair.damping": 7.0})
    >>> shape_of(damped, ()) [0] == shape_of(panel, ())[0]
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
    for family, record in ((panel.chair, Chair), (panel.drive, Drive), (panel.rail, Rail)):
        values = _geometry(record)
        for name, member in family.items():
            found = values(vars(member))
            key.append((name, *(map(_plain, found) if list in map(type, found) else found)))
    key += [(item.name, item.rail, item.x, item.height) for item in objects]
    scales = tuple(getattr(rail, name) for rail in panel.rail.values() for name in _SCALES)
    return (tuple(key), scales), tuple(named)


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
    left_out = _LAW_ALONE[record] | frozenset(_SCALES)
    fields = (name for name in record.model_fields if name not in left_out)
    return itemgetter(*fields)
