"""Display of a panel before a throw: sliders with keys, units and bounds."""

from dataclasses import asdict, dataclass
from typing import Any

from turnout.figures.moving_plan import plan_record
from turnout.law.object_kind import OBJECT_KINDS
from turnout.panel.foreign_object import resolve_objects
from turnout.panel.load import LoadedPanel
from turnout.panel.markers import ordered_movements
from turnout.panel.model import Panel
from turnout.web.measured import Measured

KILO, MILLI = 1e3, 1e-3
MOST_FRICTION, MOST_SIZE, MOST_EXTRA = 0.6, 40.0, 0.6
SHORTEST_TRAVEL_TIME = 1.0
SIZE = "Extent of the object across the gap between switch rail and stock rail."
PLACE = "Distance of the object from the toe of the switch rail."
STIFFNESS = "Force for each millimetre by which the object is compressed."
FRICTION = "Friction coefficient of the rail foot on every slide chair; higher when dry or rusty."
BUSHING = "Force of the bushing between drive rod and rail for each metre that it yields."
DURATION = "Time that the drives take for this movement."
SUPPLY = "Voltage that feeds the point machine; a lower one makes the throw slower."
DELAY = "Time by which this drive takes longer than the others in the last movement."


@dataclass(frozen=True, slots=True)
class Control:
    """A slider of the page: key, label, unit, range and step.

    Attributes
    ----------
    key : str
        Key of the panel, or "object.size", "object.x", "object.stiffness".
    label : str
        Text beside it.
    unit : str
        Unit of its numbers; empty for none.
    value, least, most, step : float
        In that unit.
    meaning : str
        In a sentence, for a tooltip.
    """

    key: str
    label: str
    unit: str
    value: float
    least: float
    most: float
    step: float
    meaning: str = ""


def controls(panel: Panel) -> list[dict[str, Any]]:
    """Return the sliders of a panel, as plain data.

    Parameters
    ----------
    panel : Panel
        Gives the initial values.

    Examples
    --------
    >>> from turnout.panel.load import load_panel
    >>> [item["key"] for item in controls(load_panel("uic60-760-1-15"))][3:6]
    ['chair.friction_coefficient', 'drive.1.stiffness', 'drive.2.stiffness']
    """
    return [asdict(item) for item in (*_of_object(panel), *_of_values(panel), *_of_times(panel))]


def _of_object(panel: Panel) -> list[Control]:
    defaults = panel.object_defaults
    rail = panel.rail[defaults.rail]
    middle = panel.sleeper["6"].x if "6" in panel.sleeper else 0.5 * (rail.start + rail.end)
    stiffness = defaults.stiffness / (KILO / MILLI)
    return [
        Control("object.size", "Size", "mm", 13.0, 1.0, MOST_SIZE, 0.5, SIZE),
        Control("object.x", "Place x", "m", middle, rail.start, _last_place(panel), 0.05, PLACE),
        Control("object.stiffness", "Stiffness", "kN/mm", stiffness, 1.0, 200.0, 1.0, STIFFNESS),
    ]


def _last_place(panel: Panel) -> float:
    """Return the place of the last chair or drive: behind it the rail does not open."""
    rail = panel.object_defaults.rail
    places = [item.x for item in panel.drive.values() if item.rail == rail]
    places += [item.x for item in panel.chair.values() if item.rails is None or rail in item.rails]
    return max(places)


def _of_values(panel: Panel) -> list[Control]:
    found = []
    frictions = [chair.friction_coefficient for chair in panel.chair.values()]
    if frictions:
        most = max(MOST_FRICTION, *frictions)
        key = "chair.friction_coefficient"
        label, value = "Chair friction", max(frictions)
        found.append(Control(key, label, "", value, 0.0, most, 0.01, FRICTION))
    for name, drive in panel.drive.items():
        if drive.extension is not None:
            continue
        value = drive.stiffness / KILO
        label = f"Drive {name} stiffness"
        key, most = f"drive.{name}.stiffness", max(1500.0, 2 * value)
        found.append(Control(key, label, "kN/m", value, 20.0, most, 5.0, BUSHING))
    for machine_name in dict.fromkeys(drive.machine for drive in panel.drive.values()):
        if machine_name is None:
            continue
        machine = panel.machine[machine_name]
        value = machine.supply.voltage or machine.motor.voltage
        key, most = f"machine.{machine_name}.supply.voltage", round(1.3 * machine.motor.voltage)
        least = round(0.3 * machine.motor.voltage)
        found.append(
            Control(key, f"Supply of {machine_name}", "V", value, least, most, 1.0, SUPPLY)
        )
    return found


def _of_times(panel: Panel) -> list[Control]:
    """Return durations of movements, and drive delays of the last one."""
    found = []
    ordered = ordered_movements(panel)
    timed = any(drive.machine is None for drive in panel.drive.values())
    until = [movement.start for _, movement in ordered][1:] + [panel.schedule.end]
    for (name, movement), end in zip(ordered, until, strict=True):
        extra = max(movement.extra_time.values(), default=0.0)
        most = round(end - movement.start - max(extra, MOST_EXTRA), 2)
        least = max(SHORTEST_TRAVEL_TIME, 2 * movement.ramp)
        if not timed or movement.shape == "table" or most < max(movement.duration, least):
            continue
        key, label = f"movement.{name}.duration", f"Duration of '{name}'"
        value = movement.duration
        found.append(Control(key, label, "s", value, least, most, 0.05, DURATION))
    for name, movement in ordered[-1:]:
        room = until[-1] - movement.start - movement.duration
        if len(panel.drive) < 2 or room < MOST_EXTRA:
            continue
        for drive in panel.drive:
            key, label = f"movement.{name}.extra_time.{drive}", f"Drive {drive} delay"
            value = movement.extra_time.get(drive, 0.0)
            most = max(MOST_EXTRA, value)
            found.append(Control(key, label, "s", value, 0.0, most, 0.05, DELAY))
    return found


def panel_controls(panel: LoadedPanel, mark: str) -> dict[str, Any]:
    """Return the data by which the page shows a panel before a throw.

    Parameters
    ----------
    panel : LoadedPanel
        Panel that the page shows; need not have been thrown.
    mark : str
        Name for the page.
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
        "kinds": list(OBJECT_KINDS),
        "places": [{"name": name, "x": _x_of(panel, name)} for name in places],
        "own_objects": [{"name": o.name, "size": o.size, "x": o.x} for o in own],
    }


def measured_record(mark: str, item: Measured) -> dict[str, Any]:
    """Return the row of a measured movement in the page's list."""
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
