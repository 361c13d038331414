"""What the page shows of panels and measured movements before a throw, as plain data."""

from typing import Any

from turnout.panel.foreign_object import resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.plot.moving_plan import plan_record
from turnout.web.controls import controls
from turnout.web.measured import Measured


def described(panel: LoadedPanel, mark: str) -> dict[str, Any]:
    """Return what the page shows of a panel before a throw.

    Parameters
    ----------
    panel : LoadedPanel
        The panel.
    mark : str
        What the page is to call it.
    """
    places = [f"sleeper {name}" for name in panel.sleeper]
    places += [f"drive {name}" for name in panel.drive]
    places += [f"sensor {name}" for name in panel.sensor]
    own = resolve_objects(panel)
    return {
        "mark": mark,
        "name": panel.name,
        "source": panel.source,
        "hash": panel.hash[:12],
        "description": " ".join(panel.description.split()),
        "plan": plan_record(panel),
        "controls": controls(panel),
        "places": [{"name": name, "x": _x_of(panel, name)} for name in places],
        "own_objects": [{"name": o.name, "size": o.size, "x": o.x} for o in own],
    }


def measured_record(mark: str, item: Measured) -> dict[str, Any]:
    """Return what the page lists of a measured movement."""
    known = item.size == item.size  # NaN is not known
    return {
        "mark": mark,
        "title": item.title,
        "direction": item.direction,
        "size": item.size if known else None,
        "place": item.place,
    }


def _x_of(panel: LoadedPanel, place: str) -> float:
    family, _, name = place.partition(" ")
    return float(getattr(panel, family)[name].x)
