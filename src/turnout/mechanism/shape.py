"""What of a panel shapes rails and rows of its mechanism, as a key to keep these by.

Friction, contact and drive parameters and the motion are no part of it. Whatever is not known to
be without influence counts, so that a new field of a panel can cost time but never a result.
"""

from collections.abc import Hashable, Sequence
from functools import cache

from turnout.panel.drive_records import Drive
from turnout.panel.foreign_object import PlacedObject
from turnout.panel.load import LoadedPanel
from turnout.panel.record import Record
from turnout.panel.support_records import Chair

_NO_SHAPE = frozenset(
    ("schema_version", "name", "description", "instrumented_rail", "schedule", "movement")
    + ("object_defaults", "object", "lock", "flangeway", "chair", "drive")
)
_LAW_ALONE = {
    Chair: frozenset(("friction_coefficient", "normal_stiffness", "stick_stiffness", "clearance")),
    Drive: frozenset(
        ("stiffness", "saturation_force", "saturated_stiffness", "extension", "force")
    ),
}
"""Fields that end up in laws, whose rows do not depend on them."""


def shape_of(
    panel: LoadedPanel, objects: Sequence[PlacedObject]
) -> tuple[Hashable, tuple[object, ...]]:
    """Return a key of all that shapes rails and rows, and the records that it names.

    Records are named by identity: those that an override leaves alone stay the same. Whoever keeps
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
    for family, record in ((panel.chair, Chair), (panel.drive, Drive)):
        fields = _geometry(record)
        for name, member in family.items():
            key.append((name, *(_plain(getattr(member, field)) for field in fields)))
    key += [(item.name, item.rail, item.x, item.height) for item in objects]
    return tuple(key), tuple(named)


def _plain(value: object) -> Hashable:
    return tuple(value) if isinstance(value, list) else value


@cache
def _shaping(panel: type[Record]) -> tuple[str, ...]:
    return tuple(name for name in panel.model_fields if name not in _NO_SHAPE)


@cache
def _geometry(record: type[Record]) -> tuple[str, ...]:
    return tuple(name for name in record.model_fields if name not in _LAW_ALONE[record])
